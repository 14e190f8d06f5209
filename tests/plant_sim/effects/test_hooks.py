"""What a law finds at each hook in the signals that it may read everywhere, and whose states it is given."""

from pathlib import Path

import numpy as np
import pytest

from plant_sim.effects import table
from plant_sim.effects.catalogue import VARIABLE
from plant_sim.effects.signals import HOOKS
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.sensors import Sensors
from plant_sim.rigs.wet_clutch import Rig, Whole

KNOWN = {  # signal: state of the rig, most that it moves within a step
    "time": ("time", 1.01e-4),  # s, the step and rounding
    "valve_pressure": ("valve_pressure", 500.0),  # Pa; measured 112
    "pressure": ("pressure", 500.0),  # Pa; measured 136
    "position": ("position", 1e-7),  # m; measured 3e-8
    "temperature": ("temperature", 1e-4),  # K; measured 3e-5
    "slip": ("slip_speed", 0.02),  # rad/s; measured 0.005
    "angle": ("angle", 2.5e-3),  # rad, a step at 20 rad/s
}
PROBE = '''"""Probe of the hooks.

What            notes what it is given
Equation        -
Assumptions     -
Valid range     -
Not modelled    -
References      -
"""

from numba import njit

from plant_sim.effects.effect import Effect, State, Strength
from plant_sim.effects.signals import *


@njit(inline="always")
def note(s, seen):
    seen[:] = {signals}


{laws}

EFFECT = Effect(
    block="fault",
    laws={{{table}}},
    parameters=(Strength("on", "1", off=0.0, typical=1.0, bounds=(0.0, 1.0), source="[D]"),),
    states=({states}),
)
'''


@pytest.fixture
def probed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rig:
    """A rig with an effect that notes the KNOWN signals at every hook, also where a state may not move."""
    monkeypatch.setattr(table, "call_dry", lambda *arguments: None)
    text = PROBE.format(
        signals=", ".join(f"s.{name}" for name in KNOWN),
        laws="\n".join(f"def at_{hook}(s, c, p, x, h):\n    note(s, x.{hook})\n\n" for hook in HOOKS),
        table=", ".join(f"{hook}: at_{hook}" for hook in HOOKS),
        states=", ".join(f'State("{hook}", "1", {len(KNOWN)})' for hook in HOOKS),
    )
    (tmp_path / "probe.py").write_text(text, encoding="utf-8")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    return Rig(wet_clutch.load_nominal(), also=("probe",))


def note_calls(rig: Rig, whole: Whole) -> dict[str, np.ndarray]:
    return dict(zip(HOOKS, whole.effects.reshape(len(HOOKS), len(KNOWN)), strict=True))


def test_every_hook_knows_the_state_of_the_clutch(probed: Rig) -> None:
    plain = Rig(wet_clutch.load_nominal())
    slipping = plain.advance(plain.fill(20.0, 343.15), 1.36, 20.0, 40.0, 0.05, 500)  # pressure still rises
    before = slipping.read()
    after = probed.advance(Whole(slipping.y, probed.table.make_rest_states()), 1.36, 20.0, 40.0, 1e-4, 1)
    _, after = Sensors(seed=1).sample(probed, after, 1e-4)
    assert all(abs(getattr(before, state)) > 10.0 * limit for state, limit in KNOWN.values()), "a 0 would be seen"
    for hook, seen in note_calls(probed, after).items():
        for (signal, (state, limit)), value in zip(KNOWN.items(), seen, strict=True):
            assert abs(value - getattr(before, state)) <= limit, f"{signal} at {hook}"


def test_states_of_another_table_are_refused(probed: Rig) -> None:
    plain = Rig(wet_clutch.load_nominal())
    state = plain.make_rest_state(20.0, 343.15)
    with pytest.raises(ValueError, match="states are not those of this table of effects"):
        probed.advance(state, 0.0, 20.0, 40.0, 1e-3, 10)
    with pytest.raises(ValueError, match="states are not those of this table of effects"):
        Sensors(seed=1).sample(probed, state, 1e-3)

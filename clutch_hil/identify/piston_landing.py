"""Piston landing: how far the pressure is above contact before the piston, which still moves, reaches the plates.

What            the controller fills the simulated clutch, from the stop of the return springs
Equation        A p = F_spring(x) + d dx/dt: while the piston moves, its damping takes a part of the pressure    docs/rig.md, 3
Not modelled    effects that the plant's values do not have
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from clutch_hil.bench.in_process import play
from clutch_hil.fitting.model import Values
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.node import load_node

_RATE = 1000  # Hz. The shipped rig's piston lands at 0.12 to 0.135 bar with 250 Hz to 2 kHz
_BEGIN, _END = 0.1, 1.7  # s, of a fill: as long as its time-out of 1.5 s, and a little
_TORQUE, _SPEED = 10.0, 10.0  # Nm, rad/s: any demand begins with the same fill


def measure_landing(plant: Values, controller: Mapping[str, float]) -> float | None:
    """Most pressure [bar] above contact, as its sensor shows it, before the piston lands; None if it does not land.

    plant: values of the rig; controller: those that its controller has; both by dotted name, in their units.
    """
    times = (0.0, _BEGIN, _BEGIN + 0.001, _END)
    profile = Profile("fill", times, (0.0, 0.0, _TORQUE, _TORQUE), (_SPEED,) * 4, (0.0,) * 4, (0.0,) * 4)
    shipped = wet_clutch.load_nominal()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "controller.toml"
        file.write_text("".join(f"{name} = {value!r}\n" for name, value in controller.items()), encoding="utf-8")
        try:
            parameters = shipped.with_values({name: value for name, value in plant.items() if name in shipped})
            rig = PlantNode(rate=_RATE, parameters=parameters, profile=profile)
            run = play(rig, load_node("controller")(rate=_RATE, parameters_file=file))
        except InputError:  # values that cannot be played: who plays them is told
            return None
    pressed = np.flatnonzero(run["truth_normal_force_n"] > 0.0)
    if not pressed.size:
        return None
    return float(run["cylinder_pressure_bar"][: pressed[0]].max()) - controller["model.contact_pressure"]

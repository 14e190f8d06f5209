"""Piston landing: how far the pressure rises above contact before the moving piston reaches the plates.

What            the controller fills the simulated clutch, starting with the piston at the stop of the return springs
Equation        A p = F_spring(x) + d dx/dt: while the piston moves, its damping takes a part of the pressure    docs/rig.md, 3
Not modelled    effects that are not among the plant's values
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
from rt_controller.loop.parameter_sets import load_controller_parameters

_RATE = 1000  # Hz. On the shipped rig the piston lands at 0.12 to 0.135 bar with 250 Hz to 2 kHz
_BEGIN, _AFTER = 0.1, 0.1  # s, begin of the fill, and what the run lasts beyond its time-out
_TIMEOUT = "phases.fill_timeout"  # s, longer with a slow valve
_TORQUE, _SPEED = 10.0, 10.0  # Nm, rad/s: any demand begins with the same fill


def measure_landing(plant: Values, controller: Mapping[str, float]) -> float | None:
    """Return the highest measured pressure [bar] above contact before the piston lands; None if it does not land.

    plant: values of the rig. controller: values of its controller. Both by dotted name, in their units.
    """
    timeout = controller[_TIMEOUT] if _TIMEOUT in controller else load_controller_parameters()[_TIMEOUT].value
    times = (0.0, _BEGIN, _BEGIN + 0.001, _BEGIN + timeout + _AFTER)
    profile = Profile("fill", times, (0.0, 0.0, _TORQUE, _TORQUE), (_SPEED,) * 4, (0.0,) * 4, (0.0,) * 4)
    shipped = wet_clutch.load_nominal()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "controller.toml"
        file.write_text("".join(f"{name} = {float(value)!r}\n" for name, value in controller.items()), encoding="utf-8")
        try:
            parameters = shipped.with_values({name: value for name, value in plant.items() if name in shipped})
            rig = PlantNode(rate=_RATE, parameters=parameters, profile=profile)
            run = play(rig, load_node("controller")(rate=_RATE, parameters_file=file))
        except InputError:  # values that cannot be simulated raise an error where they are used
            return None
    pressed = np.flatnonzero(run["truth_normal_force_n"] > 0.0)
    if not pressed.size:
        return None
    return float(run["cylinder_pressure_bar"][: pressed[0]].max()) - controller["model.contact_pressure"]

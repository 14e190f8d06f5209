"""The rig with effects, pressed at a friction pressure, its slip held by a heavy motor unless a test says otherwise."""

from collections.abc import Callable

import numpy as np

from plant_sim.rigs import wet_clutch
from protocols.files.units import BAR, ZERO_CELSIUS

HEAVY = {"motor.inertia": 10.0}  # kg m^2: the slip stays where it is put
STEP = 1e-4  # s

Signal = float | Callable[[float], float]  # a number, or a function of the time [s]


def make_rig(changed: dict[str, float], also: tuple[str, ...] = ()) -> wet_clutch.Rig:
    """The nominal rig with parameters changed, by dotted name, each in its unit."""
    return wet_clutch.Rig(wet_clutch.load_nominal().with_values(changed), also)


def find_pressing_voltage(p_star: float) -> float:
    """Valve voltage [V] at which the plates feel `p_star` [bar] in steady state: docs/rig.md, 3 and 4, solved by hand."""
    area, stack, contact, preload, clearance = 1.131e-2, 5.0e7, 2.35, 1.7, 1e-3
    deflection = (p_star - contact) * area * BAR / stack
    spring = (contact - preload) * area * BAR / clearance
    return (contact + (stack + spring) * deflection / (area * BAR)) / 2.5


def press_rig(of: wet_clutch.Rig, p_star: float, slip: float, celsius: float = 70.0) -> wet_clutch.Whole:
    """A rig that has been pressed at `p_star` [bar] for 0.3 s, then its oil at `celsius`, its effects at rest, its slip put
    to `slip` [rad/s]."""
    plain = wet_clutch.Rig(wet_clutch.load_nominal().with_values(HEAVY))
    y = plain.fill(slip, celsius + ZERO_CELSIUS)
    y = plain.advance(y, find_pressing_voltage(p_star), slip, 1e9, 0.3, 3000).y
    y["slip_speed"], y["temperature"] = slip, celsius + ZERO_CELSIUS
    y["speed_integral"] = y["angle"] = y["time"] = 0.0
    return of.advance(
        wet_clutch.Whole(y, of.table.make_rest_states()), find_pressing_voltage(p_star), slip, 1e9, 0.0, 0
    )


def simulate_states(
    of: wet_clutch.Rig, begin: wet_clutch.Whole, voltage: Signal, speed: Signal, seconds: float, step: float = STEP
) -> tuple[np.ndarray, np.ndarray]:
    """States of rig (n,) and effects (n, k) at the beginning and after every step; inputs are held over a step."""
    kept = [begin]
    for k in range(round(seconds / step)):
        inputs = (x(k * step) if callable(x) else x for x in (voltage, speed))
        kept.append(of.advance(kept[-1], *inputs, 1e9, step, 1))
    return np.concatenate([one.y for one in kept]), np.array([one.effects for one in kept])

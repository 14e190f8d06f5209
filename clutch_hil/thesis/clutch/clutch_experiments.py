"""Experiments of chapter 6 on the simulated rig, recorded by its data acquisition with noise and quantisation.

The rig runs under the controller itself, which gets pressure demands, frame by frame as on a bus. Pressures are in bar and
temperatures in degC, as on the rig and in every figure of the chapter.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import pi

import numpy as np

from clutch_hil.bench.in_process import play
from clutch_hil.identify.thesis_quantities import CONTACTS, RADIUS
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import IDLE_FIRST, Profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.units import BAR, RPM
from protocols.node import load_node

REFERENCE = 70.0  # degC, components during the identification, sec. 6.4.3

# s before a record begins; chosen: 0.2 s of idle and fill, then 15 of the motor's time constants of 85 ms ([motor])
_SETTLING = 1.5
# Hz, sampling rate of slow experiments; chosen: the controller behaves as at 1 kHz
SLOW_RATE = 250
_COLUMNS = {
    "demand": "controller_pressure_demand_bar",
    "pressure": "cylinder_pressure_bar",
    "slip": "slip_speed_rad_s",
    "temperature": "oil_temperature_degc",
    "torque": "clutch_torque_nm",
    "estimate": "controller_torque_estimate_nm",
    "true_torque": "truth_clutch_torque_nm",
    "true_position": "truth_piston_position_m",
    "true_normal_force": "truth_normal_force_n",
}


@dataclass(frozen=True)
class Run:
    """Record of an experiment, (n,) each: measured signals, signals of the controller, and true values without a sensor."""

    time: np.ndarray  # s
    demand: np.ndarray  # bar, demand of the controller's pressure loop
    pressure: np.ndarray  # bar
    slip: np.ndarray  # rad/s
    temperature: np.ndarray  # degC
    torque: np.ndarray  # Nm
    estimate: np.ndarray  # Nm, the torque that the controller estimates while it runs
    true_torque: np.ndarray  # Nm
    true_position: np.ndarray  # m, of the piston
    true_normal_force: np.ndarray  # N, on the plates

    def average_plateaus(self, count: int, share: float) -> "Run":
        """Average the last `share` of each of `count` equal pieces of the record."""
        length = self.time.size // count
        skipped = length - int(share * length)
        return Run(
            *(
                getattr(self, name)[: count * length].reshape(count, length)[:, skipped:].mean(axis=1)
                for name in self.__dataclass_fields__
            )
        )


def load_nominal(**changes: float) -> ParameterSet:
    """Return the nominal rig with parameters changed; the dot of a name is written as two underscores."""
    return wet_clutch.load_nominal().with_values({name.replace("__", "."): value for name, value in changes.items()})


def list_cooling_changes() -> dict[str, float]:
    """Return changes that hold the oil at "about 70 degC" (sec. 6.4.3) while friction heats it: more oil, and a larger flow.

    With the larger flow alone it is 0.7 K hotter at 4.2 bar. Then gamma leaves its 95 % interval in a quarter of all runs.
    """
    return {"oil__heat_transfer": 1000.0, "oil__heat_capacity": 1e5}  # W/K, J/K; chosen: the largest allowed values


def run_experiment(
    demand: np.ndarray,
    speed: np.ndarray | float,
    parameters: ParameterSet,
    temperature: float = REFERENCE,
    seed: int = 1,
    rate: int = 1000,
    tuned: Mapping[str, float] | None = None,
) -> Run:
    """Run the rig under its controller on pressure demands, from a clutch that is filled and settled at the first of them.

    demand (n,) [bar], 2 bar or more (the controller's floor), speed of the motor, scalar or (n,) [rad/s], oil temperature at
    the start [degC], rate [Hz]; `tuned` changes parameters of the controller. Raises InputError if it ends in a fault.
    """
    settling = round(_SETTLING * rate)
    speeds = np.broadcast_to(speed, demand.shape)
    before = np.array([0.0, IDLE_FIRST])  # s; the pressure is demanded from the end of IDLE_FIRST on
    times = np.concatenate([before, (settling + np.arange(demand.size + 1)) * (1.0 / rate)])
    pressures, motor = (
        np.concatenate([np.full(before.size, signal[0]), signal, signal[-1:]]) for signal in (demand, speeds)
    )
    profile = Profile("experiment", times.tolist(), [0.0] * times.size, motor.tolist(), pressures.tolist())
    plant = PlantNode(rate, parameters, profile, seed, temperature)
    controller = load_node("controller")(rate)
    controller.tune(tuned or {})
    played = play(plant, controller)
    if played["controller_fault"].any():
        raise InputError(f"the controller ended an experiment with fault {played['controller_fault'].max():g}")
    record = slice(settling, settling + demand.size)
    return Run(np.arange(demand.size) / rate, *(played[name][record].copy() for name in _COLUMNS.values()))


def stationary_law(
    pressure: np.ndarray | float, slip: np.ndarray | float, p: ParameterSet, temperature: np.ndarray | float = REFERENCE
) -> tuple[np.ndarray, np.ndarray]:
    """Stationary torques of the plant, M_C s_n and C_v r_T |omega|^gamma [Nm]: its `clutch` and `oil` implemented again.

    pressure of the cylinder [bar], slip [rad/s], oil temperature [degC].
    """
    star = effective_pressure(pressure, p)
    coulomb = np.maximum(p["clutch.coulomb_slope"].value * star + p["clutch.coulomb_intercept"].value, 0.0)
    viscous = np.maximum(p["clutch.viscous_slope"].value * star + p["clutch.viscous_intercept"].value, 0.0)
    beta = stribeck_depth(star, *(p[f"clutch.beta_{name}"].value for name in ("inf", "onset", "scale")))
    ratio = 1.0 + (beta - 1.0) * np.exp(-p["clutch.stribeck_speed"].value / np.asarray(slip))  # eq. 6.2
    mu = temperature_law(temperature, *list_temperature_parameters(p)) / temperature_law(
        REFERENCE, *list_temperature_parameters(p)
    )
    viscosity = 1.0 + p["oil.viscous_gain"].value * (mu - 1.0)  # r_T of `plant_sim.blocks.oil`
    return coulomb * ratio, viscous * viscosity * np.power(slip, p["clutch.viscous_exponent"].value)


def temperature_law(temperature: np.ndarray | float, slope: float, offset: float, origin: float) -> np.ndarray:
    """Friction coefficient mu [-] over oil temperature [degC]; origin T_0 [degC]."""
    return slope * np.log10(np.asarray(temperature) - origin) + offset  # eq. 6.3


def list_temperature_parameters(p: ParameterSet) -> tuple[float, float, float]:
    """A [-], B [-], T_0 [degC] of the plant."""
    return p["oil.slope"].value, p["oil.offset"].value, p["oil.origin"].value


def stribeck_depth(pressure: np.ndarray | float, lowest: float, onset: float, scale: float) -> np.ndarray:
    """beta [-] over pressure, all in bar."""
    return np.minimum(1.0, lowest + (1.0 - lowest) * np.exp(-(pressure - onset) / scale))  # eq. 6.6


def effective_pressure(pressure: np.ndarray | float, p: ParameterSet) -> np.ndarray:
    """Effective friction pressure p* [bar] at cylinder `pressure` [bar]: the return springs carry a share of the rise."""
    contact = p["piston.contact_pressure"].value
    return contact + stack_share(p) * (np.asarray(pressure) - contact)  # p* of `plant_sim.blocks.clutch`


def stack_share(p: ParameterSet) -> float:
    """Share of a pressure rise that the stack carries, k_stack/(k_stack + k_s); 1 in the thesis (fig 6.10)."""
    rise = (p["piston.contact_pressure"].value - p["piston.preload_pressure"].value) * BAR
    spring = p["piston.area"].value * rise / p["piston.clearance"].value
    stack = p["piston.stack_stiffness"].value
    return stack / (stack + spring)  # `plant_sim.blocks.piston`, at rest


def friction_coefficient(torque: np.ndarray | float, pressure: np.ndarray | float, p: ParameterSet) -> np.ndarray:
    """mu [-] from torque [Nm] and cylinder pressure [bar], as the thesis computes it."""
    normal = p["piston.area"].value * (np.asarray(pressure) - p["piston.contact_pressure"].value) * BAR
    return torque / (RADIUS * CONTACTS * normal)  # eqs 6.1, 6.4


PRESSURES = np.array([2.7, 2.8, 2.9, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0, 4.2])  # bar, fig 6.12
# rpm; chosen over the range of fig 6.12
SPEEDS = np.array([5, 10, 20, 30, 45, 60, 80, 100, 125, 150, 175, 200, 225, 250])


@cache
def run_stationary_curves() -> tuple[Run, ...]:
    """Run fig 6.12: at each of PRESSURES a staircase of SPEEDS, 0.8 s a step; return means over its second half."""
    runs = []
    for seed, pressure in enumerate(PRESSURES):
        speed = np.repeat(SPEEDS * RPM, 800)
        run = run_experiment(np.full(speed.size, pressure), speed, load_nominal(**list_cooling_changes()), seed=seed)
        runs.append(run.average_plateaus(SPEEDS.size, 0.5))
    return tuple(runs)


# Fig 6.8, pressure [bar]: seconds until the oil has 148 degC, at most 320; the controller's guard ends a run at 150
HEATING_TIMES = {3.2: 320.0, 3.4: 276.0, 3.6: 204.0}


@cache
def run_heating(pressure: float) -> Run:
    """Run fig 6.8: a `pressure` of HEATING_TIMES [bar] at 200 rpm from 50 degC; return means over 2 s."""
    seconds = HEATING_TIMES[pressure]
    run = run_experiment(np.full(round(seconds * SLOW_RATE), pressure), 200 * RPM, load_nominal(), 50.0, 3, SLOW_RATE)
    return run.average_plateaus(int(seconds / 2.0), 1.0)


def run_ramp(parameters: ParameterSet, seed: int, seconds: float = 100.0, low: float = 2.0, high: float = 4.4) -> Run:
    """Run fig 6.11: pressure from `low` to `high` and back [bar] in `seconds` [s], at 200 rpm."""
    half = np.linspace(low, high, round(seconds * SLOW_RATE / 2))
    return run_experiment(np.concatenate([half, half[::-1]]), 200 * RPM, parameters, seed=seed, rate=SLOW_RATE)


def make_sine(amount: float, rate: float, seconds: float) -> np.ndarray:
    """Make a sine of amplitude `amount` and frequency `rate` [Hz] for `seconds` [s], sampled at 1 kHz."""
    return amount * np.sin(2.0 * pi * rate * np.arange(round(seconds * 1000)) / 1000.0)

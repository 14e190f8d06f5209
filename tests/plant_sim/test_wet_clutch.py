"""The plant kernel against docs/rig.md: an independent integration, its printed numbers, symmetry, energy, effects."""

import ast
from collections.abc import Iterable, Sequence
from math import exp, log10, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_sim.rigs import clutch_unit, standstill, wet_clutch
from protocols.errors import InputError

BAR, KELVIN = 1e5, 273.15
ADC_STEP = 10.0 / 2048  # bar, 12 bit over +-10 V at 1 V/bar: what nobody on the rig could see

SUBSTEPS = 10  # of 0.1 ms at 1 kHz: the shipped integration step


class Deviation(NamedTuple):
    """Largest allowed difference to the independent integration at any sample."""

    pressure: float  # bar
    position: float  # m
    torque: float  # Nm
    slip: float  # rad/s
    temperature: float  # K
    angle: float  # rad


# --- docs/rig.md, equations 1 to 8, written anew in bar, degC; integrated between kinks -----------------------------------

A_CYL, P_CONTACT, P_PRELOAD, X_C = 1.131e-2, 2.35, 1.7, 1.0e-3
W_V, ZETA = 2 * np.pi * 8.0, 0.9
F_0 = A_CYL * P_PRELOAD * BAR
K_S = (A_CYL * P_CONTACT * BAR - F_0) / X_C
K_STACK, C_P = 5.0e7, 2.0e4
J, M_MAX = 0.05, 40.0
ATOL = [1e-10, 1e-8, 1e-10, 1e-14, 1e-11, 1e-9, 1e-9, 1e-11, 1e-9]


def mu(temperature: float) -> float:
    return -0.0145 * log10(temperature - 30.0) + 0.143


def stribeck(p_star: float, omega: float) -> float:
    """s_n without its sign."""
    beta = min(1.0, 0.704 + (1 - 0.704) * exp(-(p_star - 2.71) / 0.158))
    return 1.0 + (beta - 1.0) * exp(-11.52 / abs(omega)) if omega else 1.0


def friction(p_star: float, m: float, omega: float, direction: int, temperature: float) -> float:
    r_t = 1.0 + 2.354 * (mu(temperature) / mu(70.0) - 1.0)
    viscous = max(0.0, 2.67 * p_star - 6.49) * r_t * abs(omega) ** (1 / 3)
    return max(0.0, 10.8 * p_star - 25.1) * m + direction * viscous


class Reference:
    """Equations 1 to 8 with their kinks as modes, each changed only at an event: touching plates, resting piston, empty
    cylinder, limited motor, direction of slip."""

    def __init__(self, speed: float, temperature: float) -> None:
        # p_v, p_v', p_cyl, x, m, T, omega, integral of the speed error, theta
        self.y = np.array([0, 0, 0, 0, 0, temperature, speed, 0, 0], dtype=float)
        self.t = 0.0
        self.touching, self.resting, self.empty, self.limited = False, True, True, 0
        self.direction = 1 if speed >= 0 else -1
        self.u = self.omega_d = 0.0

    def asked(self, y: Sequence[float]) -> float:
        return 4.0 * (self.omega_d - y[6]) + 40.0 * y[7]

    def torques(self, y: Sequence[float]) -> tuple[float, float]:
        """Clutch and motor torque."""
        motor = self.limited * M_MAX if self.limited else self.asked(y)
        if not self.touching:
            return 0.0, motor
        p_star = P_CONTACT + K_STACK * (y[3] - X_C) / (A_CYL * BAR)
        return friction(p_star, y[4], y[6], self.direction, y[5]), motor

    def rates(self, t: float, y: Sequence[float]) -> list[float]:
        p_v, rate, p, x, m, temperature, omega, _, _ = y.tolist()
        stack = K_STACK * (x - X_C) if self.touching else 0.0
        dx = 0.0 if self.resting else (A_CYL * p * BAR - F_0 - K_S * x - stack) / C_P
        dp = 0.0 if self.empty else (2.0e-4 * (p_v - p) - A_CYL * dx) / 1.0e-6
        clutch, motor = self.torques(y)
        dm = 0.0
        if self.touching:
            s_n = self.direction * stribeck(P_CONTACT + stack / (A_CYL * BAR), omega)
            dm = self.direction * 69.0 * (1.0 - m / s_n)
        return [
            rate,
            W_V**2 * (self.u - p_v) - 2 * ZETA * W_V * rate,
            dp,
            dx,
            dm,
            (abs(clutch * omega) - 3.0 * (temperature - 70.0)) / 600.0,
            (motor - clutch) / J,
            0.0 if self.limited else self.omega_d - omega,
            omega,
        ]

    def events(self) -> list[Any]:
        """Each crosses zero in its `direction` where its mode ends."""

        def event(function: Any, direction: int) -> Any:
            def crossing(t: float, y: Sequence[float]) -> float:
                return float(function(y))

            crossing.terminal, crossing.direction = True, direction  # type: ignore[attr-defined]
            return crossing

        return [
            event(lambda y: y[3] - X_C, -1 if self.touching else 1),
            event(lambda y: A_CYL * y[2] * BAR - F_0, 1) if self.resting else event(lambda y: y[3], -1),
            event(lambda y: y[0] - y[2], 1) if self.empty else event(lambda y: y[2], -1),
            event(lambda y: self.limited * self.asked(y) - M_MAX, -1)
            if self.limited
            else event(lambda y: abs(self.asked(y)) - M_MAX, 1),
            event(lambda y: y[6], -self.direction),
        ]

    def change(self, index: int) -> None:
        if index == 0:
            self.touching = not self.touching
            if not self.touching:
                self.y[4] = 0.0
        elif index == 1:
            self.resting = not self.resting
        elif index == 2:
            self.empty = not self.empty
        elif index == 3:
            self.limited = 0 if self.limited else (1 if self.asked(self.y) > 0 else -1)
        else:
            self.direction = -self.direction

    def sample(self) -> tuple[float, ...]:
        y = self.y
        return y[2], y[3], self.torques(y)[0], y[6], y[5], y[8]

    def hold(self, voltage: float, speed_demand: float, cycles: int, period: float = 1e-3) -> list[tuple[float, ...]]:
        """Samples after each of `cycles` with the inputs held."""
        self.u, self.omega_d = min(max(2.5 * voltage, 0.0), 25.0), speed_demand
        asked = self.asked(self.y)
        self.limited = 0 if abs(asked) <= M_MAX else (1 if asked > 0 else -1)
        grid = self.t + period * np.arange(1, cycles + 1)
        samples: list[tuple[float, ...]] = []
        while len(samples) < cycles:
            left = grid[len(samples) :]
            # fmt: off
            solution = solve_ivp(self.rates, (self.t, left[-1]), self.y, "LSODA", t_eval=left, events=self.events(),
                                 rtol=1e-9, atol=ATOL)
            # fmt: on
            for self.y in np.transpose(solution.y):
                samples.append(self.sample())
            if solution.status == 1:
                [index] = [i for i, times in enumerate(solution.t_events) if times.size]
                self.t, self.y = solution.t_events[index][0], solution.y_events[index][0].copy()
                self.change(index)
        self.t = grid[-1]
        return samples


# --- the plant -------------------------------------------------------------------------------------------------------

Piece = tuple[float, float, int]  # voltage [V], speed demand [rad/s], cycles


def parameters(**changed: float) -> wet_clutch.Rig:
    names = {name.replace("__", "."): value for name, value in changed.items()}
    return wet_clutch.Rig(wet_clutch.nominal().with_values(names))


NOMINAL = parameters()


def run(
    state: np.ndarray,
    pieces: Iterable[Piece],
    rig: Any = NOMINAL,
    period: float = 1e-3,
    substeps: int = SUBSTEPS,
) -> np.ndarray:
    """States after every cycle; effects begin at rest."""
    states = [wet_clutch.Whole(state, rig.table.at_rest())]
    for voltage, speed, cycles in pieces:
        for _ in range(cycles):
            states.append(rig.advance(states[-1], voltage, speed, 1e9, period, substeps))
    return np.concatenate([state.y for state in states[1:]])


def at_rest(speed: float, celsius: float = 70.0, rig: wet_clutch.Rig = NOMINAL) -> np.ndarray:
    return rig.at_rest(speed, celsius + KELVIN).y


def pressing(p_star: float) -> float:
    """Valve voltage at which the plates feel `p_star` [bar] in steady state: docs/rig.md, eq. 3 and 4 solved by hand."""
    deflection = (p_star - P_CONTACT) * A_CYL * BAR / K_STACK
    return (p_star + K_S * deflection / (A_CYL * BAR)) / 2.5


def pressed(p_star: float, speed: float, rig: wet_clutch.Rig = NOMINAL, celsius: float = 70.0) -> np.ndarray:
    """State after a second at `p_star`, the temperature set back."""
    state = run(rig.fill(speed, celsius + KELVIN).y, [(pressing(p_star), speed, 1000)], rig)[-1:]
    state["temperature"] = celsius + KELVIN
    return state


def triangle(low: float, high: float, seconds: float, speed: float) -> list[Piece]:
    """A staircase of 20 ms up and down between two valve pressures [bar], `seconds` each way."""
    up = np.linspace(low, high, round(seconds / 0.02))
    return [(p / 2.5, speed, 20) for p in (*up, *up[::-1])]


# --- tolerances ------------------------------------------------------------------------------------------------------

# Measured maxima against the independent integration, at 0.1 ms:
#              pressure   position  torque    slip         temperature  angle
#   step       0.015 mbar 1.8 nm    0.016 Nm  0.0022 rad/s 1.1e-5 K     6.1e-5 rad   the torque just after the touch
#   release    0.82 mbar  1.8 nm    0.016 Nm  0.0022 rad/s 1.1e-5 K     6.1e-5 rad   the piston meets its rest
#   triangle   0.002 mbar 0.2 nm    0.002 Nm  0.0003 rad/s 1.9e-6 K     7.5e-6 rad
#   sine       0.015 mbar 1.8 nm    0.016 Nm  0.0023 rad/s 6.0e-6 K     6.5e-5 rad
#   saturated  0.015 mbar 1.8 nm    0.041 Nm  0.0071 rad/s 7.0e-6 K     3.7e-4 rad   slip reverses under load
#   cold oil   0.015 mbar 1.8 nm    0.016 Nm  0.0022 rad/s 1.1e-5 K     6.1e-5 rad
# Allowed: about twice that, always within what a sensor of the rig resolves (0.05 Nm of noise, an ADC step of pressure).
TOUCH = Deviation(pressure=5e-5, position=5e-9, torque=0.03, slip=0.005, temperature=3e-5, angle=1.5e-4)
RELEASE = TOUCH._replace(pressure=0.4 * ADC_STEP)
SMOOTH = Deviation(pressure=1e-5, position=1e-9, torque=0.004, slip=6e-4, temperature=5e-6, angle=2e-5)
REVERSAL = TOUCH._replace(torque=0.05, slip=0.015, angle=8e-4)

TORQUE_PRINTED = 0.006  # Nm: docs/rig.md prints 16.74
LAG_PRINTED = 5e-5  # s: docs/rig.md prints 12.1 ms
TOUCH_TIME = 0.075, 0.095  # s: "about 85 ms"; measured 86 ms
BANDWIDTH, BANDWIDTH_BAND = 9.8, 0.3  # Hz; measured 9.60 Hz, without bus, noise and rounding
ENERGY = (
    5e-4  # of the friction heat: trapezoids over 0.1 ms miss half of each jump of the motor torque; measured 2.3e-4
)
LANDING = 0.1 * ADC_STEP  # bar; measured 0.00014 bar once the volume is kept, 0.0104 bar as it is
ORDER_FLUID, ORDER_REST = 3.5, 1.8  # Runge-Kutta 4; midpoint rule; less a little for the finest step's rounding
RATE_DEVIATION = Deviation(pressure=5e-5, position=5e-9, torque=0.02, slip=0.003, temperature=2e-5, angle=3e-4)
# 4 kHz steps 1/12 ms instead of 1/10 and meets kinks elsewhere in a step: measured 0.013 mbar, 1.5 nm, 0.006 Nm,
# 0.0008 rad/s, 1.3e-4 rad; the other rates agree 1000 times better
LOOP_WIDTH = 0.1  # relative: the springs and the slow pressure ramp add to the seal's 2 W / A; measured 4 %

STEP = [(3.4 / 2.5, 20.0, 350)]
SCENARIOS: dict[str, tuple[float, float, list[Piece], Deviation]] = {
    "step": (20.0, 70.0, STEP, TOUCH),
    "release": (20.0, 70.0, [*STEP, (0.0, 20.0, 250)], RELEASE),
    "slow triangle of pressure": (20.0, 70.0, triangle(1.5, 4.2, 1.0, 20.0), SMOOTH),
    "slip sine at 5 Hz": (
        10.5,
        70.0,
        [(3.4 / 2.5, 10.5, 300), *((3.4 / 2.5, 10.5 + 6.28 * np.sin(np.pi * k / 20), 5) for k in range(120))],
        TOUCH,
    ),
    "speed step saturates the motor": (
        5.0,
        70.0,
        [(3.4 / 2.5, 5.0, 300), (3.4 / 2.5, 25.0, 150), (3.4 / 2.5, -20.0, 250)],
        REVERSAL,
    ),
    "cold oil": (20.0, 40.0, [(3.4 / 2.5, 20.0, 500)], TOUCH),
}


def outputs(states: np.ndarray) -> np.ndarray:
    """Columns in the order of `Deviation`."""
    y = states
    return np.stack(
        [
            y["pressure"] / BAR,
            y["position"],
            y["clutch_torque"],
            y["slip_speed"],
            y["temperature"] - KELVIN,
            y["angle"],
        ],
        axis=1,
    )


def assert_within(found: np.ndarray, expected: np.ndarray, allowed: Deviation) -> None:
    largest = Deviation(*np.abs(found - expected).max(axis=0))
    for name, value, limit in zip(Deviation._fields, largest, allowed, strict=True):
        assert value <= limit, f"{name} deviates by {value:.3g}, allowed {limit:.3g}"


# --- statements ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENARIOS)
def test_plant_agrees_with_an_independent_integration_of_rig_md(name: str) -> None:
    speed, celsius, pieces, allowed = SCENARIOS[name]
    reference = Reference(speed, celsius)
    expected = np.array([sample for piece in pieces for sample in reference.hold(*piece)])
    states = run(at_rest(speed, celsius), pieces)
    assert states["clutch_torque"].max() > 10.0, "the plates must be pressed or nothing is compared"
    if "saturates" in name:
        assert np.abs(states["motor_torque"]).max() == M_MAX
    assert_within(outputs(states), expected, allowed)
    assert allowed.pressure < ADC_STEP


def test_piston_meets_its_rest_without_losing_oil() -> None:
    worst = 0.0
    for last in np.linspace(2.9, 3.9, 9):  # bar: moves the landing through the phases of an integration step
        pieces = [*STEP, (last / 25.0, 20.0, 5), (0.0, 20.0, 200)]
        reference = Reference(20.0, 70.0)
        expected = np.array([sample for piece in pieces for sample in reference.hold(*piece)])
        worst = max(worst, np.abs(outputs(run(at_rest(20.0), pieces)) - expected)[:, 0].max())
    assert worst < LANDING


def test_steady_torque_at_3_4_bar_20_rad_s_70_degc_is_16_74_nm() -> None:
    state = run(pressed(3.4, 20.0), [(pressing(3.4), 20.0, 1)])[0]
    p_star = P_CONTACT + state["normal_force"] / (A_CYL * BAR)
    assert p_star == pytest.approx(3.4, abs=1e-6)
    assert state["friction_state"] == pytest.approx(0.8357, abs=5e-5)
    assert state["clutch_torque"] == pytest.approx(16.74, abs=TORQUE_PRINTED)


def test_friction_lags_a_slip_change_by_12_1_ms() -> None:
    heavy = parameters(motor__inertia=10.0)  # the slip then stays where it is put
    state = pressed(3.4, 10.0, heavy)
    state["slip_speed"], state["speed_integral"] = 20.0, 16.74 / 40.0
    m = run(state, [(pressing(3.4), 20.0, 41)], heavy)["friction_state"]
    steady = 1.0 + (0.7078 - 1.0) * exp(-11.52 / 20.0)
    slope = np.polyfit(np.arange(41) * 1e-3, np.log(m - steady), 1)[0]
    assert m[0] - steady > 0.05
    assert -1.0 / slope == pytest.approx(0.0121, abs=LAG_PRINTED + 5e-5)  # s_n is printed to 4 digits


def test_rig_at_rest_stays_at_rest() -> None:
    before = at_rest(0.0)
    after = run(before, [(0.0, 0.0, 1000)])
    for name in set(wet_clutch.State._fields) - {"time"}:
        assert (after[name] == before[name]).all(), name


def regulated(demand: Sequence[float], state: np.ndarray, cycles: int) -> np.ndarray:
    """States under the pressure regulator, sampled at 1 kHz; `demand` [bar] repeats."""
    integral, states = 0.0, [wet_clutch.Whole(state, NOMINAL.table.at_rest())]
    for k in range(cycles):
        y = states[-1].read()
        error = demand[k % len(demand)] - y.pressure / BAR
        voltage = (demand[k % len(demand)] + 0.45 * error + 6.0 * integral) / 2.5
        integral += error * 1e-3 if y.normal_force > 0.0 else 0.0
        states.append(NOMINAL.advance(states[-1], voltage, 20.0, 1e9, 1e-3, SUBSTEPS))
    return np.concatenate([state.y for state in states[1:]])


def test_a_step_to_3_4_bar_touches_the_plates_after_about_85_ms() -> None:
    states = regulated([3.4], at_rest(20.0), 200)
    touch = states["time"][np.argmax(states["normal_force"] > 0.0)]
    assert TOUCH_TIME[0] < touch < TOUCH_TIME[1]


def test_closed_pressure_loop_comes_near_the_9_8_hz_of_the_thesis() -> None:
    cycles = 2000  # one period of the multisine: lines every 0.5 Hz
    lines = np.arange(1, 61)  # 0.5..30 Hz
    phases = np.random.default_rng(1).uniform(0.0, 2 * np.pi, lines.size)
    sine = np.cos(2 * np.pi * np.outer(np.arange(cycles) / cycles, lines) + phases).sum(axis=1)
    demand = 3.4 + 0.1 * sine / np.abs(sine).max()
    pressure = regulated(demand.tolist(), pressed(3.4, 20.0), 3 * cycles)["pressure"][2 * cycles : 3 * cycles] / BAR
    gain = np.abs(np.fft.rfft(pressure)[lines] / np.fft.rfft(demand)[lines])
    first = np.argmax(gain < sqrt(0.5))
    bandwidth = 0.5 * np.interp(sqrt(0.5), gain[[first, first - 1]], lines[[first, first - 1]])
    assert bandwidth == pytest.approx(BANDWIDTH, abs=BANDWIDTH_BAND)
    assert (np.diff(gain[first:]) < 0).all(), "the gain falls monotonically above the bandwidth"


def test_torque_is_odd_in_the_direction_of_slip() -> None:
    pieces = [(1.36, 20.0, 300), (1.5, -12.0, 200), (1.2, 5.0, 200), (0.0, 5.0, 150)]
    forward = run(at_rest(20.0), pieces)
    backward = run(at_rest(-20.0), [(voltage, -speed, cycles) for voltage, speed, cycles in pieces])
    for name in ("clutch_torque", "friction_state", "slip_speed", "motor_torque", "angle", "speed_integral"):
        assert (forward[name] == -backward[name]).all(), name
    for name in ("pressure", "position", "temperature", "normal_force"):
        assert (forward[name] == backward[name]).all(), name
    assert forward["clutch_torque"].min() < -10.0 < 10.0 < forward["clutch_torque"].max()


def test_friction_always_takes_power_while_the_state_follows_the_slip() -> None:
    states = run(at_rest(20.0), [*STEP, (1.36, 12.0, 300)])
    assert (states["clutch_torque"] * states["slip_speed"] >= 0.0).all()


def test_motor_work_is_kinetic_energy_plus_friction_heat() -> None:
    start = at_rest(20.0, 90.0)  # above the sump, so that cooling counts
    pieces = [(1.36, 20.0, 3500), (1.5, 5.0, 3000), (1.3, 25.0, 3500)]
    states = np.concatenate([start, run(start, pieces, period=1e-4, substeps=1)])
    slip, celsius = states["slip_speed"], states["temperature"] - KELVIN
    work = np.trapezoid(states["motor_torque"] * slip, states["time"])
    kinetic = 0.5 * J * (slip[-1] ** 2 - slip[0] ** 2)
    heat = 600.0 * (celsius[-1] - celsius[0]) + np.trapezoid(3.0 * (celsius - 70.0), states["time"])
    assert heat > 100.0
    assert work == pytest.approx(kinetic + heat, abs=ENERGY * heat)


def test_error_falls_with_the_order_of_the_method_when_the_step_is_halved() -> None:
    start = pressed(3.0, 20.0)

    def end(substeps: int) -> np.void:
        return run(start, [(pressing(3.8), 18.0, 20)], substeps=substeps)[-1]

    exact = end(320)
    coarse, middle, fine = end(5), end(10), end(20)
    for name, order in (
        ("pressure", ORDER_FLUID),
        ("position", ORDER_FLUID),
        ("friction_state", ORDER_REST),
        ("slip_speed", ORDER_REST),
        ("angle", ORDER_REST),
    ):
        errors = [abs(state[name] - exact[name]) for state in (coarse, middle, fine)]
        assert errors[0] / errors[1] > 2.0**order, f"{name}: {errors}"
        assert errors[1] / errors[2] > 2.0**order, f"{name}: {errors}"


class _WithoutHooks(ast.NodeTransformer):
    """The rig's source as if hooks had never been written."""

    def visit_If(self, node: ast.If) -> ast.AST | None:
        self.generic_visit(node)
        return None if "has_law(" in ast.unparse(node.test) else node

    def visit_keyword(self, node: ast.keyword) -> ast.keyword | None:
        return None if node.arg == "cache" else node  # Numba keeps no cache for source without a file

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        self.generic_visit(node)
        return None if "bind_laws(" in ast.unparse(node.value) else node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Constant(None) if node.id == "e" and isinstance(node.ctx, ast.Load) else node


def rig_without_hooks() -> Any:
    """`Rig.advance` of a rig without hooks."""
    scope: dict[str, Any] = {"__name__": "rig_without_hooks"}
    modules = (clutch_unit, standstill, wet_clutch)
    names = {module.__name__ for module in modules}
    for module in modules:
        path = Path(module.__file__)
        tree = _WithoutHooks().visit(ast.parse(path.read_text()))
        tree.body = [n for n in tree.body if not (isinstance(n, ast.ImportFrom) and n.module in names)]
        source = ast.unparse(ast.fix_missing_locations(tree))
        assert "has_law(" not in source
        assert "call(" not in source
        scope["__file__"] = str(path)
        exec(compile(source, f"<{path.stem} without hooks>", "exec"), scope)
    return scope["advance"]


def test_effects_off_is_bit_identical_to_a_rig_that_never_had_hooks() -> None:
    kernel = rig_without_hooks()

    class Bare:
        table = NOMINAL.table

        @staticmethod
        def advance(before: wet_clutch.Whole, *inputs: float) -> wet_clutch.Whole:
            *held, duration, substeps = inputs
            return wet_clutch.Whole(*kernel(*before, *held, NOMINAL.record, None, duration, substeps))

    pieces = [*STEP, (1.5, -10.0, 250), (1.2, 24.0, 150), (0.0, 24.0, 200)]
    ours, theirs = (run(at_rest(20.0, 50.0), pieces, rig) for rig in (NOMINAL, Bare))
    assert ours.tobytes() == theirs.tobytes()
    other = run(at_rest(20.0, 50.0), pieces, parameters(friction_level__level=0.9))
    assert ours.tobytes() != other.tobytes()


def test_effects_attached_but_off_are_bit_identical_to_the_baseline() -> None:
    every = wet_clutch.Rig(wet_clutch.nominal(), also=("friction_level", "piston_seal_friction"))
    assert len(every.table.calls) == 2
    pieces = [*STEP, (1.5, -10.0, 250), (1.2, 24.0, 150), (0.0, 24.0, 200)]
    assert run(at_rest(20.0, 50.0), pieces, every).tobytes() == run(at_rest(20.0, 50.0), pieces).tobytes()


def test_friction_level_scales_the_torque_and_drifts_in_time() -> None:
    heavy = {"motor__inertia": 10.0}  # the same slip for all
    nominal, weak, drifting = (
        run(at_rest(20.0), STEP, parameters(**heavy, **changed))
        for changed in ({}, {"friction_level__level": 0.8}, {"friction_level__drift": 0.1})
    )
    factor = 1.0 + 0.1 * nominal["time"]
    closed = nominal["clutch_torque"] > 5.0
    for states, expected in ((weak, 0.8), (drifting, factor[closed])):
        ratio = states["clutch_torque"][closed] / nominal["clutch_torque"][closed]
        assert ratio == pytest.approx(expected, abs=1e-3)  # slip differs by 1e-3 through the inertia


def test_a_drift_switched_on_late_begins_where_the_level_is() -> None:
    late = pressed(3.4, 20.0)
    late["time"] = 600.0
    drifting, nominal = (
        run(late, [(pressing(3.4), 20.0, 10)], rig) for rig in (parameters(friction_level__drift=-0.1), NOMINAL)
    )
    assert drifting["clutch_torque"] == pytest.approx(nominal["clutch_torque"], rel=2e-3)  # 0.1 % in 10 ms
    assert drifting["clutch_torque"][-1] < nominal["clutch_torque"][-1]


def opening_minus_closing(force: float) -> np.ndarray:
    """Torque opening less torque closing [Nm] at equal cylinder pressures, away from the turning points."""
    states = run(pressed(2.45, 20.0), triangle(2.45, 4.2, 2.0, 20.0), parameters(piston_seal_friction__force=force))
    pressure, torque = states["pressure"] / BAR, states["clutch_torque"]
    top = np.argmax(pressure)
    grid = np.linspace(2.9, 3.5, 7)
    closing = np.interp(grid, pressure[:top], torque[:top])
    return np.interp(grid, pressure[:top:-1], torque[:top:-1]) - closing


def test_seal_friction_opens_the_loop_of_fig_6_11_with_opening_above_closing() -> None:
    none = np.abs(opening_minus_closing(0.0))
    widths = {force: opening_minus_closing(force) for force in (30.0, 60.0, 120.0)}
    slope = 10.8 * 0.8357 + 2.67 * 20.0 ** (1 / 3)  # Nm/bar at 20 rad/s
    for force, width in widths.items():
        assert (width > 10 * none.max()).all()
        assert width.mean() == pytest.approx(slope * 2 * force / (A_CYL * BAR), rel=LOOP_WIDTH)
    assert widths[30.0].mean() < widths[60.0].mean() < widths[120.0].mean()


def test_seal_friction_never_exceeds_its_break_away_force() -> None:
    states = run(at_rest(20.0), [*STEP, (0.0, 20.0, 250)], parameters(piston_seal_friction__force=60.0))
    assert states["seal_force"].max() == 60.0
    assert states["seal_force"].min() == -60.0


def test_advance_changes_none_of_its_arguments() -> None:
    rig = parameters(piston_seal_friction__force=60.0)
    state = wet_clutch.Whole(pressed(3.4, 20.0), rig.table.at_rest())
    arguments = (*state, rig.record, rig.table.values)
    before = [array.tobytes() for array in arguments]
    after = rig.advance(state, 2.0, -5.0, 1e9, 1e-3, SUBSTEPS)
    assert [array.tobytes() for array in arguments] == before
    for ours, theirs in zip(after, state, strict=True):
        assert ours.tobytes() != theirs.tobytes()
        assert not np.shares_memory(ours, theirs)


def test_advance_is_deterministic_to_the_bit() -> None:
    pieces = [*STEP, (1.0, -7.0, 100)]
    assert run(at_rest(20.0), pieces).tobytes() == run(at_rest(20.0), pieces).tobytes()


@pytest.mark.parametrize("rate", [250, 500, 2000, 4000])
def test_every_rate_gives_the_same_trajectory(rate: int) -> None:
    pieces = [(3.4 / 2.5, 20.0, 0.3), (1.5, 8.0, 0.1), (1.2, 15.0, 0.1)]

    def every_4_ms(rate: int) -> np.ndarray:
        substeps = -(-10_000 // rate)
        states = run(at_rest(20.0), [(v, w, round(s * rate)) for v, w, s in pieces], NOMINAL, 1 / rate, substeps)
        return states[rate // 250 - 1 :: rate // 250]

    one, other = every_4_ms(1000), every_4_ms(rate)
    assert other["time"] == pytest.approx(one["time"], abs=1e-12)
    assert_within(outputs(other), outputs(one), RATE_DEVIATION)


def test_torque_limit_of_the_command_binds_the_motor() -> None:
    state = NOMINAL.at_rest(0.0, 70.0 + KELVIN)
    for _ in range(50):
        state = NOMINAL.advance(state, 0.0, 20.0, 3.0, 1e-3, SUBSTEPS)
        assert state.read().motor_torque == 3.0
    assert state.read().slip_speed == pytest.approx(3.0 / J * 0.05, rel=1e-9)
    assert state.read().speed_integral == 0.0, "the integrator waits while the motor is limited"


@pytest.mark.parametrize("voltage", [-1.0, -10.0])
def test_a_negative_voltage_closes_the_valve(voltage: float) -> None:
    state = pressed(3.4, 20.0)
    assert run(state, [(voltage, 20.0, 50)]).tobytes() == run(state, [(0.0, 20.0, 50)]).tobytes()


def test_pressure_and_position_never_turn_negative() -> None:
    states = run(at_rest(20.0), [(10.0, 20.0, 60), (0.0, 20.0, 600)])
    assert states["valve_pressure"].min() < 0.0, "the valve must undershoot or nothing is tested"
    assert states["pressure"].min() == 0.0
    assert states["position"].min() == 0.0


def test_a_rig_too_fast_to_integrate_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"^the rig is too fast to integrate: .* reach .* 1/s; allowed are 2.5e\+04 1/s"
    ):
        parameters(piston__area=0.1)

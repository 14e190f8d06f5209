"""Reproductions of appendix E: lift-up force and lift-up of the XGMS model with a normal degree of freedom."""

from math import pi, sqrt

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.model import Array
from plant_sim.friction.xgms import XGMS

# Sizes of the tribometer (chapters 3 and 4) where it has them; the thesis's curves carry no units
LOAD = 58.0  # N, own weight, sec. 3.10
MASS = LOAD / 9.81  # kg, of the body that weighs LOAD
RESONANCE = 186.0  # Hz, normal resonance at the lowest preload, sec. 3.10
STIFFNESS = MASS * (2.0 * pi * RESONANCE) ** 2  # N/m, of the contact under LOAD and the compliances in series with it
POWER = 1.5  # Hertz, sec. 4.2.2
APPROACH = POWER * LOAD / STIFFNESS  # m, 11 um
LIFT = 1e-6  # m, over speed, sec. 4.2.2
HIGHEST_LIFT_FORCE = LOAD * (1.0 - (1.0 - LIFT / APPROACH) ** POWER)  # N, raises LOAD by LIFT: 7.9 N
SPEED = 0.1  # m/s, scale of the lift-up force; chosen: it saturates within the speeds of fig 4.18
LAG = 3e-3  # s, of the lift-up force at high speed; chosen: visible at 9 Hz
DAMPING = 0.5  # of critical; chosen for paper and oil: with little damping the film rings after each start
RADIUS = 0.075  # m, mean radius of the disks, sec. 3.4
FREQUENCY, ANGLE = 9.0, 0.06  # Hz and rad, the butterflies of fig 4.18
DT = 1e-5  # s; chosen: about 500 samples in a period of the normal resonance

MODEL = LiftingXGMS(
    XGMS(Amontons(0.25), np.full(10, 1e5), np.full(10, 0.1), beta=0.6, stribeck_velocity=0.02, viscous=0.2, attraction=60.0),
    LiftUp(
        HIGHEST_LIFT_FORCE, SPEED, HIGHEST_LIFT_FORCE / LAG, MASS, LOAD / APPROACH**POWER, POWER,
        2.0 * DAMPING * sqrt(STIFFNESS * MASS),
    ),
)  # fmt: skip
SIZES = (
    f"load {LOAD:g} N, resonance {RESONANCE:g} Hz, lift {LIFT * 1e6:g} um over speed as measured (chapters 3, 4); lift-up "
    f"force {HIGHEST_LIFT_FORCE:.1f} N from these; speed scale {SPEED:g} m/s, lag {LAG * 1e3:g} ms, damping {DAMPING:g} of "
    "critical are chosen here"
)


class Cycle:
    """Last of four cycles of a sine of `amplitude` [m]: (n,) arrays from the zero crossing upwards."""

    def __init__(self, amplitude: float = ANGLE * RADIUS, frequency: float = FREQUENCY) -> None:
        samples = 2 * round(0.5 / (frequency * DT))
        phase = 2.0 * pi * np.arange(4 * samples + 1) / samples
        trace = MODEL.trace(amplitude * np.sin(phase), DT, LOAD)
        last = slice(3 * samples, 4 * samples)
        self.position = amplitude * np.sin(phase)[last]
        self.velocity = amplitude * 2.0 * pi / (samples * DT) * np.cos(phase)[last]
        self.lift_force = MODEL.lift_force(trace.state)[last]
        self.lift = MODEL.lift(trace.state)[last]
        self.friction = trace.force[last]
        self.before = MODEL.lift(trace.state)[2 * samples : 3 * samples]
        self.rate = np.gradient(self.lift, DT)

    def compute_asymmetry(self, values: Array) -> float:
        """Compute the largest difference to the values half a cycle later, over their range [-]."""
        return float(np.abs(values - np.roll(values, len(values) // 2)).max() / np.ptp(values))

    def compute_wings(self, values: Array) -> tuple[float, float]:
        """Compute the signed areas between the branches at x > 0 and at x < 0, over that of the box around the loop [-].

        The branches cross if the two have opposite signs.
        """
        right = self.position >= 0.0
        box = np.ptp(values) * np.ptp(self.position)
        middle = 0.5 * (values + np.roll(values, -1)) * (np.roll(self.position, -1) - self.position)
        return float(middle[right].sum() / box), float(middle[~right].sum() / box)


def check_butterfly(sheet: Sheet, cycle: Cycle, values: Array, name: str) -> None:
    """Check that the curve over position is a butterfly."""
    asymmetry = cycle.compute_asymmetry(values)
    sheet.check(f"{name}: the curve is even in x, the same in both directions, relative difference", asymmetry < 0.01,
                asymmetry, "butterfly shape")  # fmt: skip
    right, left = cycle.compute_wings(values)
    sheet.check(f"{name}: the wings run in opposite directions, so the branches cross [area of the box]",
                right * left < 0.0 and min(abs(right), abs(left)) > 0.01, [right, left], "a butterfly")  # fmt: skip


@register_reproduction(
    "figure-E.1",
    "Lift-up force over velocity",
    claim="the lift-up force is even in the velocity, 0 at rest, and saturates",
)
def reproduce_figure_e_1(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    speeds = np.concatenate([-np.geomspace(1e-3, 0.8, 25)[::-1], [0.0], np.geomspace(1e-3, 0.8, 25)])
    force = np.array([simulate_steady(v)[0] for v in speeds])
    grid = np.linspace(-0.8, 0.8, 801)
    axes.plot(grid, MODEL.steady_lift_force(grid), color=REFERENCE_COLOUR, lw=1.0, label=r"$F_N(v)$")
    axes.plot(speeds, force, "o", ms=4, color="C0", label="played at constant velocity")
    axes.legend(loc="lower right")
    label_axes(axes, "v [m/s]", r"$F_N$ [N]")
    difference = float(np.abs(force - force[::-1]).max())
    sheet.check("steady force at v and -v differ by rounding [N]", difference < 1e-9, difference, "line symmetric")
    sheet.check("no force at rest [N]", force[25] == 0.0, force[25], "0")
    sheet.check("the last doubling of the speed adds less than 2 % of the force", force[-1] < 1.02 * simulate_steady(0.4)[0],
                force[-1] / simulate_steady(0.4)[0], "saturates")  # fmt: skip
    error = float(np.abs(force - MODEL.steady_lift_force(speeds)).max())
    sheet.check("the played steady force is F_N(v), both directions [N]", error < 1e-9, error, "static curve")
    printed = _compute_printed_force(-0.3)
    sheet.check("as printed, with sign(v) C_N and F_N even, it runs away for v < 0: force after 0.1 s of -0.3 m/s [N]",
                printed < -100.0 * HIGHEST_LIFT_FORCE, printed, "printed equation")  # fmt: skip
    sheet.note("so sign(v) is left out before C_N; with it the force has a steady state for v > 0 only. " + SIZES)


def simulate_steady(velocity: float) -> tuple[float, float]:
    """Simulate 0.5 s at constant velocity [m/s]; return lift-up force [N] and lift [m]."""
    position = velocity * np.arange(5001) * 1e-4
    state = MODEL.trace(position, 1e-4, LOAD).state[-1]
    return float(MODEL.lift_force(state)), float(MODEL.lift(state))


def _compute_printed_force(velocity: float) -> float:
    """Compute the lift-up force [N] of the printed slip equation, one element, after 0.1 s at `velocity` [m/s]."""
    end = float(MODEL.steady_lift_force(velocity))
    rate = np.sign(velocity) * MODEL.normal.attraction / end
    return float(end * (1.0 - np.exp(-rate * 0.1)))  # the exact solution


@register_reproduction(
    "figure-E.2",
    "Lift-up force over position",
    claim="under a sinusoidal position the lift-up force is a butterfly; its change becomes zero at motion reversal",
)
def reproduce_figure_e_2(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    cycle = Cycle()
    axes.plot(cycle.position * 1e3, cycle.lift_force, color="C0")
    label_axes(axes, r"$x_T$ [mm]", r"$F_N$ [N]")
    check_butterfly(sheet, cycle, cycle.lift_force, "lift-up force")
    change = np.abs(np.gradient(cycle.lift_force, DT))
    first = int(np.argmax(cycle.position)) + 1
    after = float(change[first : first + round(1e-3 / DT)].max() / change.max())
    sheet.check(
        "rate of change in the first ms after a reversal, of its largest in the cycle",
        after < 0.05,
        after,
        "becomes zero",
    )
    sheet.note(f"9 Hz, 0.06 rad as fig 4.18. {SIZES}")


@register_reproduction(
    "figure-E.3",
    "Lift-up over position",
    claim="the normal motion over the tangential motion has a butterfly behaviour",
)
def reproduce_figure_e_3(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    cycle = Cycle()
    axes.plot(cycle.position * 1e3, cycle.lift * 1e6, color="C0")
    label_axes(axes, r"$x_T$ [mm]", r"$h_N$ [um]")
    check_butterfly(sheet, cycle, cycle.lift, "lift-up")
    closing = float(np.abs(cycle.lift - cycle.before).max() / np.ptp(cycle.lift))
    sheet.check("the curve closes: difference to the cycle before, of its range", closing < 1e-3, closing, "closed")
    sheet.note(f"9 Hz, 0.06 rad as fig 4.18, where about 1 um was measured. {SIZES}")


@register_reproduction(
    "figure-E.4",
    "Contact lift-up hysteresis",
    claim="lift-up force over lift-up height is a hysteresis, of the non-linear contact stiffness with damping",
)
def reproduce_figure_e_4(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    cycle, slow = Cycle(), Cycle(frequency=0.5)
    axes.plot(cycle.lift * 1e6, cycle.lift_force, color="C0", label="9 Hz")
    axes.plot(slow.lift * 1e6, slow.lift_force, color="C1", lw=3.0, alpha=0.5, label="0.5 Hz")
    heights = np.linspace(cycle.lift.min(), cycle.lift.max(), 100)
    static = LOAD * (1.0 - (1.0 - heights / APPROACH) ** POWER)
    axes.plot(heights * 1e6, static, color=REFERENCE_COLOUR, lw=1.0, ls="--", label="static: the contact spring")
    axes.legend(loc="lower right")
    label_axes(axes, r"$h_N$ [um]", r"$F_N$ [N]")
    work = float(
        np.sum(0.5 * (cycle.lift_force + np.roll(cycle.lift_force, -1)) * (np.roll(cycle.lift, -1) - cycle.lift))
    )
    lost = float(np.sum(MODEL.normal.damping * cycle.rate**2) * DT)
    sheet.check("the loop is open: work of the lift-up force in a cycle [J] is above 0", work > 0.0, work, "hysteresis")
    sheet.check(
        "that work is what the damper c takes, within 5 %",
        abs(work / lost - 1.0) < 0.05,
        work / lost,
        "stiffness with damping",
    )
    apart = [_compute_spring_distance(c) for c in (cycle, slow)]
    sheet.check("rms distance from the static contact spring [of the 1 um] falls by more than 10 times from 9 to 0.5 Hz",
                apart[1] < 0.1 * apart[0], apart, "stiffness with damping")  # fmt: skip
    sheet.note(SIZES)


def _compute_spring_distance(cycle: Cycle) -> float:
    """Compute the rms distance of a cycle from the static contact spring, relative to LIFT [-]."""
    static = APPROACH * (1.0 - (1.0 - cycle.lift_force / LOAD) ** (1.0 / POWER))
    return float(np.sqrt(np.mean((cycle.lift - static) ** 2)) / LIFT)


@register_reproduction(
    "figure-E.5",
    "Lift-up height over steady velocity",
    claim="for each constant velocity a constant height is reached, and the height saturates with the speed",
)
def reproduce_figure_e_5(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    speeds = np.linspace(0.0, 1.0, 51)
    lifts = np.array([simulate_steady(v)[1] for v in speeds])
    balance = APPROACH * (1.0 - (1.0 - MODEL.steady_lift_force(speeds) / LOAD) ** (1.0 / POWER))
    axes.plot(speeds, balance * 1e6, color=REFERENCE_COLOUR, lw=1.0, label="balance of forces")
    axes.plot(speeds, lifts * 1e6, "o", ms=4, color="C0", label="played at constant velocity")
    axes.legend(loc="lower right")
    label_axes(axes, r"$v_T$ [m/s]", r"$h_N$ [um]")
    sheet.check(
        "height grows with the speed", bool(np.all(np.diff(lifts) > 0.0)), f"0 to {lifts[-1] * 1e6:.3f} um", "grows"
    )
    late = (lifts[-1] - lifts[25]) / lifts[-1]
    sheet.check("the upper half of the speeds adds less than 1 % of the height", late < 0.01, late, "saturates")
    error = float(np.abs(lifts - balance).max() / LIFT)
    sheet.check(
        "height is that of the balance of lift-up force, contact and load, of 1 um", error < 1e-6, error, "equilibrium"
    )
    sheet.check(
        "height over speed is 1 um within 1 %", abs(lifts[-1] / LIFT - 1.0) < 0.01, lifts[-1], "about 1 um (4.2.2)"
    )
    sheet.note(SIZES)

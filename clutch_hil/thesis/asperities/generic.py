"""Reproductions of the Generic model: figures 2.5 to 2.8 (sec. 2.2.4)."""

import numpy as np
from scipy.optimize import curve_fit

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.asperity_contact import FREE, STICK
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface
from plant_sim.friction.generic import GenericModel
from plant_sim.friction.model import Array
from plant_sim.friction.stribeck import Stribeck

# The thesis gives N, N_w, the fill degree, the amplitude and the duration (figs 2.4, 2.5) and no other value. The others are
# chosen. All are dimensionless: lengths in heights of a step, total tangential stiffness 1.
LOAD = 0.05  # W; chosen: it makes normal deflections of about the roughness, 0.05
# chosen: tau is near the time that a reversal of fig 2.4 holds the contact
FRICTION = StickTimeFriction(mu_0=0.2, mu_inf=0.4, tau=0.5)
MASS = 0.008  # of all asperities together; chosen: at full speed impacts are up to a third of the friction
# step and recess; chosen: the stroke passes five, and a break-away deflection (0.02) is short beside a step
PITCH = 0.2
OWN_VALUES_NOTE = (
    f"the thesis gives N, N_w, fill degree, amplitude and duration; chosen here: load {LOAD}, mu "
    f"{FRICTION.mu_0} to {FRICTION.mu_inf} "
    f"with tau {FRICTION.tau}, mean pitch {PITCH}, mass of all asperities {MASS}, roughness 0.05, nu 0.3, total k_t 1"
)
DT = 1e-3  # sampling step; chosen: 6283 samples a cycle at 1 rad/s
AMPLITUDE, PERIODS = 0.5, 1.25  # fig 2.4
TIME = np.arange(0.0, PERIODS * 2.0 * np.pi, DT)  # the axis of fig 2.4 ends at 8: 1 rad/s
POSITION, VELOCITY = AMPLITUDE * np.sin(TIME), AMPLITUDE * np.cos(TIME)
# travel since a reversal after which all asperities have slipped; chosen: five break-away deflections
GROSS_STROKE = 0.1
CYCLE = np.pi / 2.0 <= TIME  # one full period after the first quarter: from the upper reversal to the next


def draw_asperities(mass: float, seed: int = 1) -> Asperities:
    """Draw the N = 250 asperities of figs 2.5 to 2.8; `mass` of all together."""
    return Asperities.draw(250, np.random.default_rng(seed), length=100 * PITCH, mass=mass)


def make_model(mass: float = MASS) -> GenericModel:
    """Make the model of fig 2.5: N = 250, N_w = 100, fill degree 50 %."""
    return GenericModel(draw_asperities(mass), CounterSurface.draw(100, np.random.default_rng(2), 0.5, PITCH), FRICTION)


def make_flat_model(friction: StickTimeFriction = FRICTION) -> GenericModel:
    """Make the model of fig 2.8: the asperities of fig 2.5, without mass, on a flat counter surface."""
    return GenericModel(draw_asperities(0.0), FlatSurface(), friction)


@register_reproduction(
    "figure-2.5",
    "Generic model: hysteresis and friction against velocity",
    claim="hysteresis in position; friction rises with speed by the mass of the asperities; no clear Stribeck effect; "
    "friction lag hidden by noise",
)
def reproduce_figure_2_5(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=11, height=4.8)
    heavy, light = make_model(), make_model(mass=0.0)
    force = heavy.observe(POSITION, DT, LOAD).force
    quarter = TIME / (np.pi / 2.0)
    reversal = np.select([quarter < 1.0, quarter < 3.0], [0.0, AMPLITUDE], -AMPLITUDE)  # where the motion began
    sliding = (np.abs(POSITION - reversal) > GROSS_STROKE) & (np.abs(VELOCITY) > 0.0)
    speed = np.abs(VELOCITY[sliding])
    level = force[sliding] * np.sign(VELOCITY[sliding])

    def compute_curve(v: Array, static: float, beta: float, stribeck: float, viscous: float) -> Array:
        return Stribeck(static, beta, stribeck, viscous, 2.0)(v)

    start = (FRICTION.mu_inf * LOAD, 0.5, 0.05, 0.01)
    parameters, _ = curve_fit(
        compute_curve, speed, level, start, bounds=([1e-6, 0.05, 1e-3, 0.0], [0.1, 2.0, 0.5, 1.0])
    )
    noise = float(np.std(level - compute_curve(speed, *parameters)))
    v = np.linspace(0.01, AMPLITUDE, 300)
    fitted = compute_curve(v, *parameters)
    left.plot(POSITION, force, lw=0.7)
    label_axes(left, "position x [step heights]", "friction force F [-]", "hysteresis")
    right.plot(VELOCITY, force, lw=0.7, label="model")
    for side in (-1.0, 1.0):
        right.plot(
            side * v, side * fitted, color=REFERENCE_COLOUR, lw=1.6, label="fitted Stribeck curve" if side > 0 else None
        )
    right.legend(loc="upper left", frameon=False)
    label_axes(right, "velocity v", "friction force F [-]", "friction against velocity")

    area = float(np.trapezoid(force[CYCLE], POSITION[CYCLE]))
    sheet.check(
        "work of one period (area of the loop) over the 4 A mu_0 W of Coulomb friction, above 0.5",
        area > 0.5 * _compute_coulomb_work(),
        area / _compute_coulomb_work(),
        "hysteresis",
    )
    speeds = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    with_mass, without = heavy.steady_state(speeds, LOAD), light.steady_state(speeds, LOAD)
    rise = np.polyfit(np.log(speeds), np.log(with_mass - without), 1)[0]
    sheet.check(
        "steady friction from v = 0.1 to 0.5, with asperity mass: rises at each speed",
        bool(np.all(np.diff(with_mass) > 0.0)),
        with_mass / LOAD,
        "velocity strengthening",
    )
    sheet.check(
        "the same without asperity mass: does not rise by more than 2 %",
        bool(without[-1] < 1.02 * without[0]),
        without / LOAD,
        "the rise is due to the mass m",
    )
    sheet.check("exponent of v in the part due to the mass, 2 within 0.05", abs(rise - 2.0) < 0.05, rise, "m v^2 (2.9)")
    dip = (fitted[0] - fitted.min()) / noise
    sheet.check(
        "Stribeck drop of the curve fitted to gross sliding, over the noise (rms), below 1",
        bool(dip < 1.0),
        dip,
        "no clearly visible Stribeck effect",
    )
    lag = _measure_lag(force) / noise
    sheet.check(
        "friction accelerating minus decelerating at equal speed, over the noise (rms), below 1",
        abs(lag) < 1.0,
        lag,
        "friction lag not very clear due to the noise",
    )
    sheet.note(OWN_VALUES_NOTE)


def _compute_coulomb_work() -> float:
    return 4.0 * AMPLITUDE * FRICTION.mu_0 * LOAD


def _measure_lag(force: Array) -> float:
    """Mean friction while accelerating minus that while decelerating, |v| 0.2 to 0.45, over the last whole period."""
    part = CYCLE & (np.abs(VELOCITY) > 0.2) & (np.abs(VELOCITY) < 0.45)
    level, accelerating = force * np.sign(VELOCITY), -POSITION * VELOCITY > 0.0  # acceleration is -x at 1 rad/s
    return float(level[part & accelerating].mean() - level[part & ~accelerating].mean())


@register_reproduction(
    "figure-2.6",
    "Break-away force against the rate of application",
    claim="the break-away force is highest at the lowest applied rate and falls as the rate rises",
)
def reproduce_figure_2_6(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=11, height=4.5)
    rates = np.logspace(-2.0, 1.0, 13)  # velocity of the body: break-away after 5 tau down to 0.005 tau
    travel = np.linspace(0.0, 0.12, 2401)

    def play_ramps(friction: StickTimeFriction) -> list[Array]:
        return [make_flat_model(friction).observe(travel, (travel[1] - travel[0]) / rate, LOAD).force for rate in rates]

    forces, constant = play_ramps(FRICTION), play_ramps(StickTimeFriction(FRICTION.mu_0, FRICTION.mu_0, FRICTION.tau))
    peaks, flat_peaks = (np.array([f.max() for f in ramp_forces]) / LOAD for ramp_forces in (forces, constant))
    force_rate = rates * forces[0][1] / travel[1]
    for i in range(0, rates.size, 3):
        left.plot(travel, forces[i] / LOAD, lw=1.2, label=f"{force_rate[i]:.1g}")
    left.legend(title="force rate", loc="lower right", frameon=False)
    label_axes(
        left, "position x [step heights]", "friction force F/W [-]", "transition from pre-sliding to gross sliding"
    )
    right.semilogx(force_rate, peaks, "o-", label="model")
    right.semilogx(force_rate, flat_peaks, "s--", color="C2", ms=4, label=r"$\mu_\infty = \mu_0$")
    right.legend(loc="upper right", frameon=False)
    label_axes(right, "rate of application dF/dt [-]", "break-away force $F_{max}/W$ [-]")
    sheet.check("break-away force F/W falls at each higher rate", bool(np.all(np.diff(peaks) < 0.0)), peaks, "falls")
    sheet.check(
        "F/W is within mu_0 and mu_inf",
        bool(FRICTION.mu_0 <= peaks.min() and peaks.max() <= FRICTION.mu_inf),
        (peaks.min(), peaks.max()),
        "several values of the static friction for one load",
    )
    sheet.check(
        "with mu_inf = mu_0 the rate has no effect (spread of F/W, below 1e-9)",
        bool(np.ptp(flat_peaks) < 1e-9),
        np.ptp(flat_peaks),
        "due to the stick-time-dependent coefficient",
    )
    sheet.note(
        'the thesis\'s profile is "different", one without velocity strengthening, and not given; the one chosen here is flat'
    )
    sheet.note(
        "the body is moved at constant velocity; the rate is that velocity times the stiffness of the contact at rest"
    )
    sheet.note(OWN_VALUES_NOTE)


@register_reproduction(
    "figure-2.7",
    "Stick time of each asperity",
    claim="stick occurs more at motion reversal: the stick time rises there for most asperities that are in contact",
)
def reproduce_figure_2_7(sheet: Sheet) -> None:
    above, below = sheet.make_axes(2, 1, width=10, height=7, sharex=True, height_ratios=(3, 1))
    every = 10
    generic = make_model()
    states = generic.trace(POSITION, DT, LOAD).state
    _, stick_time, mode, _ = generic.split(states)
    sticks = ((mode == STICK).sum(axis=1)) / np.maximum((mode != FREE).sum(axis=1), 1)
    picture = above.imshow(
        stick_time[::every].T,
        origin="lower",
        aspect="auto",
        extent=(0.0, TIME[-1], 0.0, 250.0),
        cmap="viridis",
        interpolation="nearest",
    )
    above.grid(visible=False)
    sheet.figure.colorbar(picture, ax=[above, below], label="stick time", shrink=0.8)
    label_axes(above, "", "asperity")
    below.plot(TIME, sticks, lw=0.9)
    below.set_ylim(0.0, 1.05)
    label_axes(below, "time", "part in stick [-]")
    reversals = np.pi * np.array([0.5, 1.5])  # the third is the end
    for time in reversals:
        below.axvline(time, color=REFERENCE_COLOUR, lw=0.8, ls="--")
    near = np.min(np.abs(TIME[:, None] - reversals), axis=1) < 0.15
    far = np.abs(VELOCITY) > 0.4
    at = [round((time + 0.15) / DT) for time in reversals]
    sheet.check(
        "part of the touching asperities in stick within 0.15 of a reversal, over twice that at |v| > 0.4",
        bool(sticks[near].mean() > 2.0 * sticks[far & (TIME > 1.0)].mean()),
        (sticks[near].mean(), sticks[far & (TIME > 1.0)].mean()),
        "more at reversal",
    )
    sheet.check(
        "part of the touching asperities that stick 0.15 after a reversal, above 0.5",
        bool(np.all(sticks[at] > 0.5)),
        sticks[at],
        "most",
    )
    mean_time = np.array([stick_time[k][mode[k] != FREE].mean() for k in (at[0] - 300, at[0], at[1] - 300, at[1])])
    sheet.check(
        "mean stick time of touching asperities 0.15 before and after each reversal: rises",
        bool(mean_time[1] > mean_time[0] and mean_time[3] > mean_time[2]),
        mean_time,
        "rising",
    )
    sheet.check(
        "part of all asperities that do not touch at the reversals, above 0",
        bool(np.all((mode[at] == FREE).mean(axis=1) > 0.0)),
        (mode[at] == FREE).mean(axis=1),
        "some do not touch and appear not to stick",
    )
    sheet.note(OWN_VALUES_NOTE)


@register_reproduction(
    "figure-2.8",
    "Flat counter surface",
    claim="on a flat counter surface the friction force overshoots, because the coefficient depends on stick time",
)
def reproduce_figure_2_8(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, width=8, height=4.8)
    generic = make_flat_model()
    force = generic.observe(POSITION, DT, LOAD).force / LOAD
    plain = (
        make_flat_model(StickTimeFriction(FRICTION.mu_0, FRICTION.mu_0, FRICTION.tau)).observe(POSITION, DT, LOAD).force
        / LOAD
    )
    axes.plot(POSITION, force, lw=1.2, label=r"$\mu(t)$, N = 250")
    axes.plot(POSITION, plain, lw=1.0, ls="--", color=REFERENCE_COLOUR, label=r"$\mu_\infty = \mu_0$")
    axes.legend(loc="center", bbox_to_anchor=(0.7, 0.5), frameon=False)
    label_axes(axes, "position x [step heights]", "friction force F/W [-]")
    overshoot = (force[CYCLE].max() / FRICTION.mu_0 - 1.0, -force[CYCLE].min() / FRICTION.mu_0 - 1.0)
    sheet.check(
        "overshoot over mu_0 W, both directions, above 0.05",
        min(overshoot) > 0.05,
        overshoot,
        "an overshoot would be expected",
    )
    sheet.check(
        "both directions alike within 0.01",
        abs(overshoot[0] - overshoot[1]) < 0.01,
        abs(overshoot[0] - overshoot[1]),
        "symmetric picture",
    )
    sheet.check(
        "largest F/(mu_0 W) - 1 with mu_inf = mu_0: none (below 1e-9)",
        bool(np.abs(plain).max() / FRICTION.mu_0 - 1.0 < 1e-9),
        np.abs(plain).max() / FRICTION.mu_0 - 1.0,
        "caused by the time dependence",
    )
    sheet.check(
        "in gross sliding F/(mu_0 W) = 1 within 1e-9",
        abs(force[TIME > 6.0][0] / FRICTION.mu_0 - 1.0) < 1e-9,
        force[TIME > 6.0][0] / FRICTION.mu_0,
        "slip force",
    )
    sheet.note(OWN_VALUES_NOTE)

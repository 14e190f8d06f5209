"""The Generic-Rayleigh model: all lubrication regimes with one model (section 2.4).

The figures of the thesis have no numbers. These are chosen for all entries:

dry friction    mu_0 = 0.15, mu_inf = 0.2, tau_t = 0.05
tips            alpha = 1.5 and dh/L = 0.02: the least friction of the film is then half of mu_0
viscosity       a tip under the mean load begins to slide on its film at velocity 1
threshold       at the force of dry slip
"""

from dataclasses import replace

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction import asperity_contact as contact
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import CounterSurface, FlatSurface
from plant_sim.friction.generic import GenericModel
from plant_sim.friction.generic_rayleigh import GenericRayleighModel
from plant_sim.friction.rayleigh_step import steady_gap
from plant_sim.friction.tip_film import SlidingThreshold, TipFilm

FRICTION = StickTimeFriction(0.15, 0.2, 0.05)  # mu_0, mu_inf, tau_t; chosen, see above
ASPERITIES, STEPS, FILL = 250, 100, 0.5  # as the Generic model of fig 2.5
LOAD = 0.03  # of (total k_t) x (step height); chosen: it makes deflections of a tenth of a step
STROKE = 0.5  # amplitude of the motion, as in fig 2.5
Array = np.ndarray


def _make_film(tip_load: float) -> TipFilm:
    """Make the film on which a tip under `tip_load` begins to slide at velocity 1."""
    film = TipFilm(alpha=1.5, length=2e-4, step=4e-6, area=1e-6, viscosity=1.0)
    needed = film.ratio(film.gap_at(FRICTION.mu_0)) * tip_load / film.area
    return replace(film, viscosity=needed / film.sliding_per_velocity)


def _make_wet_model(dry: GenericModel, tip_load: float) -> GenericRayleighModel:
    film = _make_film(tip_load)
    return GenericRayleighModel(dry, film, SlidingThreshold.at_friction(film, FRICTION.mu_0))


@register_reproduction(
    "figure-2.25",
    "Generic-Rayleigh: from stick over dry slip to wet slip",
    claim="three zones: stick, dry slip with a drop from the break-away force, wet slip on the Stribeck curve; the force is "
    "continuous from dry to wet",
)
def reproduce_figure_2_25(sheet: Sheet) -> None:
    model = _make_wet_model(
        GenericModel(Asperities(np.zeros(1), np.zeros(1), np.ones(1)), FlatSurface(), FRICTION), LOAD
    )
    time = np.linspace(0.0, 1.0, 40001)
    speed, position = 6.0 * time**2, 2.0 * time**3  # to velocity 6, gently at first
    played = model.trace(position, time[1], LOAD)
    mu = played.force / LOAD
    wet = model.gaps(played.state)[:, 0] > 0.0
    stuck = played.state[:, 2] == contact.STICK

    def compute_static_friction(velocities: Array) -> Array:
        slidings = model.film.sliding_per_velocity * velocities
        gaps = [steady_gap(model.film.alpha, float(value), LOAD / model.film.area) for value in slidings]
        return np.array([model.film.coefficient(gap) for gap in gaps])

    left, right = sheet.make_axes(1, 2, 12, 4.8)
    peak = float(mu.max())
    for zone, name, colour in ((stuck, "stick", "C0"), (~stuck & ~wet, "dry slip", "C1"), (wet, "wet slip", "C2")):
        left.plot(position[zone], mu[zone] / peak, colour, lw=2.5, label=name)
        right.plot(speed[zone], mu[zone], colour, lw=2.5, label=name)
    velocities = np.linspace(0.9, 6.0, 400)
    right.plot(
        velocities,
        compute_static_friction(velocities),
        color=REFERENCE_COLOUR,
        ls="--",
        lw=1.0,
        label="Stribeck curve of the film",
    )
    left.set_xscale("log")
    left.set_xlim(1e-4, 2.0)
    right.set_ylim(0.0, 0.25)
    left.legend()
    right.legend()
    label_axes(left, "displacement [step heights]", "force over break-away force [-]")
    label_axes(right, "V over that of the threshold [-]", r"$F_f/W$ [-]")

    order = np.where(stuck, 0, np.where(wet, 2, 1))
    sheet.check("order of the zones is stick, dry slip, wet slip, each once", bool(np.all(np.diff(order) >= 0)),
                np.unique(order), "three zones")  # fmt: skip
    drop = float(mu[order == 1][0])
    sheet.check("break-away force over W is above mu_0, at most mu_inf; then it drops to mu_0",
                FRICTION.mu_0 < peak <= FRICTION.mu_inf and abs(drop - FRICTION.mu_0) < 1e-9, [peak, drop],
                "drop in the friction force")  # fmt: skip
    first = int(np.flatnonzero(wet)[0])
    jump, step = float(abs(mu[first + 1] - mu[first - 1])), float(np.abs(np.diff(mu[first:])).max())
    sheet.check("change of the force over W where wet slip begins is below 1e-3", jump < 1e-3, jump, "continuous")
    sheet.check("largest change of it between samples in wet slip is below 1e-3", step < 1e-3, step, "continuous")
    steady = model.steady_state(np.array([0.999, 1.001]), LOAD) / LOAD
    sheet.check("steady friction 0.1 % of speed below and above the threshold differs by less than 1 %",
                abs(steady[1] / steady[0] - 1.0) < 0.01, steady, "smooth transition")  # fmt: skip
    riding = np.flatnonzero(speed > 3.0)[::50]
    error = float(np.abs(mu[riding] / compute_static_friction(speed[riding]) - 1.0).max())
    sheet.check("above three times the threshold speed it is the Stribeck curve within 2 %", error < 0.02, error,
                "Stribeck curve")  # fmt: skip
    sheet.note("one tip on a flat surface, V = 6 t^2. The hump where wet slip begins is the lag of the film. The threshold is "
               "at mu_0, the force of dry slip: only that makes the steady curve continuous")  # fmt: skip


@register_reproduction(
    "figure-2.26",
    "Generic-Rayleigh: reciprocating at low and at high speed",
    claim="at low speed no film builds up and friction is the dry hysteresis; at higher speed it shows all lubrication regimes",
)
def reproduce_figure_2_26(sheet: Sheet) -> None:
    rng = np.random.default_rng(2)
    asperities = Asperities.draw(ASPERITIES, rng)
    dry = GenericModel(asperities, CounterSurface.draw(STEPS, rng, FILL), FRICTION)
    model = _make_wet_model(dry, LOAD / (FILL * ASPERITIES))
    cycles = np.linspace(0.0, 1.25, 5001)
    position, phase = STROKE * np.sin(2 * np.pi * cycles), 2 * np.pi * STROKE * np.cos(2 * np.pi * cycles)
    last_cycle = slice(1000, None)  # the last full cycle

    def reciprocate(peak: float) -> tuple[Array, Array, Array]:
        """Velocity, friction coefficient and share of the slipping tips that slide on a film."""
        frequency = peak / (2 * np.pi * STROKE)
        run = model.observe(position, cycles[1] / frequency, LOAD)
        slipping = np.maximum(run.dry + run.wet, 1.0)
        return phase[last_cycle] * frequency, run.force[last_cycle] / LOAD, (run.wet / slipping)[last_cycle]

    axes = sheet.make_axes(1, 3, 14, 4.5)
    velocity, low, riding = reciprocate(1e-3)
    generic = dry.observe(position, cycles[1] * 2 * np.pi * STROKE / 1e-3, LOAD).force[last_cycle] / LOAD
    axes[0].plot(position[last_cycle], low, lw=1.0)
    axes[1].plot(1e3 * velocity, low, lw=1.0)
    axes[1].set_xticks([-1, 0, 1])
    label_axes(axes[0], "x [step heights]", r"$F_f/W$ [-]", "low speed")
    label_axes(axes[1], "V over that of the threshold [1e-3]", r"$F_f/W$ [-]", "low speed")
    difference = float(np.abs(low - generic).max() / np.abs(generic).max())
    sheet.check(
        "low speed: it is the Generic model, relative difference below 1 %",
        difference < 0.01,
        difference,
        "dry friction",
    )
    sheet.check("low speed: share of the slipping tips that ride is below 2 %", riding.mean() < 0.02, float(riding.mean()),
                "the step stays in contact")  # fmt: skip
    loop = float(abs(np.trapezoid(low, position[last_cycle])))
    work = loop / (4 * STROKE * FRICTION.mu_0)
    sheet.check(
        "low speed: work of a cycle over that of Coulomb friction mu_0 W is 0.8 to 1.1",
        0.8 < work < 1.1,
        work,
        "hysteresis",
    )

    high = {peak: reciprocate(peak) for peak in (3.0, 10.0, 30.0)}
    for peak, (velocity, mu, _) in high.items():
        axes[2].plot(velocity, mu, lw=1.0, label=f"to {peak:g}")
    axes[2].legend()
    label_axes(axes[2], "V over that of the threshold [-]", r"$F_f/W$ [-]", "high speed")
    velocity, mu, riding = high[30.0]
    bands = ((0.0, 0.2), (1.0, 3.0), (3.0, 10.0), (24.0, 31.0))
    shares = [float(riding[(np.abs(velocity) > a) & (np.abs(velocity) <= b)].mean()) for a, b in bands]
    sheet.check("to 30: share of slipping tips that ride at |V| to 0.2, 1 to 3, 3 to 10, above 24 grows to nearly all",
                shares[0] < shares[1] < shares[2] <= shares[3] > 0.95, shares, "all regimes")  # fmt: skip
    straight = np.linspace(0.0, 3.0, 1501)
    steady = [float(model.observe(straight, 2e-3 / v, LOAD).force[500:].mean()) / LOAD for v in (0.01, 1.0, 3.0, 30.0)]
    sheet.check("friction over W at constant V = 0.01, 1, 3 falls, at 30 has risen again",
                steady[0] > steady[1] > steady[2] < steady[3], steady, "boundary, mixed, hydrodynamic")  # fmt: skip
    fast = [float(np.abs(mu)[(np.abs(velocity) > a) & (np.abs(velocity) <= b)].mean()) for a, b in bands[2:]]
    sheet.check(
        "to 30: friction over W grows from |V| 3 to 10 to above 24",
        fast[1] > 1.2 * fast[0],
        fast,
        "hydrodynamic effect",
    )
    sheet.note(
        f"N = {ASPERITIES}, N_w = {STEPS}, fill {FILL:.0%}, amplitude {STROKE:g}, load {LOAD:g}; seed 2; without inertia"
    )

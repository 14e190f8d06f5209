"""Across the levels: models of control identified on traces of the Generic-Rayleigh model predict others.

The claim is of this project, not of the thesis.

The asperities with their films are the measured contact. As on a test rig, the elements come from the virgin curve of slow
loops (app. D) and the Stribeck curve from a staircase of speeds (sec. 5.6). Then all other parameters are fitted to all
training records at once. Lengths are in step heights, forces in (total k_t) x (step height). The unit of velocity is that at
which a tip under the mean load begins to slide on its film.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.counter_surface import CounterSurface
from plant_sim.friction.generic import GenericModel
from plant_sim.friction.generic_rayleigh import GenericRayleighModel
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.break_points import CurvatureSpacing
from plant_sim.friction.identification.least_squares import minimise
from plant_sim.friction.identification.maxwell_slip import fit as fit_elements
from plant_sim.friction.identification.stribeck_fit import STRIBECK, fit_least_squares
from plant_sim.friction.identification.virgin_curve import from_loops
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.tip_film import SlidingThreshold, TipFilm
from plant_sim.friction.xgms import XGMS

FRICTION = StickTimeFriction(0.15, 0.2, 0.05)  # mu_0, mu_inf, tau_t; as are film and surface in `generic_rayleigh.py`
# asperities, steps of the surface, share of steps; chosen: twice the asperities of fig 2.26
COUNT, STEPS, FILL = (500, 100, 0.5)
# two of the training, one to predict; chosen: fig 2.26, twice, between
LOAD, SECOND_LOAD, PREDICTED_LOAD = (0.03, 0.06, 0.045)
SPEEDS = np.geomspace(0.03, 30.0, 10)  # of the staircase: from dry slip to a full film
STRIDE, SAMPLES = 1.0, 250  # at each speed: step heights (five pitches of the surface), samples
RUN_IN = 50  # samples before steady sliding: one pitch
ELEMENTS = 10  # of GMS and XGMS; as in sec. 5.5
COLOURS = {"Coulomb": "C7", "LuGre": "C1", "GMS": "C2", "XGMS": "C0"}
Array = np.ndarray
Values = Mapping[str, float]


@dataclass(frozen=True)
class Motion:
    """A `position` (n,), `dt` apart, from rest, under `load` (scalar or (n,))."""

    name: str
    position: Array
    dt: float
    load: Array | float = LOAD

    def measure(self, contact: GenericRayleighModel) -> Array:
        """Measure the friction of the asperities (n,)."""
        return contact.observe(self.position, self.dt, self.load).force

    def predict(self, model: FrictionModel) -> Array:
        """Predict the friction by `model` (n,)."""
        return _scale_to_load(self.load, model, model.trace(self.position, self.dt, self.load).force)


@dataclass(frozen=True)
class Staircase:
    """Steady sliding at each of SPEEDS under `load`."""

    load: float

    def measure(self, contact: GenericRayleighModel) -> Array:
        """Measure the mean friction of the asperities over four pitches of the surface (10,)."""
        position = np.linspace(0.0, STRIDE, SAMPLES + 1)
        runs = [contact.observe(position, position[1] / speed, self.load).force for speed in SPEEDS]
        return np.array([force[RUN_IN:].mean() for force in runs])

    def predict(self, model: FrictionModel) -> Array:
        """Predict the steady friction by `model` (10,)."""
        return _scale_to_load(self.load, model, model.steady_state(SPEEDS, self.load))


def _scale_to_load(load: Array | float, model: FrictionModel, force: Array) -> Array:
    """Scale the `force` of a `model` that ignores the load in proportion to `load`, as in Coulomb's law; not that of XGMS."""
    return force if isinstance(model, XGMS) else force * load / LOAD


def make_contact(surface: int) -> GenericRayleighModel:
    """Make one body on the part of the counter surface that the seed `surface` draws."""
    asperities = Asperities.draw(COUNT, np.random.default_rng(0))
    dry = GenericModel(asperities, CounterSurface.draw(STEPS, np.random.default_rng(surface), FILL), FRICTION)
    film = TipFilm(alpha=1.5, length=2e-4, step=4e-6, area=1e-6, viscosity=1.0)
    needed = film.ratio(film.gap_at(FRICTION.mu_0)) * LOAD / (FILL * COUNT) / film.area
    film = replace(film, viscosity=needed / film.sliding_per_velocity)
    return GenericRayleighModel(dry, film, SlidingThreshold.at_friction(film, FRICTION.mu_0))


def _make_sine(name: str, amplitude: float, peak: float, cycles: float, samples: int) -> Motion:
    """Make a sine whose velocity reaches `peak`, with `samples` a cycle."""
    phase = 2 * np.pi * np.arange(round(cycles * samples) + 1) / samples
    return Motion(name, amplitude * np.sin(phase), phase[1] * amplitude / peak)


def _make_multisine(name: str, lines: Sequence[int], reach: float, speed: float) -> Motion:
    """Make a multisine of random phases, equal velocities on all `lines`, farthest position `reach`, rms velocity `speed`."""
    phases = np.random.default_rng(5).uniform(0.0, 2 * np.pi, len(lines))
    angle = 2 * np.pi * np.outer(np.arange(1201) / 1200, lines)
    wave = (np.sin(angle + phases) / lines).sum(axis=1)
    position = reach * (wave - wave[0]) / np.abs(wave - wave[0]).max()
    return Motion(name, position, float(np.sqrt(np.mean(np.diff(position) ** 2))) / speed)


def make_training() -> tuple[tuple[Motion, ...], tuple[Staircase, ...]]:
    """Make the training motions: slow loops, a sine through all regimes, and the steady friction at two loads."""
    motions = _make_sine("slow loops", 0.03, 0.03, 2.25, 400), _make_sine("sine", 0.5, 10.0, 1.5, 1000)
    return motions, (Staircase(LOAD), Staircase(SECOND_LOAD))


def make_held_out() -> tuple[tuple[Motion, ...], tuple[Motion, ...]]:
    """Make the held-out motions: other amplitudes, frequencies and paths at the training load; then other loads."""
    inner = _make_multisine("inner loops", (1, 2, 5, 7), 0.04, 0.03)
    wide = _make_multisine("multisine", (1, 2, 3, 5, 7), 0.5, 3.0)
    swing = PREDICTED_LOAD * (1.0 + np.sin(2 * np.pi * 4.3 * np.linspace(0.0, 1.0, wide.position.size)) / 3.0)
    small, slow = _make_sine("small slow loops", 0.01, 0.03, 2.25, 400), _make_sine("slow sine", 0.25, 1.0, 1.25, 800)
    return (small, inner, slow, _make_sine("fast sine", 0.5, 25.0, 1.5, 1000), wide), (
        replace(inner, load=PREDICTED_LOAD, name="inner loops, load 1.5"),
        replace(wide, load=PREDICTED_LOAD, name="multisine, load 1.5"),
        replace(wide, load=swing, name="multisine, load 1 to 2"),
    )


Build = Callable[[Values], FrictionModel]
Record = tuple[Motion | Staircase, Array]  # a motion, and its friction


def _make_builders(elements: MaxwellSlip) -> dict[str, tuple[Build, tuple[str, ...]]]:
    """Make a builder of each model from named values, and list the names of values that are not of the Stribeck curve."""
    stiffness, weights = elements.stiffness, elements.limits / elements.limits.sum()

    def make_curve(p: Values) -> Stribeck:
        return Stribeck(*(p[name] for name in STRIBECK.names))

    def make_gms(p: Values) -> GMS:
        return GMS(make_curve(p), stiffness, weights, p["attraction"] * p["static_force"])

    def make_xgms(p: Values) -> XGMS:
        static = p["static_force"]
        shape = (p["beta"], p["stribeck_velocity"], p["viscous"] / static, p["exponent"], p["attraction"])
        return XGMS(Amontons(static / LOAD), stiffness, weights, *shape)

    return {
        "Coulomb": (lambda p: Coulomb(make_curve(p)), ()),
        "LuGre": (lambda p: LuGre(make_curve(p), p["stiffness"], p["damping"]), ("stiffness", "damping")),
        "GMS": (make_gms, ("attraction",)),
        "XGMS": (make_xgms, ("attraction",)),
    }


def identify_models(
    motions: Sequence[Motion], stairs: Sequence[Staircase], forces: Sequence[Array]
) -> dict[str, FrictionModel]:
    """Fit every model to the `forces` of `motions`, then `stairs`; return them by name. Each record is divided by its rms."""
    virgin, steady = from_loops(motions[0].position, forces[0]), forces[len(motions)]
    elements = fit_elements(virgin, CurvatureSpacing(0.5).place(virgin, ELEMENTS))
    curve = fit_least_squares(STRIBECK, SPEEDS, steady)
    common = {n: (v, *bounds) for n, v, bounds in zip(curve.names, curve.values, STRIBECK.bounds, strict=True)}
    extra = {
        "stiffness": (elements.stiffness.sum(), 0.01, 100.0),
        "damping": (1e-2 * curve["static_force"], 0.0, 1.0),
        "attraction": (100.0, 0.1, 1e5),
    }
    records: list[Record] = list(zip((*motions, *stairs), forces, strict=True))
    builds = _make_builders(elements).items()
    return {name: _fit_records(build, common | {x: extra[x] for x in own}, records) for name, (build, own) in builds}


def _fit_records(build: Build, free: Mapping[str, tuple[float, ...]], records: list[Record]) -> FrictionModel:
    """Fit one model to `records` by least squares; `free` has start, lowest and highest value of each parameter by name."""

    def build_from(theta: Array) -> FrictionModel:
        return build(dict(zip(free, map(float, theta), strict=True)))

    def compute_residual(theta: Array) -> Array:
        model = build_from(theta)
        return np.concatenate([(motion.predict(model) - force) / np.linalg.norm(force) for motion, force in records])

    start, *bounds = np.array(list(free.values())).T
    return build_from(minimise(compute_residual, list(free), start, np.transpose(bounds)).values)


def compute_nrmse(predicted: Array, force: Array) -> float:
    """Compute the rms of the error over the rms of `force` [-]."""
    return float(np.sqrt(np.mean((predicted - force) ** 2) / np.mean(force**2)))


def _pool_errors(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


@register_reproduction(
    "cross-level",
    "This project: XGMS identified on asperities with oil films predicts motions it has not seen",
    claim="identified on slow loops, one sine and steady friction at two loads, XGMS predicts every held-out motion better "
    "than Coulomb and LuGre, also under another and a moving load",
)
def cross_level(sheet: Sheet) -> None:
    """Identify on one part of the surface, predict on another."""
    here, elsewhere = make_contact(1), make_contact(2)
    motions, stairs = make_training()
    trained = [*(motion.measure(here) for motion in motions), *(staircase.measure(here) for staircase in stairs)]
    sheet.progress(1, 3)
    models = identify_models(motions, stairs, trained)
    sheet.progress(2, 3)
    known, others = make_held_out()
    pairs = [(motion, motion.measure(elsewhere)) for motion in (*known, *others)]
    errors = {name: np.array([compute_nrmse(m.predict(model), f) for m, f in pairs]) for name, model in models.items()}
    floor = np.array([compute_nrmse(m.measure(here), f) for m, f in pairs])
    _draw(sheet, list(zip(stairs, trained[-2:], strict=True)), models, pairs, errors, floor)
    sheet.table = [("held-out motion", *(f"{name} [-]" for name in errors), "repeat [-]")]
    for i, (motion, _) in enumerate(pairs):
        sheet.table.append((motion.name, *(f"{e[i]:.3f}" for e in (*errors.values(), floor))))

    at_load = {name: _pool_errors(e[: len(known)]) for name, e in errors.items()}
    other = {name: _pool_errors(e[len(known) :]) for name, e in errors.items()}
    coulomb, lugre, gms, xgms = at_load.values()
    repeat = _pool_errors(floor[: len(known)])
    sheet.check("training load, rms of the NRMSE of five motions: XGMS below LuGre below Coulomb, and at most 0.1",
                xgms < lugre < coulomb and xgms <= 0.1, [xgms, lugre, coulomb])  # fmt: skip
    inner = [motion.name for motion in known].index("inner loops")
    sheet.check("inner loops, which need non-local memory: NRMSE of XGMS at most half of LuGre's",
                errors["XGMS"][inner] <= 0.5 * errors["LuGre"][inner],
                [errors["XGMS"][inner], errors["LuGre"][inner]])  # fmt: skip
    worst = float((errors["XGMS"] / np.minimum(errors["LuGre"], errors["Coulomb"])).max())
    sheet.check("NRMSE of XGMS over the lower one of LuGre's and Coulomb's, largest of all motions: below 1",
                worst < 1.0, worst)  # fmt: skip
    sheet.check("training load: GMS as good as XGMS within 10 %, as only the load divides them", abs(gms / xgms - 1.0) < 0.1,
                gms / xgms)  # fmt: skip
    sheet.check("other loads, rms of the NRMSE of three motions: XGMS below LuGre and Coulomb times the load, and at most 0.15",
                other["XGMS"] < min(other["LuGre"], other["Coulomb"]) and other["XGMS"] <= 0.15,
                [other["XGMS"], other["LuGre"], other["Coulomb"]])  # fmt: skip
    sheet.check("XGMS at the training load over the asperities' own repeat on another part of the surface: at most 3",
                xgms <= 3.0 * repeat, xgms / repeat)  # fmt: skip
    stiffness = _measure_stiffness(here, PREDICTED_LOAD) / _measure_stiffness(here, LOAD)
    sheet.note(
        f"under load 1.5 the asperities are {stiffness:.2f} times as stiff (more of them touch), XGMS 1, GMS times the load "
        "1.5 times: which is nearer in inner loops depends on the part of the surface"
    )
    sheet.note(
        "more load lets the tips ride at a higher speed only; the friction coefficient of XGMS over the speed stays"
    )
    sheet.note("models that ignore the load are multiplied by load over training load, in fit and prediction")
    sheet.note(
        f"{COUNT} asperities as in fig 2.26; NRMSE: rms error over rms force; repeat: the asperities' own force elsewhere"
    )


def _measure_stiffness(asperities: GenericRayleighModel, load: float) -> float:
    """Measure the total stiffness of the asperities that touch under `load`, undeflected."""
    return float(asperities.trace(np.array([0.0, 1e-6]), 1.0, load).force[-1] / 1e-6)  # far below any break-away


def _draw(
    sheet: Sheet,
    stairs: Sequence[tuple[Staircase, Array]],
    models: dict[str, FrictionModel],
    pairs: Sequence[tuple[Motion, Array]],
    errors: dict[str, Array],
    floor: Array,
) -> None:
    (steady, loop), (swing, dots) = sheet.make_axes(2, 2, width=13, height=9)
    velocity = np.geomspace(SPEEDS[0], SPEEDS[-1], 200)
    for marker, (staircase, force) in zip("os", stairs, strict=True):
        load = staircase.load
        steady.semilogx(
            SPEEDS, force / load, marker, color=REFERENCE_COLOUR, ms=5, label=f"asperities, load {load / LOAD:g}"
        )
    steady.semilogx(velocity, models["XGMS"].steady_state(velocity, LOAD) / LOAD, "C0", label="XGMS, any load")
    steady.set_ylim(0.0, 0.2)
    steady.legend(fontsize=8, loc="lower left")
    label_axes(steady, "V over that at which a tip begins to ride [-]", r"$F_f/W$ [-]", "training: steady friction")
    for axes, index in ((loop, 1), (swing, 7)):
        motion, force = pairs[index]
        across = motion.position if axes is loop else motion.dt * np.arange(force.size)
        axes.plot(across, force, color=REFERENCE_COLOUR, lw=3.0, alpha=0.35, label="asperities")
        for name in ("LuGre", "XGMS"):
            axes.plot(across, motion.predict(models[name]), color=COLOURS[name], lw=1.2, label=name)
        axes.set_ylim(top=1.7 * float(force.max()))  # room for the legend
        axes.legend(fontsize=8, ncols=3, loc="upper left")
    label_axes(loop, "x [step heights]", r"$F_f$ [total $k_t$ x step height]", "held out: inner loops")
    label_axes(swing, "time [-]", r"$F_f$ [total $k_t$ x step height]", "held out: multisine, load from 1 to 2")
    rows = np.arange(len(pairs))[::-1]
    for name, values in errors.items():
        dots.semilogx(values, rows, "D" if name == "GMS" else "o", color=COLOURS[name], ms=7, label=name, alpha=0.8)
    dots.semilogx(floor, rows, "|", color=REFERENCE_COLOUR, ms=14, mew=2, label="repeat")
    dots.set_yticks(rows, [motion.name for motion, _ in pairs])
    dots.set_xlim(0.01, 2.0)
    dots.set_ylim(-0.6, len(pairs) + 0.3)
    dots.legend(fontsize=8, ncols=5, loc="upper left")
    label_axes(dots, "rms error over rms force [-]", "", "held-out motions")

"""Figure 4.17: the Stribeck curve and the regimes of lubrication, by the Generic-Rayleigh model."""

from dataclasses import replace

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import FlatSurface
from plant_sim.friction.generic import GenericModel
from plant_sim.friction.generic_rayleigh import GenericRayleighModel
from plant_sim.friction.tip_film import SlidingThreshold, TipFilm

Array = np.ndarray
TIPS, LOAD = 200, 0.03  # number; W in (total k_t) x (step height), as in figures 2.25 and 2.26
MU = 0.15  # dry, as there. It is constant because the stick time does not matter in steady sliding
SPEEDS = np.geomspace(0.03, 300.0, 41)  # over the speed at which a tip with the mean load begins to ride
TRAVEL, SAMPLES = 10.0, 100  # step heights, -; chosen: four times both change the friction by less than 1e-10


def _make_model() -> GenericRayleighModel:
    friction = StickTimeFriction(MU, MU, 1.0)
    dry = GenericModel(Asperities.draw(TIPS, np.random.default_rng(2)), FlatSurface(), friction)
    film = TipFilm(alpha=1.5, length=2e-4, step=4e-6, area=1e-6, viscosity=1.0)
    needed = film.ratio(film.gap_at(MU)) * LOAD / TIPS / film.area
    film = replace(film, viscosity=needed / film.sliding_per_velocity)
    return GenericRayleighModel(dry, film, SlidingThreshold.at_friction(film, MU))


def _measure_at(model: GenericRayleighModel, speed: float) -> tuple[float, float, float, float]:
    """Measure steady sliding at `speed`.

    Return the friction coefficient, the share of the load on films, the mean film h of the tips on films, and the number of
    tips in dry contact.
    """
    position = np.linspace(0.0, TRAVEL, SAMPLES)
    run = model.observe(position, position[1] / speed, LOAD)
    tips, gaps, film = model.dry.asperities, model.gaps(run.state), model.film
    riding = gaps > 0.0
    lifted = np.where(riding, film.step * (gaps - model.threshold.gap), 0.0)
    load = tips.normal_stiffness * np.maximum(1.0 - tips.height - run.separation[-1] + lifted, 0.0)  # 2.4, lifted
    thick = float(gaps[riding].mean()) if riding.any() else 0.0
    dry = float(((load > 0.0) & ~riding).sum())
    return float(run.force[-1]) / LOAD, float(load[riding].sum() / load.sum()), thick, dry


@register_reproduction(
    "figure-4.17", "Stribeck curve and lubrication regimes",
    claim="boundary: asperities bear the load, friction as dry; mixed: film and asperities, friction falls;"
          " hydrodynamic: the film bears all of it, friction rises",
)  # fmt: skip
def reproduce_figure_4_17(sheet: Sheet) -> None:
    """Steady sliding over four decades of speed."""
    model = _make_model()
    mu, borne, thick, dry = np.array([_measure_at(model, speed) for speed in SPEEDS]).T
    boundary, film = borne < 0.02, borne > 0.98
    above, below = sheet.make_axes(2, 1, width=9, height=6.5, sharex=True, height_ratios=(2, 1))
    above.semilogx(SPEEDS, mu, lw=1.6)
    above.set_ylim(0.0, None)
    above.axhline(MU, color=REFERENCE_COLOUR, ls="--", lw=0.8)
    below.semilogx(SPEEDS, borne, lw=1.6)
    for panel in (above, below):
        for edge in (SPEEDS[boundary][-1], SPEEDS[film][0]):
            panel.axvline(edge, color="0.6", lw=1.0)
    edges = (SPEEDS[0], SPEEDS[boundary][-1], SPEEDS[film][0], SPEEDS[-1])
    for i, name in enumerate(("boundary", "mixed", "hydrodynamic")):
        above.text((edges[i] * edges[i + 1]) ** 0.5, 0.45, name, ha="center")
    label_axes(above, "", "friction coefficient [-]", "vertical: 2 and 98 % of the load on films; dashed: dry friction")
    label_axes(below, "speed over that at which a mean tip rides [-]", "share of load on films [-]")
    mixed = ~boundary & ~film
    sheet.check("the regimes follow each other: share of the load on films goes from 0 to 1, never back by more than 0.02",
                bool(np.diff(borne).min() > -0.02 and borne[0] < 0.02 and borne[-1] > 0.98), borne[[0, 20, -1]],
                "boundary, mixed, full")  # fmt: skip
    sheet.check("boundary: friction is the dry one within 1 %", float(np.abs(mu[boundary] / MU - 1.0).max()) < 0.01,
                mu[boundary], "similar to dry friction")  # fmt: skip
    sheet.check("mixed: friction falls, from its begin to its end, by 10 % or more", mu[mixed][-1] < 0.9 * mu[mixed][0],
                mu[mixed][[0, -1]], "falls")  # fmt: skip
    lowest = int(np.argmin(mu))
    sheet.check("beyond the minimum friction rises with every speed", bool(np.all(np.diff(mu[lowest:]) > 0.0)),
                [SPEEDS[lowest], mu[lowest], mu[-1]], "rises")  # fmt: skip
    grows = bool(np.all(np.diff(thick[film]) > 0.0))
    sheet.check(
        "hydrodynamic: the film grows with every speed [h, first and last]", grows, thick[film][[0, -1]], "lift-up"
    )
    sheet.check("tips that touch without a film: none at the highest speed", dry[-1] == 0.0, dry[[0, -1]],
                "the number of contacting asperities decreases")  # fmt: skip
    sheet.note("the figure is a drawing without numbers. Chosen here: 200 tips on a flat surface, mu 0.15, film as in"
               " figure-2.25; h is the film under a tip in heights of its own step, not the gap of two rough bodies"
               " that figure 4.17 compares with R")  # fmt: skip

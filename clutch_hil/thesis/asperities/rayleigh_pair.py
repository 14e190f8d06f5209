"""Two Rayleigh steps back to back: friction and lift-up in reciprocating motion (section 2.3.4).

Parameters are those of `rayleigh_step.py`, which says why they were chosen.
"""

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.asperities.rayleigh_step import (
    ALPHA,
    ASYMPTOTE,
    FRICTION_LABEL,
    NUMBER_LABEL,
    SAMPLES,
    SLOPE,
    Loop,
    simulate_periodic,
)
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.step_bearing import StepBearing

PAIR = (1, -1)  # directions of the two steps
FREQUENCIES = (0.5, 1.0, 2.0, 5.0, 10.0)  # f of fig 2.19
SQUEEZE_NUMBER = 3e-3  # Pa; chosen: the largest friction of fig 2.19 is then that of its axis, 8e-3 Pa


def _simulate_pair() -> list[Loop]:
    """Simulate two steps back to back; Lambda/W is a cosine of amplitude 5."""
    bearing = StepBearing(ALPHA, SLOPE, SQUEEZE_NUMBER, 0.0, PAIR)
    return [simulate_periodic(bearing, 1.0, -10.0, f, start=5.0) for f in FREQUENCIES]


@register_reproduction(
    "figure-2.19",
    "Two Rayleigh steps back to back: friction in reciprocating motion",
    claim="two steps back to back allow reciprocating motion, with friction lag at every frequency",
)
def reproduce_figure_2_19(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    numbers = np.linspace(ASYMPTOTE + 1e-3, 5.0, 600)
    static = StepBearing(ALPHA, SLOPE, SQUEEZE_NUMBER, 0.0, PAIR).stribeck(numbers, 1.0)
    axes.plot(numbers, static, color=REFERENCE_COLOUR, ls="--", lw=1.0, label="Stribeck")
    axes.plot(-numbers, -static, color=REFERENCE_COLOUR, ls="--", lw=1.0)
    loops = _simulate_pair()
    for f, loop in zip(FREQUENCIES, loops, strict=True):
        axes.plot(loop.number, loop.friction, label=f"f = {f:g}")
    axes.set_ylim(-0.01, 0.01)
    axes.legend()
    label_axes(axes, NUMBER_LABEL, FRICTION_LABEL)
    half = SAMPLES // 2
    odd = max(
        float(np.abs(loop.friction[half:-1] + loop.friction[:half]).max() / loop.friction.max()) for loop in loops
    )
    sheet.check("friction half a cycle later is opposite, relative difference", odd < 1e-6, odd, "both branches alike")
    quarter = SAMPLES // 4
    ratios = [float(loop.friction[half + quarter : -1].mean() / loop.friction[:quarter].mean()) for loop in loops]
    sheet.check("friction accelerating over decelerating at Lambda > 0 is above 1", min(ratios) > 1.0, ratios, "lag")
    peak = max(float(loop.friction.max()) for loop in loops)
    sheet.check("friction stays finite below Lambda_0, where the Stribeck curve has none", bool(np.isfinite(peak)),
                f"{peak:.2g} Pa", "axis to 8e-3")  # fmt: skip
    sheet.note(
        f"W = 1 Pa, sigma = {SQUEEZE_NUMBER:g} Pa; the pressure of the cavitated step is cut in the friction too"
    )


@register_reproduction(
    "figure-2.20",
    "Two Rayleigh steps back to back: lift-up over displacement",
    claim="the lift-up height against the tangential displacement is a symmetric butterfly at every frequency",
)
def reproduce_figure_2_20(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    half, quarter = SAMPLES // 2, SAMPLES // 4
    loops, mirrored, lower = _simulate_pair(), [], []
    for f, loop in zip(FREQUENCIES, loops, strict=True):
        displacement = 5.0 / (2 * np.pi * f) * np.sin(2 * np.pi * np.arange(SAMPLES + 1) / SAMPLES)  # of Lambda/W
        axes.plot(displacement, loop.gap, label=f"f = {f:g}")
        mirrored.append(float(np.abs(loop.gap[half:-1] / loop.gap[:half] - 1.0).max()))
        lower.append(bool(loop.gap[half + quarter] < loop.gap[0] and loop.gap[quarter] < loop.gap[0]))
    axes.legend()
    label_axes(axes, r"displacement, $\int \Lambda/W\,dt$ [-]", "gap h [-]")
    sheet.check(
        "both directions give the same wing, relative difference", max(mirrored) < 1e-6, max(mirrored), "symmetric"
    )
    sheet.check("the film is thinner at both reversals than in the middle", all(lower), lower, "butterfly")
    crossing = [float(loop.gap[: half + 1 : half].std()) for loop in loops]
    open_wings = [float(np.abs(loop.gap[:quarter] - loop.gap[half:quarter:-1]).max()) for loop in loops]
    sheet.check("branches meet in the middle and part in the wings [h]", max(crossing) < 1e-6 < min(open_wings),
                open_wings, "butterfly")  # fmt: skip

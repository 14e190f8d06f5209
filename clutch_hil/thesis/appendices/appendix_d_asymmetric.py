"""Conditions on asymmetric hysteresis (thesis appendix D.3): figures D.5 and D.6."""

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.appendices.appendix_d import AMPLITUDE, LEGEND, make_path
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.identification.asymmetric import ShapedElements, TwoSidedElements, fit_two_sided
from plant_sim.friction.identification.maxwell_slip import virgin_force
from plant_sim.friction.identification.virgin_curve import VirginCurve
from plant_sim.friction.maxwell_slip import MaxwellSlip

# Sets of two elements, stiffness [N/um], limits [N]; chosen: of equal height, because a loop must close
UP = MaxwellSlip(np.array([2.0, 1.0]), np.array([2.0, 4.0]))
DOWN = MaxwellSlip(np.array([3.0, 1.0]), np.array([3.0, 3.0]))
LEVEL = MaxwellSlip(np.array([2.5, 0.5]), np.array([2.0, 4.0]))  # sum of stiffness as UP


@register_reproduction(
    "figure-D.5",
    "Drift due to different sums of stiffness, small stroke",
    claim="the output drifts towards the side with the larger sum of stiffness; with equal sums it does not",
)
def reproduce_figure_d_5(sheet: Sheet) -> None:
    """Small strokes of a pair of sets, in which no element slips."""
    stroke, cycles = 0.5, 12  # um, below the first break point
    left, right = sheet.make_axes(1, 2, width=10, height=4.5)
    pairs = {
        "k_up < k_down": TwoSidedElements(UP, DOWN, AMPLITUDE),
        "k_up = k_down": TwoSidedElements(UP, LEVEL, AMPLITUDE),
    }
    pairs["k_up > k_down"] = TwoSidedElements(DOWN, UP, AMPLITUDE)
    drifts, sums = [], []
    for colour, (name, pair) in zip(("tab:blue", REFERENCE_COLOUR, "tab:orange"), pairs.items(), strict=True):
        position, force = pair.play(np.tile([0.0, stroke], cycles + 1)[:-1], 20)
        drifts.append(force[-1] / cycles)
        sums.append(pair.equal_stiffness().violation * stroke)
        left.plot(position, force, lw=1, color=colour, label=name)
        right.plot(
            np.arange(cycles + 1), force[::40], "o-", ms=4, color=colour, label=f"{name}: {drifts[-1]:+.3g} N a cycle"
        )
    label_axes(left, "x [µm]", "h [N]", f"{cycles} cycles of {stroke:g} µm")
    label_axes(right, "cycle [-]", "h at x = 0 [N]", "drift")
    left.legend(loc="upper left", **LEGEND)
    right.legend(loc="upper left", **LEGEND)
    for axes in (left, right):
        axes.set_ylim(-7.5, 10.5)
    sheet.check("drift a cycle [N] has the sign of k_up - k_down", drifts[0] < 0.0 < drifts[2],
                drifts, "down for k_sum1 < k_sum2")  # fmt: skip
    sheet.check("and is their difference by the stroke [N]", bool(np.allclose(drifts, sums)), drifts, sums)
    sheet.check("none with equal sums, though the elements differ [N]", abs(drifts[1]) < 1e-12, drifts[1], "0")
    early, late = (_simulate_elements(pairs["k_up = k_down"], stroke, n) for n in (6, 200))
    sheet.note(
        "branches follow the virgin curve of their side (eq D.1). Elements that keep their own force, with equal sums, give "
        f"{early:.2g} N after 6 cycles and {late:.2g} N after 200: each drifts to its limit unless its own two stiffnesses are "
        "equal, so that equal sums are necessary, not sufficient"
    )


def _simulate_elements(pair: TwoSidedElements, stroke: float, cycles: int) -> float:
    """Simulate elements with a stiffness and a limit for each direction that keep their own force; return the output [N]."""
    force = np.zeros(2)
    for _ in range(cycles):
        force = np.minimum(force + pair.up.stiffness * stroke, pair.up.limits)
        force = np.maximum(force - pair.down.stiffness * stroke, -pair.down.limits)
    return float(force.sum())


@register_reproduction(
    "figure-D.6",
    "Asymmetric hysteresis of two elements",
    claim="the output must return through the extreme it left; two sets hardly can for every reversal, a shaped set can",
)
def reproduce_figure_d_6(sheet: Sheet) -> None:
    """Return from a reversal (2) towards the maximum (1), for pairs of sets and for a shaped one."""
    pair = TwoSidedElements(UP, DOWN, AMPLITUDE)
    left, right = sheet.make_axes(1, 2, width=11, height=4.8)
    position, force = pair.play(np.array([-AMPLITUDE, AMPLITUDE, -AMPLITUDE]), 400, -6.0)
    left.plot(position, force, color="tab:gray", label="outer loop")
    inner_x, inner = pair.play(np.array([AMPLITUDE, AMPLITUDE - 4.0, AMPLITUDE]), 200, force[400])
    left.plot(inner_x, inner, color="tab:blue", label="to (2) and back")
    for place, name, shift in (
        ((AMPLITUDE, force[400]), "(1)", (5, -3)),
        ((inner_x[200], inner[200]), "(2)", (-18, -6)),
    ):
        left.plot(*place, "o", color=REFERENCE_COLOUR, ms=4)
        left.annotate(name, place, shift, textcoords="offset points", fontsize=9)
    gap = force[400] - inner[-1]
    label_axes(
        left,
        "x [µm]",
        "h [N]",
        f"two sets, two elements: passes {abs(gap):.2g} N {'below' if gap > 0 else 'above'} (1)",
    )
    left.legend(loc="upper left", **LEGEND)
    strokes = np.linspace(0.0, 2.0 * AMPLITUDE, 401)
    x = np.linspace(0.0, AMPLITUDE, 801)
    curves = VirginCurve(x, virgin_force(UP, x)), VirginCurve(x, virgin_force(DOWN, x))
    points = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 10.0])
    tied = fit_two_sided(*curves, points)
    shaped = ShapedElements(UP, np.array([0.3]), AMPLITUDE)
    shaped_gap = [_measure_gap(shaped, stroke) for stroke in strokes[1::20]]
    right.plot(strokes, pair.gap(strokes), color="tab:blue", label="two sets")
    right.plot(strokes, tied.gap(strokes), color="tab:orange", label="two sets, sums and heights tied")
    right.plot(strokes[1::20], shaped_gap, "o", ms=3, color="tab:green", label="one set, shaped by g(x)")
    label_axes(right, "stroke to (2) [µm]", "return below (1) [N]", "gap against the stroke")
    right.legend(loc="upper right", **LEGEND)
    expected = float(pair.gap(4.0))
    sheet.check(
        "gap at (1) after a stroke of 4 µm [N] is 2 (f_down - f_up)(2 µm)", abs(gap - expected) < 1e-9, gap, expected
    )
    free, bound = pair.return_through_extreme(), tied.return_through_extreme()
    sheet.check("two sets do not return through (1), largest gap [N]", not free.holds, free.violation, "must return")
    slope, sums = float(pair.gap(1e-6)) / 1e-6, pair.equal_stiffness().violation
    sheet.check("condition 1 is the slope of the gap at no stroke [N/µm]", abs(slope + sums) < 1e-6, slope, -sums)
    last = float(tied.gap(2.0 * AMPLITUDE))
    sheet.check("tied: equal sums, and the full loop closes, gap [N]",
                tied.equal_stiffness().holds and abs(last) < 1e-6, last, "0")  # fmt: skip
    sheet.check("tied: between, a gap stays [N]", not bound.holds, bound.violation, "difficult or impossible")
    worst = float(np.max(np.abs(shaped_gap)))
    sheet.check("shaped: returns through (1) after every stroke, largest gap [N]", worst < 1e-9, worst, "a solution")
    sheet.note(
        "the gap vanishes for every stroke only if both virgin curves are the same: two sets that differ cannot meet the "
        "second condition. The thesis's way out, a symmetric loop multiplied with a function of x, meets it exactly"
    )


def _measure_gap(shaped: ShapedElements, stroke: float) -> float:
    """Measure by how much the force [N] misses the maximum on the return to it, after a `stroke` [um] away."""
    force = shaped.force(make_path([0.0, AMPLITUDE, -AMPLITUDE, AMPLITUDE, AMPLITUDE - stroke, AMPLITUDE], 50))
    return float(force[150] - force[-1])

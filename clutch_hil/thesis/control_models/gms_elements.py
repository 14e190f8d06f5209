"""How many elements a GMS model needs: the claims of section 5.5."""

import numpy as np
from scipy.optimize import least_squares, nnls

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.gms import GMS
from plant_sim.friction.model import Array
from plant_sim.friction.stribeck import Stribeck


@register_reproduction(
    "elements",
    "How many elements a GMS model needs",
    claim="4 elements nearly as good as 10 (Tjahjowidodo [9], sec. 5.5); for gross sliding one element is enough",
)
def reproduce_elements(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=12, height=4.5)
    counts = (1, 2, 3, 4, 6, 10)
    dt, seconds = 1e-3, 8.0
    time = np.arange(round(seconds / dt)) * dt
    pre_sliding = 2e-5 * (np.sin(2 * np.pi * 0.5 * time) + 0.6 * np.sin(2 * np.pi * 1.7 * time)) * np.minimum(time, 1.0)
    sliding = 5e-3 * (1.0 - np.cos(2 * np.pi * 1.0 * time))
    truth, models = _make_smooth_model(), {n: _fit_elements(n) for n in counts}
    rows = {}
    for name, position in (("pre-sliding", pre_sliding), ("gross sliding", sliding)):
        true = truth.trace(position, dt).force
        scale = float(np.sqrt(np.mean(true**2)))
        rows[name] = [
            float(np.sqrt(np.mean((models[n].trace(position, dt).force - true) ** 2))) / scale for n in counts
        ]
    for name, errors in rows.items():
        left.loglog(counts, errors, "o-", label=name)
    left.set_xticks(counts, [str(n) for n in counts])
    left.minorticks_off()
    left.legend()
    label_axes(left, "number of elements", "rms error over rms friction [-]", "Error")
    window = time >= 6.0
    right.plot(
        pre_sliding[window] * 1e6,
        truth.trace(pre_sliding, dt).force[window],
        color=REFERENCE_COLOUR,
        lw=2.5,
        alpha=0.4,
        label="truth",
    )
    for n, colour in ((1, "C1"), (4, "C0"), (10, "C2")):
        right.plot(
            pre_sliding[window] * 1e6,
            models[n].trace(pre_sliding, dt).force[window],
            color=colour,
            lw=1.0,
            label=f"N = {n}",
        )
    right.legend(loc="upper left")
    label_axes(right, "displacement [um]", "friction [N]", "Pre-sliding")

    by_count = dict(zip(counts, rows["pre-sliding"], strict=True))
    sheet.check(
        "pre-sliding: 4 elements err by less than 5 % of the friction",
        by_count[4] < 0.05,
        by_count[4],
    )
    ratio = by_count[4] / by_count[10]
    sheet.check("pre-sliding: 4 elements err by at most a fifth more than 10 (4 over 10)", ratio <= 1.2, ratio,
                "10 slightly better, not significant")  # fmt: skip
    sheet.check(
        "pre-sliding: one element errs by more than three times as much as four",
        by_count[1] > 3.0 * by_count[4],
        [by_count[1], by_count[4]],
    )
    position = 0.05 * time + 0.04 / (2 * np.pi) * np.sin(2 * np.pi * time)  # sliding without reversal
    one, ten = (models[n].trace(position, dt).force[time >= 0.5] for n in (1, 10))
    apart = float(np.abs(one - ten).max() / STATIC)
    sheet.check("gross sliding without reversal: 1 and 10 elements differ by rounding [of F_S]", apart < 1e-9, apart,
                "one is enough")  # fmt: skip
    back = rows["gross sliding"][0]
    sheet.check(
        "gross sliding with reversals: one element errs by less than 10 % of the friction",
        back < 0.1,
        back,
        "one is enough",
    )
    sheet.note(
        f"10 elements err by {by_count[10]:.1%} of the friction where 4 err by {by_count[4]:.1%}: the remaining error of 4 is "
        "visible unless measurements scatter by more than that, as those of Tjahjowidodo may do. On a measured"
        " contact (`microtribometer`) "
        "4 are as good as 10; on an axis with a better repeatability more elements reduce the error"
    )
    sheet.note(
        "truth: 200 elements on a smooth virgin curve x/(x + x_0) up to 60 um; break points and limits of N elements fitted to "
        "that curve, judged on other motions; the same Stribeck curve and C for all (chosen here; "
        "Tjahjowidodo fitted measurements)"
    )


# m, m, N: virgin curve x/(x + X_0), all slide at END; chosen: sizes of a machine's axis
X_0, END, STATIC = (8e-6, 6e-5, 30.0)


def _make_smooth_model() -> GMS:
    """Make the GMS model of 200 elements on the virgin curve itself."""
    points = np.geomspace(2e-7, END, 200)
    height = points / (points + X_0) * (END + X_0) / END
    slope = np.append(np.diff(np.append(0.0, height)) / np.diff(np.append(0.0, points)), 0.0)
    limits = -np.diff(slope) * points  # D.3, by differences
    return GMS(Stribeck(STATIC, 0.7, 5e-3, 50.0), STATIC * limits / points, limits / limits.sum(), 2000.0)


def _fit_elements(count: int) -> GMS:
    """Make a GMS model of `count` elements; fit break points and limits to the virgin curve by least squares."""
    position = np.linspace(0.0, END, 401)[1:]
    curve = position / (position + X_0) * (END + X_0) / END

    def compute_limits(points: Array) -> tuple[Array, Array]:
        share = np.minimum(position[:, None] / points, 1.0)  # of its limit that an element gives
        return share, nnls(np.vstack([share, np.full(count, 100.0)]), np.append(curve, 100.0))[0]  # sum 1

    def compute_residual(logarithms: Array) -> Array:
        share, weights = compute_limits(np.exp(logarithms))
        return share @ weights - curve

    start = np.log(np.geomspace(2e-6, END, count)) if count > 1 else np.log([X_0])
    points = np.exp(least_squares(compute_residual, start, bounds=(np.log(1e-7), np.log(1.01 * END))).x)
    weights = np.maximum(compute_limits(points)[1], 1e-9)
    weights /= weights.sum()
    return GMS(Stribeck(STATIC, 0.7, 5e-3, 50.0), STATIC * weights / points, weights, 2000.0)

"""Maxwell-slip identification of a symmetric loop (thesis appendix D.2): figures D.1 to D.4."""

from functools import cache
from itertools import pairwise

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.identification.break_points import CurvatureSpacing, EqualSpacing, Spacing
from plant_sim.friction.identification.maxwell_slip import compute_error, solve, virgin_force
from plant_sim.friction.identification.virgin_curve import VirginCurve, find_reversals, from_half_loop, from_loops
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Array

AMPLITUDE = 10.0  # um, of the position; figures D.1 to D.6 have no numbers; chosen: as in pre-sliding of steel
HEIGHT = 10.0  # N, virgin curve at AMPLITUDE; chosen: a round number
KNEE = 0.15  # of AMPLITUDE: the virgin curve is 1 - exp(-x/knee); chosen: most of its bend is then within the stroke
NOISE = 0.1  # N, of the measured force; chosen: 1 % of the height
CYCLES = 4  # of the record; chosen: enough to average noise
STROKE_SAMPLES = 400  # a stroke; chosen: straight pieces between them miss the curve by less than the noise
RULES: dict[str, Spacing] = {
    "equal": EqualSpacing(),
    "inverse to f'' (thesis)": CurvatureSpacing(),
    "inverse to √f'' (this project)": CurvatureSpacing(0.5),
}
LEGEND = {"fontsize": 8, "frameon": False}


@cache
def make_virgin_curve(knee: float = KNEE) -> VirginCurve:
    """Make a virgin curve [um, N] that bends within `knee` of AMPLITUDE."""
    x = np.linspace(0.0, AMPLITUDE, 4001)
    rise = 1.0 - np.exp(-x / (knee * AMPLITUDE))
    return VirginCurve(x, HEIGHT * rise / rise[-1])


def make_path(turns: list[float] | Array, samples: int = STROKE_SAMPLES) -> Array:
    """Make a path of positions through `turns`, with `samples` a stroke."""
    return np.append(np.concatenate([np.linspace(a, b, samples + 1)[:-1] for a, b in pairwise(turns)]), turns[-1])


@cache
def make_contact() -> MaxwellSlip:
    """Make the contact that is measured: 200 elements, so that its loops look smooth."""
    return solve(make_virgin_curve(), CurvatureSpacing(0.5).place(make_virgin_curve(), 200))


@cache
def simulate_record() -> tuple[Array, Array]:
    """Simulate a record [um, N] with noise: CYCLES times a full loop and one with an inner loop."""
    position = make_path(
        [0.0, AMPLITUDE, *[-AMPLITUDE, AMPLITUDE, -AMPLITUDE, 0.3 * AMPLITUDE, -0.4 * AMPLITUDE, AMPLITUDE] * CYCLES]
    )
    noise = np.random.default_rng(0).normal(0.0, NOISE, position.size)
    return position, make_contact().trace(position, 1.0).force + noise


@register_reproduction(
    "figure-D.1",
    "Measured hysteresis, cut at its reversals",
    claim="one half of the outer loop gives the parameters; of a symmetric loop both halves give the same",
)
def reproduce_figure_d_1(sheet: Sheet) -> None:
    """Cut a noisy record and reduce its two halves to virgin curves."""
    position, force = simulate_record()
    turns = find_reversals(position)
    up, down = (from_loops(position, force, side=side) for side in (1, -1))
    left, right = sheet.make_axes(1, 2, width=10, height=4.5)
    left.plot(position, force, lw=0.5, color="tab:gray", label="measured")
    for (a, b), colour in zip(pairwise(turns[:3]), ("tab:blue", "tab:orange"), strict=True):
        left.plot(position[a : b + 1], force[a : b + 1], lw=1, color=colour)
    left.plot(position[turns], force[turns], "o", ms=4, color=REFERENCE_COLOUR, label="reversals")
    label_axes(left, "x [µm]", "h [N]", "noisy record with inner loops; one stroke each way coloured")
    left.legend(loc="lower right", **LEGEND)
    right.plot(up.position, up.force, color="tab:orange", label="upper left half")
    right.plot(down.position, down.force, "--", color="tab:blue", label="lower right half")
    right.plot(
        make_virgin_curve().position, make_virgin_curve().force, ":", color=REFERENCE_COLOUR, label="of the contact"
    )
    label_axes(right, "x [µm]", "h [N]", "virgin curve from either half")
    right.legend(loc="lower right", **LEGEND)
    apart = float(np.abs(up.force - down(np.minimum(up.position, down.stroke))).max())
    sheet.check("the record is cut at each of its reversals", turns.size == 6 * CYCLES, turns.size, 6 * CYCLES)
    sheet.check("both halves give the same curve, apart at most [N]", apart < NOISE, apart, "the same")
    sheet.note(
        f"the thesis's figure has no numbers: amplitude {AMPLITUDE:g} µm, height {HEIGHT:g} N, noise "
        f"{NOISE:g} N are chosen here"
    )


@register_reproduction(
    "figure-D.2",
    "Virgin curve from hysteresis",
    claim="half a loop, halved in both directions, is the virgin curve, and the virgin curve gives back every branch (Masing)",
)
def reproduce_figure_d_2(sheet: Sheet) -> None:
    """Halve a branch, and rebuild loops that were not used from the virgin curve."""
    position = make_path([0.0, AMPLITUDE, -AMPLITUDE, AMPLITUDE, -0.4 * AMPLITUDE, 0.3 * AMPLITUDE])
    force = make_contact().trace(position, 1.0).force
    half = slice(2 * STROKE_SAMPLES, 3 * STROKE_SAMPLES + 1)
    virgin = from_half_loop(position[half], force[half])
    noisy = from_loops(*simulate_record())
    left, right = sheet.make_axes(1, 2, width=10, height=4.5)
    left.plot(position[half], force[half], color="tab:orange", label="upper left half of the loop")
    left.plot(virgin.position, virgin.force, color=REFERENCE_COLOUR, label="halved: virgin curve")
    left.plot(-AMPLITUDE, force[2 * STROKE_SAMPLES], "o", color=REFERENCE_COLOUR, ms=4)
    left.annotate(
        "(x_m, h_m)", (-AMPLITUDE, force[2 * STROKE_SAMPLES]), (10, 2), textcoords="offset points", fontsize=8
    )
    label_axes(left, "x [µm]", "h [N]", "A by B halved")
    left.legend(loc="lower right", **LEGEND)
    right.plot(position, force, color="tab:gray", lw=3, alpha=0.5, label="loop with an inner branch")
    wrong = []
    for i in range(1, 5):
        a, b = i * STROKE_SAMPLES, (i + 1) * STROKE_SAMPLES
        branch = virgin.branch(position[a : b + 1], position[a], force[a])
        wrong.append(np.abs(branch - force[a : b + 1]).max())
        right.plot(
            position[a : b + 1],
            branch,
            "--",
            lw=1,
            color=REFERENCE_COLOUR,
            label="rebuilt by eq D.1" if i == 1 else None,
        )
    label_axes(right, "x [µm]", "h [N]", "rebuilt from the virgin curve")
    right.set_ylim(-14.0, 11.0)
    right.legend(loc="lower right", **LEGEND)
    off = float(np.abs(noisy.force - make_virgin_curve()(np.minimum(noisy.position, AMPLITUDE))).max())
    # linear between points: 400 of them leave f'' d^2/8 of this curve
    coarse = HEIGHT / (KNEE * AMPLITUDE) ** 2 * (AMPLITUDE / STROKE_SAMPLES) ** 2 / 8.0
    sheet.check(
        "largest error of four rebuilt branches, two of the inner loop [N]", max(wrong) < 4.0 * coarse, max(wrong), "0"
    )
    sheet.check("the same from the noisy record [N], below its noise", off < NOISE, off, f"noise {NOISE:g}")
    sheet.note(
        f"the clean loop is sampled {STROKE_SAMPLES} times a stroke, which alone makes an error of {coarse:.1g} N"
    )


@register_reproduction(
    "figure-D.3",
    "One Maxwell-slip element and its behaviour",
    claim="an element is a spring of stiffness k_i up to its limit W_i, and slips at it in either direction",
)
def reproduce_figure_d_3(sheet: Sheet) -> None:
    """Play one element through two amplitudes."""
    stiffness, limit = 2.0, 5.0  # N/um, N; chosen: it slips at 2.5 um, a quarter of the amplitude
    element = MaxwellSlip(np.array([stiffness]), np.array([limit]))
    axes = sheet.make_axes(1, 1, width=6.5, height=4.5)
    position = make_path([0.0, AMPLITUDE, -AMPLITUDE, AMPLITUDE], 2000)
    force = element.trace(position, 1.0).force
    small = make_path([0.0, 2.0, -2.0, 2.0])
    axes.plot(position, force, color="tab:blue", label=f"amplitude {AMPLITUDE:g} µm")
    axes.plot(small, element.trace(small, 1.0).force, color="tab:orange", label="amplitude 2 µm: no slip")
    for level, name in ((limit, "$W_i$"), (-limit, "$-W_i$")):
        axes.axhline(level, color=REFERENCE_COLOUR, lw=0.7, ls=":")
        axes.annotate(name, (0.0, level), (0, 4 if level > 0 else -13), textcoords="offset points", fontsize=10)
    axes.annotate("$k_i$", (-6.4, 1.2), fontsize=11)
    label_axes(axes, "x [µm]", "F [N]")
    axes.set_ylim(-8.5, 6.5)
    axes.legend(loc="lower center", ncols=2, **LEGEND)
    loop = float(np.trapezoid(force[2000:], position[2000:]))
    expected = 4.0 * limit * (AMPLITUDE - limit / stiffness)
    slope = np.gradient(force[:2000], position[:2000])
    sheet.check("stiffness at the start, and once beyond W/k [N/µm]", slope[0] == stiffness and slope[-1] == 0.0,
                [slope[0], slope[-1]], [stiffness, 0.0])  # fmt: skip
    sheet.check("largest and smallest force [N]", force.max() == limit and force.min() == -limit,
                [force.max(), force.min()], [limit, -limit])  # fmt: skip
    sheet.check("work of one cycle [N µm], 4 W (A - W/k)", abs(loop - expected) < 1e-3 * expected, loop, expected)


@register_reproduction(
    "figure-D.4",
    "Virgin curve and break points",
    claim="straight pieces through the break points represent the curve; distances inverse to its second derivative are good",
)
def reproduce_figure_d_4(sheet: Sheet) -> None:
    """Elements by A k = b for three rules of placing break points, and the error with their number."""
    curve, numbers = make_virgin_curve(), (2, 3, 4, 6, 8, 10, 16, 24, 32)
    left, right = sheet.make_axes(1, 2, width=11, height=4.8)
    left.plot(curve.position, curve.force, color=REFERENCE_COLOUR, label="virgin curve")
    for colour, (name, rule) in zip(("tab:blue", "tab:orange", "tab:green"), RULES.items(), strict=True):
        points = rule.place(curve, 4)
        corners = np.append(0.0, points)
        left.plot(corners, np.append(0.0, curve(points)), "o-", ms=4, lw=1, color=colour, label=f"N = 4, {name}")
        errors = [compute_error(solve(curve, rule.place(curve, n)), curve) for n in numbers]
        right.loglog(numbers, errors, "o-", ms=4, color=colour, label=name)
        sheet.check(f"{name}: more break points, smaller largest error [N], N = 2..32", bool(np.all(np.diff(errors) < 0.0)),
                    errors, "smaller")  # fmt: skip
    label_axes(left, "x [µm]", "h [N]", "four elements")
    left.legend(loc="lower right", **LEGEND)
    label_axes(
        right, "number of elements N [-]", "largest error [N]", f"curve that bends within {KNEE:.0%} of its stroke"
    )
    right.set_xticks(numbers, [str(n) for n in numbers])
    right.minorticks_off()
    right.legend(loc="lower left", **LEGEND)
    points = CurvatureSpacing().place(curve, 10)
    model = solve(curve, points)
    through = float(np.abs(virgin_force(model, points) - curve(points)).max())
    sheet.check("the elements of A k = b run through all (x_i, h_i), off by [N]", through < 1e-9, through, "0")
    against_equal, against_both = [], []
    for number in (4, 10):  # the numbers that section 5.5 compares
        for knee in (0.05, 0.15, 0.3):
            bent = make_virgin_curve(knee)
            equal, thesis, root = (
                compute_error(solve(bent, rule.place(bent, number)), bent) for rule in RULES.values()
            )
            against_equal.append(thesis / equal)
            against_both.append(root / min(thesis, equal))
    text = "of curves that bend within 5, 15, 30 % of the stroke, N = 4 then N = 10"
    sheet.check(
        f"largest error, inverse to f'' by equal distances, {text}", max(against_equal) < 1.0, against_equal, "below 1"
    )
    sheet.check(f"largest error, inverse to √f'' by the better of the others, {text}", max(against_both) < 1.0,
                against_both, "(this project) below 1")  # fmt: skip
    sheet.note(
        "the error of a straight piece of length d is |f''| d²/8: equal for all pieces when d is inverse to the root of f''. "
        "Inverse to f'' itself, every element has the same stiffness; the points crowd in the knee and the last pieces are too "
        "long, so it beats equal distances only where few elements meet a sharp knee"
    )

"""Stribeck curves: the shapes of figures 1.7, 5.2 and 5.3."""

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.stribeck import Stribeck

LEGEND = {"fontsize": 8, "frameon": False}
SPEED = np.linspace(1e-4, 1.0, 4001)  # m/s, as the axis of figure 1.7
NO_SPEED = 1e-9  # m/s; chosen: far below any Stribeck velocity, but not at rest
FAST = 1e9  # m/s; chosen: far above any Stribeck velocity


@register_reproduction(
    "figure-1.7",
    "Friction force of the Stribeck and the viscous model",
    claim="from F_S the force falls, at a speed given by V_S, towards F_C = beta F_S; viscous friction raises it again",
)
def reproduce_figure_1_7(sheet: Sheet) -> None:
    """Eq 1.4 with its Stribeck and its viscous part."""
    static, beta, velocity, viscous, exponent = 1.5, 0.7, 0.02, 0.7, 1.0
    curve = Stribeck(static, beta, velocity, viscous, exponent)
    axes = sheet.make_axes(1, 1, width=8, height=4.8)
    both = np.concatenate([-SPEED[::-1], SPEED])
    x, total, stribeck, viscous_part = (
        np.insert(values, SPEED.size, np.nan) for values in (both, curve(both), curve.s(both), curve.f(both))
    )  # NaN: no line between the branches
    axes.plot(x, total, color="tab:blue", label="F_f, eq 1.4")
    axes.plot(x, stribeck, "--", lw=1, color="tab:orange", label="Stribeck part")
    axes.plot(x, viscous_part, ":", lw=1.2, color="tab:green", label="viscous part")
    axes.plot([0, 0], [-static, static], color="tab:blue")
    for level, name in ((static, "$F_S$"), (beta * static, "$F_C$"), (-beta * static, "$-F_C$"), (-static, "$-F_S$")):
        axes.axhline(level, lw=0.6, ls=":", color=REFERENCE_COLOUR)
        axes.annotate(name, (1.02, level), xycoords=("axes fraction", "data"), va="center")
    label_axes(axes, "sliding speed", "friction force")
    axes.set_ylim(-2.2, 2.2)
    axes.legend(loc="upper left", **LEGEND)
    force = curve(SPEED)
    lowest = int(np.argmin(force))
    bump = float(force[:lowest].max()) - static
    sheet.check(
        "force just above rest", bool(abs(curve(NO_SPEED) - static) < 1e-6), float(curve(NO_SPEED)), f"F_S = {static:g}"
    )
    rises = bool((np.diff(force[lowest:]) > 0.0).all())
    sheet.check("lowest force, inside the range of speeds and below F_S; from there it rises",
                rises and 0 < lowest < force.size - 1 and force[lowest] < static, force[lowest], "one minimum")  # fmt: skip
    sheet.check(
        "Stribeck part at high speed",
        bool(abs(curve.s(FAST) - beta * static) < 1e-6),
        float(curve.s(FAST)),
        "F_C = beta F_S",
    )
    passed = [float((static - Stribeck(static, beta, v).s(v)) / (static * (1.0 - beta))) for v in (0.01, 0.05, 0.25)]
    sheet.check("part of the fall done at the speed V_S, for V_S 0.01, 0.05, 0.25", bool(np.allclose(passed, np.exp(-1.0))),
                passed, "V_S indicates the transition")  # fmt: skip
    powers = (1.0 / 3.0, 1.0, 2.0)
    shaped = [float(np.log(Stribeck(1.0, 1.0, 1.0, 2.0, g).f(8.0) / 2.0) / np.log(8.0)) for g in powers]
    sheet.check(
        "power of speed in the viscous part, for gamma 1/3, 1, 2", bool(np.allclose(shaped, powers)), shaped, "gamma"
    )
    sheet.check("odd", bool(np.array_equal(curve(-SPEED), -force)), "F(-v) = -F(v)", "sign(v)")
    sheet.note(
        "F_S and F_C stand between 1 and 2 on the figure's axis; 1.5, 1.05, V_S = 0.02, C_v = 0.7 and gamma = 1 are "
        "chosen here. "
        "exp(-V_S/|v|) falls late: at V_S 37 % of the fall is done, at 10 V_S 90 %"
    )
    sheet.note(
        f"as it is flat at rest, viscous friction raises the force first, here by {bump:.1g}; eq 1.4 always does so"
    )


@register_reproduction(
    "figure-5.2",
    "Stribeck curve as a function of v_s and sigma_v",
    claim="v_s sets how fast the friction falls, sigma_v how it rises; v_s infinite and sigma_v 0 is Coulomb friction",
)
def reproduce_figure_5_2(sheet: Sheet) -> None:
    """Eq 4.1 over the ranges that the thesis gives."""
    velocities, factors = np.geomspace(0.25, 0.01, 5), np.geomspace(0.01, 1.0, 5)  # ranges of the thesis
    static, a_1, gamma = 1.0, 2.0, 1.0  # N, -, -; chosen: the falling and the rising part are both visible
    left, right = sheet.make_axes(1, 2, width=10.5, height=4.6, sharey=True)
    middle = float(velocities[2]), float(factors[2])
    first = [Stribeck.from_depth(static, a_1, float(v), middle[1], gamma) for v in velocities]
    second = [Stribeck.from_depth(static, a_1, middle[0], float(s), gamma) for s in factors]
    for curve, v in zip(first, velocities, strict=True):
        left.plot(SPEED, curve(SPEED), label=f"$v_s$ = {v:.3g}")
    for curve, s in zip(second, factors, strict=True):
        right.plot(SPEED, curve(SPEED), label=f"$\\sigma_v$ = {s:.3g}")
    coulomb = Stribeck.from_depth(static, a_1, np.inf, 0.0, gamma)
    for axes in (left, right):
        axes.plot(SPEED, coulomb(SPEED), color=REFERENCE_COLOUR, lw=1, ls=":", label="$v_s$ = ∞, $\\sigma_v$ = 0")
        axes.legend(loc="upper right", ncols=2, **LEGEND)
        axes.set_ylim(0.4, 1.95)
    label_axes(left, "speed v [m/s]", "S [N]", f"$\\sigma_v$ = {middle[1]:.3g}, $v_s$ from 0.25 to 0.01")
    label_axes(right, "speed v [m/s]", "", f"$v_s$ = {middle[0]:.3g}, $\\sigma_v$ from 0.01 to 1")
    half = [float(SPEED[np.argmax(c.s(SPEED) <= static * (1.0 - np.exp(-1.0) / a_1))]) for c in first]
    sheet.check(
        "speed at which 1/e of the fall is done [m/s]",
        bool(np.allclose(half, velocities, atol=3e-4)),
        half,
        list(velocities),
    )
    at_once = bool((np.diff([c(SPEED) for c in first], axis=0) <= 1e-12).all())
    sheet.check("a smaller v_s gives less friction at every speed", at_once, "at 4001 speeds", "falls sooner")
    rising = bool((np.diff([c(SPEED) for c in second], axis=0) > 0.0).all())
    ends = [float(c(1.0)) for c in second]
    sheet.check("a larger sigma_v gives more friction at every speed; S(1) [N]", rising, ends, "grows")
    spread = float(np.ptp(coulomb(SPEED)))
    sheet.check("v_s infinite, sigma_v 0: difference over all speeds [N]", spread == 0.0, spread, "0, Coulomb")
    sheet.note("the ranges are the thesis's; F_s = 1 N, a_1 = 2 and gamma = 1 are chosen here")


@register_reproduction(
    "figure-5.3",
    "Stribeck curve as a function of the normal force",
    claim="for a given v_s and sigma_v the Stribeck function is rescaled by F_s",
)
def reproduce_figure_5_3(sheet: Sheet) -> None:
    """Eq 4.1 for F_s from 0.1 to 2, also divided by F_s."""
    forces = np.linspace(0.1, 2.0, 6)  # range of the thesis
    left, right = sheet.make_axes(1, 2, width=10.5, height=4.6)
    curves = [Stribeck.from_depth(float(f), 2.0, 0.05, 0.3, 1.0) for f in forces]
    for curve, f in zip(curves, forces, strict=True):
        left.plot(SPEED, curve(SPEED), label=f"$F_s$ = {f:.3g} N")
        right.plot(SPEED, curve(SPEED) / f)
    label_axes(left, "speed v [m/s]", "S [N]", "one curve for each normal force")
    label_axes(right, "speed v [m/s]", "S/$F_s$ [-]", "divided by $F_s$: one curve")
    left.set_ylim(0.0, 2.9)
    left.legend(loc="upper right", ncols=2, **LEGEND)
    scaled = np.array([curve(SPEED) / f for curve, f in zip(curves, forces, strict=True)])
    spread = float(np.ptp(scaled, axis=0).max())
    sheet.check("S/F_s of all six, apart at most [-]", spread < 1e-12, spread, "one curve")
    minima = [float(SPEED[np.argmin(curve(SPEED))]) for curve in curves]
    sheet.check("speed of the minimum [m/s]", float(np.ptp(minima)) < 1e-12, minima, "the same")
    sheet.note("the range of F_s is the thesis's; a_1 = 2, v_s = 0.05 m/s, sigma_v = 0.3 and gamma = 1 are chosen here")

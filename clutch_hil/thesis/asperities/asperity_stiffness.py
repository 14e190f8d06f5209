"""Reproductions of one asperity: when stick ends (figure 2.3, appendix A), and normal and tangential stiffness (appendix B)."""

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.optimize import brentq

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.asperities import Asperities, StickTimeFriction
from plant_sim.friction.counter_surface import FlatSurface
from plant_sim.friction.generic import FixedSeparationModel, GenericModel
from plant_sim.friction.mindlin import Material, SphereOnFlat, stiffness_ratio
from plant_sim.friction.model import Array

# The axes of figures 2.3 and A.1 have numbers without units: x 0 to 3500, F 0 to 1.8. Chosen: a sample is 1e-3 step heights,
# and the coefficient makes the limit begin at 0.6 and end at 1.8, where the axis does.
FRICTION = StickTimeFriction(mu_0=0.5, mu_inf=1.5, tau=0.6)
VELOCITY, DEPTH, DT = 1.0, 1.0, 1e-3  # of the body; zeta; sampling step; chosen: 1 is the simplest
POISSON = 0.3  # -, of steel
REACH_DEPTH = stiffness_ratio(POISSON) * DEPTH  # c z of appendix A
OWN_VALUES_NOTE = (
    f"chosen here: mu {FRICTION.mu_0} to {FRICTION.mu_inf}, tau {FRICTION.tau}, zeta {DEPTH:g}, velocity {VELOCITY:g}, "
    f"nu {POISSON}"
)


def make_asperity(stiffness: float) -> Asperities:
    """Make a single asperity of tangential `stiffness` k_t."""
    return Asperities(np.zeros(1), np.zeros(1), np.array([stiffness]), poisson=POISSON)


def press_asperity(stiffness: float) -> FixedSeparationModel:
    """Make a single asperity of tangential `stiffness` k_t that is pressed by DEPTH into a flat surface."""
    return FixedSeparationModel(make_asperity(stiffness), FlatSurface(), FRICTION, 1.0 - DEPTH)


def find_end_of_stick(model: GenericModel, load: float = 1.0) -> float:
    """Find the position at which a body that is drawn at VELOCITY from rest first slips."""
    x = np.arange(0.0, 4.0, VELOCITY * DT)
    sticking = model.observe(x, DT, load).sticking
    return float(x[np.argmax(sticking < 1.0)])


def find_crossing(secant: float = 1.0) -> float:
    """Find where the spring force meets the friction limit: `secant` x = `secant` c z mu(x/v) (appendix A)."""
    return float(brentq(lambda x: secant * (x - REACH_DEPTH * FRICTION(x / VELOCITY)), 1e-9, 4.0))


@register_reproduction(
    "figure-2.3",
    "End of stick of one asperity",
    claim="stick ends where the linear spring force crosses the stick-time-dependent limit of the friction force",
)
def reproduce_figure_2_3(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, width=8, height=4.5)
    x = np.arange(0.0, 3.5, VELOCITY * DT)
    force = press_asperity(1.0).observe(x, DT).force
    ends, expected = x[1:][np.diff(force) < 0.0], find_crossing()
    axes.plot(x, x, color="C0", lw=1.0, label="spring $k_t x$")
    axes.plot(x, REACH_DEPTH * FRICTION(x / VELOCITY), color="C1", lw=1.2, label=r"limit $\mu(t)\,k_n\zeta$")
    axes.plot(x, force, color=REFERENCE_COLOUR, lw=1.8, label="asperity")
    axes.set_ylim(0.0, 2.2)
    axes.legend(loc="center right", frameon=False)
    label_axes(axes, "position x [step heights]", "tangential force F [-]")
    sheet.check(
        "position where stick ends, once, within one sample of the crossing",
        ends.size == 1 and abs(ends[0] - expected) <= VELOCITY * DT,
        ends,
        f"at the crossing, {expected:.4f}",
    )
    slip = REACH_DEPTH * FRICTION.mu_0
    sheet.check(
        "force in slip",
        bool(np.all(np.abs(force[x > expected + DT] - slip) < 1e-12)),
        force[-1],
        f"the limit at stick time 0, {slip:.4f}",
    )
    sheet.note(OWN_VALUES_NOTE)


@register_reproduction(
    "figure-A.1",
    "End of stick for different stiffnesses",
    claim="at constant normal displacement z stick ends at x = c z mu(t_x), the same for whatever stiffness",
)
def reproduce_figure_a_1(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=11, height=4.5)
    x = np.arange(0.0, 3.5, VELOCITY * DT)
    for stiffness, colour in ((0.5, "C0"), (1.0, "C1"), (1.5, "C2")):
        left.plot(x, stiffness * REACH_DEPTH * FRICTION(x / VELOCITY), color=colour, lw=0.9, ls="--")
        left.plot(x, press_asperity(stiffness).observe(x, DT).force, color=colour, label=f"$k_t$ = {stiffness}")
    left.axvline(find_crossing(), color=REFERENCE_COLOUR, lw=0.8, ls=":")
    left.legend(loc="upper left", frameon=False)
    label_axes(left, "position x [step heights]", "force F [-] (dashed: limit)", "constant normal displacement")
    stiffnesses = np.logspace(-1.0, 1.0, 9)
    displaced = np.array([find_end_of_stick(press_asperity(k)) for k in stiffnesses])
    load = REACH_DEPTH  # the load of the asperity of stiffness 1
    loaded = np.array(
        [find_end_of_stick(GenericModel(make_asperity(k), FlatSurface(), FRICTION), load) for k in stiffnesses[3:]]
    )
    right.loglog(stiffnesses, displaced, "o-", label="constant normal displacement")
    right.loglog(stiffnesses[3:], loaded, "s--", color="C3", label="constant normal load")
    right.legend(loc="lower left", frameon=False)
    label_axes(right, "tangential stiffness $k_t$ [-]", "position at the end of stick", "stick ends")
    sheet.check("end of stick, k_t 0.1 to 10, spread", bool(np.ptp(displaced) == 0.0), np.ptp(displaced), "the same")
    sheet.check(
        "end of stick, within one sample",
        abs(displaced[0] - find_crossing()) <= DT * VELOCITY,
        displaced[0],
        f"c z mu(t_x) = {find_crossing():.4f}",
    )
    sheet.check(
        "under constant normal load instead: falls with the stiffness",
        bool(np.all(np.diff(loaded) < 0.0)),
        loaded,
        '"constant normal displacement z" is the condition',
    )
    sheet.note(OWN_VALUES_NOTE)


@register_reproduction(
    "figure-A.2",
    "End of stick of a softening asperity",
    claim="the force is the integral of the tangent stiffness k_2 and k_1(x) x; with k_1 for the normal force the end of stick "
    "is that of the linear spring",
)
def reproduce_figure_a_2(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=11, height=4.5)
    softening = 2.0  # k_t/tau of appendix A; chosen: with k_t = 2 it makes F(infinity) = 1
    x = np.linspace(1e-6, 3.5, 3501)

    def compute_tangent(position: Array) -> Array:
        return 2.0 * np.exp(-softening * position)

    def compute_spring_force(position: Array) -> Array:
        return 2.0 / softening * (1.0 - np.exp(-softening * position))

    secant = compute_spring_force(x) / x
    integral = compute_spring_force(x[0]) + cumulative_simpson(compute_tangent(x), x=x, initial=0.0)
    left.plot(x, integral, color=REFERENCE_COLOUR, label="force F(x)")
    left.plot(x, secant, label="secant stiffness $k_1$")
    left.plot(x, compute_tangent(x), label="tangent stiffness $k_2$")
    left.legend(loc="upper right", frameon=False)
    label_axes(left, "position x", "F, $k_1$, $k_2$ [-]", "stiffness and force")
    limit = REACH_DEPTH * secant * FRICTION(x / VELOCITY)
    right.plot(x, compute_spring_force(x), color=REFERENCE_COLOUR, label="softening spring F(x)")
    right.plot(x, limit, color="C1", label=r"limit $\mu(t)\,c\,k_1 z$")
    right.axvline(find_crossing(), color=REFERENCE_COLOUR, lw=0.8, ls=":", label="end of stick, linear spring")
    right.legend(loc="upper right", frameon=False)
    label_axes(right, "position x", "F [-]", "crossing")
    sheet.check(
        "largest difference of integral of k_2 and k_1 x, below 1e-9",
        bool(np.abs(integral - secant * x).max() < 1e-9),
        np.abs(integral - secant * x).max(),
        "the same force",
    )
    ends = brentq(
        lambda p: compute_spring_force(p) - REACH_DEPTH * compute_spring_force(p) / p * FRICTION(p / VELOCITY),
        1e-6,
        3.5,
    )
    sheet.check(
        "end of stick of the softening spring, within 1e-9",
        abs(ends - find_crossing()) < 1e-9,
        ends,
        f"that of the linear spring, {find_crossing():.6f}",
    )
    sheet.note("the Generic model has linear springs; the softening one is drawn from the formulas of appendix A")
    sheet.note(OWN_VALUES_NOTE)


def make_mindlin_sphere(contact: SphereOnFlat, load: float, mu: float, springs: int) -> FixedSeparationModel:
    """Make the sphere as asperities of equal stiffness at depths z = x^2/R, under `load` [N] (dimensionality reduction).

    Its normal force is Hertz's and its friction Cattaneo's and Mindlin's exactly as the number of `springs` grows.
    """
    a = float(contact.contact_radius(load))
    x = (np.arange(springs) + 0.5) / springs * 2.0 * a - a
    stiffness = np.full(springs, 4.0 * contact.tangential_modulus * 2.0 * a / springs)
    body = Asperities(x, x**2 / contact.radius, stiffness, poisson=contact.sphere.poisson)
    separation = 1.0 - float(contact.deflection(load))
    return FixedSeparationModel(body, FlatSurface(), StickTimeFriction(mu, mu, 1.0), separation)


@register_reproduction(
    "appendix-B",
    "Sphere on a flat: normal and tangential stiffness",
    claim="for a contact in full stick between equal materials k_n/k_t = (2 - nu)/(2 (1 - nu)) (eq 2.1)",
)
def reproduce_appendix_b(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=11, height=4.5)
    steel = 210e9
    poissons = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    measured = []
    for poisson in poissons:
        contact = SphereOnFlat(0.01, Material(steel, poisson), Material(steel, poisson))
        load, nudge = 10.0, 1e-6
        depth = float(contact.deflection(load))
        k_n = (contact.load(depth * (1 + nudge)) - contact.load(depth * (1 - nudge))) / (2.0 * nudge * depth)
        k_t = nudge * load / contact.tangential_deflection(load, 1.0, nudge * load)
        measured.append(float(k_n / k_t))
    fine = np.linspace(0.0, 0.5, 100)
    left.plot(fine, [stiffness_ratio(nu) for nu in fine], color=REFERENCE_COLOUR, label="eq 2.1")
    left.plot(poissons, measured, "o", label="from deflections of appendix B")
    left.legend(loc="upper left", frameon=False)
    label_axes(left, "Poisson coefficient [-]", "$k_n/k_t$ [-]", "stiffness ratio")
    difference = np.abs(np.array(measured) / [stiffness_ratio(nu) for nu in poissons] - 1.0)
    sheet.check(
        "k_n/k_t from differences of the deflections, relative difference below 1e-5, nu 0 to 0.5",
        bool(difference.max() < 1e-5),
        difference.max(),
        "(2 - nu)/(2 (1 - nu))",
    )

    contact, load, mu = SphereOnFlat(0.01, Material(steel, 0.3), Material(steel, 0.3)), 10.0, 0.3
    used = np.linspace(0.0, 1.0, 201)
    closed = contact.tangential_deflection(load, mu, used * mu * load)
    model = make_mindlin_sphere(contact, load, mu, 2000)
    force = model.observe(np.append(closed, 1.2 * closed[-1]), 1.0).force
    right.plot(1e9 * closed, used * mu * load, color=REFERENCE_COLOUR, lw=3.0, alpha=0.4, label="Mindlin, appendix B")
    right.plot(1e9 * np.append(closed, 1.2 * closed[-1]), force, color="C1", label="Generic model, 2000 asperities")
    right.legend(loc="lower right", frameon=False)
    label_axes(
        right, "tangential displacement [nm]", "tangential force Q [N]", "steel sphere R = 10 mm, W = 10 N, mu = 0.3"
    )
    error = np.abs(force[:-1] / (mu * load) - used).max()
    sheet.check(
        "Generic model of the sphere (asperities at depths x^2/R): largest difference of Q/(mu W), below 1e-4",
        bool(error < 1e-4),
        error,
        "delta_t = 3 mu W/(16 a G*) (1 - (1 - Q/mu W)^(2/3))",
    )
    stiff = force[1] / closed[1]
    ratio = float(contact.normal_stiffness(load)) / stiff
    sheet.check(
        "k_n of Hertz over the model's first stiffness, within 0.5 %",
        abs(ratio / stiffness_ratio(0.3) - 1.0) < 0.005,
        ratio,
        f"{stiffness_ratio(0.3):.4f}, at Q = 0.005 mu W",
    )
    sheet.note("the appendix gives no numbers; sphere, load and coefficient are chosen here")

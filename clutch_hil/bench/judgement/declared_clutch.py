"""Declared clutch: numbers of one clutch, each within its bounds, that contradict each other.

What            of a slope, an intercept and a contact pressure that belong together one was changed alone, or one has another
                unit. Such a clutch jumps to a torque at the first touch, or carries none up to a higher pressure
Equation        M_C(p) and C_v(p), lines a p + b, are 0 at -b/a, and plates that only touch carry nothing:
                -b/a = p_contact                                                  Janssens 2010, Table 6.4 beside Table 6.3
                viscous share  C_v omega^gamma/M_C  at 10 rad/s
Limit           |-b/a - p_contact| > limit p_contact, three standard deviations of the shipped zero. Slope and intercept are
                each known within 2.8 % for M_C and 5.5 % for C_v (janssens2010.toml), so the zero within 4 and 8 %. The
                shipped zeros are 1.1 % below and 3.4 % above contact
                a viscous share of 2: four times the shipped 0.53, chosen
References      docs/rig.md, 4 and 5
"""

from collections.abc import Iterator, Mapping

# Line -> largest distance of its zero from the contact pressure, as a share of it; see Limit
_LIMITS = {"coulomb": 0.12, "viscous": 0.24}
_LINE = {"coulomb": "Coulomb torque", "viscous": "viscous torque"}
_SHARE, _SLIP = 2.0, 10.0  # -, rad/s: see Limit
# Group of the maps -> contact pressure, and how the intercept is left to the program
_KNOWN = {
    "clutch": ("piston.contact_pressure", ""),
    "model": ("model.contact_pressure", ", or leave it out: then it follows the contact pressure"),
}


def list_contradictions(parameters: Mapping[str, float], prefix: str = "") -> list[str]:
    """Return a sentence for each contradiction among `parameters` of a rig or of a controller, by dotted name, in their units.

    prefix: of the names of one of two clutches, such as `a.`.
    """
    return [
        sentence
        for group, (contact, remedy) in _KNOWN.items()
        for sentence in (
            *_find_shifted_lines(parameters, f"{prefix}{group}", f"{prefix}{contact}", remedy),
            *_find_viscous(parameters, f"{prefix}{group}"),
        )
    ]


def _find_shifted_lines(parameters: Mapping[str, float], group: str, contact_name: str, remedy: str) -> Iterator[str]:
    """Yield a sentence for each line that does not begin at the contact pressure."""
    contact = parameters.get(contact_name)
    for line, limit in _LIMITS.items():
        names = [f"{group}.{line}_{part}" for part in ("slope", "intercept")]
        slope, intercept = (parameters.get(name) for name in names)
        if contact is None or intercept is None or not slope:
            continue
        zero = -intercept / slope
        if abs(zero - contact) <= limit * contact:
            continue
        where = f"{contact_name} = {contact:g} bar, where the plates begin to touch"
        if zero < contact:
            unit = "Nm" if line == "coulomb" else "Nm/(rad/s)^gamma"
            what = f"is {slope * contact + intercept:.3g} {unit} at {where}, and not about 0"
        else:
            what = f"is 0 up to {zero:.3g} bar, far above {where}"
        yield (
            f"by {names[0]} = {slope:g} and {names[1]} = {intercept:g} the {_LINE[line]} {what}: {names[1]} ="
            f" {-slope * contact:.4g} would fit{remedy}"
        )


def _find_viscous(parameters: Mapping[str, float], group: str) -> Iterator[str]:
    """Yield a sentence if the torque is nearly all viscous."""
    names = [f"{group}.{name}" for name in ("viscous_slope", "coulomb_slope", "viscous_exponent")]
    viscous, coulomb, exponent = (parameters.get(name) for name in names)
    if viscous is None or exponent is None or not coulomb:
        return
    share = viscous * _SLIP**exponent / coulomb
    if share > _SHARE:
        yield (
            f"by {names[0]} = {viscous:g} and {names[1]} = {coulomb:g} the viscous torque at {_SLIP:g} rad/s is {share:.3g}"
            " times the Coulomb torque; it is about half of it on the shipped clutch: change slope and intercept of both lines"
            " by the same factor"
        )

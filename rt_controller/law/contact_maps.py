"""Friction maps of a clutch of which only contact pressure and slope are known: those that begin at this pressure.

What            a file that gives a contact pressure and no maps describes a clutch that is not identified. With the maps where
                they were, the estimate was 12 Nm at a contact of 3.5 bar, and the first engagement ended in a fault. So it is
                with a slope alone: ten times the slope gave 229 Nm at contact, and a hundredth of it a torque that is nearly
                all viscous
Equation        M_C(p) and C_v(p), lines a p + b, are 0 at -b/a; this pressure and the onset of beta keep their distance from
                the contact pressure:  b = -a (p_contact - d),  d = p_contact,shipped + b_shipped/a_shipped
                a of C_v keeps its ratio to a of M_C
Assumptions     a contact has the same friction coefficients as on the shipped clutch: number of contacts, radius and area of
                the piston multiply both slopes alike
References      the same shift as clutch_hil/identify/clutch_parameters.py, shift_pressures
"""

from collections.abc import Collection

from protocols.files.parameters import ParameterSet

_CONTACT, _ONSET = "model.contact_pressure", "model.beta_onset"
_COULOMB, _VISCOUS = "model.coulomb", "model.viscous"  # lines, each with a slope and an intercept


def shift_maps(parameters: ParameterSet, shipped: ParameterSet, given: Collection[str]) -> dict[str, float]:
    """Return what follows contact pressure and slope of `parameters` in the maps, by dotted name, in their units.

    Empty with contact pressure and slopes of the `shipped` parameters. given: names that the user set, which do not follow.
    Values keep their bounds.
    """
    contact, was = parameters[_CONTACT].value, shipped[_CONTACT].value
    following = {} if contact == was else {_ONSET: shipped[_ONSET].value + contact - was}
    for line in (_COULOMB, _VISCOUS):
        slope, intercept = f"{line}_slope", f"{line}_intercept"
        value = parameters[slope].value
        if line == _VISCOUS and slope not in given:
            value = shipped[slope].value * (parameters[f"{_COULOMB}_slope"].value / shipped[f"{_COULOMB}_slope"].value)
        if contact == was and value == shipped[slope].value:
            continue
        distance = was + shipped[intercept].value / shipped[slope].value  # bar, of the line's zero below contact
        following[intercept] = -value * (contact - distance)
        if value != parameters[slope].value:
            following[slope] = value
    bounds = {name: parameters[name].bounds for name in following}
    return {n: min(max(v, bounds[n][0]), bounds[n][1]) for n, v in following.items() if n not in given}

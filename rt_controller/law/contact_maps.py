"""Friction maps of a clutch of which only the contact pressure is known: those of the controller, from this pressure on.

What            a file that gives a contact pressure and no maps describes a clutch that is not identified. With the maps where
                they were, the estimate was 12 Nm at a contact of 3.5 bar, and the first engagement ended in a fault
Equation        M_C(p) and C_v(p), lines a p + b, are 0 at -b/a; this pressure and the onset of beta keep their distance from
                the contact pressure:  b = -a (p_contact - d),  d = p_contact,shipped + b_shipped/a_shipped
Assumptions     the slopes are the shipped ones, or those of the file
References      the same shift as clutch_hil/identify/clutch_parameters.py, shift_pressures
"""

from collections.abc import Collection

from protocols.files.parameters import ParameterSet

_CONTACT, _ONSET = "model.contact_pressure", "model.beta_onset"
_LINES = ("model.coulomb", "model.viscous")  # each with a slope and an intercept


def shift_maps(parameters: ParameterSet, shipped: ParameterSet, given: Collection[str]) -> dict[str, float]:
    """Return the intercepts and the onset that follow the contact pressure of `parameters`, by dotted name, in their units.

    Empty at the contact pressure of the `shipped` parameters. given: names that the user set, which do not follow. Values keep
    their bounds.
    """
    contact, was = parameters[_CONTACT].value, shipped[_CONTACT].value
    if contact == was:
        return {}
    following = {_ONSET: shipped[_ONSET].value + contact - was}
    for line in _LINES:
        slope, intercept = f"{line}_slope", f"{line}_intercept"
        distance = was + shipped[intercept].value / shipped[slope].value  # bar, of the line's zero below contact
        following[intercept] = -parameters[slope].value * (contact - distance)
    bounds = {name: parameters[name].bounds for name in following}
    return {n: min(max(v, bounds[n][0]), bounds[n][1]) for n, v in following.items() if n not in given}

"""Names under groups: two lines of names, the upper one of groups, as merged cells of a spreadsheet leave them.

`time,Clutch A,,Clutch B,` over `,Torque,Pressure,Torque,Pressure` are the names time, Clutch A Torque, Clutch A Pressure, ...
"""

from collections import Counter
from collections.abc import Sequence

_FEWEST_GROUPS = 2  # cells of a line of groups: a single one is a title


def name_by_groups(groups: Sequence[str], names: Sequence[str]) -> list[str] | None:
    """Return the names (n,) of columns, by a line of `groups` over one of `names`; None if the groups change no name.

    Without a name, a column has the name of its group. A name that several columns have begins with its group. These names must
    be different ones, else the upper line is none of groups.
    """
    if sum(map(bool, groups)) < _FEWEST_GROUPS:
        return None
    own = [name or group for group, name in zip(groups, names, strict=True)]
    counts = Counter(name for name in names if name)
    group = ""
    for number, (upper, lower) in enumerate(zip(groups, names, strict=True)):
        if upper:
            group = upper if lower else ""  # one without a name below is itself a name, of one column
        if counts[lower] > 1 and group:
            own[number] = f"{group} {lower}"
    given = [name for name in own if name]
    return own if own != list(names) and len(set(given)) == len(given) else None

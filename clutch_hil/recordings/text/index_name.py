"""Name of the index of pandas, which `to_csv` writes alone in a line below several lines of names."""

from collections.abc import Mapping, Sequence

from clutch_hil.recordings.text.lines import Line


def name_index(rows: Mapping[int, Sequence[str]], above: Sequence[Line]) -> dict[int, list[str]]:
    """Return cells of lines above the rows, in which the name of the first column is in the first line of names.

    `,torque,speed`, `,Nm,rpm` and `time,,`: the first line becomes `time,torque,speed`.
    """
    found = {number: list(row) for number, row in rows.items()}
    last = found.get(len(above) - 1, [])
    if len(last) < 3 or not last[0] or any(last[1:]):
        return found
    before = [number for number in range(len(above) - 1) if (row := found[number]) and not row[0] and all(row[1:])]
    if before and before == list(range(len(above) - 1))[-len(before) :]:
        found[before[0]][0] = last[0]
    return found

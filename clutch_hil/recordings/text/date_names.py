"""Names of a date and a time of day in two columns, for which the line of names has a single one: `Time` or `Time,,Torque`."""

from collections.abc import Sequence

from clutch_hil.recordings.text.lines import Line, split


def name_date_and_time(row: Sequence[str], line: Line, delimiter: str, widths: tuple[int, int], date: int) -> list[str]:
    """The cells of a line above rows, with the common name for the times, and for the dates before them.

    row: cells of the line, empty where it has not as many as a row. widths: of a row, without and with the empty cells at its
    end. date: index of the column of dates.
    """
    cells = list(row)
    if not cells:
        cells = [" ".join(cell.split()) for cell in split(line.text, delimiter)]
        if len(cells) != widths[0] - 1 or not all(cells):
            return []
        cells.insert(date, cells[date])
        cells += [""] * (widths[1] - len(cells))
    name, other = cells[date : date + 2]
    if name and other in ("", name):
        cells[date : date + 2] = [f"{name} (date)", name]
    return cells

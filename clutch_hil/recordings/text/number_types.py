"""Types of numbers in a line above the rows of a text file: f8, LREAL, DBL."""

import re
from collections.abc import Sequence

from clutch_hil.recordings.unit_in_name import strip_brackets

# Names of types of numbers: of ETAS, LabVIEW, IEC 61131-3, NumPy and C. A line of them tells how a tool keeps its columns
_TYPE = re.compile(
    r"[fiur](?:4|8|16|32|64)|float(?:16|32|64)?|double|single|half|l?real(?:32|64)?|bool(?:ean)?(?:_t)?|string"
    r"|u?(?:byte|word|long|char|short)|s(?:byte|word|long)|[dl]word|u?[sdl]?int(?:8|16|32|64)?(?:_t)?|dbl|sgl|ext",
    re.IGNORECASE,
)


def are_types(row: Sequence[str]) -> bool:
    """Whether the cells are types of numbers."""
    given = [strip_brackets(cell) for cell in row if cell]
    return bool(given) and all(map(_TYPE.fullmatch, given))

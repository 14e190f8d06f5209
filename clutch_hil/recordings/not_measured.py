"""Columns of a run that were not measured: constants and formulas in the import map from which it was made."""

import re
from collections.abc import Collection, Mapping

from protocols.files.run import Run

NotMeasured = Mapping[str, float | str]  # by column: the constant in its unit, or the text of the formula


def read_not_measured(run: Run) -> dict[str, float | str]:
    """Return the columns of a run that were not measured. Invalid metadata of other programs are ignored."""
    origin = run.metadata.get("import")
    given = origin.get("not_measured") if isinstance(origin, Mapping) else None
    if not isinstance(given, Mapping):
        return {}
    return {str(column): value for column, value in given.items() if isinstance(value, (int, float, str))}


def find_source(given: NotMeasured, column: str, among: Collection[str]) -> str:
    """Return the first column of `among` in the formula of `column`; "" if there is none, or it was measured."""
    formula = given.get(column)
    words = re.findall(r"\w+", formula) if isinstance(formula, str) else []
    return next((word for word in words if word in among), "")

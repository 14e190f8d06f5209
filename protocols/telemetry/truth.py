"""Truth: columns of a blind plant that are not published, but written to a sealed file (clutch_hil/bench/sealed.py)."""

_TRUTH = "truth_"  # prefix of columns that only a simulation knows
_WORK = "plant_work_us"  # reveals injections: a cycle in which one begins takes longer


def reveals_truth(column: str) -> bool:
    """Return whether a column reveals the true plant parameters, or when they were changed."""
    return column.startswith(_TRUTH) or column == _WORK

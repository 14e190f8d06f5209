"""Blind: what nobody but a truth file (clutch_hil/bench/sealed.py) is told of a plant whose truth is kept back."""

_TRUTH = "truth_"  # how the names of columns begin that only a simulation knows
_WORK = "plant_work_us"  # a cycle in which an injection begins takes longer


def tells_truth(column: str) -> bool:
    """Whether a column of a record tells what the plant is, or when it was changed."""
    return column.startswith(_TRUTH) or column == _WORK

"""Finding: what a check sees in a recording, in a sentence that says what to do."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from protocols.errors import InputError, name_run

_MOST_LISTED = 4  # hard findings in an error message: one sentence, and the first ones explain the others


@dataclass(frozen=True)
class Finding:
    """What the check `check` sees in `column` of the run `run`.

    rows: the first and the last row concerned, from 0. text: a sentence with the numbers seen and what to do. hard: nothing is
    to be concluded from such a recording.
    """

    check: str
    column: str
    rows: tuple[int, int]
    text: str
    hard: bool
    run: str = ""

    def __str__(self) -> str:
        """The sentence with run, column and rows."""
        where = f"{name_run(self.run)}: " if self.run else ""
        first, last = self.rows
        rows = f"row {first}" if first == last else f"rows {first} to {last}"
        return f"{where}{self.column}, {rows}, {self.text}"

    def as_json(self) -> dict[str, Any]:
        """The finding in report.json and in the metadata of an imported run."""
        return vars(self) | {"rows": list(self.rows)}


def refuse_hard(findings: Sequence[Finding], option: str = "--force") -> None:
    """Raise InputError where some of `findings` are hard. option: of the command, that goes on all the same; "" for none."""
    if hard := [str(finding) for finding in findings if finding.hard]:
        further = f"; and {len(hard) - _MOST_LISTED} more" if len(hard) > _MOST_LISTED else ""
        all_the_same = f"; {option}, force=True from Python, goes on in spite of it, with a note" if option else ""
        raise InputError(f"{'; '.join(hard[:_MOST_LISTED])}{further}{all_the_same}")

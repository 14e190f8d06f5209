"""Report: the files that present a `Result`.

report.json     the result for machines
report.html     the page that is read from top to bottom
atlas.png       where measurement and model disagree
gap.png         the error before and after, on runs that were not fitted
evidence.rrd    measured, before and after for the viewer
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from clutch_hil.discrepancy.result import Result
from protocols.files.output_file import whole_file

if TYPE_CHECKING:
    from clutch_hil.discrepancy.report.residuals import Regimes

JSON, PAGE, ATLAS, GAP, EVIDENCE, MODEL = (
    "report.json", "report.html", "atlas.png", "gap.png", "evidence.rrd", "model.toml",
)  # fmt: skip
REPORT_FILES = (JSON, PAGE, ATLAS, GAP, EVIDENCE)  # the files that `write_report` writes


def write_report(result: Result, folder: Path, regimes: "Regimes | None" = None, command: str = "") -> list[Path]:
    """Write the report to `folder`, replacing an older one; return the paths of its files.

    regimes: returns samples (n,) by regime from the columns of a run, to mark them in pictures. command: the command line that
    made the result. Raises InputError naming a file that cannot be written.
    """
    # loading takes a second of CPU; a search without a report, as in a program, does not need it
    from clutch_hil.discrepancy.report.html_page import compose_page
    from clutch_hil.discrepancy.report.pictures import Pictures
    from clutch_hil.discrepancy.report.residuals import Residuals
    from clutch_hil.discrepancy.report.rrd import write_evidence

    residuals = Residuals(result, regimes)
    pictures = Pictures(residuals)
    document = json.dumps(_convert_values(result.as_json()), indent=1, ensure_ascii=False, default=str, allow_nan=False)
    files = {JSON: document.encode(errors="replace"), ATLAS: pictures.draw_atlas()}
    gap = pictures.draw_gap()
    if gap is not None:
        files[GAP] = gap
    model = [MODEL] if (folder / MODEL).exists() else []
    page = compose_page(pictures, [*files, EVIDENCE, *model], command)
    files[PAGE] = page.encode(errors="replace")
    for name, content in files.items():
        with whole_file(folder / name) as part:
            part.write_bytes(content)
    write_evidence(residuals, folder / EVIDENCE)
    return [folder / name for name in (*files, EVIDENCE)]


def _convert_values(thing: Any) -> Any:
    """Return `thing` for JSON: NumPy numbers as Python numbers, null for infinities and not-a-number."""
    if isinstance(thing, dict):
        return {str(key): _convert_values(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [_convert_values(value) for value in thing]
    if hasattr(thing, "tolist"):
        return _convert_values(thing.tolist())
    if isinstance(thing, float) and not math.isfinite(thing):
        return None
    return thing

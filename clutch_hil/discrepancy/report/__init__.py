"""Report: everything that shows a `Result`, made from nothing else.

report.json     the result for machines
report.html     the page that is read from top to bottom
atlas.png       where measurement and model disagree
gap.png         the error before and after, on runs that were not fitted
evidence.rrd    measured, before and after for the viewer
"""

import json
import math
from pathlib import Path
from typing import Any

from clutch_hil.discrepancy.report.page import page_text
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.residuals import Regimes, Residuals
from clutch_hil.discrepancy.report.rrd import write_evidence
from clutch_hil.discrepancy.result import Result
from protocols.files.run import whole_file

JSON, PAGE, ATLAS, GAP, EVIDENCE, MODEL = (
    "report.json", "report.html", "atlas.png", "gap.png", "evidence.rrd", "model.toml",
)  # fmt: skip


def write_report(result: Result, folder: Path, regimes: Regimes | None = None, command: str = "") -> list[Path]:
    """Write the files of this package into `folder`, in place of older ones; return their paths.

    `regimes` gives from the columns of a run the samples of each regime, by the names that claims have, to mark them in
    pictures; `command` is what was typed. Raises InputError naming a file that cannot be written.
    """
    residuals = Residuals(result, regimes)
    pictures = Pictures(residuals)
    document = json.dumps(_finite(result.as_json()), indent=1, ensure_ascii=False, default=str, allow_nan=False)
    files = {JSON: document.encode(errors="replace"), ATLAS: pictures.atlas()}
    gap = pictures.gap()
    if gap is not None:
        files[GAP] = gap
    model = [MODEL] if (folder / MODEL).exists() else []
    page = page_text(pictures, [*files, EVIDENCE, *model], command)
    files[PAGE] = page.encode(errors="replace")
    for name, content in files.items():
        with whole_file(folder / name) as part:
            part.write_bytes(content)
    write_evidence(residuals, folder / EVIDENCE)
    return [folder / name for name in (*files, EVIDENCE)]


def _finite(thing: Any) -> Any:
    """The same with null for what JSON has no number for, and plain numbers for numpy's."""
    if isinstance(thing, dict):
        return {str(key): _finite(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [_finite(value) for value in thing]
    if hasattr(thing, "tolist"):
        return _finite(thing.tolist())
    if isinstance(thing, float) and not math.isfinite(thing):
        return None
    return thing

"""docs/python.md: every example runs, and every public name has one."""

import re
import subprocess
import sys
from pathlib import Path

import clutch_hil as ch

PAGE = Path(__file__).parents[3] / "docs" / "python.md"
PATIENCE = 600.0  # s for what takes a minute on an idle machine


def test_the_page_runs_as_a_script_and_has_every_public_name(tmp_path: Path, local_bus: str) -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert not [name for name in ch.__all__ if f"ch.{name}" not in page]
    script = tmp_path / "page.py"
    script.write_text("\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL)), encoding="utf-8")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert "named: torque_sensor_offset" in done.stdout
    assert {"run.parquet", "run.png", "sweep.png", "figure.png", "report"} <= {path.name for path in tmp_path.iterdir()}

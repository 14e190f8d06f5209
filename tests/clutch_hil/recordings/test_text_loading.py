"""What a process loads to import a text file: nothing that only other formats need."""

import subprocess
import sys
from pathlib import Path

from tests.clutch_hil.recordings.text_files import MAP, make_table

IMPORT = """
import sys
from pathlib import Path
from clutch_hil.recordings.import_map import load_map
from protocols.files.runs import write_run
run = load_map(sys.argv[2]).read(Path(sys.argv[1]))
write_run(run, Path(sys.argv[1]).with_suffix(".parquet"))
print([name for name in ("pandas", "numba", "cantools", "asammdf", "h5py") if name in sys.modules])
"""


def test_a_text_file_is_imported_without_pandas_and_numba(tmp_path: Path) -> None:
    lines = make_table().splitlines()
    lines[20] = lines[20].replace(lines[20].split(",")[1], "NaN")
    recording, toml = tmp_path / "recording.csv", tmp_path / "map.toml"
    recording.write_text("\n".join([*lines, ""]))
    toml.write_text(f"[file]\nresample_hz = 100.0\n{MAP}")
    command = [sys.executable, "-c", IMPORT, str(recording), str(toml)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120.0)
    assert answer.stdout.strip() == "[]"

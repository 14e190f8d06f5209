"""Maps in tests: a recording imported by the text of a map, or the sentence that refuses it."""

from pathlib import Path

import pytest

from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from protocols.files.run import Run


def import_by(tmp_path: Path, recording: Path, text: str) -> Run:
    """The run that the map `text` makes of a recording."""
    toml = tmp_path / "map.toml"
    toml.write_text(text, encoding="utf-8")
    return load_map(str(toml)).read(recording)


def find_refusal(tmp_path: Path, recording: Path, text: str) -> str:
    """The one line that refuses a recording with the map `text`."""
    with pytest.raises(InputError) as refused:
        import_by(tmp_path, recording, text)
    assert "\n" not in str(refused.value)
    return str(refused.value)

"""Sealed recording: write a run file without the truth, and a truth file with everything.

The truth file is the whole run as it would be without `--blind`. The run file has its columns without the truth. Of the
metadata it has only those that reveal nothing about the truth, and the name and SHA-256 of the truth file. So the run file
alone does not show what was done to the plant. A changed truth file has another SHA-256. A changed run file differs from its
truth file.
"""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from clutch_hil.bench.recording import Recording
from plant_sim.effects.catalogue import load_effects
from protocols.errors import InputError
from protocols.files.disk import Disk
from protocols.files.runs import RunWriter
from protocols.node import Column
from protocols.telemetry.truth import reveals_truth

SEAL = "sealed"  # key of a blind run's metadata: the truth file's name and SHA-256
_SUFFIX = ".truth.parquet"
# Metadata of a blind run. Others, such as the name of a scenario or a seed, may hint at the truth.
_PUBLIC_KEYS = (
    "rig", "sample_rate_hz", "recorded_at", "time_zero", "versions", "controller_parameters", "bus", "interrupted",
    "incomplete", "record_rows_lost",
)  # fmt: skip
_PUBLIC_SETTINGS = ("rate", "seconds", "law", "adaptation", "mode")


class SealedRecording(Recording):
    """A `Recording` that also writes a truth file to `folder`, or beside the run file if that is None. Raises InputError.

    `finish` takes the metadata of a run that is not blind. `truth` is the path of the truth file.
    """

    def __init__(
        self,
        path: Path,
        plant: Sequence[Column],
        controllers: Sequence[Sequence[Column]],
        rate: int,
        folder: Path | None = None,
        disk: Disk | None = None,
    ) -> None:
        self.truth = make_truth_path(path, folder)
        super().__init__(path, plant, controllers, rate, disk)

    @property
    def _journal_of(self) -> Path:
        return self.truth  # the journal contains the truth, so it is named after the truth file

    def _make_writer(self, path: Path, columns: Sequence[Column]) -> RunWriter:
        return SealedWriter(path, columns, self.truth, self._disk)


class SealedWriter(RunWriter):
    """A `RunWriter` of the run at `path` that also writes its truth file at `truth`."""

    def __init__(self, path: Path, columns: Sequence[Column], truth: Path, disk: Disk | None = None) -> None:
        if truth.exists():
            raise InputError(f"truth file {truth} exists already; move it away, or give another folder")
        self._truth_path = truth
        self._public = [i for i, column in enumerate(columns) if not reveals_truth(column.name)]
        self._truth = RunWriter(truth, columns, disk)
        try:
            super().__init__(path, [columns[i] for i in self._public], disk)
        except BaseException:
            self._truth.__exit__(None, None, None)
            raise

    def append(self, rows: np.ndarray) -> None:
        """Add `rows`, shape (samples, columns with the truth)."""
        self._truth.append(rows)
        super().append(rows[:, self._public])

    def finish(self, metadata: Mapping[str, Any]) -> None:
        """Finish the truth file with all `metadata`, seal it, and finish the run with the public metadata."""
        self._truth.finish(metadata)
        seal = {"file": self._truth_path.name, "sha256": compute_checksum(self._truth_path)}
        super().finish(select_public_metadata(metadata) | {SEAL: seal})

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self._truth.__exit__(kind, error, trace)
        if not self._finished:
            self._truth_path.unlink(missing_ok=True)


def make_truth_path(path: Path, folder: Path | None = None) -> Path:
    """Return the path of the truth file of the blind run at `path`: beside it, or in `folder`."""
    return (folder or path.parent) / f"{path.stem}{_SUFFIX}"


def select_public_metadata(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return those `metadata` of a whole run that a blind run contains."""
    public = _select(metadata, _PUBLIC_KEYS)
    public["settings"] = select_public_settings(metadata.get("settings", {}))
    public["plant_parameters"] = {
        name: value
        for name, value in metadata.get("plant_parameters", {}).items()
        if name.partition(".")[0] not in load_effects()
    }
    return public


def select_public_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return those `settings` that a blind run contains."""
    return _select(settings, _PUBLIC_SETTINGS)


def _select(mapping: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return {name: mapping[name] for name in names if name in mapping}


def compute_checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

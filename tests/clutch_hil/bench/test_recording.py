"""Recording: each plant row with the terms of the cycle that answered it, in whatever order and pieces the rows come."""

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.recording import Recording, make_writable
from clutch_hil.bench.recovery import recover_folder
from protocols.errors import InputError
from protocols.files.disk import Disk, be_full, have_no_fault
from protocols.files.run import Run
from protocols.files.runs import REQUIRED, read_run
from protocols.node import Column

RATE = 1000
ROWS = 70_000  # more than the recording lets wait
PLANT = [Column(name, "1", name) for name in REQUIRED]
CONTROLLER = [Column("sample_tick", "1", "tick"), Column("torque_demand_nm", "Nm", "M_d")]
NOTHING = np.empty((0, len(PLANT))), np.empty((0, len(CONTROLLER)))
UNANSWERED = np.array([5, 6, 20_500, 20_501, 41_000])  # ticks that no cycle saw


def make_plant_rows() -> np.ndarray:
    rows = np.ones((ROWS, len(PLANT)))
    rows[:, 0] = np.arange(ROWS) / RATE
    return rows


def make_controller_rows() -> np.ndarray:
    ticks = np.setdiff1d(np.arange(ROWS), UNANSWERED)
    return np.column_stack([ticks, 0.5 * ticks])


def record_rows(path: Path, pieces: Iterable[tuple[np.ndarray, np.ndarray]]) -> Run:
    with Recording(path, PLANT, [CONTROLLER], RATE) as recording:
        for plant, controller in pieces:
            recording.add(plant, controller)
        recording.finish({})
    return read_run(path)


def cut_rows(size: int, late: int) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Pieces of `size` rows, the controller's `late` rows after the plant's."""
    plant, controller = make_plant_rows(), make_controller_rows()
    for k in range(0, ROWS + late, size):
        yield plant[k : k + size], NOTHING[1]
        if k >= late:
            yield NOTHING[0], controller[k - late : k - late + size]


@pytest.mark.parametrize(("size", "late"), [(ROWS, 0), (20, 0), (1000, 1000), (1000, 30_000)])
def test_every_row_has_the_terms_of_the_cycle_that_answered_it(tmp_path: Path, size: int, late: int) -> None:
    run = record_rows(tmp_path / "run.parquet", cut_rows(size, late))
    ticks = np.arange(ROWS, dtype=float)
    for tick in UNANSWERED:  # the cycle before still acts there
        ticks[tick] = ticks[tick - 1]
    np.testing.assert_array_equal(run["controller_sample_tick"], ticks)
    np.testing.assert_array_equal(run["torque_demand_nm"], 0.5 * ticks)


def test_rows_do_not_wait_for_a_controller_for_ever(tmp_path: Path) -> None:
    with Recording(tmp_path / "run.parquet", PLANT, [CONTROLLER], RATE) as recording:
        for k in range(0, ROWS, 1000):
            recording.add(make_plant_rows()[k : k + 1000], NOTHING[1])
        assert recording.rows == 0
        recording.add(make_plant_rows()[:15_000] + np.eye(1, len(PLANT)) * (ROWS / RATE), NOTHING[1])
        assert recording.rows > 0
        recording.finish({})
    assert np.isnan(read_run(tmp_path / "run.parquet")["controller_sample_tick"]).all()


def record_on(disk: Disk, path: Path) -> None:
    """Record 5000 rows; after 2000 of them the disk is full, until the recording is left."""
    with Recording(path, PLANT, [CONTROLLER], RATE, disk) as recording:
        recording.keep_journal({})
        for k in range(0, 5000, 1000):
            recording.add(make_plant_rows()[k : k + 1000], make_controller_rows()[k : k + 1000])
            disk.before_write = be_full if k == 1000 else have_no_fault


def test_of_a_full_disk_the_rows_that_are_told_are_those_that_can_be_recovered(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    with pytest.raises(InputError, match=r"No space left on device; the 2000 samples until then are in .*journal"):
        record_on(Disk(), path)
    assert not path.exists()
    recover_folder(tmp_path, lambda _: None)
    assert len(read_run(path)["time_s"]) == 2000


@pytest.mark.parametrize("early", [True, False], ids=["while rows come", "before its end"])
def test_of_a_folder_that_is_removed_the_rows_are_told_as_lost(tmp_path: Path, early: bool) -> None:
    path = tmp_path / "gone" / "run.parquet"

    def record() -> None:
        with Recording(path, PLANT, [CONTROLLER], RATE) as recording:
            recording.keep_journal({})
            recording.add(make_plant_rows()[:1000], make_controller_rows()[:1000])
            shutil.rmtree(path.parent)
            if early:
                recording.add(make_plant_rows()[1000:2000], make_controller_rows()[1000:2000])
            recording.finish({})

    with pytest.raises(InputError, match=r"the \d+ samples until then are lost") as sentence:
        record()
    assert "was removed" in str(sentence.value) or "No such file" in str(sentence.value)
    assert not path.parent.exists()


def test_a_new_folder_with_the_name_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.parquet would be a folder, .* give a folder, such as .*run$"):
        make_writable(tmp_path / "run.parquet")
    assert not (tmp_path / "run.parquet").exists()
    assert make_writable(tmp_path / "v1.2").is_dir()  # other names may have points


def test_a_folder_that_a_person_made_may_have_any_name(tmp_path: Path) -> None:
    (tmp_path / "all.csv").mkdir()
    assert make_writable(tmp_path / "all.csv").is_dir()

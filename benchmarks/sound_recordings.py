"""Sound recordings: a small valid file of each format, for damaged copies, and how each copy is read.

Copies must pass the opening, otherwise they do not test the readers: so a log has a database, and a text has a suitable map.
"""

import json
import resource
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.logged_frames import CAR, write_mf4
from benchmarks.mutations import MOST_KIB, Reach, assert_sentence, play_copy, read_recording
from clutch_hil.bench.faults.damage import mutate
from protocols.errors import InputError
from protocols.files.child_reader import MOST_SECONDS, ChildReader
from protocols.files.runs import read_columns

_ROWS = 200
_TIME = 0.01 * np.arange(_ROWS)
_COLUMNS = {"time_s": _TIME, "torque_nm": np.sin(_TIME), "speed_rad_s": 100.0 + _TIME}
_MAP = """[file]
longest_gap_s = 1.0
resample_hz = 50.0
low_pass_hz = 10.0
{file}
[columns]
time_s = {{ from = "{time}", unit = "s" }}
torque_nm = {{ from = "{torque}", unit = "Nm", unit_from = "map" }}
speed_rad_s = {{ from = "{speed}", unit = "rpm", unit_from = "map" }}
"""
_MAT_HEAD, _MAT_DEFLATED = 128, 15  # bytes of the head of a file of level 5; its type of a deflated variable
_FILES_OF_A_CHILD = 100  # copies read by one process before the next begins: limits a leak or an undetected heap error
_CHILD_SECONDS = 120  # s of CPU time for them


@dataclass(frozen=True)
class Sound:
    """A valid file: name of its format, `file` that `damage` copies, and `play`, which returns how far a copy gets."""

    name: str
    file: Path
    play: Callable[[Path], Reach]
    damage: Callable[[bytes, int, int], Iterator[bytes]] = mutate


def make_files(folder: Path) -> Iterator[Sound]:
    """Write a small valid file of each format into `folder`."""
    yield from _list_tables(folder)
    yield from _list_measurements(folder)
    yield from _list_hdf5_files(folder)
    yield from _list_bus_logs(folder)


def describe_file(path: Path) -> Sound:
    """Return a user's file, without a map, as a Sound."""
    from clutch_hil.recordings.format import recognise

    return Sound(path.name, path, partial(play_copy, whole=recognise(path).order < 2))


def _import_by_map(folder: Path, file: Path, name: str, whole: bool = True, run: bool = False, **keys: str) -> Sound:
    """Return a Sound that is imported by a map, and read as a run if `run`."""
    names = {"time": "time_s", "torque": "torque_nm", "speed": "speed_rad_s", "file": ""} | keys
    map_file = folder / f"{file.name}.toml"
    map_file.write_text(_MAP.format(**names), encoding="utf-8")

    def play(copy: Path) -> Reach:
        if run:
            try:
                read_columns(copy)
            except InputError as error:
                assert_sentence(error)
        return play_copy(copy, map_file=map_file, whole=whole)

    return Sound(name, file, play)


def _list_tables(folder: Path) -> Iterator[Sound]:
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.feather
    import pyarrow.parquet

    table = pa.table(_COLUMNS)
    csv, text, parquet, feather = (
        folder / name for name in ("sound.csv", "sound.txt", "sound.parquet", "sound.feather")
    )
    pyarrow.csv.write_csv(table, csv)
    lines = [f"{t:.3f};{m:.4f};{w:.3f}".replace(".", ",") for t, m, w in zip(*_COLUMNS.values(), strict=True)]
    text.write_text("\r\n".join(["Bench 3", "", "time;torque;speed", "s;Nm;1/min", *lines]), encoding="cp1252")
    pyarrow.parquet.write_table(table, parquet)
    pyarrow.feather.write_feather(table, feather)
    yield _import_by_map(folder, csv, "CSV", whole=False, run=True)
    yield _import_by_map(folder, text, "text of a logger", whole=False, time="time", torque="torque", speed="speed")
    yield _import_by_map(folder, parquet, "Parquet", run=True)
    yield _import_by_map(folder, feather, "Feather")
    objects, columns = folder / "sound.jsonl", folder / "sound.json"
    objects.write_text("".join(json.dumps(row) + "\n" for row in table.to_pylist()))
    columns.write_text(json.dumps({"units": {"torque_nm": "Nm"}} | table.to_pydict()))
    yield _import_by_map(folder, objects, "JSON, objects", whole=False)
    yield _import_by_map(folder, columns, "JSON, columns", whole=False)


def _list_measurements(folder: Path) -> Iterator[Sound]:
    import asammdf
    import nptdms
    import scipy.io

    time, others = _TIME, {name: _COLUMNS[name] for name in ("torque_nm", "speed_rad_s")}
    for version, compression in (("4.10", 2), ("4.10", 0), ("3.30", 0)):
        name = f"sound-{version}-{compression}{'.mf4' if version > '4' else '.mdf'}"
        with asammdf.MDF(version=version) as mdf:
            mdf.append([asammdf.Signal(values, time, name=one, unit="1") for one, values in others.items()])
            mdf.save(folder / name, compression=compression, overwrite=True)
        kind = f"MDF {version}{' deflated' if compression else ''}"
        yield _import_by_map(folder, folder / name, kind, run=bool(compression), time="time")
    for level, options in (("5", {"do_compression": True}), ("5", {}), ("4", {"format": "4"})):
        mat = folder / f"sound-{level}-{len(options)}.mat"
        content: dict[str, Any] = dict(_COLUMNS)
        if level == "5":
            content["rec"] = {"X": time, "Y": {"Name": "torque", "Data": time}}
        scipy.io.savemat(mat, content, **options)
        deflated = level == "5" and bool(options)
        yield _import_by_map(folder, mat, f"MATLAB {level}{' deflated' if deflated else ''}", run=True)
        if level == "5" and not deflated:
            sound = _import_by_map(folder, mat, "MATLAB 5, deflated after the damage", run=True)
            yield replace(sound, play=partial(_play_deflated, sound.play))
    tdms = folder / "sound.tdms"
    with nptdms.TdmsWriter(str(tdms)) as writer:
        for part in (slice(0, _ROWS // 2), slice(_ROWS // 2, None)):
            writer.write_segment([nptdms.ChannelObject("rig", name, values[part]) for name, values in _COLUMNS.items()])
    yield _import_by_map(folder, tdms, "TDMS")


def _play_deflated(play: Callable[[Path], Reach], copy: Path) -> Reach:
    """Play a damaged file of level 5 with each variable deflated afterwards, as damaged deflated data only fail a checksum."""
    content = copy.read_bytes()
    parts, at = [content[:_MAT_HEAD]], _MAT_HEAD
    while at + 8 <= len(content):
        size = 8 + struct.unpack_from("<I", content, at + 4)[0]
        packed = zlib.compress(content[at : at + size], 1)
        parts.append(struct.pack("<II", _MAT_DEFLATED, len(packed)) + packed)
        at += size
    copy.write_bytes(b"".join(parts))
    return play(copy)


def _list_hdf5_files(folder: Path) -> Iterator[Sound]:
    """Yield files in HDF5 and MATLAB 7.3. One process reads many copies, because its start takes 0.3 s."""
    import h5py

    hdf5, chunked, level73 = (folder / name for name in ("sound.h5", "chunked.h5", "sound-7.3.mat"))
    for path, options in ((hdf5, {}), (chunked, {"compression": "gzip", "chunks": (32,), "shuffle": True})):
        with h5py.File(path, "w") as file:
            group = file.create_group("rig")
            for name, values in _COLUMNS.items():
                group.create_dataset(name, data=values, **options).attrs["unit"] = "1"
            file["table"] = np.rec.fromarrays(list(_COLUMNS.values()), names=",".join(_COLUMNS))
    with h5py.File(level73, "w", userblock_size=512) as file:
        for name, values in _COLUMNS.items():
            data = file.create_dataset(name, data=values[None, :], compression="gzip")
            data.attrs["MATLAB_class"] = np.bytes_("double")
        inside = file.create_group("rec")
        inside.attrs["MATLAB_class"] = np.bytes_("struct")
        inside.create_dataset("x", data=_TIME[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    raw = bytearray(level73.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    level73.write_bytes(raw)
    yield Sound("HDF5", hdf5, _ManyByOne("clutch_hil.recordings.formats.hdf5:open_hdf5"))
    yield Sound("HDF5 in chunks", chunked, _ManyByOne("clutch_hil.recordings.formats.hdf5:open_hdf5"))
    yield Sound("MATLAB 7.3", level73, _ManyByOne("clutch_hil.recordings.formats.matlab:open_level73"))


class _ManyByOne:
    """Plays copies in another process.

    A copy that ends the process is read again as for users, and must be refused properly.
    """

    def __init__(self, opener: str) -> None:
        self._opener = opener
        self._child: ChildReader | None = None
        self._left = 0

    def __call__(self, copy: Path) -> Reach:
        if self._child is None or self._left == 0:
            self._child = ChildReader(
                f"recording {copy}", f"{__name__}:serve_many", self._opener, most_seconds=_CHILD_SECONDS
            )
            self._left = _FILES_OF_A_CHILD
        self._left -= 1
        try:
            return Reach(self._child.ask(str(copy)))
        except InputError as error:
            assert_sentence(error)
            ended = self._child.process.poll() is not None
        if ended:
            self._child = None
            return play_copy(copy)
        return Reach.REFUSED


def serve_many(opener: str) -> Callable[[str], int]:
    """Return a function that opens and reads a file, for the other process; see ChildReader."""
    module, function = opener.split(":")
    open_here = getattr(import_module(module), function)
    most = resource.getrlimit(resource.RLIMIT_CPU)[1]

    def answer(path: str) -> int:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        before, seconds = usage.ru_maxrss, int(usage.ru_utime + usage.ru_stime) + 1 + MOST_SECONDS
        if seconds < most:  # each copy gets the CPU time of a user's file
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, most))
        reach = read_recording(open_here(Path(path)), True)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_KIB
        return int(reach)

    return answer


def _list_bus_logs(folder: Path) -> Iterator[Sound]:
    """Yield logs of a car with their own database, logs of the bench as `replay` reads them, and the database itself."""
    import can

    dbc = folder / "car.dbc"
    dbc.write_text(CAR, encoding="utf-8")
    random = np.random.default_rng(1)
    messages = []
    for k in range(_ROWS):
        engine, page = random.bytes(8), bytes((k % 2,)) + random.bytes(7)
        at = 1.7e9 + 0.01 * k
        messages.append(can.Message(at, 291, is_extended_id=False, data=engine, channel=0))
        messages.append(can.Message(at + 1e-3, 2566844926 & 0x1FFFFFFF, is_extended_id=True, data=page, channel=0))
    keys = {"time": "ENGINE.time", "torque": "ENGINE.TORQUE", "speed": "ENGINE.SPEED", "file": f'dbc = "{dbc}"'}
    map_file = folder / "car.toml"
    map_file.write_text(_MAP.format(**keys), encoding="utf-8")
    play = partial(play_copy, options={"dbc": str(dbc)}, map_file=map_file)
    writers: dict[str, tuple[str, dict[str, Any]]] = {
        "candump": ("sound.log", {}), "ASC": ("sound.asc", {}), "TRC": ("sound.trc", {}),
        "CSV of python-can": ("frames.csv", {}), "SQLite of python-can": ("frames.db", {}),
        "BLF": ("sound.blf", {"compression_level": 0}),  # uncompressed, so that damage reaches the objects
        "BLF deflated": ("deflated.blf", {"max_container_size": 2000}),
    }  # fmt: skip
    for name, (file_name, options) in writers.items():
        (folder / file_name).unlink(missing_ok=True)  # a database would grow
        with can.Logger(folder / file_name, **options) as writer:
            for message in messages:
                writer(message)
        yield Sound(f"bus log, {name}", folder / file_name, play)
    mf4 = folder / "frames.mf4"
    write_mf4(mf4, messages)
    yield Sound("bus log, MF4", mf4, play)
    log = folder / "sound.log"
    yield Sound("DBC", dbc, lambda copy: play_copy(log, {"dbc": str(copy)}))
    bench = folder / "bench.log"
    bench.write_text(_write_bench_log(), encoding="utf-8")
    yield Sound("log of the bench", bench, _replay)


def _write_bench_log() -> str:
    """Return a candump log of a bench without a controller: heartbeats and samples at 1 kHz."""
    from protocols.can.frames import load_frames

    frames = load_frames()
    analog, encoder, heartbeat = frames["ANALOG_SENSORS"], frames["ENCODER"], frames["PLANT_HEARTBEAT"]
    lines = []
    for k in range(_ROWS):
        sent = [(heartbeat, heartbeat.pack(k // 50, lifecycle=2, rate=1000, session=1))] if k % 50 == 0 else []
        sent += [
            (analog, analog.pack(k, 0.01 * (k % 300), 60.0, 0.0)),
            (encoder, encoder.pack(k, 0.001 * (k % 5000), k % 1024)),
        ]
        lines += [f"({1.7e9 + 1e-3 * k:.6f}) can0 {codec.can_id:03X}#{data.hex().upper()}\n" for codec, data in sent]
    return "".join(lines)


def _replay(copy: Path) -> Reach:
    """Read a log as `replay` does; the result is READ if any sample is left."""
    from rt_controller.loop.bench_log import Log

    try:
        log = Log(copy)
    except InputError as error:
        assert_sentence(error)
        return Reach.REFUSED
    assert sum(1 for _ in log.samples) == len(log.samples)
    assert "\n" not in log.defects
    return Reach.READ

"""Bench samples: the rows of a run in a log of the bench's own frames, one for each sample.

Rule            A row is a frame ENCODER and the frame ANALOG_SENSORS before it. Its time is the number of the sample by
                SAMPLE_TICK over the rate that the heartbeats tell: stamps of a receiver have jitter, samples have none. Inputs
                are those of the last commands before the sample: row k holds the inputs that act from t_k on (docs/rig.md). A
                command that is not enabled counts as 0
Not there       Samples that are missing for BRIDGED at most: outputs by straight lines, inputs keep their value. A longer gap
                stays
Assumptions     one clutch; frames of one channel, with a correct CRC, in the order in which they were on the bus
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from clutch_hil.recordings.can_signals import read_physical_values
from protocols.can.frames import FrameCodec, load_frames
from protocols.files.bounds import check_rows
from protocols.files.bus_frames import BusLog
from protocols.files.bus_log import check_crcs

BRIDGED = 0.05  # s: `longest_gap_s` of the map bench.toml
_RATES = (50.0, 20_000.0)  # Hz that a heartbeat may tell: twice the highest of a bench
# Column -> frame and signal; what `enables` it
_OUTPUTS: Mapping[str, tuple[str, str]] = {
    "cylinder_pressure": ("ANALOG_SENSORS", "CYLINDER_PRESSURE"), "oil_temperature": ("ANALOG_SENSORS", "OIL_TEMPERATURE"),
    "clutch_torque": ("ANALOG_SENSORS", "CLUTCH_TORQUE"), "motor_torque": ("ENCODER", "MOTOR_TORQUE"),
}  # fmt: skip
_INPUTS: Mapping[str, tuple[str, str, str]] = {
    "valve_voltage": ("VALVE_COMMAND", "VALVE_VOLTAGE", "VALVE_ENABLE"),
    "motor_speed_demand": ("MOTOR_COMMAND", "SPEED_DEMAND", "MOTOR_ENABLE"),
    "motor_torque_limit": ("MOTOR_COMMAND", "TORQUE_LIMIT", "MOTOR_ENABLE"),
}  # fmt: skip


@dataclass(frozen=True)
class BenchSamples:
    """Rows of a log: `time` (n,) [s] from the first, columns (n,) by name, their units, and what was done.

    first: row of the log that has the first sample.
    """

    first: int
    time: np.ndarray
    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    notes: list[str]


def find_samples(log: BusLog) -> BenchSamples | None:
    """The samples of a bench with one clutch in a log of one channel; None where there are fewer than two, or no rate."""
    codecs = load_frames()
    rows = {name: _find_rows(log, codec) for name, codec in codecs.items()}
    second = load_frames(clutch="b")["ENCODER"]
    rate = _read_rate(log, codecs, rows)
    if len(rows["ENCODER"]) < 2 or not rate or len(_find_rows(log, second)):
        return None
    analog, encoder = _pair(rows["ANALOG_SENSORS"], rows["ENCODER"])
    if len(encoder) < 2:
        return None
    alone = len(rows["ENCODER"]) - len(encoder)
    steps = _count_steps(log, codecs["ENCODER"], encoder, rate)
    index = np.concatenate([[0], np.cumsum(steps)])
    read = {
        name: _read(log, codecs[frame], signal, analog if frame == "ANALOG_SENSORS" else encoder)
        for name, (frame, signal) in _OUTPUTS.items()
    }
    wraps = _read(log, codecs["ENCODER"], "SHAFT_ANGLE", encoder)
    angle = codecs["ENCODER"]
    read["shaft_angle"] = np.unwrap(wraps, period=angle.scale["shaft_angle"] * 2 ** angle.bits["shaft_angle"])
    held = {name: _hold(log, codecs[i[0]], i, rows[i[0]], encoder) for name, i in _INPUTS.items()}
    every = _bridge(index, rate)
    columns = {name: np.interp(every, index, values) for name, values in read.items()}
    before = np.searchsorted(index, every, side="right") - 1
    columns |= {name: values[before] for name, values in held.items()}
    columns["slip_speed"] = _differentiate(columns["shaft_angle"], every, rate)
    notes = [f"rows are the samples of the bench, by SAMPLE_TICK at {rate:g} Hz"]
    if alone:
        notes.append(f"left out {alone} frames of ENCODER without one of ANALOG_SENSORS")
    if filled := len(every) - len(index):
        notes.append(f"{filled} samples are missing and were bridged")
    return BenchSamples(int(encoder[0]), every / rate, columns, _list_units(codecs), notes)


def _find_rows(log: BusLog, codec: FrameCodec) -> np.ndarray:
    rows = np.flatnonzero((log.ids == codec.can_id) & (log.flags == 0) & (log.lengths == codec.length))
    return rows[check_crcs(log, rows, codec.length, codec.data_id)]


def _read(log: BusLog, codec: FrameCodec, name: str, rows: np.ndarray) -> np.ndarray:
    (signal,) = (one for one in codec.definitions if one.name == name)
    return np.asarray(read_physical_values(signal, log.read_matrix(rows, codec.length)), float)


def _read_rate(log: BusLog, codecs: Mapping[str, FrameCodec], rows: Mapping[str, np.ndarray]) -> float:
    """Rate [Hz] that all heartbeats tell; 0 where none does, or two differ."""
    names = ("PLANT_HEARTBEAT", "CONTROLLER_HEARTBEAT")
    told = np.unique(np.concatenate([_read(log, codecs[name], "RATE", rows[name]) for name in names]))
    return float(told[0]) if len(told) == 1 and _RATES[0] <= told[0] <= _RATES[1] else 0.0


def _pair(analog: np.ndarray, encoder: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of each sample: the last of `analog` before each of `encoder`, and after the one before that."""
    before = np.searchsorted(analog, encoder) - 1
    there = before >= 0
    there[1:] &= before[1:] > before[:-1]
    return analog[before[there]], encoder[there]


def _count_steps(log: BusLog, codec: FrameCodec, rows: np.ndarray, rate: float) -> np.ndarray:
    """Samples from each of `rows` to the next, (n - 1,): the number nearest to the stamps that the wrapping tick allows.

    Where that is 0 or less, or further from the stamps than BRIDGED, the plant began anew: the stamps count, as a gap.
    """
    modulus = 1 << codec.bits["sample_tick"]
    ticks = np.diff(_read(log, codec, "SAMPLE_TICK", rows).astype(np.int64))
    stamped = np.rint(np.diff(log.stamps[rows]) * rate).astype(np.int64)
    steps = stamped + (ticks - stamped + modulus // 2) % modulus - modulus // 2
    anew = (steps < 1) | (np.abs(steps - stamped) > max(BRIDGED * rate, 2.0))
    return np.where(anew, np.maximum(stamped, int(2.0 * BRIDGED * rate) + 2), steps)


def _hold(
    log: BusLog, codec: FrameCodec, source: tuple[str, str, str], rows: np.ndarray, samples: np.ndarray
) -> np.ndarray:
    """The value of the last command before each of `samples`, of the first one where none is before; 0 without commands."""
    _, name, enable = source
    if not len(rows):
        return np.zeros(len(samples))
    values = _read(log, codec, name, rows) * _read(log, codec, enable, rows)
    return np.asarray(values[np.maximum(np.searchsorted(rows, samples) - 1, 0)])


def _bridge(index: np.ndarray, rate: float) -> np.ndarray:
    """Numbers of the samples, those of short gaps among them. Raises InputError for more than a run may have."""
    steps = np.diff(index)
    short = steps <= max(BRIDGED * rate, 1.0)
    rows = 1 + int(np.sum(np.where(short, steps, 1)))
    check_rows("the log's samples make", float(rows), len(_OUTPUTS) + len(_INPUTS) + 3)
    counts = np.where(short, steps, 1)
    starts = np.repeat(np.where(short, index[:-1], index[1:] - 1), counts)
    within = np.arange(rows - 1) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.append(index[0], starts + within + 1)


def _differentiate(angle: np.ndarray, index: np.ndarray, rate: float) -> np.ndarray:
    """Slip [rad/s] as the bench measures it: turn since the sample before; of the first row of a piece that of the second."""
    slip = np.diff(angle) / np.diff(index) * rate
    slip = np.append(slip[:1], slip)
    first = np.flatnonzero(np.diff(index) > 1) + 1
    slip[first[first + 1 < len(slip)]] = slip[first[first + 1 < len(slip)] + 1]
    return slip


def _list_units(codecs: Mapping[str, FrameCodec]) -> dict[str, str]:
    """Units of the columns, as the database has them."""
    told = {}
    for name, (frame, signal, *_) in {**_OUTPUTS, **_INPUTS, "shaft_angle": ("ENCODER", "SHAFT_ANGLE")}.items():
        told[name] = next(one.unit or "" for one in codecs[frame].definitions if one.name == signal)
    return told | {"slip_speed": "rad/s"}

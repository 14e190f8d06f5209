"""Bench samples: rows of a run from a log of the bench's own frames, one per sample.

Rule            A row is a frame ENCODER and the frame ANALOG_SENSORS before it. Its time is the sample number from SAMPLE_TICK
                over the rate in the heartbeats: stamps of a receiver have jitter, sample numbers have none. Inputs are those of
                the last commands before the sample: row k has the inputs that act from t_k on (docs/rig.md). A valve that is
                not enabled has 0 V. Samples with a disabled motor are left out, because it coasts then
Missing         Samples that are missing for BRIDGED at most: outputs are interpolated linearly, inputs are held. A longer gap
                stays
Assumptions     one clutch; frames of one channel, with a correct CRC, in the order in which they were on the bus
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from cantools.database.can import Signal

from clutch_hil.recordings.can_signals import read_physical_values
from protocols.can.frames import load_frames
from protocols.errors import format_count
from protocols.files.bounds import check_rows
from protocols.files.bus_logs.bus_frames import BusLog
from protocols.files.bus_logs.bus_log import check_crcs

BRIDGED = 0.05  # s: `longest_gap_s` of the map bench.toml
_RATES = (50.0, 20_000.0)  # Hz, allowed rates in a heartbeat: up to twice the highest of a bench
# Column -> frame and signal; for inputs also the signal that enables the command
_OUTPUTS: Mapping[str, tuple[str, str]] = {
    "cylinder_pressure": ("ANALOG_SENSORS", "CYLINDER_PRESSURE"), "oil_temperature": ("ANALOG_SENSORS", "OIL_TEMPERATURE"),
    "clutch_torque": ("ANALOG_SENSORS", "CLUTCH_TORQUE"), "motor_torque": ("ENCODER", "MOTOR_TORQUE"),
}  # fmt: skip
_ANGLE = ("ENCODER", "SHAFT_ANGLE")
_INPUTS: Mapping[str, tuple[str, str, str]] = {
    "valve_voltage": ("VALVE_COMMAND", "VALVE_VOLTAGE", "VALVE_ENABLE"),
    "motor_speed_demand": ("MOTOR_COMMAND", "SPEED_DEMAND", "MOTOR_ENABLE"),
    "motor_torque_limit": ("MOTOR_COMMAND", "TORQUE_LIMIT", "MOTOR_ENABLE"),
}  # fmt: skip


@dataclass(frozen=True)
class SoundFrames:
    """Frames of one kind with a correct CRC: indices `rows` (n,) in the log, `payloads` (n, 8)."""

    rows: np.ndarray
    payloads: np.ndarray

    def keep(self, mask: np.ndarray) -> "SoundFrames":
        """Return the frames of a mask (n,) or of indices."""
        return SoundFrames(self.rows[mask], self.payloads[mask])


@dataclass(frozen=True)
class BenchSamples:
    """Rows of a log: `time` (n,) [s] from the first, columns (n,) by name, their units, and notes on the processing.

    first: row of the log with the first sample.
    """

    first: int
    time: np.ndarray
    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    notes: list[str]


def find_samples(log: BusLog, frames: Mapping[str, SoundFrames]) -> BenchSamples | None:
    """Return the samples of a bench with one clutch in a log of one channel; None if there are fewer than two, or no rate.

    frames: the bench's frames in the log, by name. Raises InputError for more samples than a run may have.
    """
    if not {"ANALOG_SENSORS", "ENCODER"} <= frames.keys() or _has_second_clutch(log):
        return None
    codecs, rate = load_frames(), _read_rate(frames)
    analog, encoder = _pair(frames["ANALOG_SENSORS"], frames["ENCODER"])
    alone = len(frames["ENCODER"].rows) - len(encoder.rows)
    driven = _hold(frames.get("MOTOR_COMMAND"), "MOTOR_COMMAND", "MOTOR_ENABLE", "MOTOR_ENABLE", encoder.rows) > 0.0
    if off := np.count_nonzero(~driven) if driven.any() else 0:
        analog, encoder = analog.keep(driven), encoder.keep(driven)
    if not rate or len(encoder.rows) < 2:
        return None
    sampled = {"ANALOG_SENSORS": analog, "ENCODER": encoder}
    index = np.concatenate([[0], np.cumsum(_count_steps(log, encoder, rate))])
    every = _bridge(index, rate)
    before = np.searchsorted(index, every, side="right") - 1
    columns = {
        name: np.interp(every, index, _read(sampled[frame], frame, signal))
        for name, (frame, signal) in _OUTPUTS.items()
    }
    codec = codecs["ENCODER"]
    angle = np.unwrap(_read(encoder, *_ANGLE), period=codec.scale["shaft_angle"] * 2 ** codec.bits["shaft_angle"])
    columns["shaft_angle"] = np.interp(every, index, angle)
    columns["slip_speed"] = _differentiate(columns["shaft_angle"], every, rate)
    for name, (frame, signal, enable) in _INPUTS.items():
        columns[name] = _hold(frames.get(frame), frame, signal, enable, encoder.rows)[before]
    notes = [f"rows are the samples of the bench, by SAMPLE_TICK at {rate:g} Hz"]
    if off:
        notes.append(
            f"left out {format_count(off, 'sample')} in which the motor is not enabled: it has no speed demand"
        )
    if alone:
        notes.append(f"left out {format_count(alone, 'frame')} of ENCODER without one of ANALOG_SENSORS")
    if filled := len(every) - len(index):
        notes.append(f"bridged {format_count(filled, 'sample')} that are missing")
    places = {**_OUTPUTS, **_INPUTS, "shaft_angle": _ANGLE}
    units = {name: _find_signal(frame, signal).unit or "" for name, (frame, signal, *_) in places.items()}
    return BenchSamples(int(encoder.rows[0]), every / rate, columns, units | {"slip_speed": "rad/s"}, notes)


def _find_signal(frame: str, name: str) -> Signal:
    (signal,) = (one for one in load_frames()[frame].definitions if one.name == name)
    return signal


def _read(frames: SoundFrames, frame: str, name: str) -> np.ndarray:
    return np.asarray(read_physical_values(_find_signal(frame, name), frames.payloads), float)


def _has_second_clutch(log: BusLog) -> bool:
    codec = load_frames(clutch="b")["ENCODER"]
    rows = np.flatnonzero((log.ids == codec.can_id) & (log.flags == 0) & (log.lengths == codec.length))
    return bool(check_crcs(log, rows, codec.length, codec.data_id).any())


def _read_rate(frames: Mapping[str, SoundFrames]) -> float:
    """Return the rate [Hz] in all heartbeats; 0 without one, or if two differ."""
    names = [name for name in ("PLANT_HEARTBEAT", "CONTROLLER_HEARTBEAT") if name in frames]
    rates = np.unique(np.concatenate([np.zeros(0), *(_read(frames[name], name, "RATE") for name in names)]))
    return float(rates[0]) if len(rates) == 1 and _RATES[0] <= rates[0] <= _RATES[1] else 0.0


def _pair(analog: SoundFrames, encoder: SoundFrames) -> tuple[SoundFrames, SoundFrames]:
    """Return both frames of each sample: for each frame of `encoder` the last one of `analog` since the previous `encoder`
    frame."""
    before = np.searchsorted(analog.rows, encoder.rows) - 1
    there = before >= 0
    there[1:] &= before[1:] > before[:-1]
    return analog.keep(before[there]), encoder.keep(there)


def _count_steps(log: BusLog, encoder: SoundFrames, rate: float) -> np.ndarray:
    """Return the samples from each frame to the next, (n - 1,): the number closest to the stamps that fits the wrapping tick.

    Where it is 0 or less, or differs from the stamps by more than BRIDGED, the plant was restarted: the step becomes a gap.
    """
    modulus = 1 << load_frames()["ENCODER"].bits["sample_tick"]
    ticks = np.diff(_read(encoder, "ENCODER", "SAMPLE_TICK").astype(np.int64))
    stamped = np.rint(np.diff(log.stamps[encoder.rows]) * rate).astype(np.int64)
    steps = stamped + (ticks - stamped + modulus // 2) % modulus - modulus // 2
    anew = (steps < 1) | (np.abs(steps - stamped) > max(BRIDGED * rate, 2.0))
    return np.where(anew, np.maximum(stamped, int(2.0 * BRIDGED * rate) + 2), steps)


def _hold(commands: SoundFrames | None, frame: str, signal: str, enable: str, samples: np.ndarray) -> np.ndarray:
    """Return the value of the last command before each of `samples`, of the first command if none is before; 0 without
    commands."""
    if commands is None:
        return np.zeros(len(samples))
    values = _read(commands, frame, signal) * _read(commands, frame, enable)
    return np.asarray(values[np.maximum(np.searchsorted(commands.rows, samples) - 1, 0)])


def _bridge(index: np.ndarray, rate: float) -> np.ndarray:
    """Return the sample numbers including those of short gaps. Raises InputError for more than a run may have."""
    steps = np.diff(index)
    short = steps <= max(BRIDGED * rate, 1.0)
    counts = np.where(short, steps, 1)
    rows = 1 + int(np.sum(counts))
    check_rows("the log's samples make", float(rows), len(_OUTPUTS) + len(_INPUTS) + 3)
    starts = np.repeat(np.where(short, index[:-1], index[1:] - 1), counts)
    within = np.arange(rows - 1) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.append(index[0], starts + within + 1)


def _differentiate(angle: np.ndarray, index: np.ndarray, rate: float) -> np.ndarray:
    """Return the slip [rad/s] as the bench measures it: turn since the previous sample. The first row of a piece copies the
    second."""
    slip = np.diff(angle) / np.diff(index) * rate
    slip = np.append(slip[:1], slip)
    first = np.flatnonzero(np.diff(index) > 1) + 1
    first = first[first + 1 < len(slip)]
    slip[first] = slip[first + 1]
    return slip

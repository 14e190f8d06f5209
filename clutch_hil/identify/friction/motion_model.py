"""The force that a rig shows when it is moved along a measured position: its friction, inertia, and what its sensors add.

Equation        F(t) = f(t - delay),  f = friction(x, W) + m x'' + offset + load_gain W
                friction goes through the low pass of the record, as the measured force does: its corners are rounded alike
                delay: of the force behind the position; negative where the force is recorded before it acts
Assumptions     rigid; the contact is at rest without force at the first sample, so the beginning is not judged
                (`select_judged`)
Not modelled    flexible modes, cogging, friction that depends on the place (but the shape of Maxwell-slip)
References      Janot, Gautier and Brunot 2019 (inverse dynamics with an offset); Janssens 2010, sec. 5.8
"""

from collections.abc import Sequence

import numpy as np

from clutch_hil.identify.friction.law import Structure, Values
from clutch_hil.identify.friction.slide_record import WINDOW, SlideRecord
from clutch_hil.recordings.rasters import filter_low_pass

SETTLING_SHARE = 0.5  # of the position's range: after so long a way the contact has forgotten how it began
MOST_SETTLING = 0.25  # of a record: more of it is never left out


class MotionModel:
    """`structure` on `records`: forces, and residuals of the samples that are judged.

    usable: which of these can be fitted, bool (n,). A law without memory is not fitted where its speed changes its sign.
    """

    def __init__(self, structure: Structure, records: Sequence[SlideRecord]) -> None:
        self.structure, self.records = structure, tuple(records)
        centred = structure.law.centred
        self._paths = [_centre_path(one) if centred else one.path for one in self.records]
        self._times = [one.period * np.arange(one.size) for one in self.records]
        self._judged = [select_judged(one) for one in self.records]
        self.measured = np.concatenate([one.force[part] for one, part in zip(self.records, self._judged, strict=True)])
        resolved = [_resolve_speed(one) if centred else np.ones(one.size, bool) for one in self.records]
        self.usable = np.concatenate([own[part] for own, part in zip(resolved, self._judged, strict=True)])

    def compute_forces(self, values: Values) -> list[np.ndarray]:
        """Force [N] (n,) at every sample of each record. Raises InputError."""
        friction = self.structure.build(values)
        mass, offset, gain, delay = (values.get(name, 0.0) for name in ("mass", "offset", "load_gain", "delay"))
        shown = []
        for record, path, time in zip(self.records, self._paths, self._times, strict=True):
            force = friction.trace(path, record.period, record.load).force
            if record.low_pass:
                force = filter_low_pass(record.source, "friction", force, record.low_pass, 1.0 / record.period)
            force = force + offset
            if mass:
                force += mass * record.acceleration
            if gain:
                force += gain * record.load
            shown.append(np.interp(time - delay, time, force) if delay else force)
        return shown

    def compute_residual(self, values: Values) -> np.ndarray:
        """Model less measured force [N] at the judged samples of all records, one after the other."""
        forces = self.compute_forces(values)
        return np.concatenate([f[part] for f, part in zip(forces, self._judged, strict=True)]) - self.measured

    def split_blocks(self, per_record: int) -> list[np.ndarray]:
        """Indices of the judged samples in contiguous blocks, `per_record` of each record."""
        blocks, start = [], 0
        for part in self._judged:
            count = part.stop - part.start
            blocks += np.array_split(np.arange(start, start + count), per_record)
            start += count
        return blocks


def select_judged(record: SlideRecord) -> slice:
    """The samples that are judged: from where the contact has gone far enough to have forgotten its beginning."""
    way = np.cumsum(np.abs(np.diff(record.path, prepend=record.path[0])))
    first = int(np.searchsorted(way, SETTLING_SHARE * float(np.ptp(record.position))))
    return slice(min(first, int(MOST_SETTLING * record.size)), record.size)


def _resolve_speed(record: SlideRecord) -> np.ndarray:
    """Whether the window of the speed at each sample (n,) has no change of sign: the speed is not resolved there."""
    still = np.abs(record.speed) * record.period < record.flicker
    changes = np.flatnonzero(np.diff(np.where(still, 0.0, np.sign(record.speed))))
    clear = np.ones(record.size, bool)
    for k in range(-(WINDOW // 2) + 1, WINDOW // 2 + 1):
        clear[np.clip(changes + k, 0, record.size - 1)] = False
    return clear


def _centre_path(record: SlideRecord) -> np.ndarray:
    """A path (n,) whose step before each sample is made at the speed of that sample."""
    still = np.abs(record.speed) * record.period < record.flicker
    return np.asarray(record.position[0] + np.cumsum(np.where(still, 0.0, record.speed) * record.period))

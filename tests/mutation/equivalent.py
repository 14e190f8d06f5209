"""Equivalent mutants: changes that no test can notice, by the argument of the checks; each has its reason."""

_OTHER_IDENTIFIERS = "falls through to identifiers that are all different, then returns the same"
_NONE = "any negative number says: none"
_NAMED = "the type of a record has names: the rest is for the type checker"

EQUIVALENT: dict[str, dict[str, str]] = {
    "words": {
        "definition: np.void = np.zeros(1, make_frame_layout(codec))[0]: column 35: 1 to 2": "more room",
        "return (counts - before + wrap // 2) % wrap - wrap // 2: column 12: Add to Sub": (
            "plus and minus half the range are the same modulo the range"
        ),
        "return (remainder << 8 & 0xFF00) ^ np.int64(CRC_TABLE[remainder >> 8 ^ byte]): column 29: 65280 to 65281": (
            "bit 0 is 0 after the shift"
        ),
        "for shift in range(_CRC_BITS, 64, 8):: column 4: one turn less": "ends before 63: the last shift is still 56",
        "for shift in range(_CRC_BITS, 64, 8):: column 34: 64 to 63": "as above",
    },
    "reception": {
        'self._counter, self._data = -1, b"": column 8: target 1 dropped': "read after a first frame only, which sets it",
        'self._counter, self._data = -1, b"": column 37: 1 to 2': _NONE,
        """self._counter, self._data = -1, b"": column 40: b'' to b'\\x01'""": "as the first",
    },
    "exchange": {
        "if self._ignored[0]:: column 8: condition to True": "adds 0, and sets 0 to 0",
        "if kept < end + index:: column 16: condition to True": "a frame at its place is written to its place",
        "if kept < end + index:: column 19: Lt to LtE": "as above",
        "while at < index and inbox[at].stamp <= inbox[index].stamp:: column 14: Lt to LtE": (
            "a frame at its place stays, and so do those after it"
        ),
        "if at < index:: column 8: condition to True": "a frame at its place is written to its place",
        "if at < index:: column 11: Lt to LtE": "as above",
        "for back in range(index, at, -1):: column 12: one turn less": (
            "counts down: one turn more, and what it writes is overwritten"
        ),
    },
    "limits": {
        "for _byte in range(256):: column 19: 256 to 257": "a 257th entry of the CRC table is never looked up",
        '_COUNTERS, _BROKEN = ("counters", "i8", (4,)), ("broken", "i8", (12,)): column 41: 4 to 5': "more room",
        '_COUNTERS, _BROKEN = ("counters", "i8", (4,)), ("broken", "i8", (12,)): column 65: 12 to 13': "more room",
        "last, guard.counters[kind] = guard.counters[kind], 1 + int(data[2]): column 55: 1 to 2": "any that is not 0",
        "claims = session >= _SESSIONS and (guard.session > 0 or guard.asked <= 0): column 59: 0 to 1": (
            "a session is 0, or 0x0800 and more"
        ),
        "guard.asked = 0.0 if request == 0 or request == 2 else limits.asked: column 22: 0.0 to -1.0": (
            "any that is not above 0"
        ),
        "guard.session, guard.counters[2], guard.asked = session, 0, 0.0: column 68: 0.0 to -1.0": "as above",
        "_KNOWN = 4096: column 9: 4096 to 4095": "any above 2048 makes a value of 12 bits positive",
        "_KNOWN = 4096: column 9: 4096 to 4097": "as above",
        "return 3 if can_id == SUPERVISOR_CLAIM else -1: column 49: 1 to 2": _NONE,
        "turned = (angle - guard.angle + 0x20000 & 0x3FFFF) - 0x20000: column 22: Add to Sub": (
            "plus and minus 2^17 are the same modulo 2^18"
        ),
    },
    "presliding": {
        "if slips or (along >= level and turned != 0.0):: column 21: GtE to Gt": (
            "at the level exactly it slips either way, and stays there"
        ),
    },
    "cycle": {
        "return 0: column 12: deleted": _OTHER_IDENTIFIERS,
        "kind = -1: column 12: 1 to 2": _NONE,
    },
    "plant_cycle": {
        "for index in range(len(settings.own)):: column 4: one turn less": "the last of the 8 places is never used",
        "return 0: column 12: deleted": _OTHER_IDENTIFIERS,
        "return 0: column 8: deleted": _OTHER_IDENTIFIERS,
        "return False: column 4: deleted": "None is as false",
        "if periods > 1:: column 7: Gt to GtE": "takes 0 away from the age",
        "if periods > 1:: column 17: 1 to 0": "as above",
    },
    "beat": {
        "asleep = at < due: column 13: Lt to LtE": "at the slot itself nobody sleeps or spins, and is late by 0 either way",
        "if asleep:: column 4: condition to True": "who is late for a slot neither sleeps nor spins until it",
        "spins[0] = needed if needed > spin else spin - (spin - needed) // SPIN_DECAY_SLEEPS: column 33: Gt to GtE": (
            "two equal lengths"
        ),
        "histogram.bins[min(max(duration, 0) // 1000, histogram.bins.size - 1)] += 1: column 37: 0 to 1": "the same bin",
    },
    "plant_turn": {
        "samples, known, behind, clock = 0, count, owed > 0, beat.clocks[0]: column 46: Gt to GtE": (
            "where no sample is owed, the first wait sets it before it is read"
        ),
        "samples, known, behind, clock = 0, count, owed > 0, beat.clocks[0]: column 53: 0 to -1": "as above",
    },
    "plant_service": {
        "_KERNEL_TICK = 1_000_000: column 15: 1000000 to 1000001": "a quarter of it in whole ns is the same",
    },
    "turn": {
        "arrived = _find_arrival(line, turn.woken) if line.marks > marks else 0: column 77: 0 to -1": (
            "any time that is not above 0 says: none"
        ),
        "if turn.slots == 0 and line.changed:: column 11: operand 0 dropped": "with slots the loop ends, too",
        "views = [self._turns[name].data for name in _TURN.names or ()]: column 52: operand 1 dropped": (
            "the type of a record has names: the rest is for the type checker"
        ),
    },
    "estimator": {
        "target = s_n if slip > 0.0 else -s_n: column 20: Gt to GtE": "a slip of 0 has been answered before",
    },
    "node": {
        "_NO_FRAME = -1: column 13: 1 to 2": _NONE,
        "PHASE_SETTINGS, {name: (phases | contact)[name] for name in PHASE_SETTINGS.names or ()}:"
        " column 72: operand 1 dropped": _NAMED,
        "plausibility = {name: phases[name] for name in PLAUSIBILITY_SETTINGS.names or ()}:"
        " column 55: operand 1 dropped": _NAMED,
    },
    "interface": {
        "_NO_FRAME = -1: column 13: 1 to 2": _NONE,
        "counted = zip(self._received, rows, strict=True): column 51: True to False": "each frame has its row",
        "for first in range(0, max(len(inbox), 1), INBOX):: column 46: 1 to 2": "one part in both cases",
    },
    "plant_node": {
        "self._substeps = ceil(self._period / wet_clutch.STEP_LIMIT - 1e-9): column 69: 1e-09 to 1.01e-09": (
            "a whole rate leaves a remainder that is far smaller, by rounding, or far larger"
        ),
        "self._substeps = ceil(self._period / wet_clutch.STEP_LIMIT - 1e-9): column 69: 1e-09 to 9.9e-10": "as above",
        "if self._schedule.planned:: column 8: condition to True": "where nothing is planned nothing begins",
        "return most if remaining >= most else max(1, floor(remaining + 1e-6)): column 23: GtE to Gt": (
            "at `most` exactly both are `most`"
        ),
    },
    "bus": {
        "_FILTER_MASK = 0xC0000000 | _STANDARD_ID: column 15: 3221225472 to 3221225473": "bit 0 is in the identifier, too",
    },
    "local_bus": {
        "os.eventfd_write(self._taken_event, 1): column 52: 1 to 2": "a read takes all that was written",
    },
}

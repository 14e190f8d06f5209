"""Mutation testing of the guard: every change of a comparison, an operator or a constant of limits.py is noticed by
a test of FILES, but for the equivalent ones listed here with their reason."""

import rt_controller.guard.limits
from tests.mutation.mutants import find_survivors, is_killed, load_checks, parse_plain

FILES = [f"rt_controller/test_limits{part}.py" for part in ("", "_content", "_samples", "_claim")]
# Mutants no test can kill, by "line of source: column: change", and why.
EQUIVALENT = {
    "for _byte in range(256):: column 19: 256 to 257": "a 257th entry of the CRC table is never looked up",
    '_COUNTERS, _BROKEN = ("counters", "i8", (4,)), ("broken", "i8", (12,)): column 41: 4 to 5': "more room",
    '_COUNTERS, _BROKEN = ("counters", "i8", (4,)), ("broken", "i8", (12,)): column 65: 12 to 13': "more room",
    "last, guard.counters[kind] = guard.counters[kind], 1 + int(data[2]): column 55: 1 to 2": "any that is not 0",
    "claims = session >= _SESSIONS and (guard.session > 0 or guard.asked <= 0): column 59: 0 to 1": (
        "a session is 0, or 0x0800 and more"
    ),
    "guard.asked = 0.0 if request == 0 or request == 2 else limits.asked: column 22: 0.0 to -1.0": "any that is not above 0",
    "guard.session, guard.counters[2], guard.asked = session, 0, 0.0: column 68: 0.0 to -1.0": "as above",
    "_KNOWN = 4096: column 9: 4096 to 4095": "any above 2048 makes a value of 12 bits positive",
    "_KNOWN = 4096: column 9: 4096 to 4097": "as above",
    "out_of_range = pressure < _VACUUM or temperature < limits.cold or guard.railed: column 19: Lt to LtE": (
        "-204.8 counts, which no sample has"
    ),
    "return 3 if can_id == SUPERVISOR_CLAIM else -1: column 49: 1 to 2": "any negative number says: none",
    "turned = (angle - guard.angle + 0x20000 & 0x3FFFF) - 0x20000: column 22: Add to Sub": (
        "plus and minus 2^17 are the same modulo 2^18"
    ),
}


def test_the_unchanged_guard_passes_every_check() -> None:
    by = load_checks(FILES, "limits")
    assert len(by) >= 25
    assert not is_killed(parse_plain(rt_controller.guard.limits), by)


def test_every_mutant_of_the_guard_is_killed() -> None:
    population, alive = find_survivors(rt_controller.guard.limits, FILES, "limits")
    assert population > 200
    unexpected = sorted(set(alive) - set(EQUIVALENT))
    assert not unexpected, f"{len(unexpected)} of {population} mutants survive:\n" + "\n".join(unexpected)
    assert not set(EQUIVALENT) - set(alive), "an equivalent mutant is killed or gone: take it off the list"

"""Changes to come, as the telemetry process sees them: each starts and ends once, wherever the loop is ahead of it."""

from protocols.telemetry.pending_changes import PendingChanges


def change(name: str, row: int, ramp: float = 0.0, old: float = 0.0, new: float = 1.0) -> dict:
    return {"name": name, "row": row, "at": row / 100, "ramp": ramp, "old": old, "new": new}


def test_a_change_starts_once_when_its_row_has_come() -> None:
    step = change("a", 5)
    pending = PendingChanges([step])
    assert pending.take_started(5) == []  # rows 0 to 4
    assert pending.take_started(6) == [step]
    assert pending.take_started(7) == []
    assert pending.take_ended(9.0) == []  # a step has no end


def test_a_change_that_began_before_its_row_was_seen_is_not_lost_to_a_new_plan() -> None:
    begun, dropped, planned = change("a", 5), change("b", 9), change("b", 20)
    pending = PendingChanges([begun, dropped])
    pending.plan([planned], row=8)  # the loop is at row 8 and plans anew; we have seen 3 rows
    assert pending.take_started(8) == [begun]
    assert pending.take_started(30) == [planned]


def test_a_ramp_is_under_way_until_its_end() -> None:
    ramp = change("a", 100, ramp=2.0, old=1.0, new=3.0)
    pending = PendingChanges([ramp])
    pending.take_started(101)
    assert pending.compute_values(2.0) == {"a": 2.0}
    assert pending.take_ended(2.9) == []
    assert pending.take_ended(3.0) == [ramp]
    assert pending.take_ended(4.0) == []
    assert pending.compute_values(4.0) == {}


def test_a_ramp_that_another_change_takes_over_never_ends() -> None:
    pending = PendingChanges([change("a", 100, ramp=2.0), change("a", 200), change("b", 100, ramp=2.0)])
    pending.take_started(101)
    pending.take_started(201)
    pending.forget("b")  # set by hand
    assert pending.take_ended(9.0) == []

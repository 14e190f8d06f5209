"""Messages that come twice are kept once, in a time that does not grow with their number."""

from protocols.telemetry.distinct import DistinctMessages

MANY = 20_000  # messages: comparing each with all earlier ones would take a minute


def make_event(number: int) -> dict:
    return {"row": number, "name": "x"}


def test_each_is_kept_once_in_the_order_in_which_it_came() -> None:
    messages = DistinctMessages(10)
    assert messages.add([make_event(2), make_event(1), make_event(2)]) == [make_event(2), make_event(1)]
    assert messages.add([{"name": "x", "row": 1}, make_event(3)]) == [make_event(3)]
    assert messages.kept == [make_event(2), make_event(1), make_event(3)]


def test_a_value_that_is_no_number_is_known_again() -> None:
    messages = DistinctMessages(10)
    for _ in range(2):
        messages.add([{"old": float("nan")}])
    assert len(messages.kept) == 1


def test_the_newest_are_kept_and_many_take_no_longer() -> None:
    messages = DistinctMessages(100)
    messages.add(map(make_event, range(MANY)))
    assert [event["row"] for event in messages.kept] == list(range(MANY - 100, MANY))

"""Claims of the set-points as the guard reads them: whose request for idle ends a finding. Each test has the module as
argument, so that it can run on mutants (tests/mutation)."""

from types import ModuleType

import pytest

import rt_controller.guard.limits
from protocols.can.claim import CLAIM_TIMEOUT, LEAST_SESSION
from tests.rt_controller.guard_bench import (
    ENGAGE,
    IDENTIFIERS,
    IDLE,
    PERIOD,
    PRESSURE_LIMIT,
    RELEASE,
    Bench,
    make_frame,
    protect,
)

FIRST, SECOND = 0x9B21, 0x8A3F
SETPOINT, CLAIM = IDENTIFIERS["TORQUE_SETPOINT"], IDENTIFIERS["SUPERVISOR_CLAIM"]
DATA_ID = 0xC180  # of a set-point without a claim
SILENCE, ASKED = 250, 100  # cycles: 0.25 s without a claim, 0.1 s without a set-point


@pytest.fixture(scope="module")
def limits() -> ModuleType:
    return rt_controller.guard.limits


class Bus(Bench):
    """A guard that has found too high a pressure, which is gone; and supervisors."""

    def __init__(self, limits: ModuleType) -> None:
        super().__init__(limits)
        self.trip()

    def trip(self) -> None:
        for _ in range(3):
            self.run_cycle(PRESSURE_LIMIT + 1)
        self.run_cycle()

    def claim(self, session: int, counter: int, claimed: int = 1) -> None:
        self.guard.check_inbound(CLAIM, make_frame("SUPERVISOR_CLAIM", counter, CLAIM=claimed, SESSION=session))

    def request(self, session: int, counter: int, request: int = IDLE) -> None:
        own = (DATA_ID ^ session) - DATA_ID
        self.guard.check_inbound(SETPOINT, make_frame("TORQUE_SETPOINT", counter, own, REQUEST=request))

    def is_ended_by(self, session: int, counter: int) -> bool:
        """Whether a request for idle ends the finding, which is there again afterwards."""
        assert self.guard.finding
        self.request(session, counter)
        if self.guard.finding:
            return False
        self.trip()
        return True


def test_only_who_has_the_claim_ends_a_finding(limits: ModuleType) -> None:
    bus = Bus(limits)
    bus.claim(FIRST, 0)
    assert not bus.is_ended_by(0, 10)
    assert not bus.is_ended_by(SECOND, 11)
    bus.claim(SECOND, 77)
    assert not bus.is_ended_by(SECOND, 12)
    bus.claim(FIRST, 1)  # the counter of the other has not disturbed it
    bus.claim(SECOND, 2, claimed=0)  # who has none cannot release it
    assert bus.is_ended_by(FIRST, 200)
    bus.claim(FIRST, 2)
    assert not bus.is_ended_by(FIRST, 200), "a stuck counter"
    assert bus.is_ended_by(FIRST, 201)


def test_without_a_claim_every_supervisor_ends_a_finding(limits: ModuleType) -> None:
    bus = Bus(limits)
    assert bus.is_ended_by(0, 10)
    assert not bus.is_ended_by(FIRST, 11)
    bus.claim(FIRST, 0, claimed=0)
    assert bus.is_ended_by(0, 12)


def test_a_released_claim_is_free_for_the_next(limits: ModuleType) -> None:
    bus = Bus(limits)
    bus.claim(FIRST, 5)
    bus.request(FIRST, 10, ENGAGE)
    bus.claim(FIRST, 6, claimed=0)
    assert not bus.is_ended_by(FIRST, 11)
    assert bus.is_ended_by(0, 200)
    bus.claim(SECOND, 203)  # in the same cycle, with a counter of its own
    assert bus.is_ended_by(SECOND, 90)


def test_who_asks_to_close_keeps_the_claim_and_leaves_nothing_of_it(limits: ModuleType) -> None:
    """What the one before has asked for does not keep the next one off."""
    bus = Bus(limits)
    bus.claim(FIRST, 0)
    bus.request(FIRST, 1, ENGAGE)
    bus.claim(FIRST, 1)
    assert bus.guard.session == FIRST
    bus.claim(FIRST, 2, claimed=0)
    bus.claim(SECOND, 50)
    assert bus.guard.session == SECOND


def test_a_damaged_or_old_claim_is_none(limits: ModuleType) -> None:
    bus = Bus(limits)
    good = make_frame("SUPERVISOR_CLAIM", 3, CLAIM=1, SESSION=FIRST)
    for data in (
        bytes((good[0] ^ 1,)) + good[1:],
        good[:7],
        make_frame("SUPERVISOR_CLAIM", 3, 8, CLAIM=1, SESSION=FIRST),
    ):
        bus.guard.check_inbound(CLAIM, data)
    for other in (0x300, 0x700):  # other frames with the same bits
        bus.guard.check_inbound(other, protect(good, 0xC000 + other))
    assert bus.guard.session == 0
    bus.guard.check_inbound(CLAIM, good)
    bus.claim(FIRST, 2, claimed=0)
    assert bus.is_ended_by(FIRST, 1), "a frame of before releases nothing"


def test_a_supervisor_that_is_silent_for_a_quarter_of_a_second_has_none(limits: ModuleType) -> None:
    assert pytest.approx(CLAIM_TIMEOUT) == SILENCE * PERIOD
    bus = Bus(limits)
    bus.claim(FIRST, 0)
    for count in range(1, 4):  # a claim in time keeps it
        for _ in range(SILENCE):
            bus.run_cycle()
        bus.claim(FIRST, count)
    bus.run_cycle()
    for _ in range(SILENCE):
        bus.run_cycle()
    assert bus.guard.session == FIRST
    bus.run_cycle()
    assert bus.guard.session == 0
    bus.claim(SECOND, 100)
    assert bus.is_ended_by(SECOND, 50)


def test_a_claim_that_waited_while_the_computer_stood_counts(limits: ModuleType) -> None:
    bus = Bus(limits)
    bus.claim(FIRST, 0)
    bus.guard.run_cycle()
    bus.claim(FIRST, 1)
    bus.guard.run_cycle(2 * SILENCE)
    assert bus.guard.session == FIRST
    bus.guard.run_cycle(2 * SILENCE)
    assert bus.guard.session == 0


def test_who_asks_to_close_without_a_claim_is_not_cut_off_by_one(limits: ModuleType) -> None:
    for number in range(8):
        check_request(limits, number)


def check_request(limits: ModuleType, number: int) -> None:
    """A claim in the same cycle as a request, and after it."""
    bus = Bus(limits)
    bus.request(0, 1, number)
    bus.claim(FIRST, 0)
    closes = number not in (IDLE, RELEASE)
    assert (bus.guard.session == 0) is closes
    if closes:
        for _ in range(ASKED - 1):
            bus.run_cycle()
        bus.claim(FIRST, 33)
        assert bus.guard.session == 0
        bus.run_cycle()
        bus.claim(FIRST, 99)
    assert bus.guard.session == FIRST


def test_a_session_that_would_make_the_data_id_of_another_frame_is_refused(limits: ModuleType) -> None:
    bus = Bus(limits)
    bus.claim(LEAST_SESSION - 1, 0)
    assert bus.guard.session == 0
    bus.claim(LEAST_SESSION, 1)
    assert bus.guard.session == LEAST_SESSION


def test_samples_and_commands_are_the_same_with_a_claim(limits: ModuleType) -> None:
    bus = Bus(limits)
    bus.claim(FIRST, 0)
    assert bus.is_ended_by(FIRST, 1)
    bus.request(FIRST, 2)
    for _ in range(SILENCE):
        assert bus.run_cycle() == limits.HEALTHY
    assert bus.open

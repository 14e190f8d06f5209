"""Rules of the claim, one by one. Each test has the module as argument, so that it can run on mutants (tests/mutation)."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

import rt_controller.loop.claim
import rt_controller.loop.cycle
from protocols.can.claim import CLAIM_TIMEOUT, LEAST_SESSION, Supervision, bind_data_id
from protocols.can.request import Request
from rt_controller.law.phases import Phase
from tests.rt_controller.cycle_bench import FRAMES, SETPOINT, CycleBench

FIRST, SECOND = 0x9B21, 0x8A3F  # sessions of two supervisors
CLAIM = FRAMES["SUPERVISOR_CLAIM"]
IN_TIME = 0.1  # s: `setpoint_timeout`


@pytest.fixture(scope="module")
def claim() -> ModuleType:
    return rt_controller.loop.claim


class Board:
    """The records of a controller that has no set-point, and the functions of a module on them."""

    def __init__(self, claim: ModuleType, holder: int = 0) -> None:
        bench = CycleBench(rt_controller.loop.cycle)
        self.module, self.state, self.settings = claim, bench.state, bench.settings
        self.claims, self.setpoints = self.state.receptions[4], self.state.receptions[2]
        self.state.claim.session, self.state.claim.age, self.state.claim.refused_age = holder, 0.1, 0.2
        self.state.request, self.state.setpoint_age = Request.IDLE.value, np.inf

    def take(self, session: int, claimed: int = 1) -> bool:
        word = int.from_bytes(CLAIM.pack_raw(0, claim=claimed, session=session), "little", signed=True)
        return bool(self.module.take_claim(self.state, self.settings, self.claims, self.setpoints, word))

    @property
    def held(self) -> tuple[int, float]:
        return int(self.state.claim.session), float(self.state.claim.age)

    @property
    def refused(self) -> tuple[int, float]:
        return int(self.state.claim.refused), float(self.state.claim.refused_age)


def test_a_first_claim_binds_the_set_points_and_opens_the_clutch(claim: ModuleType) -> None:
    board = Board(claim)
    board.setpoints.counter, board.setpoints.doubts, board.claims.counter = 9, 7, 5
    board.state.phases.phase, board.state.phases.permitted = Phase.SLIP_CONTROL.value, True
    assert not board.take(FIRST)
    assert board.held == (FIRST, 0.0)
    assert int(board.setpoints.data_id) == bind_data_id(SETPOINT.data_id, FIRST)
    assert (int(board.setpoints.counter), int(board.setpoints.doubts), int(board.claims.counter)) == (0, 0, 5)
    assert int(board.state.request) == Request.RELEASE
    assert not board.state.phases.permitted
    assert board.refused == (0, 0.2)


def test_only_sessions_from_the_least_one_on_can_claim(claim: ModuleType) -> None:
    for session, holder in (
        (LEAST_SESSION - 1, 0),
        (LEAST_SESSION, LEAST_SESSION),
        (LEAST_SESSION + 1, LEAST_SESSION + 1),
    ):
        board = Board(claim)
        assert board.take(session) == (holder == 0)
        assert board.held[0] == holder


def test_a_release_where_nobody_holds_it_changes_nothing(claim: ModuleType) -> None:
    board = Board(claim)
    assert not board.take(FIRST, claimed=0)
    assert board.held == (0, 0.1)
    assert board.refused == (0, 0.2)


def test_the_claim_of_the_holder_keeps_it(claim: ModuleType) -> None:
    board = Board(claim, FIRST)
    board.setpoints.counter, board.claims.counter, board.state.request = 9, 5, Request.ENGAGE.value
    assert not board.take(FIRST)
    assert board.held == (FIRST, 0.0)
    assert (int(board.setpoints.counter), int(board.claims.counter)) == (9, 5)
    assert int(board.state.request) == Request.ENGAGE
    assert board.refused == (0, 0.2)


def test_the_claim_of_another_is_refused_and_counted(claim: ModuleType) -> None:
    board = Board(claim, FIRST)
    board.claims.counter = 5
    assert board.take(SECOND)
    assert board.held == (FIRST, 0.1)
    assert board.refused == (1, 0.0)
    assert board.take(SECOND)
    assert board.refused == (2, 0.0)
    assert int(board.claims.counter) == 5


def test_the_holder_releases_and_nobody_else(claim: ModuleType) -> None:
    board = Board(claim, FIRST)
    assert not board.take(SECOND, claimed=0)
    assert board.held == (FIRST, 0.1)
    assert board.refused == (0, 0.2)
    board.setpoints.counter, board.claims.counter, board.state.request = 9, 5, Request.ENGAGE.value
    assert not board.take(FIRST, claimed=0)
    assert board.held == (0, 0.0)
    assert int(board.setpoints.data_id) == SETPOINT.data_id
    assert (int(board.setpoints.counter), int(board.claims.counter)) == (0, 0)
    assert int(board.state.request) == Request.RELEASE


def test_while_a_set_point_without_a_claim_asks_to_close_nobody_can_claim(claim: ModuleType) -> None:
    for request in Request:
        closes = request not in (Request.IDLE, Request.RELEASE)
        for age, in_time in ((0.0, True), (IN_TIME, True), (IN_TIME + 0.001, False)):
            board = Board(claim)
            board.settings.setpoint_timeout = IN_TIME
            board.state.request, board.state.setpoint_age = request.value, age
            assert board.take(FIRST) == (closes and in_time), (request, age)
            assert board.held[0] == (0 if closes and in_time else FIRST)


def test_a_claim_ends_after_its_time_of_silence(claim: ModuleType) -> None:
    for holder, age, after in ((FIRST, CLAIM_TIMEOUT, FIRST), (FIRST, CLAIM_TIMEOUT + 0.001, 0), (0, 9.0, 0)):
        board = Board(claim, holder)
        board.state.claim.age, board.claims.counter, board.state.request = age, 5, Request.ENGAGE.value
        claim.end_silent_claim(board.state, board.settings, board.claims, board.setpoints)
        ended = holder != after
        assert board.held == (after, 0.0 if ended else age)
        assert int(board.claims.counter) == (0 if ended else 5)
        assert int(board.state.request) == (Request.RELEASE if ended else Request.ENGAGE)


def test_a_claim_is_of_another_where_somebody_else_holds_it(claim: ModuleType) -> None:
    for holder, session, another in ((0, FIRST, False), (FIRST, FIRST, False), (FIRST, SECOND, True), (FIRST, 0, True)):
        board = Board(claim, holder)
        word = int.from_bytes(CLAIM.pack_raw(0, claim=1, session=session), "little", signed=True)
        assert bool(claim.is_of_another(board.state.claim, board.settings, word)) == another


def test_a_refused_claim_is_told_for_a_while(claim: ModuleType) -> None:
    cases: tuple[tuple[int, int, float, Any], ...] = (
        (0, 0, 0.0, Supervision.UNCLAIMED), (FIRST, 0, 0.0, Supervision.CLAIMED),
        (FIRST, 1, CLAIM_TIMEOUT, Supervision.CONTESTED),
        (FIRST, 1, CLAIM_TIMEOUT + 0.001, Supervision.CLAIMED), (0, 2, 0.0, Supervision.CONTESTED),
        (0, 2, 1.0, Supervision.UNCLAIMED),
    )  # fmt: skip
    for holder, refused, age, expected in cases:
        board = Board(claim, holder)
        board.state.claim.refused, board.state.claim.refused_age = refused, age
        assert claim.find_supervision(board.state.claim) == expected.value

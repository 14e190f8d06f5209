"""Claims of the set-points: which supervisor the controller follows, and what it tells of the others."""

from itertools import count

import pytest

from protocols.can.claim import BOUND, CLAIM_TIMEOUT, LEAST_SESSION, Supervision, bind_data_id, make_claim_session
from protocols.can.frames import Frame, list_bus_frames, load_frames
from protocols.can.request import Request
from rt_controller.law.phases import Fault, Phase
from rt_controller.loop.cycle_record import RECORD
from rt_controller.loop.node import ControllerNode
from tests.claims import Supervisor
from tests.rt_controller.test_cycle import sample

FIRST, SECOND = 0x9B21, 0x8A3F
SILENCE = round(CLAIM_TIMEOUT * 1000)  # cycles
DWELL = 30  # cycles of enough pressure after which the clutch counts as closed: 10 ms


class Bus:
    """A controller whose cylinder has enough pressure to close."""

    def __init__(self) -> None:
        self.node = ControllerNode()
        self._ticks = count()

    def step(self, *frames: Frame) -> None:
        sensors = sample(next(self._ticks))[:2]
        self.node.step([*sensors, *frames])

    def close(self, supervisor: Supervisor) -> None:
        """Let it ask for idle and then for torque, until the clutch is closed."""
        for request in (Request.IDLE, *[Request.ENGAGE] * DWELL):
            self.step(supervisor.ask(request, 10.0))
        assert self.phase == Phase.SLIP_CONTROL

    def read(self, name: str) -> float:
        return float(self.node.record.view(RECORD)[name][0])

    @property
    def phase(self) -> Phase:
        return Phase(int(self.read("phase")))

    @property
    def supervision(self) -> Supervision:
        return Supervision(int(self.read("supervisor")))


def test_no_supervisor_makes_the_data_id_of_another_frame() -> None:
    frames = list_bus_frames(clutches=2)
    known = {codec.data_id for codec in frames}
    setpoints = [codec for codec in frames if codec.name in BOUND.values()]
    assert len(setpoints) == len(BOUND) == 2
    for codec in setpoints:
        ids = {bind_data_id(codec.data_id, session) for session in range(LEAST_SESSION, 0x10000)}
        assert len(ids) == 0x10000 - LEAST_SESSION
        assert not ids & known
    assert {make_claim_session(number) >= LEAST_SESSION for number in (0, 1, 0x7FFF, 0xFFFF, 1 << 40)} == {True}


def test_the_crc_shows_every_other_supervisor_whatever_it_asks() -> None:
    setpoint = load_frames()["TORQUE_SETPOINT"]
    for session in (FIRST, SECOND, LEAST_SESSION, 0xFFFF):
        data = setpoint.bind(session).pack(session, 1, 10.0, 10.0, 0.0)
        valid = [other for other in (0, FIRST, SECOND, LEAST_SESSION, 0xFFFF) if setpoint.bind(other).is_valid(data)]
        assert valid == [session]


def test_supervisions_are_numbered_as_in_the_dbc() -> None:
    choices = load_frames()["CONTROLLER_HEARTBEAT"].list_choices("supervisor")
    assert {value: name.upper() for value, name in choices.items()} == {s.value: s.name for s in Supervision}


@pytest.mark.parametrize("session", [0, FIRST])
def test_a_supervisor_is_followed_with_a_claim_and_without(session: int) -> None:
    bus, first = Bus(), Supervisor(session)
    if session:
        bus.step(first.claim())
    bus.close(first)
    assert bus.supervision == (Supervision.CLAIMED if session else Supervision.UNCLAIMED)
    assert bus.node.describe_claim() == {"session": "9b21" if session else None, "claims_refused": 0}


def test_the_heartbeat_tells_who_is_followed() -> None:
    bus, first, heartbeat = Bus(), Supervisor(FIRST), load_frames()["CONTROLLER_HEARTBEAT"]
    sentence = []
    for frames in ([], [first.claim()], [Supervisor(SECOND).claim()]):
        for frame in frames:
            bus.step(frame)
        sent = [frame for _ in range(60) for frame in bus.node.step([])]
        sentence.append([heartbeat.unpack(data).supervisor for can_id, data in sent if can_id == heartbeat.can_id][-1])
    assert sentence == [Supervision.UNCLAIMED, Supervision.CLAIMED, Supervision.CONTESTED]


@pytest.mark.parametrize("other", [Supervisor(0), Supervisor(SECOND)], ids=["unclaimed", "another"])
def test_set_points_of_another_supervisor_are_corrupt_whatever_their_counter(other: Supervisor) -> None:
    bus, first = Bus(), Supervisor(FIRST)
    bus.step(first.claim())
    bus.close(first)
    for _ in range(200):
        other.asked = first.asked
        bus.step(other.ask(Request.RELEASE), first.ask(Request.ENGAGE, 10.0))
        assert bus.read("request") == Request.ENGAGE
    counts = bus.node.count_receptions()["TORQUE_SETPOINT"]
    assert counts["corrupt"] == bus.read("frames_corrupt") == 200
    assert counts["conflicting"] == counts["wrong_sequence"] == 0


def test_the_claim_of_another_is_refused_counted_and_told() -> None:
    bus, first, second = Bus(), Supervisor(FIRST), Supervisor(SECOND, counter=100)
    bus.step(first.claim())
    bus.close(first)
    for n in range(200):
        claims = [second.claim(), first.claim()] if n % 50 == 0 else []
        bus.step(*claims, second.ask(Request.RELEASE), first.ask(Request.ENGAGE, 10.0))
        assert bus.read("request") == Request.ENGAGE
        assert bus.supervision == Supervision.CONTESTED
    assert bus.node.describe_claim() == {"session": "9b21", "claims_refused": 4}
    assert bus.node.first_rejected == "the claim of supervisor 8a3f was refused: another supervisor had the clutch"
    for n in range(SILENCE + 1):
        bus.step(*([first.claim()] if n % 50 == 0 else []), first.ask(Request.ENGAGE, 10.0))
    assert bus.supervision == Supervision.CLAIMED, "the other has gone"
    assert bus.node.count_receptions()["SUPERVISOR_CLAIM"]["wrong_sequence"] == 0


def test_who_has_no_claim_cannot_release_it() -> None:
    bus, first, second = Bus(), Supervisor(FIRST), Supervisor(SECOND)
    bus.step(first.claim())
    bus.close(first)
    bus.step(second.claim(claimed=False), first.ask(Request.ENGAGE, 10.0))
    assert (bus.phase, bus.supervision) == (Phase.SLIP_CONTROL, Supervision.CLAIMED)


@pytest.mark.parametrize("second", [Supervisor(0), Supervisor(SECOND)], ids=["unclaimed", "another"])
def test_after_a_release_the_clutch_opens_and_the_next_asks_for_idle_first(second: Supervisor) -> None:
    bus, first = Bus(), Supervisor(FIRST)
    bus.step(first.claim())
    bus.close(first)
    claims = [second.claim()] if second.session else []
    bus.step(first.claim(claimed=False), *claims, second.ask(Request.ENGAGE, 10.0))
    assert bus.phase == Phase.RELEASE, "in the same cycle"
    assert bus.supervision == (Supervision.CLAIMED if second.session else Supervision.UNCLAIMED)
    bus.node.states["phases"]["phase"] = Phase.IDLE  # the cylinder is empty
    for _ in range(DWELL):
        bus.step(second.ask(Request.ENGAGE, 10.0), first.ask(Request.IDLE))
        assert bus.phase == Phase.IDLE, "the idle of who is not followed does not count"
    bus.close(second)


def test_idle_that_was_asked_before_a_claim_does_not_count_for_it() -> None:
    bus, simple, second = Bus(), Supervisor(0), Supervisor(SECOND)
    bus.step(simple.ask(Request.IDLE))
    bus.step(second.claim(), second.ask(Request.ENGAGE, 10.0))
    assert bus.phase == Phase.IDLE
    bus.close(second)


def test_a_claim_does_not_cut_off_who_asks_to_close_without_one() -> None:
    bus, simple, second = Bus(), Supervisor(0), Supervisor(SECOND)
    bus.close(simple)
    bus.step(second.claim(), simple.ask(Request.ENGAGE, 10.0))
    assert (bus.phase, bus.supervision) == (Phase.SLIP_CONTROL, Supervision.CONTESTED)
    bus.step(simple.ask(Request.RELEASE))
    bus.step(second.claim(), simple.ask(Request.RELEASE))
    assert bus.node.describe_claim()["session"] == "8a3f"


def test_a_claim_takes_the_place_of_who_has_fallen_silent_without_one() -> None:
    bus, simple, second = Bus(), Supervisor(0), Supervisor(SECOND)
    bus.close(simple)
    for _ in range(110):  # longer than setpoint_timeout
        bus.step()
    bus.step(second.claim())
    assert bus.node.describe_claim()["session"] == "8a3f"


def test_a_silent_claim_ends_and_its_set_points_with_it() -> None:
    bus, first = Bus(), Supervisor(FIRST)
    bus.step(first.claim())
    bus.close(first)
    assert bus.node.states["claim"]["age"] == pytest.approx(1e-3 * (DWELL + 1))
    bus.node.states["claim"]["age"] = CLAIM_TIMEOUT - 4e-3
    for _ in range(3):
        bus.step(first.ask(Request.ENGAGE, 10.0))
        assert (bus.phase, bus.supervision) == (Phase.SLIP_CONTROL, Supervision.CLAIMED)
    for _ in range(2):  # one of them is for rounding
        bus.step(first.ask(Request.ENGAGE, 10.0))
    assert (bus.phase, bus.supervision) == (Phase.RELEASE, Supervision.UNCLAIMED)
    bus.node.states["phases"]["phase"] = Phase.IDLE  # the cylinder is empty
    for _ in range(DWELL):
        bus.step(first.claim(), first.ask(Request.ENGAGE, 10.0))
    assert (bus.phase, bus.supervision) == (Phase.IDLE, Supervision.CLAIMED)
    bus.close(first)


def test_a_claim_that_waited_while_the_computer_stood_is_in_time() -> None:
    bus, first = Bus(), Supervisor(FIRST)
    bus.step(first.claim())
    bus.node.step([first.claim()], slots=10 * SILENCE)
    assert bus.node.describe_claim()["session"] == "9b21"


def test_who_copies_the_session_is_found_by_sequence_as_without_a_claim() -> None:
    bus, first, copy = Bus(), Supervisor(FIRST), Supervisor(FIRST, counter=100)
    bus.step(first.claim())
    bus.close(first)
    for _ in range(5):
        bus.step(copy.ask(Request.ENGAGE, 30.0), first.ask(Request.ENGAGE, 10.0))
    assert bus.read("fault") == Fault.SECOND_SENDER


def test_doubts_about_the_set_points_of_before_end_with_the_claim() -> None:
    """Two supervisors without a claim are a fault; one that claims is told apart from both."""
    bus, simple, other, second = Bus(), Supervisor(0), Supervisor(0, counter=100), Supervisor(SECOND)
    for _ in range(10):
        bus.step(simple.ask(Request.IDLE), other.ask(Request.IDLE))
    assert bus.read("fault") == Fault.SECOND_SENDER
    bus.step(second.claim())
    bus.step(simple.ask(Request.IDLE), other.ask(Request.IDLE), second.ask(Request.IDLE))
    assert bus.read("fault") == Fault.NONE
    bus.close(second)


def test_a_session_that_would_make_the_data_id_of_another_frame_is_refused() -> None:
    bus = Bus()
    bus.step(Supervisor(LEAST_SESSION - 1).claim())
    assert bus.node.describe_claim() == {"session": None, "claims_refused": 1}
    bus.step(Supervisor(LEAST_SESSION).claim())
    assert bus.node.describe_claim()["session"] == f"{LEAST_SESSION:04x}"


def test_the_guard_and_the_controller_know_the_same_supervisor() -> None:
    bus, first, second, simple = Bus(), Supervisor(FIRST), Supervisor(SECOND), Supervisor(0)
    acts = [
        [first.claim()], [first.ask(Request.IDLE), second.claim()], [second.claim(claimed=False)],
        [first.claim(claimed=False)], [simple.ask(Request.ENGAGE)], [second.claim()], [simple.ask(Request.RELEASE)],
        [second.claim(), first.claim()], *[[]] * (SILENCE + 2), [first.claim()],
    ]  # fmt: skip
    held, apart = [], 0
    for act in acts:
        bus.step(*act)
        state = bus.node.states[0]
        apart += state["guard"]["session"] != state["claim"]["session"]
        held.append(int(state["claim"]["session"]))
    assert held[:8] == [FIRST, FIRST, FIRST, 0, 0, 0, 0, SECOND]
    assert held[-2:] == [0, FIRST]
    assert apart <= 1, "in the cycle in which the silence is long enough, by rounding"

"""What two supervisors do on one bus while the clutch slips: the one that has claimed the set-points is followed, no other."""

from collections.abc import Callable

import numpy as np
import pytest

from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from plant_sim.profiles.profile import Profile
from plant_sim.profiles.shift_profile import load_shift_profile
from protocols.can.claim import CLAIM_TIMEOUT, Supervision, make_claim_session
from protocols.can.frames import Frame, load_frames
from protocols.can.request import Request
from protocols.node import load_node
from rt_controller.law.phases import Fault, Phase
from tests.claims import Supervisor, drop, drop_claims
from tests.clutch_hil.bench.test_protected_loop import AT, CLOSED, DEMAND, END, RATE, Bus, check_safe, play

HELD = make_claim_session(1)  # of the plant, whose session is 1
OTHER = 0x8A3F
SILENCE = round(CLAIM_TIMEOUT * RATE)  # ticks
TORQUE = "truth_clutch_torque_nm"


@pytest.fixture(scope="module")
def undisturbed() -> dict[str, np.ndarray]:
    columns, plant = play()
    assert columns[TORQUE][AT] == pytest.approx(DEMAND, abs=0.5)
    assert set(columns["controller_supervisor"]) == {Supervision.CLAIMED}
    assert plant.first_rejected == ""
    return columns


def compare(columns: dict[str, np.ndarray], expected: dict[str, np.ndarray], *but: str) -> None:
    """Check that all columns are equal to the bit, but for some of the controller."""
    for name, values in columns.items():
        if name.removeprefix("controller_") not in but:
            np.testing.assert_array_equal(values, expected[name], err_msg=name)


def test_without_claims_a_bus_does_what_it_did(undisturbed: dict[str, np.ndarray]) -> None:
    """As logs from before, and simple supervisors."""
    columns, _ = play(lambda _, frames: drop_claims(frames))
    compare(columns, undisturbed, "supervisor")
    assert set(columns["controller_supervisor"]) == {Supervision.UNCLAIMED}


@pytest.mark.parametrize("session", [0, OTHER], ids=["unclaimed", "another"])
@pytest.mark.parametrize("first", [True, False], ids=["before the first", "after it"])
def test_a_second_supervisor_with_right_counters_changes_nothing(
    undisturbed: dict[str, np.ndarray], session: int, first: bool
) -> None:
    second = Supervisor(session)

    def send(tick: int, frames: list[Frame]) -> list[Frame]:
        if tick < AT:
            return frames
        second.asked = tick - 1  # the plant counts set-points by its ticks
        own = second.ask(Request.ENGAGE, 30.0)
        return [own, *frames] if first else [*frames, own]

    columns, _ = play(send)
    compare(columns, undisturbed, "frames_corrupt")
    assert columns["controller_frames_corrupt"][-1] == END - AT


def test_a_second_claim_is_refused_and_changes_no_torque(undisturbed: dict[str, np.ndarray]) -> None:
    second = Supervisor(OTHER)

    def send(tick: int, frames: list[Frame]) -> list[Frame]:
        if not AT <= tick < AT + 1000:
            return frames
        claims = [second.claim()] if tick % 50 == 0 else []
        return [*claims, *frames, second.ask(Request.ENGAGE, 30.0)]

    columns, _ = play(send)
    compare(columns, undisturbed, "frames_corrupt", "supervisor")
    sentence = columns["controller_supervisor"]
    assert set(sentence[AT : AT + 1000]) == {Supervision.CONTESTED}
    assert set(sentence[:AT]) == set(sentence[AT + 1000 + SILENCE :]) == {Supervision.CLAIMED}


def test_who_copies_the_session_is_found_by_what_the_first_sends() -> None:
    copy = Supervisor(HELD)
    columns, _ = play(lambda tick, frames: [*frames, copy.ask(Request.ENGAGE, 30.0)] if tick >= AT else frames)
    assert columns["controller_fault"][-1] == Fault.SECOND_SENDER
    check_safe(columns, AT, 8)


def test_who_copies_session_and_counter_of_one_that_is_cut_off_is_followed() -> None:
    """The limit of it, which the page tells: a CRC is no signature."""
    copy = Supervisor(HELD)

    def send(tick: int, frames: list[Frame]) -> list[Frame]:
        copy.asked = tick - 1
        setpoint = copy.ask(Request.ENGAGE, 0.5 * DEMAND, 10.47)
        return [*drop(frames, "TORQUE_SETPOINT"), setpoint] if tick >= AT else frames

    columns, _ = play(send)
    assert not columns["controller_fault"].any()
    assert columns[TORQUE][-1] == pytest.approx(0.5 * DEMAND, abs=0.5)


def take_over(idle_at: int) -> Bus:
    """The plant, cut off at AT, releases its claim; another claims and asks for torque, and for idle at one time."""
    plant, second = Supervisor(HELD, counter=AT // 50 + 1), Supervisor(OTHER)

    def send(tick: int, frames: list[Frame]) -> list[Frame]:
        if tick < AT:
            return frames
        others = drop(frames, "TORQUE_SETPOINT", "SUPERVISOR_CLAIM")
        claims = [plant.claim(claimed=False)] if tick == AT else []
        claims += [second.claim()] if tick % 50 == 0 else []
        request = Request.IDLE if idle_at <= tick < idle_at + 100 else Request.ENGAGE
        return [*others, *claims, second.ask(request, 0.7 * DEMAND, 10.47)]

    return send


def test_after_a_release_another_takes_over_and_asks_for_idle_first() -> None:
    idle = AT + 800
    columns, _ = play(take_over(idle))
    check = {name: values[: idle + 100] for name, values in columns.items()}
    check_safe(check, AT, 1)
    assert set(columns["controller_supervisor"]) == {Supervision.CLAIMED}
    assert not columns["controller_fault"].any()
    assert columns[TORQUE][-1] == pytest.approx(0.7 * DEMAND, abs=0.5)


def test_a_silent_claim_ends_and_the_clutch_opens() -> None:
    """The set-points go on; so do the claims, 1 s later, and the demand, which is no request for idle."""
    back = AT + 1000

    def send(tick: int, frames: list[Frame]) -> list[Frame]:
        return drop(frames, "SUPERVISOR_CLAIM") if AT <= tick < back else frames

    columns, _ = play(send)
    last = AT - 50  # the last claim
    check_safe(columns, last + SILENCE, 2)
    sentence = columns["controller_supervisor"]
    assert set(sentence[last + SILENCE + 2 : back]) == {Supervision.UNCLAIMED}
    assert set(sentence[back:]) == {Supervision.CLAIMED}
    assert columns["controller_phase"][-1] == Phase.IDLE
    assert not columns["controller_fault"].any()


AGAIN = Profile(
    "again",
    (0.0, 0.6, 0.9, 2.5, 2.51, 2.81, 3.2, END / RATE),
    (0.0, 0.0, DEMAND, DEMAND, 0.0, 0.0, DEMAND, DEMAND),
    (10.47,) * 8,
)


def restart(make_plant: Callable[[int], PlantNode | None], renew: bool) -> list[tuple[int, float, float]]:
    """Phase, supervisor and torque of each tick; at AT there is another plant, or another controller where `renew` says so."""
    plant, controller = PlantNode(profile=AGAIN), load_node("controller")()
    inbox: list[Frame] = []
    rows = []
    for tick in range(END + AT):
        if tick == AT:
            plant, inbox = make_plant(tick) or plant, []
            controller = load_node("controller")() if renew else controller
        if plant.finished:
            break
        inbox = controller.step(plant.step(inbox))
        row = dict(zip((c.name for c in controller.columns), controller.make_row(), strict=True))
        truth = dict(zip((c.name for c in plant.columns), plant.make_row(), strict=True))
        rows.append((int(row["phase"]), row["supervisor"], truth[TORQUE]))
    return rows


def test_a_controller_that_restarts_in_a_run_waits_for_a_claim_and_does_not_close_by_itself() -> None:
    rows = restart(lambda _: None, renew=True)
    phases, sentence, torque = map(np.array, zip(*rows, strict=True))
    assert torque[AT - 1] == pytest.approx(DEMAND, abs=0.5)
    bound = AT + int(np.flatnonzero(sentence[AT:] == Supervision.CLAIMED)[0])
    assert bound <= AT + 50
    assert set(phases[AT:2510]) == {Phase.IDLE}
    assert torque[AT + 100 : 2510].max() < CLOSED
    assert torque[-1] == pytest.approx(DEMAND, abs=0.5), "after idle"


def test_a_plant_that_restarts_has_the_claim_when_that_of_before_is_silent() -> None:
    rows = restart(lambda _: PlantNode(profile=AGAIN, session=2), renew=False)
    phases, sentence, torque = map(np.array, zip(*rows, strict=True))
    assert set(sentence[AT : AT + SILENCE - 55]) == {Supervision.CONTESTED}
    assert torque[AT + 100 : AT + 600].max() < CLOSED
    assert set(sentence[AT + 2 * SILENCE + 100 :]) == {Supervision.CLAIMED}
    assert torque[AT + 1500] == pytest.approx(DEMAND, abs=0.5)
    assert phases[AT + 1500] == Phase.SLIP_CONTROL


def test_each_of_two_clutches_has_a_supervisor_of_its_own() -> None:
    """Another claims both; then the plant releases b, which the other takes over, and a is as before."""
    plant = PowerShiftNode(profile=load_shift_profile("shift", 1.0))
    nodes = {clutch: load_node("controller")(clutch=clutch) for clutch in ("a", "b")}
    others = {clutch: Supervisor(OTHER, clutch=clutch) for clutch in nodes}
    released = load_frames(clutch="b")["SUPERVISOR_CLAIM"]
    sent: list[Frame] = []
    while not plant.finished:
        frames = plant.step(sent)
        if plant.tick == 210:
            frames += [other.claim() for other in others.values()]
        if plant.tick == 220:
            frames += [Frame(released.can_id, released.pack(6, session=HELD)), others["b"].claim()]
        if plant.tick == 210:
            assert {node.describe_claim()["session"] for node in nodes.values()} == {f"{HELD:04x}"}
        sent = [frame for node in nodes.values() for frame in node.step([*sent, *frames])]
        if plant.tick == 220:
            break
    claims = {clutch: node.describe_claim() for clutch, node in nodes.items()}
    assert claims["a"] == {"session": f"{HELD:04x}", "claims_refused": 1}
    assert claims["b"] == {"session": f"{OTHER:04x}", "claims_refused": 1}

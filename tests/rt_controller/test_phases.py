"""Phases of the clutch: the transitions of the docstring and no other. Each test has the module as argument, so that it can
run on mutants (tests/mutation)."""

from collections import namedtuple
from collections.abc import Callable
from itertools import product
from types import ModuleType
from typing import Any

import pytest

import rt_controller.law.phases
from protocols.can.frames import load_frames
from rt_controller.guard import limits
from rt_controller.law.phases import PHASE_SETTINGS, PHASES, Fault, Phase, Request
from rt_controller.law.record import make_record

BAR = 1e5
STEP = 1e-3
LIMITS = {
    "contact_pressure": 2.35 * BAR,
    "released_pressure": 1.0 * BAR,
    "fill_dwell": 0.01,
    "fill_timeout": 1.5,
}
SETTINGS = make_record(PHASE_SETTINGS, LIMITS)
BOOLEANS = (False, True)
CLOSING = (Request.ENGAGE, Request.PRESSURE, Request.LOCK)
FOLLOWING = (Request.ENGAGE, Request.PRESSURE)
PRESSURES = {"low": 0.5 * BAR, "between": 2.0 * BAR, "contact": 2.6 * BAR}
GUARD = (Fault.NONE, Fault.STALE_SENSORS, Fault.OVERPRESSURE, Fault.OVERTEMPERATURE, Fault.OVERSPEED)

# Every arrow of the docstring: (from, to): when, of a case. Guard healthy; `dwelt`: every dwell is over, `late`: the time-out.
Case = namedtuple("Case", "request pressure dwelt late permitted lost implausible")
ARROWS: dict[tuple[Phase, Phase], Callable[[Case], bool]] = {
    (Phase.IDLE, Phase.FILL): lambda c: c.request in CLOSING and c.permitted,
    (Phase.FILL, Phase.SLIP_CONTROL): lambda c: c.request in FOLLOWING and c.pressure == "contact" and c.dwelt,
    (Phase.FILL, Phase.LOCK): lambda c: c.request is Request.LOCK and c.pressure == "contact" and c.dwelt,
    (Phase.FILL, Phase.RELEASE): lambda c: c.request not in CLOSING,
    (Phase.FILL, Phase.FAULT): lambda c: c.request in CLOSING and c.late and not (c.pressure == "contact" and c.dwelt),
    (Phase.SLIP_CONTROL, Phase.RELEASE): lambda c: c.request not in CLOSING,
    (Phase.SLIP_CONTROL, Phase.FAULT): lambda c: c.request in CLOSING and (c.lost or c.implausible),
    (Phase.SLIP_CONTROL, Phase.LOCK): lambda c: c.request is Request.LOCK and not (c.lost or c.implausible),
    (Phase.LOCK, Phase.RELEASE): lambda c: c.request not in CLOSING,
    (Phase.LOCK, Phase.FAULT): lambda c: c.request in CLOSING and (c.lost or c.implausible),
    (Phase.LOCK, Phase.SLIP_CONTROL): lambda c: c.request in FOLLOWING and not (c.lost or c.implausible),
    (Phase.RELEASE, Phase.IDLE): lambda c: c.pressure == "low",
    (Phase.FAULT, Phase.IDLE): lambda c: c.request is Request.IDLE,
}
CASES = [Case(*values) for values in product(Request, PRESSURES, *[BOOLEANS] * 5)]


@pytest.fixture(scope="module")
def phases() -> ModuleType:
    return rt_controller.law.phases


class PhaseMachine:
    """The function `advance` of a module with a record of its own; phase and fault as enumerations."""

    def __init__(
        self, module: ModuleType, settings: Any, phase: Phase = Phase.IDLE, fault: Fault = Fault.NONE, lasted: float = 0.0,
        dwelt: float = 0.0, permitted: bool = False,
    ) -> None:  # fmt: skip
        self._state = make_record(
            PHASES, phase=phase, fault=fault, time_in_phase=lasted, time_in_contact=dwelt, permitted=permitted
        )
        self._module, self._settings = module, settings

    def step(
        self, request: Request, pressure: float, lost: bool, implausible: bool, finding: Fault, step: float
    ) -> Phase:
        arguments = self._state, self._settings, request.value, pressure, lost, implausible, finding.value, step
        return Phase(self._module.advance(*arguments))

    @property
    def phase(self) -> Phase:
        return Phase(self._state.phase)

    @property
    def fault(self) -> Fault:
        return Fault(self._state.fault)


def make_machine(
    phases: ModuleType, phase: Phase, dwelt: bool = False, late: bool = False, permitted: bool = True
) -> PhaseMachine:
    fault = Fault.OVERPRESSURE if phase is Phase.FAULT else Fault.NONE
    dwell = 1.0 if dwelt else 0.0
    return PhaseMachine(phases, SETTINGS, phase, fault, 1.5 if late else 0.5, dwell, permitted)


def step(
    clutch: PhaseMachine, request: Request, pressure: float, guard: Fault = Fault.NONE, step: float = STEP
) -> Phase:
    return clutch.step(request, pressure, False, False, guard, step)


def test_every_transition_of_the_docstring_and_no_other(phases: ModuleType) -> None:
    for phase in Phase:
        assert_transitions(phases, phase)


def assert_transitions(phases: ModuleType, phase: Phase) -> None:
    seen = set()
    for case, guard in product(CASES, GUARD):
        clutch = make_machine(phases, phase, case.dwelt, case.late, case.permitted)
        after = clutch.step(case.request, PRESSURES[case.pressure], case.lost, case.implausible, guard, STEP)
        expected = {to for (start, to), when in ARROWS.items() if start is phase and when(case)}
        sentence = f"{phase.name} {case} {guard.name}"
        assert after is clutch.phase, sentence
        assert {after} == ({Phase.FAULT} if guard else expected or {phase}), sentence
        seen.add(after)
        # the reason is given in a fault and only there
        if after is not Phase.FAULT:
            assert clutch.fault is Fault.NONE, sentence
        elif guard:
            assert clutch.fault is guard, sentence
        else:
            doubt = Fault.PRESSURE_LOST if case.lost else Fault.TORQUE_IMPLAUSIBLE
            reasons = {Phase.FAULT: Fault.OVERPRESSURE, Phase.FILL: Fault.FILL_TIMEOUT}
            reasons |= {Phase.SLIP_CONTROL: doubt, Phase.LOCK: doubt}
            assert clutch.fault is reasons[phase], sentence
    assert seen == {to for start, to in ARROWS if start is phase} | {phase, Phase.FAULT}


def test_arrows_never_contradict() -> None:
    for phase, case in product(Phase, CASES):
        assert len([end for (start, end), when in ARROWS.items() if start is phase and when(case)]) <= 1


def test_each_engagement_needs_a_request_for_idle_before_it(phases: ModuleType) -> None:
    clutch = PhaseMachine(phases, SETTINGS)
    assert step(clutch, Request.ENGAGE, 0.0) is Phase.IDLE, "a controller that restarts"
    assert step(clutch, Request.RELEASE, 0.0) is Phase.IDLE
    assert step(clutch, Request.ENGAGE, 0.0) is Phase.IDLE, "a supervisor that comes back"
    assert step(clutch, Request.IDLE, 0.0) is Phase.IDLE
    assert step(clutch, Request.ENGAGE, 0.0) is Phase.FILL
    assert step(clutch, Request.RELEASE, 0.0) is Phase.RELEASE
    assert step(clutch, Request.RELEASE, 0.0) is Phase.IDLE
    assert step(clutch, Request.ENGAGE, 0.0) is Phase.IDLE, "once"


def test_another_supervisor_begins_with_an_open_clutch(phases: ModuleType) -> None:
    for phase in Phase:
        state = make_record(PHASES, phase=phase, time_in_phase=5.0, permitted=True)
        phases.let_go(state)
        opens = phase in (Phase.FILL, Phase.SLIP_CONTROL, Phase.LOCK)
        assert state.phase == (Phase.RELEASE if opens else phase)
        assert state.time_in_phase == (0.0 if opens else 5.0)
        assert not state.permitted


def test_phases_and_requests_are_numbered_as_in_the_dbc(phases: ModuleType) -> None:
    frames = load_frames()
    for enumeration, frame, signal in (
        (phases.Phase, "CONTROLLER_STATUS", "PHASE"),
        (Request, "TORQUE_SETPOINT", "REQUEST"),
        (phases.Fault, "CONTROLLER_STATUS", "FAULT"),
    ):
        [choices] = [s.choices for s in frames[frame].definitions if s.name == signal]
        assert {int(value): str(name).upper() for value, name in choices.items()} == {
            e.value: e.name for e in enumeration
        }


def test_faults_are_numbered_as_the_guards_findings_then_the_fill_time_out(phases: ModuleType) -> None:
    for fault in GUARD[1:]:
        assert getattr(limits, fault.name) == phases.Fault[fault.name].value
    assert (phases.Fault.NONE, phases.Fault.FILL_TIMEOUT) == (limits.HEALTHY, 5)


def test_dwell_is_complete_at_its_end_and_a_time_out_after_it(phases: ModuleType) -> None:
    quarters = {"contact_pressure": 2.0, "released_pressure": 1.0, "fill_dwell": 0.5, "fill_timeout": 1.0}
    binary = make_record(PHASE_SETTINGS, LIMITS | quarters)  # sums of quarters are exact
    clutch = PhaseMachine(phases, binary, permitted=True)
    assert [step(clutch, Request.ENGAGE, p, Fault.NONE, 0.25) for p in (0.0, 2.0, 2.0)] == [
        Phase.FILL,
        Phase.FILL,
        Phase.SLIP_CONTROL,
    ]
    clutch = PhaseMachine(phases, binary, permitted=True)
    assert [step(clutch, Request.ENGAGE, 0.0, Fault.NONE, 0.25) for _ in range(6)] == [Phase.FILL] * 5 + [Phase.FAULT]


def test_a_clutch_starts_idle_and_healthy(phases: ModuleType) -> None:
    clutch = PhaseMachine(phases, SETTINGS)
    assert (clutch.phase, clutch.fault) == (Phase.IDLE, Fault.NONE)


def make_filling_machine(phases: ModuleType) -> PhaseMachine:
    clutch = PhaseMachine(phases, SETTINGS, permitted=True)
    assert step(clutch, Request.ENGAGE, 0.0, Fault.NONE, STEP) is Phase.FILL
    return clutch


def test_pressure_must_stay_above_contact_for_the_whole_dwell(phases: ModuleType) -> None:
    clutch = make_filling_machine(phases)
    for _ in range(9):
        assert step(clutch, Request.ENGAGE, 2.6 * BAR, Fault.NONE, STEP) is Phase.FILL
    assert step(clutch, Request.ENGAGE, 2.34 * BAR, Fault.NONE, STEP) is Phase.FILL, "a dip starts the dwell again"
    for _ in range(9):
        assert step(clutch, Request.ENGAGE, 2.35 * BAR, Fault.NONE, STEP) is Phase.FILL
    assert step(clutch, Request.ENGAGE, 2.35 * BAR, Fault.NONE, 1.001 * STEP) is Phase.SLIP_CONTROL


def test_a_fill_that_takes_too_long_is_a_fault(phases: ModuleType) -> None:
    clutch, steps = make_filling_machine(phases), 0
    while step(clutch, Request.ENGAGE, 2.0 * BAR, Fault.NONE, STEP) is Phase.FILL:
        steps += 1
        assert steps < 2000
    assert (clutch.phase, clutch.fault) == (Phase.FAULT, Fault.FILL_TIMEOUT)
    assert steps * STEP == pytest.approx(SETTINGS.fill_timeout, abs=2 * STEP)


def test_each_fill_has_the_full_time(phases: ModuleType) -> None:
    clutch = make_filling_machine(phases)
    for _ in range(1400):
        step(clutch, Request.ENGAGE, 0.5 * BAR, Fault.NONE, STEP)
    assert step(clutch, Request.IDLE, 0.5 * BAR, Fault.NONE, STEP) is Phase.RELEASE
    assert step(clutch, Request.IDLE, 0.5 * BAR, Fault.NONE, STEP) is Phase.IDLE
    for _ in range(1400):
        assert step(clutch, Request.ENGAGE, 0.5 * BAR, Fault.NONE, STEP) is Phase.FILL


def test_slip_control_has_no_time_out(phases: ModuleType) -> None:
    clutch = make_machine(phases, Phase.SLIP_CONTROL)
    for _ in range(5000):
        assert step(clutch, Request.ENGAGE, 2.0 * BAR, Fault.NONE, STEP) is Phase.SLIP_CONTROL


def test_a_fault_is_latched_until_idle_is_asked(phases: ModuleType) -> None:
    for cause in Fault:
        if cause:
            assert_latched(phases, cause)


def assert_latched(phases: ModuleType, cause: Fault) -> None:
    clutch = PhaseMachine(phases, SETTINGS, Phase.FAULT, cause)
    for request in (Request.ENGAGE, Request.RELEASE, Request.ENGAGE):
        for pressure in PRESSURES.values():
            assert step(clutch, request, pressure, Fault.NONE, 10.0) is Phase.FAULT
            assert clutch.fault is cause
    assert step(clutch, Request.IDLE, 3.0 * BAR, Fault.NONE, STEP) is Phase.IDLE
    assert clutch.fault is Fault.NONE


def test_idle_does_not_clear_a_fault_while_the_guard_finds_something(phases: ModuleType) -> None:
    for cause in GUARD[1:]:
        assert_not_cleared(phases, cause)


def assert_not_cleared(phases: ModuleType, cause: Fault) -> None:
    clutch = PhaseMachine(phases, SETTINGS, Phase.FAULT, cause)
    for _ in range(5):
        assert step(clutch, Request.IDLE, 0.0, cause, STEP) is Phase.FAULT


def test_no_path_leads_from_fault_to_fill_in_one_step(phases: ModuleType) -> None:
    for request in Request:
        clutch = make_machine(phases, Phase.FAULT)
        assert step(clutch, request, 2.6 * BAR, Fault.NONE, STEP) in (Phase.FAULT, Phase.IDLE)


def test_a_release_is_finished_before_the_clutch_engages_again(phases: ModuleType) -> None:
    clutch = make_machine(phases, Phase.RELEASE)
    assert step(clutch, Request.ENGAGE, 2.6 * BAR, Fault.NONE, STEP) is Phase.RELEASE
    assert step(clutch, Request.ENGAGE, 1.0 * BAR, Fault.NONE, STEP) is Phase.RELEASE
    assert step(clutch, Request.ENGAGE, 0.99 * BAR, Fault.NONE, STEP) is Phase.IDLE

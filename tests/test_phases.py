"""Phases of the clutch: the transitions of the docstring and no other."""

from itertools import product

import pytest

from protocols.frames import load_frames
from rt_controller import limits
from rt_controller.phases import Fault, Phase, PhaseMachine, PhaseSettings, Request

BAR = 1e5
STEP = 1e-3
SETTINGS = PhaseSettings(contact_pressure=2.35 * BAR, released_pressure=1.0 * BAR, fill_dwell=0.01, fill_timeout=1.5)
PRESSURES = {"low": 0.5 * BAR, "between": 2.0 * BAR, "contact": 2.6 * BAR}
GUARD = (Fault.NONE, Fault.STALE_SENSORS, Fault.OVERPRESSURE, Fault.OVERTEMPERATURE, Fault.OVERSPEED)

# Every arrow of the docstring: (from, to): when, in terms of request, pressure, dwell over, time over. Guard healthy.
ARROWS = {
    (Phase.IDLE, Phase.FILL): lambda request, pressure, dwelt, late: request is Request.ENGAGE,
    (Phase.FILL, Phase.SLIP_CONTROL): lambda request, pressure, dwelt, late: (
        request is Request.ENGAGE and pressure == "contact" and dwelt
    ),
    (Phase.FILL, Phase.RELEASE): lambda request, pressure, dwelt, late: request is not Request.ENGAGE,
    (Phase.FILL, Phase.FAULT): lambda request, pressure, dwelt, late: (
        request is Request.ENGAGE and late and not (pressure == "contact" and dwelt)
    ),
    (Phase.SLIP_CONTROL, Phase.RELEASE): lambda request, pressure, dwelt, late: request is not Request.ENGAGE,
    (Phase.RELEASE, Phase.IDLE): lambda request, pressure, dwelt, late: pressure == "low",
    (Phase.FAULT, Phase.IDLE): lambda request, pressure, dwelt, late: request is Request.IDLE,
}


def machine(phase: Phase, dwelt: bool = False, late: bool = False) -> PhaseMachine:
    fault = Fault.OVERPRESSURE if phase is Phase.FAULT else Fault.NONE
    return PhaseMachine(SETTINGS, phase, fault, 1.5 if late else 0.5, 0.02 if dwelt else 0.0)


@pytest.mark.parametrize("phase", list(Phase))
def test_every_transition_of_the_docstring_and_no_other(phase: Phase) -> None:
    seen = set()
    for request, pressure, guard, dwelt, late in product(Request, PRESSURES, GUARD, (False, True), (False, True)):
        clutch = machine(phase, dwelt, late)
        after = clutch.step(request, PRESSURES[pressure], guard, STEP)
        if guard:
            expected = {Phase.FAULT}
        else:
            arrows = ARROWS.items()
            expected = {to for (start, to), when in arrows if start is phase and when(request, pressure, dwelt, late)}
        case = f"{phase.name} {request.name} {pressure} {guard.name} dwelt={dwelt} late={late}"
        assert after is clutch.phase, case
        assert {after} == (expected or {phase}), case
        seen.add(after)
        # the reason is given in a fault and only there
        if after is not Phase.FAULT:
            assert clutch.fault is Fault.NONE, case
        elif guard:
            assert clutch.fault is guard, case
        else:
            assert clutch.fault is (Fault.OVERPRESSURE if phase is Phase.FAULT else Fault.FILL_TIMEOUT), case
    assert seen == {to for start, to in ARROWS if start is phase} | {phase, Phase.FAULT}


def test_arrows_never_contradict() -> None:
    for phase, request, pressure, dwelt, late in product(Phase, Request, PRESSURES, (False, True), (False, True)):
        to = [end for (start, end), when in ARROWS.items() if start is phase and when(request, pressure, dwelt, late)]
        assert len(to) <= 1


def test_phases_and_requests_are_numbered_as_in_the_dbc() -> None:
    frames = load_frames()
    for enumeration, frame, signal in (
        (Phase, "CONTROLLER_STATUS", "PHASE"),
        (Request, "TORQUE_SETPOINT", "REQUEST"),
    ):
        [choices] = [s.choices for s in frames[frame].definitions if s.name == signal]
        assert {int(value): str(name).upper() for value, name in choices.items()} == {
            e.value: e.name for e in enumeration
        }


def test_faults_are_numbered_as_the_guards_findings_then_the_fill_time_out() -> None:
    for fault in GUARD[1:]:
        assert getattr(limits, fault.name) == fault.value
    assert (Fault.NONE, Fault.FILL_TIMEOUT) == (limits.HEALTHY, 5)


def test_dwell_is_complete_at_its_end_and_a_time_out_after_it() -> None:
    binary = PhaseSettings(2.0, 1.0, fill_dwell=0.5, fill_timeout=1.0)  # sums of quarters are exact
    clutch = PhaseMachine(binary)
    assert [clutch.step(Request.ENGAGE, p, Fault.NONE, 0.25) for p in (0.0, 2.0, 2.0)] == [
        Phase.FILL,
        Phase.FILL,
        Phase.SLIP_CONTROL,
    ]
    clutch = PhaseMachine(binary)
    assert [clutch.step(Request.ENGAGE, 0.0, Fault.NONE, 0.25) for _ in range(6)] == [Phase.FILL] * 5 + [Phase.FAULT]


def test_a_clutch_starts_idle_and_healthy() -> None:
    clutch = PhaseMachine(SETTINGS)
    assert (clutch.phase, clutch.fault) == (Phase.IDLE, Fault.NONE)


def filling() -> PhaseMachine:
    clutch = PhaseMachine(SETTINGS)
    assert clutch.step(Request.ENGAGE, 0.0, Fault.NONE, STEP) is Phase.FILL
    return clutch


def test_pressure_must_stay_above_contact_for_the_whole_dwell() -> None:
    clutch = filling()
    for _ in range(9):
        assert clutch.step(Request.ENGAGE, 2.6 * BAR, Fault.NONE, STEP) is Phase.FILL
    assert clutch.step(Request.ENGAGE, 2.34 * BAR, Fault.NONE, STEP) is Phase.FILL, "a dip starts the dwell again"
    for _ in range(9):
        assert clutch.step(Request.ENGAGE, 2.35 * BAR, Fault.NONE, STEP) is Phase.FILL
    assert clutch.step(Request.ENGAGE, 2.35 * BAR, Fault.NONE, 1.001 * STEP) is Phase.SLIP_CONTROL


def test_a_fill_that_takes_too_long_is_a_fault() -> None:
    clutch, steps = filling(), 0
    while clutch.step(Request.ENGAGE, 2.0 * BAR, Fault.NONE, STEP) is Phase.FILL:
        steps += 1
        assert steps < 2000
    assert (clutch.phase, clutch.fault) == (Phase.FAULT, Fault.FILL_TIMEOUT)
    assert steps * STEP == pytest.approx(SETTINGS.fill_timeout, abs=2 * STEP)


def test_each_fill_has_the_full_time() -> None:
    clutch = filling()
    for _ in range(1400):
        clutch.step(Request.ENGAGE, 0.5 * BAR, Fault.NONE, STEP)
    assert clutch.step(Request.IDLE, 0.5 * BAR, Fault.NONE, STEP) is Phase.RELEASE
    assert clutch.step(Request.IDLE, 0.5 * BAR, Fault.NONE, STEP) is Phase.IDLE
    for _ in range(1400):
        assert clutch.step(Request.ENGAGE, 0.5 * BAR, Fault.NONE, STEP) is Phase.FILL


def test_slip_control_has_no_time_out() -> None:
    clutch = machine(Phase.SLIP_CONTROL)
    for _ in range(5000):
        assert clutch.step(Request.ENGAGE, 2.0 * BAR, Fault.NONE, STEP) is Phase.SLIP_CONTROL


@pytest.mark.parametrize("cause", [fault for fault in Fault if fault])
def test_a_fault_is_latched_until_idle_is_asked(cause: Fault) -> None:
    clutch = PhaseMachine(SETTINGS, Phase.FAULT, cause)
    for request in (Request.ENGAGE, Request.RELEASE, Request.ENGAGE):
        for pressure in PRESSURES.values():
            assert clutch.step(request, pressure, Fault.NONE, 10.0) is Phase.FAULT
            assert clutch.fault is cause
    assert clutch.step(Request.IDLE, 3.0 * BAR, Fault.NONE, STEP) is Phase.IDLE
    assert clutch.fault is Fault.NONE


@pytest.mark.parametrize("cause", GUARD[1:])
def test_idle_does_not_clear_a_fault_while_the_guard_finds_something(cause: Fault) -> None:
    clutch = PhaseMachine(SETTINGS, Phase.FAULT, cause)
    for _ in range(5):
        assert clutch.step(Request.IDLE, 0.0, cause, STEP) is Phase.FAULT


def test_no_path_leads_from_fault_to_fill_in_one_step() -> None:
    for request in Request:
        clutch = machine(Phase.FAULT)
        assert clutch.step(request, 2.6 * BAR, Fault.NONE, STEP) in (Phase.FAULT, Phase.IDLE)


def test_a_release_is_finished_before_the_clutch_engages_again() -> None:
    clutch = machine(Phase.RELEASE)
    assert clutch.step(Request.ENGAGE, 2.6 * BAR, Fault.NONE, STEP) is Phase.RELEASE
    assert clutch.step(Request.ENGAGE, 1.0 * BAR, Fault.NONE, STEP) is Phase.RELEASE
    assert clutch.step(Request.ENGAGE, 0.99 * BAR, Fault.NONE, STEP) is Phase.IDLE

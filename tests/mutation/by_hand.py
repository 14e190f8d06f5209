"""Mutants set by hand: mistakes that were made on purpose in the safety path once, and that no test noticed then."""

from typing import NamedTuple

from tests.mutation.subjects import SUBJECTS, Subject


class HandMade(NamedTuple):
    """A mistake: `old` text of the module's source, which it has once, becomes `new`."""

    what: str
    argument: str
    old: str
    new: str

    @property
    def subject(self) -> Subject:
        return SUBJECTS[self.argument]


_OPENED = "opened = phase == Phase.FILL or phase == Phase.SLIP_CONTROL or phase == Phase.LOCK"
BY_HAND = (
    HandMade(
        "the guard is not applied to the valve command", "cycle",
        "    limit_outbound(node.guard, settings.guard, s.can_id, outbox[sent].data)\n    node.cycle = cycle + 1\n",
        "    node.cycle = cycle + 1\n",
    ),
    HandMade(
        "the guard is always told one slot", "cycle", "close_cycle(guard, settings.guard, slots)",
        "close_cycle(guard, settings.guard, 1)",
    ),
    HandMade(
        "the motor is on in fault", "cycle", "if phase != Phase.FAULT and node.setpoint_age != inf:",
        "if node.setpoint_age != inf:",
    ),
    HandMade("the valve is enabled in release", "cycle", _OPENED, f"{_OPENED} or phase == Phase.RELEASE"),
    HandMade("the valve is enabled in fault", "cycle", _OPENED, f"{_OPENED} or phase == Phase.FAULT"),
    HandMade(
        "the age of the set-point ignores slots that were slept through", "cycle", "node.setpoint_age += elapsed",
        "node.setpoint_age += settings.period",
    ),
    HandMade(
        "a step is not limited", "cycle", "step = min(ticks, _STEP_LIMIT) * settings.period",
        "step = ticks * settings.period",
    ),
    HandMade("a length byte above 8 is taken", "exchange", "                    or frame.length > _DATA\n", ""),
    HandMade(
        "slots that were slept through are not told on a grid", "turn",
        "answer(lines, inbox, count, 1 + missed, node, turns)", "answer(lines, inbox, count, 1, node, turns)",
    ),
    HandMade(
        "an encoder frame without its analog half is a sample", "sample", "    if not sample.analog:\n        return 0\n", "",
    ),
)  # fmt: skip

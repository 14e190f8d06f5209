"""Subjects: the modules of the safety path whose mutants are played, and the tests that must notice each of them."""

from typing import NamedTuple

from tests.mutation.equivalent import EQUIVALENT


class Subject(NamedTuple):
    """A module, the argument and the files of its checks, and the functions that are changed; None for all."""

    module: str
    argument: str
    files: tuple[str, ...]
    only: tuple[str, ...] | None = None

    @property
    def equivalent(self) -> dict[str, str]:
        """Mutants that no test can kill, and why."""
        return EQUIVALENT.get(self.argument, {})


SUBJECTS = {
    subject.argument: subject
    for subject in (
        Subject("protocols.can.words", "words", ("protocols/test_words.py",)),
        Subject("protocols.can.reception", "reception", ("protocols/test_reception_rules.py",)),
        Subject(
            "protocols.can.version", "version", ("protocols/test_version.py",),
            ("Version.counter_start", "Version.counter_modulus", "Version.needs_data_id", "_protect_1", "_check_1",
             "_protect_2", "_check_2", "find_version", "_read_protection"),
        ),
        Subject(
            "protocols.buses.exchange", "exchange",
            tuple(f"protocols/test_exchange_{part}.py" for part in ("calls", "port", "frames")),
        ),
        Subject(
            "rt_controller.loop.cycle", "cycle",
            tuple(f"rt_controller/test_cycle_{part}.py" for part in ("decisions", "reception", "commands")),
        ),
        Subject(
            "rt_controller.guard.limits", "limits",
            tuple(f"rt_controller/test_limits{part}.py" for part in ("", "_content", "_samples", "_claim", "_size")),
        ),
        *(
            Subject(f"rt_controller.law.{name}", name, (f"rt_controller/test_{name}.py",))
            for name in ("clutch_state", "motion", "phases", "plausibility", "presliding", "trim")
        ),
        Subject("rt_controller.loop.claim", "claim", ("rt_controller/test_claim_rules.py",)),
        Subject(
            "plant_sim.node.plant_cycle", "plant_cycle",
            ("plant_sim/test_plant_commands.py", "plant_sim/test_plant_samples.py"),
        ),
        Subject("plant_sim.node.plant_turn", "plant_turn", ("plant_sim/test_plant_turn_steps.py",)),
        Subject("protocols.realtime.beat", "beat", ("protocols/test_beat_rules.py",)),
        Subject("plant_sim.node.plant_service", "plant_service", ("plant_sim/test_plant_service.py",)),
        Subject(
            "rt_controller.loop.turn", "turn", ("rt_controller/test_turn_steps.py", "rt_controller/test_turn_calls.py")
        ),
        Subject("rt_controller.loop.samples", "samples", ("rt_controller/test_samples.py",)),
        Subject("rt_controller.law.sample", "sample", ("rt_controller/test_sample.py",)),
        Subject(
            "rt_controller.loop.node", "node",
            tuple(f"rt_controller/test_{name}.py" for name in ("exit", "node_beginning", "node_calls", "own_limits")),
        ),
        Subject("rt_controller.loop.parameter_sets", "parameter_sets", ("rt_controller/test_parameter_sets.py",)),
        Subject(
            "rt_controller.loop.service", "service",
            tuple(f"rt_controller/test_{part}.py" for part in ("safe_commands", "service_run", "service_loops")),
        ),
        Subject(
            "plant_sim.node.interface", "interface",
            tuple(f"plant_sim/test_interface_{part}.py" for part in ("settings", "frames", "reports")),
        ),
        Subject("rt_controller.loop.phase_lock", "phase_lock", ("rt_controller/test_phase_lock.py",)),
        Subject("rt_controller.loop.trigger", "trigger", ("rt_controller/test_trigger.py",)),
        Subject("rt_controller.law.estimator", "estimator", ("rt_controller/test_estimator.py",)),
        Subject("rt_controller.guard.layout", "layout", ("rt_controller/test_layout_rules.py",)),
        Subject("rt_controller.guard.allowed_limits", "allowed_limits", ("rt_controller/test_allowed_limits.py",)),
        Subject(
            "plant_sim.node.plant_node", "plant_node",
            tuple(f"plant_sim/test_plant_node_{part}.py" for part in ("turns", "changes")),
        ),
        Subject("protocols.buses.bus", "bus", ("protocols/test_bus_rules.py",)),
        Subject("protocols.buses.local_bus", "local_bus", ("protocols/local_bus/test_local_bus_rules.py",)),
    )
}  # fmt: skip

"""What the guard finds in a database whose layout is not its own. Each test has the module as argument, so that it can run on
mutants (tests/mutation)."""

from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import rt_controller.guard.layout
from protocols.can.frames import DBC, DBC_1, load_frames
from protocols.errors import InputError

# Signals whose bits the guard reads or writes
OF_GUARD = {
    "VALVE_COMMAND": ("VALVE_ENABLE", "VALVE_VOLTAGE"),
    "MOTOR_COMMAND": ("MOTOR_ENABLE", "SPEED_DEMAND", "TORQUE_LIMIT"),
    "ANALOG_SENSORS": ("CYLINDER_PRESSURE", "OIL_TEMPERATURE"),
    "ENCODER": ("SHAFT_ANGLE", "SAMPLE_TICK", "MOTOR_TORQUE"),
    "TORQUE_SETPOINT": ("REQUEST",),
    "SUPERVISOR_CLAIM": ("CLAIM", "SESSION"),
}
VALUES = {"motor_range": 65.536, "pressure_range": 10.0, "data_key": 0.0}  # Nm, bar: of the shipped limits
OF_SIZE = {
    "TORQUE_LIMIT": ", as guard.motor_range is 65.536 Nm", "CYLINDER_PRESSURE": ", as guard.pressure_range is 10 bar",
}  # fmt: skip
EITHER_SIGN = ("SPEED_DEMAND", "SHAFT_ANGLE")  # it writes 0 there, and takes differences
ANY_FACTOR = ("MOTOR_TORQUE",)  # the ends of its range are what counts
ZERO = ("SPEED_DEMAND",)  # of any factor: it writes 0 there


@pytest.fixture(scope="module")
def layout() -> ModuleType:
    return rt_controller.guard.layout


class Database:
    """The frames of a database, to be changed."""

    def __init__(self, path: Path = DBC) -> None:
        self.frames = {name: self._copy(codec) for name, codec in load_frames(path).items()}

    def _copy(self, codec: Any) -> Any:
        names = "name", "start", "length", "scale", "offset", "is_signed"
        signals = [SimpleNamespace(**{name: getattr(signal, name) for name in names}) for signal in codec.definitions]
        return SimpleNamespace(
            can_id=codec.can_id, length=codec.length, data_id=codec.data_id, version=codec.version, definitions=signals
        )

    def find(self, frame: str, signal: str) -> Any:
        return next(one for one in self.frames[frame].definitions if one.name == signal)

    def list_of_guard(self) -> list[tuple[str, str]]:
        """Frame and name of each signal of it that the guard reads or writes."""
        result = {(name, signal.name) for name, codec in self.frames.items() for signal in codec.definitions}
        return [(frame, name) for frame, names in OF_GUARD.items() for name in names if (frame, name) in result]

    def list_problems(self, layout: ModuleType, **changed: float) -> list[str]:
        """What `layout` finds in it, which is not to be used then."""
        sentence = ""
        try:
            layout.check_layout(Path("other.dbc"), self.frames, VALUES | changed)
        except InputError as error:
            sentence = str(error)
        head, colon, problems = sentence.partition(" bits: ")
        assert head in ("", "DBC other.dbc: the guard has its own layout, and would read other")
        return problems.split("; ") if colon else []


def test_the_guard_reads_the_databases_of_both_versions(layout: ModuleType) -> None:
    for path in (DBC, DBC_1):
        assert Database(path).list_problems(layout) == []
    assert {name: set(places) for name, (_, places) in layout.LAYOUT.items()} == {
        name: set(signals) for name, signals in OF_GUARD.items()
    }


def test_a_signal_elsewhere_is_told(layout: ModuleType) -> None:
    for path in (DBC, DBC_1):
        for frame, name in Database(path).list_of_guard():
            for field in ("start", "length"):
                for change in (1, -1):
                    database = Database(path)
                    signal = database.find(frame, name)
                    here = f"{signal.start}|{signal.length}"
                    setattr(signal, field, getattr(signal, field) + change)
                    assert database.list_problems(layout) == [
                        f"{frame}.{name} is at {signal.start}|{signal.length}", f"the guard's is at {here}"
                    ]  # fmt: skip


def test_a_signal_with_another_factor_or_an_offset_is_told(layout: ModuleType) -> None:
    for path in (DBC, DBC_1):
        for frame, name in Database(path).list_of_guard():
            for factor, offset in ((1.01, 0), (0.99, 0), (1.0, 1), (1.0, -1), (1.0, 0.5), (1.01, 1)):
                database = Database(path)
                signal = database.find(frame, name)
                own = f"{float(signal.scale):.10g}"
                signal.scale, signal.offset = factor * float(signal.scale), offset
                of_range = OF_SIZE.get(name, "")
                sentence = [
                    f"{frame}.{name} has the factor {signal.scale:.10g} and offset {offset:g}",
                    f"the guard's are {own} and 0{of_range}",
                ]
                if name in ZERO:
                    sentence = [f"{frame}.{name} has the offset {offset:g}", "the guard's is 0"] if offset else []
                assert database.list_problems(layout) == ([] if name in ANY_FACTOR else sentence)


def test_signals_of_a_larger_bench_have_the_range_that_its_guard_is_told(layout: ModuleType) -> None:
    for frame, name, limit in (
        ("MOTOR_COMMAND", "TORQUE_LIMIT", "motor_range"), ("ANALOG_SENSORS", "CYLINDER_PRESSURE", "pressure_range"),
    ):  # fmt: skip
        for ratio in (1.0, 6.0):
            for sentence in (VALUES[limit], 6.0 * VALUES[limit]):
                database = Database()
                database.find(frame, name).scale *= ratio
                problems = database.list_problems(layout, **{limit: sentence})
                assert (problems == []) is (ratio * VALUES[limit] == pytest.approx(sentence))


def test_frames_of_a_larger_bench_have_the_key_that_its_guard_is_told(layout: ModuleType) -> None:
    for key in (0, 2577, 0x37F7):
        for sentence in (0, 2577, 2576, 0x37F7):
            database = Database()
            for codec in database.frames.values():
                codec.data_id ^= key
            problems = database.list_problems(layout, data_key=float(sentence))
            assert (problems == []) is (key == sentence)
            if problems:
                first, second = problems  # one sentence for all frames
                assert first == f"the key of its data IDs is {key}"
                assert second.startswith(
                    f"guard.data_key is {sentence}: CLUTCH_HIL_LIMITS must name the limits of this"
                )


def test_factors_are_the_same_to_a_billionth(layout: ModuleType) -> None:
    for part, same in ((0.995e-9, True), (1.005e-9, False)):
        for sign in (1.0, -1.0):
            database = Database()
            database.find("ENCODER", "SAMPLE_TICK").scale = 1.0 + sign * part
            assert (database.list_problems(layout) == []) is same


def test_a_signal_with_another_sign_is_told_where_it_matters(layout: ModuleType) -> None:
    names = {True: "signed", False: "unsigned"}
    for path in (DBC, DBC_1):
        for frame, name in Database(path).list_of_guard():
            database = Database(path)
            signal = database.find(frame, name)
            own, signal.is_signed = signal.is_signed, not signal.is_signed
            assert database.list_problems(layout) == (
                [] if name in EITHER_SIGN else
                [f"{frame}.{name} is {names[not own]}", f"the guard's is {names[own]}"]
            )  # fmt: skip


def test_a_frame_with_another_identifier_length_or_data_id_is_told(layout: ModuleType) -> None:
    for path in (DBC, DBC_1):
        for name in OF_GUARD:
            if name not in load_frames(path):
                continue
            database = Database(path)
            frame = database.frames[name]
            can_id, length, data_id = frame.can_id, frame.length, frame.data_id
            frame.can_id, frame.length, frame.data_id = can_id + 2, 7, 5
            assert database.list_problems(layout) == [
                f"frame {name} has the identifier 0x{can_id + 2:03X}", f"the guard's is 0x{can_id:03X}",
                f"frame {name} has 7 bytes", f"the guard's has {length}",
                f"frame {name} has the data ID 5", f"the guard's is {data_id}, as guard.data_key is 0",
            ]  # fmt: skip


def test_data_ids_that_no_single_key_explains_are_told_one_by_one(layout: ModuleType) -> None:
    database = Database()
    for number, codec in enumerate(database.frames.values(), 1):
        codec.data_id ^= number
    told = [text for text in database.list_problems(layout) if text.startswith("frame ")]
    assert told == [f"frame {name} has the data ID {database.frames[name].data_id}" for name in OF_GUARD]


def test_a_database_without_a_claim_can_be_used(layout: ModuleType) -> None:
    database = Database()
    del database.frames["SUPERVISOR_CLAIM"]
    assert database.list_problems(layout) == []
    database.find("TORQUE_SETPOINT", "REQUEST").start = 25
    assert database.list_problems(layout) == ["TORQUE_SETPOINT.REQUEST is at 25|3", "the guard's is at 24|3"]


def test_all_that_is_wrong_is_told_at_once(layout: ModuleType) -> None:
    database = Database()
    database.frames["VALVE_COMMAND"].length = 6
    pressure = database.find("ANALOG_SENSORS", "CYLINDER_PRESSURE")
    pressure.start, pressure.is_signed, pressure.offset = 20, False, 3
    assert [problem.split(" ")[0] for problem in database.list_problems(layout)[::2]] == [
        "frame", *3 * ["ANALOG_SENSORS.CYLINDER_PRESSURE"]
    ]  # fmt: skip
    assert len(database.list_problems(layout)) == 8


def test_what_the_guard_does_not_read_may_be_elsewhere(layout: ModuleType) -> None:
    database = Database()
    for frame, codec in database.frames.items():
        for signal in codec.definitions:
            if signal.name not in OF_GUARD.get(frame, ()):
                signal.start, signal.scale, signal.offset = 60, 7.0, 1.0
    assert database.list_problems(layout) == []


def test_names_of_signals_may_be_in_small_letters(layout: ModuleType) -> None:
    database = Database()
    for codec in database.frames.values():
        for signal in codec.definitions:
            signal.name = signal.name.lower()
    assert database.list_problems(layout) == []

"""Two clutches on one bus: the frames of clutch b, derived from those of the DBC, which are clutch a's.

A frame of clutch b is the frame of clutch a with `_B` appended to its name and OFFSET added to its identifier and data ID. So
bit 3 of the identifier is the clutch. The priority is by kind of frame: valve, motor, sensors, set-points; a comes before b.
Frames of motor and plant exist once; the controller of clutch a commands the motor.
"""

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from cantools.database.can import Database, Message, Node

from protocols.can.database import read_data_id, read_database, read_text
from protocols.can.version import DATA_ID
from protocols.errors import InputError, join_names

CLUTCHES = ("a", "b")
# Names of the controllers of both clutches: of services, in telemetry and in columns of runs
CONTROLLERS = ("controller", "controller_b")
OFFSET = 0x008  # identifier of a frame of clutch b minus that of clutch a: bit 3, which the DBC leaves free
SHARED = ("MOTOR_COMMAND", "PLANT_STATUS", "PLANT_HEARTBEAT")  # frames that exist once
_SUFFIX = "_B"  # of a frame's name
_CONTROLLER = "CONTROLLER"  # DBC node of clutch a's controller; that of clutch b is CONTROLLER_B


def check_clutch(name: str) -> str:
    """Return `name` if it is a or b. Raises InputError otherwise."""
    if name not in CLUTCHES:
        raise InputError(f"clutch {name!r} is unknown; allowed are {join_names(CLUTCHES)}")
    return name


def find_other_clutch(name: str) -> str:
    """Return the other of the two clutches. Raises InputError for an unknown `name`."""
    return "b" if check_clutch(name) == "a" else "a"


def make_message(message: Message, clutch: str) -> Message:
    """Return a message of the DBC for a clutch, a or b. Raises InputError for another `clutch`."""
    if check_clutch(clutch) == "a" or message.name in SHARED:
        return message
    own = deepcopy(message)
    own.name, own.frame_id = f"{message.name}{_SUFFIX}", message.frame_id + OFFSET
    if own.dbc and (attribute := own.dbc.attributes.get(DATA_ID)):
        attribute.value = int(attribute.value) + OFFSET
    own._senders = [_rename_node(node) for node in message.senders]  # cantools has no setter
    for signal in own.signals:
        signal.receivers = [_rename_node(node) for node in signal.receivers]
    return own


def make_messages(path: Path, messages: Sequence[Message], clutch: str) -> dict[str, Message]:
    """Return the messages of a clutch, a or b, made from `messages` of the DBC at `path`, by the names of clutch a's.

    A DBC that `write_dbc_text` has written for two clutches contains frames of b; they must equal those made here. Raises
    InputError if one does not, and for another `clutch`.
    """
    if check_clutch(clutch) == "a":
        return {message.name: message for message in messages}
    by_name = {message.name: message for message in messages}
    of_a = [name for name in by_name if name.removesuffix(_SUFFIX) not in by_name.keys() - {name}]
    made = {name: make_message(by_name[name], "b") for name in of_a}
    for name, message in made.items():
        if message.name in by_name and _describe(by_name[message.name]) != _describe(message):
            raise InputError(
                f"DBC {path}: frame {message.name} is not as {name}; for clutch b it needs the same signals, and identifier and"
                f" data ID 0x{OFFSET:X} more"
            )
    return made


def load_two_clutch_database(path: Path) -> Database:
    """Return the DBC at `path` with the frames of clutch b, added if it lacks them.

    Raises InputError if two frames have the same identifier, and for a frame of clutch b that does not match clutch a's.
    """
    database = read_database(path)
    named = {message.name for message in database.messages}
    messages_of_b = make_messages(path, database.messages, "b").values()
    added = [message for message in messages_of_b if message.name not in {*named, *SHARED}]
    taken = {message.frame_id: message.name for message in database.messages}
    for message in added:
        if message.frame_id in taken:
            raise InputError(
                f"DBC {path}: frame {message.name} would have 0x{message.frame_id:03X}, which is {taken[message.frame_id]};"
                f" identifiers must leave room for clutch b at 0x{OFFSET:X} more"
            )
    controller = _rename_node(_CONTROLLER)
    for message in database.messages:
        for signal in message.signals if message.name in SHARED else ():
            if _CONTROLLER in signal.receivers and controller not in signal.receivers:
                signal.receivers += [controller]
    nodes = database.nodes
    if controller not in [node.name for node in nodes]:
        nodes = [*nodes, Node(controller, "Controller of clutch b.")]
    return Database(
        messages=sorted([*database.messages, *added], key=lambda message: message.frame_id),
        nodes=nodes,
        version=database.version,
        dbc_specifics=database.dbc,
    )


def write_dbc_text(path: Path, clutches: int) -> str:
    """Return the text of the DBC at `path` for one or two `clutches`."""
    return read_text(path) if clutches == 1 else load_two_clutch_database(path).as_dbc_string()


def _describe(message: Message) -> tuple[Any, ...]:
    """Return the properties of a frame that the bench uses: identifier, data ID, length, and place of each signal."""
    signals = sorted((s.name, s.start, s.length, s.byte_order, s.is_signed, s.scale, s.offset) for s in message.signals)
    return message.frame_id, message.is_extended_frame, message.length, read_data_id(message), signals


def _rename_node(node: str) -> str:
    """Return the DBC node for clutch b: only the controller has another name."""
    return f"{node}_B" if node == _CONTROLLER else node

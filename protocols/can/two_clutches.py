"""Two clutches on one bus: the frames of clutch b, derived from those of the DBC, which are clutch a's.

A frame of clutch b is that of clutch a with `_B` at its name and OFFSET added to its identifier. Bit 3 of an identifier thus
tells the clutch, and arbitration stays by kind of frame: valves before motor before sensors before set-points, a before b.
Shared are the frames of what there is once: motor (clutch a's controller commands it) and plant.
"""

from copy import deepcopy
from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message, Node

from protocols.errors import InputError, listing

CLUTCHES = ("a", "b")
CONTROLLERS = (
    "controller",
    "controller_b",
)  # names of their controllers as services, in telemetry and in columns of runs
OFFSET = 0x008
SHARED = ("MOTOR_COMMAND", "PLANT_STATUS", "PLANT_HEARTBEAT")
_CONTROLLER = "CONTROLLER"  # node of the DBC; clutch b's is CONTROLLER_B


def checked_clutch(name: str) -> str:
    """`name` when it is a clutch's. Raises InputError."""
    if name not in CLUTCHES:
        raise InputError(f"clutch {name!r} is unknown; allowed are {listing(CLUTCHES)}")
    return name


def other_clutch(name: str) -> str:
    """The other of the two."""
    return "b" if checked_clutch(name) == "a" else "a"


def of_clutch(message: Message, clutch: str) -> Message:
    """A message of the DBC as clutch `clutch` has it."""
    if checked_clutch(clutch) == "a" or message.name in SHARED:
        return message
    own = deepcopy(message)
    own.name, own.frame_id = f"{message.name}_B", message.frame_id + OFFSET
    own._senders = [_of_b(node) for node in message.senders]  # cantools has no setter
    for signal in own.signals:
        signal.receivers = [_of_b(node) for node in signal.receivers]
    return own


def two_clutch_database(path: Path) -> Database:
    """The bus of the power-shift rig: the DBC at `path` with the frames of clutch b. Raises InputError for a collision."""
    database = cantools.database.load_file(path)
    assert isinstance(database, Database)
    further = [of_clutch(message, "b") for message in database.messages if message.name not in SHARED]
    taken = {message.frame_id: message.name for message in database.messages}
    for message in further:
        if message.frame_id in taken:
            raise InputError(
                f"DBC {path}: frame {message.name} would have 0x{message.frame_id:03X}, which is {taken[message.frame_id]};"
                f" identifiers must leave room for clutch b at 0x{OFFSET:X} more"
            )
    for message in database.messages:
        for signal in message.signals if message.name in SHARED else ():
            signal.receivers += [_of_b(_CONTROLLER)] if _CONTROLLER in signal.receivers else []
    return Database(
        messages=sorted([*database.messages, *further], key=lambda message: message.frame_id),
        nodes=[*database.nodes, Node(_of_b(_CONTROLLER), "Controller of clutch b.")],
        version=database.version,
        dbc_specifics=database.dbc,
    )


def write_dbc(path: Path, clutches: int, dbc: Path) -> None:
    """Write the bus of one or two `clutches`, of the DBC at `path`, into the file `dbc`. Raises InputError."""
    text = path.read_text(encoding="utf-8") if clutches == 1 else two_clutch_database(path).as_dbc_string()
    try:
        dbc.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(f"DBC {dbc} cannot be written: {error.strerror}") from None


def _of_b(node: str) -> str:
    return f"{node}_B" if node == _CONTROLLER else node

"""SAE J1939: conventions for its frames that a DBC does not contain.

Identifier      29 bits: priority (3), data pages (2), PDU format (8), PDU specific (8), source address (8). A message is
                identified by its parameter group: pages, format and, from format 240 on, PDU specific, which is a destination
                below. Priority, source and destination differ from vehicle to vehicle; in a DBC the source is often 0xFE, the
                null address
No value        an integer of 8 bits or more whose eight highest bits are 0xFE (error) or 0xFF (not available). Shorter ones
                are states
References      SAE J1939-21, section 5.2 (identifier); SAE J1939-71, table 1 (ranges of signals)
"""

import numpy as np
from cantools.database.can import Database, Message, Signal
from cantools.j1939 import frame_id_unpack, pgn_pack

from clutch_hil.recordings.can_signals import read_raw_values

_FIRST_GROUP_EXTENSION = 240  # PDU format from which PDU specific belongs to the group: J1939-21, table 2
_NOBODY = 0xFE  # source address of messages that belong to no particular node: J1939-81, null address
_ATTRIBUTES = {"VFrameFormat", "ProtocolType"}  # attributes of a database that mark J1939 messages
_SHORTEST_NUMBER = 8  # bits
_FIRST_NO_VALUE = 0xFE  # least value of the eight highest bits that means no value


def is_j1939(database: Database, message: Message, stated: bool | None = None) -> bool:
    """Return whether a message is a J1939 message. stated: the user's answer for all messages with 29 bits; None for none.

    A database marks J1939 by attributes of a message or of all messages. Without attributes, a database counts as J1939 if all
    its messages with 29 bits have the null address as source, as those of SAE have.
    """
    if not message.is_extended_frame:
        return False
    if stated is not None:
        return stated
    attributes = database.dbc.attributes if database.dbc else {}
    protocol = attributes.get("ProtocolType")
    if message.protocol == "j1939" or (protocol is not None and str(protocol.value).upper() == "J1939"):
        return True
    definitions = database.dbc.attribute_definitions if database.dbc else {}
    return not (_ATTRIBUTES & set(definitions)) and all(
        frame_id_unpack(one.frame_id).source_address == _NOBODY for one in database.messages if one.is_extended_frame
    )


def match_groups(database: Database, ids: np.ndarray, stated: bool | None = None) -> dict[int, Message]:
    """Return extended identifiers (n,) that are not in the database, with the only message of their parameter group."""
    exact = {message.frame_id for message in database.messages if message.is_extended_frame}
    groups: dict[int, list[Message]] = {}
    for message in database.messages:
        if is_j1939(database, message, stated):
            groups.setdefault(_find_group(message.frame_id), []).append(message)
    matched = {}
    for can_id in np.unique(ids).tolist() if groups else []:
        candidates = groups.get(_find_group(can_id), [])
        if can_id not in exact and len(candidates) == 1:
            matched[can_id] = candidates[0]
    return matched


def find_no_values(signal: Signal, payloads: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of `payloads`, shape (n, bytes), in which a signal means error or not available."""
    if signal.is_float or signal.is_signed or signal.length < _SHORTEST_NUMBER:
        return np.zeros(len(payloads), bool)
    highest: np.ndarray = read_raw_values(signal, payloads) >> np.uint64(signal.length - 8)
    return highest >= _FIRST_NO_VALUE


def _find_group(can_id: int) -> int:
    """Return the parameter group number of an identifier."""
    one = frame_id_unpack(can_id)
    specific = one.pdu_specific if one.pdu_format >= _FIRST_GROUP_EXTENSION else 0
    return pgn_pack(one.reserved, one.data_page, one.pdu_format, specific)

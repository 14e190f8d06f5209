"""Claim: the right of one supervisor to send the set-points of a clutch, by frames SUPERVISOR_CLAIM.

Binding         set-points of the supervisor that holds the claim have another data ID: E2EDataId XOR its session. The CRC
                detects every other 16-bit data ID, so a set-point of another supervisor has a wrong CRC, whatever its counter
Session         0 stands for no claim: then the data ID is E2EDataId, as in old logs
"""

from enum import IntEnum

# The data IDs of all frames are 0xC000 to 0xC7FF; a session with a higher bit gives a data ID that no frame has
LEAST_SESSION, HIGHEST_SESSION = 0x0800, 0xFFFF
# s without a claim frame after which the claim ends. Chosen: five claims, so that four may be lost; longer than the 0.1 s
# without a set-point after which the clutch opens (`setpoint_timeout`), so that a claim does not end before its demand
CLAIM_TIMEOUT = 0.25


# Claims, and the set-points that each binds, of clutch a and b
BOUND = {"SUPERVISOR_CLAIM": "TORQUE_SETPOINT", "SUPERVISOR_CLAIM_B": "TORQUE_SETPOINT_B"}


# Message for the state in which one supervisor is followed and another's claim is refused
CONTESTED_TEXT = "another supervisor claims the set-points and is refused"


class Supervision(IntEnum):
    """Values of CONTROLLER_HEARTBEAT.SUPERVISOR."""

    UNCLAIMED = 0  # set-points without a claim are followed
    CLAIMED = 1
    CONTESTED = 2  # one supervisor is followed, and the claim of another is refused


def make_claim_session(number: int) -> int:
    """Return the session of a supervisor, from its process number."""
    return number & HIGHEST_SESSION | 0x8000


def bind_data_id(data_id: int, session: int) -> int:
    """Return the data ID of the set-points of a supervisor; `data_id` is that of the DBC."""
    return data_id ^ session

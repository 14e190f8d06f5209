"""Claim: the supervisor whose set-points the controller follows.

unclaimed --claim, while no set-point asks to close--> claimed --released, or silent for CLAIM_TIMEOUT--> unclaimed

While the set-points are claimed, those of another supervisor have a wrong CRC, and its claims are refused. When the supervisor
changes, the clutch opens, and stays open until idle is requested. Claims of other supervisors have their own reception, because
their counters differ from the holder's.
"""

import numpy as np
from numba import njit

from protocols.can.claim import CLAIM_TIMEOUT, LEAST_SESSION, Supervision, bind_data_id
from protocols.can.reception import RECEPTION
from protocols.can.request import Request
from protocols.can.words import read_raw
from rt_controller.law.phases import let_go

# session: of the supervisor that holds the claim, 0 for none; age [s]: of its last claim. refused: claims of others so far;
# refused_age [s]: of the last one; others: reception of their claims
CLAIM = np.dtype([("session", "i8"), ("age", "f8"), ("refused", "i8"), ("refused_age", "f8"), ("others", RECEPTION)])
_bind = njit(bind_data_id)


@njit
def is_of_another(claim, settings, word):
    """Return whether the payload `word` of SUPERVISOR_CLAIM is of a supervisor other than the holder.

    `word` need not be valid.
    """
    return claim.session != 0 and read_raw(word, settings.supervisor_claim.session) != claim.session


@njit
def take_claim(node, settings, claims, setpoints, word):
    """Take a valid payload `word` of SUPERVISOR_CLAIM; return whether it is refused.

    `claims` and `setpoints` are the receptions of the holder's claims and of TORQUE_SETPOINT.
    """
    s, claim = settings.supervisor_claim, node.claim
    session, claimed = read_raw(word, s.session), read_raw(word, s.claim) != 0
    free = claim.session == 0 and session >= LEAST_SESSION and not _asks_to_close(node, settings)
    if session == claim.session:
        claim.age = 0.0
        if not claimed:
            _follow(node, settings, setpoints, 0)
    elif claimed and free:
        _follow(node, settings, setpoints, session)
    elif claimed:
        claim.refused, claim.refused_age = claim.refused + 1, 0.0
    if claim.session == 0:
        claims.counter = 0  # the next claim may be of another supervisor
    return claimed and session != claim.session


@njit
def end_silent_claim(node, settings, claims, setpoints):
    """End the claim of a holder that has been silent for too long. Call it after the frames of a cycle are taken."""
    if node.claim.session != 0 and node.claim.age > CLAIM_TIMEOUT:
        _follow(node, settings, setpoints, 0)
        claims.counter = 0


@njit
def find_supervision(claim):
    """Return the Supervision of the claim."""
    if claim.refused > 0 and claim.refused_age <= CLAIM_TIMEOUT:
        return Supervision.CONTESTED.value
    return Supervision.CLAIMED.value if claim.session != 0 else Supervision.UNCLAIMED.value


@njit
def _asks_to_close(node, settings):
    """Return whether a set-point without a claim requests to close the clutch, and is not too old."""
    closes = node.request != Request.IDLE and node.request != Request.RELEASE
    return closes and node.setpoint_age <= settings.setpoint_timeout


@njit
def _follow(node, settings, setpoints, session):
    """Follow the supervisor with `session` from now on, 0 for those without a claim."""
    node.claim.session, node.claim.age = session, 0.0
    setpoints.data_id = _bind(settings.torque_setpoint.data_id, session)
    setpoints.counter = setpoints.doubts = 0  # another sender starts at any counter value
    node.request = Request.RELEASE.value
    let_go(node.phases)

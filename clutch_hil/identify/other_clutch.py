"""Other clutch: runs that are of different clutches, which no calibration fits.

Equation        M = a_M (p - p_contact) at the faster half of the slips, of each run by itself (Table 6.3)
What            the torques of these lines at one pressure, 1.4 times the contact pressure, beside each other: there they are
                sure, as it is within the pressures of most runs. Slope and contact pressure alone are not, as a steeper line
                begins at a higher pressure
Assumptions     temperature and slip change the torque of one clutch little there
Not modelled    clutches that are nearer to each other; runs in which the torque does not rise with the pressure are not judged
"""

from collections.abc import Mapping

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.clutch_effects import estimate_line
from clutch_hil.recordings.checks.finding import Finding
from protocols.errors import name_run

_PRESSURE = 1.4  # of the mean contact pressure
# Ratio of torques. Of 48 clutches within 30 and 40 %, with offsets and drag, up to five experiments each had at most 1.106;
# of 496 pairs of clutches within 30 % 74 % have more than 1.3
_RATIO = 1.3


def find_other_clutch(runs: Mapping[str, Columns]) -> list[Finding]:
    """A hard finding of the run with the highest torque, where that with the lowest is not of the same clutch."""
    lines = {name: line for name, run in runs.items() if (line := estimate_line([run]))}
    if len(lines) < 2:
        return []
    pressure = _PRESSURE * sum(contact for _, contact in lines.values()) / len(lines)
    torques = {name: slope * max(pressure - contact, 0.0) for name, (slope, contact) in lines.items()}
    low, high = min(torques, key=torques.__getitem__), max(torques, key=torques.__getitem__)
    if torques[high] <= _RATIO * torques[low]:
        return []
    text = (
        f"is {torques[high]:.3g} Nm at {pressure:.3g} bar, where that of {name_run(low)} is {torques[low]:.3g} Nm: they are of"
        " different clutches, or a sensor was changed in between; give runs of one clutch"
    )
    return [Finding("other_clutch", "clutch_torque_nm", (0, len(runs[high]["time_s"]) - 1), text, True, high)]

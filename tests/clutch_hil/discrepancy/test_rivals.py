"""Rivals: what the report says of candidates that are not named."""

from dataclasses import replace

from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.recalibration import Moved, Recalibration
from clutch_hil.discrepancy.report.html_page import compose_page
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.residuals import Residuals
from clutch_hil.discrepancy.result import IDENTIFY_FIRST, NOTHING
from clutch_hil.discrepancy.search import investigate
from tests.clutch_hil.discrepancy import results
from tests.clutch_hil.discrepancy.clutch_runs import record_runs

CANDIDATES = ["backlash", "friction_level", "clearance_change"]


def test_a_candidate_that_stays_off_gains_nothing() -> None:
    """The linearised baseline may promise more than its re-fit holds. No candidate has a part in that."""
    found = investigate(WetClutch(), {"a": record_runs({}, seed=2)[0]}, names=CANDIDATES)
    assert found.verdict == NOTHING
    for rival in found.rivals:
        assert (rival.closed, rival.gain) == (0.0, 0.0), rival
        assert rival.reason == "explains nothing more than the parameters of the baseline do"


def test_a_calibration_of_a_rig_without_a_disagreement_is_reported() -> None:
    """Effects can be refused for a likely calibration although the baseline leaves nothing above the floor."""
    result = results.make_result(IDENTIFY_FIRST, runs=2, seconds=4.0, outputs=2)
    moved = (Moved("clutch.coulomb_slope", 10.8, 11.0, "Nm/bar", 0.3),)
    calibration = Recalibration(moved, 0.0, 0.0, 0.0, 0.03, "clutch-hil identify", likely=True)
    page = compose_page(Pictures(Residuals(replace(result, recalibration=calibration))), [], "")
    assert "leaves 0 times" in page
    assert "clutch.coulomb_slope move most" in page
    assert "beyond their stated" not in page

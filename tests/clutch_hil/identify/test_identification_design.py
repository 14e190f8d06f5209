"""`clutch-hil identify --design`: the pieces that a lack needs, within the limits of the rig, and no more of them."""

from pathlib import Path

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.discrepancy.identification_design import MARGIN, design_experiment
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.clutch_parameters import FITTED
from clutch_hil.identify.course_pieces import PIECES, compose
from clutch_hil.identify.courses import HIGHEST, Span, dynamics
from clutch_hil.identify.goals import GOALS
from clutch_hil.identify.identification import Identification
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch

KNOWN, POOR = 1e-4, 0.5  # half width over value
OUTPUTS = {
    "cylinder_pressure_bar": "bar", "clutch_torque_nm": "Nm", "motor_torque_nm": "Nm", "slip_speed_rad_s": "rad/s",
    "oil_temperature_degc": "degC",
}  # fmt: skip
FLOORS = dict(zip(OUTPUTS, (0.005, 0.05, 0.05, 0.04, 0.1), strict=True))  # docs/rig.md, 9


@pytest.fixture(scope="module")
def measured() -> dict[str, np.ndarray]:
    return dict(ch.simulate(profile="crawl", seconds=1.0).columns)


def identification(measured: dict[str, np.ndarray], poor: tuple[str, ...] = ()) -> Identification:
    """The nominal rig, all of it known well but what is `poor`."""
    nominal = wet_clutch.nominal()
    held = "piston.clearance"
    parameters = [
        Identified(n, nominal[n].value, (POOR if n in poor else KNOWN) * abs(nominal[n].value), nominal[n].unit, 1.0)
        for n in FITTED
        if n != held
    ]
    calibration = Calibration("wet_clutch", parameters, {}, np.eye(len(parameters)), {}, held={held: "the drawing's"})
    simulated = {c: measured[c] - FLOORS[c] for c in OUTPUTS}
    return Identification(
        calibration, {"run": measured}, {"run": simulated}, OUTPUTS, dict.fromkeys(OUTPUTS, 1.0), [], 0.0
    )


def test_what_is_known_needs_no_experiment(measured: dict[str, np.ndarray]) -> None:
    design = design_experiment(identification(measured))
    assert design.reaches
    assert not design.pieces


def test_what_is_poor_gets_less_time_than_the_fixed_courses_for_it(
    measured: dict[str, np.ndarray], tmp_path: Path
) -> None:
    design = design_experiment(identification(measured, ("clutch.attraction", "motor.inertia")))
    for name in ("C", "inertia"):
        before, after = ({s.goal.name: s for s in standings}[name] for standings in (design.before, design.after))
        assert before.worst == pytest.approx(100.0 * POOR, rel=0.01)
        assert after.worst <= MARGIN * after.goal.limit
    assert design.reaches
    assert design.seconds < 0.5 * dynamics(Span(2.35)).rows[-1][0]
    path = tmp_path / "next_experiment.csv"
    path.write_text(design.profile, encoding="utf-8")
    assert load_profile(str(path)).duration == pytest.approx(design.seconds, abs=0.01)


def test_what_no_run_has_shown_is_looked_for(measured: dict[str, np.ndarray]) -> None:
    found = identification(measured)
    calibration = found.calibration
    fewer = [p for p in calibration.parameters if p.name != "clutch.stribeck_speed"]
    held = {**calibration.held, "clutch.stribeck_speed": "the runs do not excite it"}
    partial = Calibration("wet_clutch", fewer, {}, np.eye(len(fewer)), {}, held=held)
    design = design_experiment(Identification(partial, found.measured, found.simulated, OUTPUTS, found.misfit, [], 0.0))
    (before,) = [s for s in design.before if s.goal.name == "V_S"]
    assert before.worst > 100.0  # %: nothing is known of it
    assert set(design.pieces) - {"coasting"}  # only a closed clutch shows it
    assert design.reaches


@pytest.mark.parametrize("name", PIECES)
@pytest.mark.parametrize("span", [Span(2.35), Span.of_line(25.0, 2.65, 30.0)])
def test_pieces_begin_and_end_open_and_keep_to_the_span(name: str, span: Span) -> None:
    rows = np.array(compose([name], span).rows)
    _, _, speed, pressure = rows.T
    assert (pressure[0], pressure[-1]) == (0.0, 0.0)
    assert speed[0] == speed[-1]
    assert pressure.max() <= min(HIGHEST, span.contact + span.reach) + 1e-9
    assert np.abs(speed).max() <= 26.2  # rad/s, the speed limit of the maps


def test_goals_are_those_that_were_asked() -> None:
    assert {goal.name: goal.limit for goal in GOALS} == {
        "contact pressure": 10.0, "M_C(p)": 2.0, "C_v(p)": 2.0, "beta(p)": 2.0, "V_S": 10.0, "gamma": 10.0, "C": 10.0,
        "inertia": 2.0,
    }  # fmt: skip

"""Pictures of runs: what is signed, what an axis is made for, what the lanes say."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.colors
import numpy as np
import pytest

from clutch_hil.bench.clutch_state import STATES
from clutch_hil.bench.in_process import play
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.picture import draw_run, make_run_sheet
from clutch_hil.bench.pictures.sheet import Sheet, choose_error_reach
from clutch_hil.bench.pictures.shift_picture import make_shift_sheet
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile
from protocols.can.frames import load_frames
from protocols.can.request import Request
from rt_controller.loop.node import ControllerNode

RATE = 1000  # Hz
LAG = 0.15  # s after a turn of the slip or a step of the demand until the torque has followed
PHASES = {word: value for value, word in load_frames()["CONTROLLER_STATUS"].list_choices("phase").items()}
FAULTS = {word: value for value, word in load_frames()["CONTROLLER_STATUS"].list_choices("fault").items()}


def simulate_columns(*rows: tuple[float, float, float]) -> dict[str, np.ndarray]:
    """The columns of a run by a profile of rows (time [s], torque demand [Nm], motor speed [rad/s])."""
    time, torque, speed = np.array(rows).T
    plant, controller = (
        PlantNode(RATE, profile=Profile("a test", tuple(time), tuple(torque), tuple(speed))),
        ControllerNode(RATE),
    )
    played = play(plant, controller)
    columns = {column.name: played.plant[:, k] for k, column in enumerate(played.plant_columns)}
    columns |= {f"controller_{c.name}": played.controllers[0][:, k] for k, c in enumerate(played.controller_columns[0])}
    return columns | {"torque_demand_nm": columns["controller_torque_demand_nm"]}


@pytest.fixture(scope="module")
def reversing() -> dict[str, np.ndarray]:
    """10 Nm while the slip goes from 10 to -10 rad/s and stays there."""
    return simulate_columns(
        (0.0, 0.0, 10.0), (0.5, 0.0, 10.0), (0.8, 10.0, 10.0), (1.5, 10.0, 10.0), (1.7, 10.0, -10.0), (2.5, 10.0, -10.0)
    )


def make_columns(samples: int = 1000, **changed: Any) -> dict[str, np.ndarray]:
    """The columns of a run in which nothing happens, at 1 kHz, but for what is `changed`."""
    names = (
        "torque_demand_nm", "motor_speed_demand_rad_s", "clutch_torque_nm", "cylinder_pressure_bar", "slip_speed_rad_s",
        "truth_clutch_torque_nm", "truth_cylinder_pressure_bar", "truth_slip_speed_rad_s", "controller_torque_estimate_nm",
        "controller_pressure_demand_bar", "controller_request", "controller_phase", "controller_clutch_state",
        "controller_fault", "controller_capacity_nm",
    )  # fmt: skip
    columns = {name: np.zeros(samples) for name in names}
    return (
        columns | {"time_s": np.arange(samples) / RATE} | {name: changed[name] + np.zeros(samples) for name in changed}
    )


def make_sliding_columns(samples: int = 1000, **changed: Any) -> dict[str, np.ndarray]:
    """Columns of a closed clutch that slides at 10 rad/s and carries the 10 Nm that it is asked for."""
    usual = {
        "torque_demand_nm": 10.0, "controller_torque_estimate_nm": 10.0, "truth_clutch_torque_nm": 10.0,
        "slip_speed_rad_s": 10.0, "truth_slip_speed_rad_s": 10.0,
        "controller_request": Request.ENGAGE, "controller_phase": PHASES["slip control"],
        "controller_clutch_state": STATES.index("sliding"),
    }  # fmt: skip
    return make_columns(samples, **usual | changed)


def list_lines(axes: Any) -> dict[str, Any]:
    """The lines of a panel by their label, without what it says of its ends."""
    return {line.get_label().partition(" (")[0]: line for line in axes.get_lines()}


def read_panel(sheet: Sheet, number: int) -> dict[str, np.ndarray]:
    return {label: np.asarray(line.get_ydata()) for label, line in list_lines(sheet.panels[number]).items()}


def list_words(sheet: Sheet) -> dict[int, list[str]]:
    """What stands in each lane, from left to right."""
    result: dict[int, list[tuple[float, str]]] = {}
    for text in sheet.strip.texts:
        x, y = text.get_position()
        result.setdefault(round(y), []).append((x, text.get_text().strip()))
    return {y: [word for _, word in sorted(texts)] for y, texts in result.items()}


def list_explanations(sheet: Sheet) -> list[str]:
    legend = sheet.strip.get_legend()
    return [text.get_text() for text in legend.texts] if legend else []


def test_backwards_truth_estimate_and_demand_lie_on_each_other(reversing: Mapping[str, np.ndarray]) -> None:
    torque, time = read_panel(make_run_sheet(reversing, ""), 0), reversing["time_s"]
    for part, way in (((time > 1.2) & (time < 1.5), 1.0), (time > 2.2, -1.0)):
        for name in ("true", "estimate", "demand"):
            assert np.abs(torque[name][part] - way * 10.0).max() < 1.0, name


def test_what_is_drawn_of_a_torque_is_never_its_magnitude(reversing: Mapping[str, np.ndarray]) -> None:
    torque = read_panel(make_run_sheet(reversing, ""), 0)
    assert np.array_equal(torque["true"], reversing["truth_clutch_torque_nm"])
    assert np.array_equal(torque["estimate"], reversing["controller_torque_estimate_nm"])
    assert np.array_equal(np.abs(torque["demand"]), reversing["torque_demand_nm"])


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_too_much_torque_is_above_zero_either_way(way: float) -> None:
    signs = {name: way * value for name, value in (("slip_speed_rad_s", 10.0), ("truth_slip_speed_rad_s", 10.0),
             ("truth_clutch_torque_nm", 10.4), ("controller_torque_estimate_nm", 10.1))}  # fmt: skip
    error = read_panel(make_run_sheet(make_sliding_columns(**signs), ""), 1)
    assert error["true - demand"] == pytest.approx(0.4)
    assert error["estimate - true"] == pytest.approx(-0.3)


def test_a_torque_against_the_slip_is_too_little() -> None:
    error = read_panel(make_run_sheet(make_sliding_columns(truth_clutch_torque_nm=-10.0), ""), 1)
    assert error["true - demand"] == pytest.approx(-20.0)


def test_an_estimate_of_the_wrong_sign_is_seen() -> None:
    error = read_panel(make_run_sheet(make_sliding_columns(controller_torque_estimate_nm=-10.0), ""), 1)
    assert error["estimate - true"] == pytest.approx(-20.0)


@pytest.mark.parametrize(
    "changed",
    [
        {"controller_clutch_state": STATES.index("sticking")},  # carry what is applied
        {"controller_clutch_state": STATES.index("locked"), "controller_request": Request.LOCK},
        {"controller_request": Request.PRESSURE},
        {"controller_request": Request.IDLE, "controller_clutch_state": STATES.index("open")},
    ],
)
def test_there_is_no_error_of_a_torque_that_nobody_follows(changed: dict[str, float]) -> None:
    assert set(read_panel(make_run_sheet(make_sliding_columns(**changed), ""), 1)) & {
        "true - demand",
        "estimate - true",
    } == {"estimate - true"}


@pytest.mark.parametrize("request_", [Request.LOCK, Request.PRESSURE])
def test_no_demand_is_drawn_where_none_is_made(request_: Request) -> None:
    assert "demand" not in read_panel(make_run_sheet(make_sliding_columns(controller_request=request_), ""), 0)


def test_the_slip_axis_is_symmetric_where_the_clutch_slips_backwards(reversing: Mapping[str, np.ndarray]) -> None:
    low, high = make_run_sheet(reversing, "").panels[3].get_ylim()
    assert low == -high
    assert high > 10.0


@pytest.mark.parametrize("back", [0.0, -0.04])  # rad/s, nothing, and a count of the encoder
def test_the_slip_axis_begins_at_zero_where_it_does_not(back: float) -> None:
    slip = np.where(np.arange(1000) % 7, 10.0, back)
    low, high = make_run_sheet(make_sliding_columns(slip_speed_rad_s=slip), "").panels[3].get_ylim()
    assert low == 0.0
    assert high > 10.0


def test_a_transient_does_not_flatten_the_error_and_is_told(tmp_path: Path) -> None:
    torque = 10.0 + 0.2 * np.sin(np.arange(1000.0))
    torque[0], torque[500] = 3.0, 14.0
    sheet = make_run_sheet(make_sliding_columns(truth_clutch_torque_nm=torque), "")
    sheet.save(tmp_path / "run.png")
    axes = sheet.panels[1]
    assert 0.2 < axes.get_ylim()[1] < 0.5
    assert any(text.get_text() == "true - demand (to -7.0 and +4.0)" for text in axes.get_legend().texts)
    marks = {line.get_marker(): list(line.get_xdata()) for line in axes.get_lines() if line.get_color() == palette.TRUE}
    assert (marks["v"], marks["^"]) == ([0.0], [0.5])
    heights = {line.get_marker(): set(line.get_ydata()) for line in axes.get_lines() if line.get_marker() in ("v", "^")}
    for height, end in zip((heights["v"], heights["^"]), axes.get_ylim(), strict=True):
        assert 0.9 < height.pop() / end < 1.0


def test_an_error_that_lasts_is_shown_whole() -> None:
    axes = make_run_sheet(
        make_sliding_columns(truth_clutch_torque_nm=np.where(np.arange(1000) < 100, 3.0, 10.0)), ""
    ).panels[1]
    assert axes.get_ylim()[0] < -7.0


def test_a_long_idle_time_makes_no_difference_to_the_error_axis() -> None:
    """An open clutch has no error."""
    short, calm = make_sliding_columns(100, controller_torque_estimate_nm=10.5), make_columns(20_000)
    idle = {name: np.concatenate([short[name], calm[name]]) for name in short}
    idle["time_s"] = np.arange(20_100) / RATE
    assert make_run_sheet(idle, "").panels[1].get_ylim() == make_run_sheet(short, "").panels[1].get_ylim()


def test_an_axis_of_no_error_has_a_height() -> None:
    assert choose_error_reach([np.zeros(10)]) > 0.0
    assert choose_error_reach([np.full(3, np.nan)]) > 0.0


def test_the_capacity_is_a_band_where_plates_stand() -> None:
    state = np.where(np.arange(1000) < 400, STATES.index("sticking"), STATES.index("sliding"))
    sheet = make_run_sheet(make_sliding_columns(controller_clutch_state=state, controller_capacity_nm=15.0), "")
    (band,) = sheet.panels[0].collections
    corners = np.concatenate([path.vertices for path in band.get_paths()])
    assert (corners[:, 1].min(), corners[:, 1].max()) == (-15.0, 15.0)
    assert corners[:, 0].max() < 0.4
    assert sheet.panels[0].get_ylim()[1] > 15.0
    assert not make_run_sheet(make_sliding_columns(controller_capacity_nm=15.0), "").panels[0].collections


def test_lanes_say_phase_clutch_and_fault() -> None:
    closed = np.arange(1000) >= 500
    sheet = make_run_sheet(make_sliding_columns(
        controller_phase=np.where(closed, PHASES["slip control"], PHASES["idle"]),
        controller_clutch_state=np.where(closed, STATES.index("sliding"), STATES.index("open")),
    ), "")  # fmt: skip
    assert [label.get_text() for label in sheet.strip.get_yticklabels()] == ["phase", "clutch", "fault"]
    assert list_words(sheet) == {0: ["idle", "slip control"], 1: ["open", "sliding"], 2: ["none"]}
    assert list_explanations(sheet) == []


def test_what_is_too_short_for_its_word_is_explained() -> None:
    phase = np.full(1000, PHASES["slip control"])
    phase[:20] = PHASES["fill"]
    assert list_explanations(make_run_sheet(make_sliding_columns(controller_phase=phase), "")) == ["fill"]


@pytest.mark.parametrize("at", [0, 300, 990], ids=["at once", "within", "at the end"])
def test_a_fault_is_named_with_its_time(at: int, tmp_path: Path) -> None:
    fault = np.where(np.arange(1000) >= at, FAULTS["torque implausible"], 0)
    sheet = make_run_sheet(make_sliding_columns(controller_fault=fault), "")
    assert list_words(sheet)[2] == [f"torque implausible, {at / RATE:.3f} s"]
    sheet.save(tmp_path / "run.png")
    begin, end = sheet.strip.get_xlim()
    for text in sheet.strip.texts:
        box = text.get_window_extent().transformed(sheet.strip.transData.inverted())
        assert begin <= box.x0 < box.x1 <= end + 0.02 * (end - begin), text.get_text()
    assert any(text.get_text() == "fault" for text in sheet.panels[0].get_legend().texts)


def test_faults_that_crowd_are_written_over_none_of_each_other_and_all_explained() -> None:
    samples = np.arange(1000)
    fault = np.where(samples % 50 < 25, FAULTS["pressure lost"], 0) + np.where(samples == 990, FAULTS["overspeed"], 0)
    sheet = make_run_sheet(make_sliding_columns(controller_fault=fault), "")
    places = [
        (x, x + 0.15) if t.get_ha() == "left" else (x - 0.15, x)
        for t in sheet.strip.texts
        if (x := t.get_position()[0]) or 1
    ]
    names = [t.get_text() for t in sheet.strip.texts if "lost" in t.get_text() or "overspeed" in t.get_text()]
    assert names
    assert {"overspeed", "pressure lost"} <= {*list_explanations(sheet), *(n.partition(",")[0].strip() for n in names)}
    faults = sorted(p for p, t in zip(places, sheet.strip.texts, strict=True) if "," in t.get_text())
    assert all(before[1] <= after[0] for before, after in pairwise(faults))


def test_lanes_have_the_colours_of_the_palette() -> None:
    sheet = make_run_sheet(make_sliding_columns(controller_clutch_state=STATES.index("sticking")), "")
    shown = {matplotlib.colors.to_hex(c.get_facecolor()[0]) for c in sheet.strip.collections}
    assert shown == {palette.choose_state_colour(word) for word in ("slip control", "sticking", "none")}


def test_lines_have_the_colours_of_their_columns(reversing: Mapping[str, np.ndarray]) -> None:
    sheet = make_run_sheet(reversing, "")
    wanted = {"true": palette.TRUE, "estimate": palette.ESTIMATE, "demand": palette.DEMAND, "measured": palette.MEASURED,
              "motor demand": palette.DEMAND, "true - demand": palette.TRUE, "estimate - true": palette.ESTIMATE}  # fmt: skip
    for number in range(4):
        for label, line in list_lines(sheet.panels[number]).items():
            assert line.get_color() == wanted.get(label, line.get_color()), label


def test_a_blind_run_has_measured_for_true() -> None:
    blind = {
        name: values
        for name, values in make_sliding_columns(clutch_torque_nm=10.2).items()
        if not name.startswith("truth_")
    }
    sheet = make_run_sheet(blind, "")
    assert read_panel(sheet, 1)["measured - demand"] == pytest.approx(0.2)
    assert list_lines(sheet.panels[0])["measured"].get_color() == palette.MEASURED


NOTHING_YET = {f"controller_{name}": np.nan for name in ("torque_estimate_nm", "pressure_demand_bar", "request", "phase",
               "clutch_state", "fault", "capacity_nm")} | {"torque_demand_nm": np.nan}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "columns",
    [
        make_columns(2),
        make_columns(1000),
        make_columns(1000, **NOTHING_YET),
        make_sliding_columns(2),
        make_sliding_columns(3, controller_fault=FAULTS["overspeed"]),
    ],
    ids=["two samples", "zeros", "no controller", "two samples, sliding", "nothing but a fault"],
)
def test_any_run_has_a_picture(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    draw_run(tmp_path / "run.png", columns, "a run\npassed: 3 limits hold", [0.0])
    assert (tmp_path / "run.png").stat().st_size > 10_000


def simulate_shift(**changed: Any) -> dict[str, np.ndarray]:
    """The columns of the power-shift rig, clutch a carrying 10 Nm backwards, clutch b open, for 1 s."""
    columns: dict[str, Any] = {
        "input_speed_demand_rad_s": 20.0,
        "truth_input_speed_rad_s": 20.0,
        "truth_output_torque_nm": 0.0,
    }
    columns["truth_road_torque_nm"] = 0.0
    for clutch, prefix, torque in (("a", "controller_", -10.0), ("b", "controller_b_", 0.0)):
        columns |= {
            f"torque_demand_{clutch}_nm": abs(torque), f"truth_clutch_torque_{clutch}_nm": torque,
            f"truth_slip_speed_{clutch}_rad_s": torque, f"cylinder_pressure_{clutch}_bar": 3.0,
            f"{prefix}torque_estimate_nm": torque, f"{prefix}pressure_demand_bar": 3.0, f"{prefix}request": Request.ENGAGE,
            f"{prefix}phase": PHASES["slip control" if torque else "idle"], f"{prefix}fault": 0,
            f"{prefix}clutch_state": STATES.index("sliding" if torque else "open"),
        }  # fmt: skip
    return {name: value + np.zeros(1000) for name, value in (columns | changed).items()} | {
        "time_s": np.arange(1000) / RATE
    }


def test_a_shift_has_lanes_of_both_clutches() -> None:
    sheet = make_shift_sheet(simulate_shift(controller_b_fault=FAULTS["fill timeout"]), "")
    names = [label.get_text() for label in sheet.strip.get_yticklabels()]
    assert names == [f"{clutch} {lane}" for clutch in "ab" for lane in ("phase", "clutch", "fault")]
    assert list_words(sheet) == {
        0: ["slip control"], 1: ["sliding"], 2: ["none"], 3: ["idle"], 4: ["open"], 5: ["fill timeout, 0.000 s"],
    }  # fmt: skip


def test_a_shift_draws_torque_estimate_and_demand_the_same_way_round() -> None:
    torque = [
        line for line in make_shift_sheet(simulate_shift(), "").panels[1].get_lines() if len(line.get_ydata()) == 1000
    ]
    of_a = [line for line in torque if np.all(np.asarray(line.get_ydata()) == -10.0)]
    assert len(of_a) == 3
    assert {line.get_color() for line in of_a} == {palette.CLUTCH_A, palette.DEMAND}


def test_a_title_is_no_formula(tmp_path: Path) -> None:
    draw_run(tmp_path / "run.png", make_columns(), r"costs \frac$_{$")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")

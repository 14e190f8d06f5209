"""A run of two clutches goes wherever a run of one goes, or one sentence says why not."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rich.console import Console
from typer.testing import CliRunner

import clutch_hil as ch
from clutch_hil.bench.in_process import Played
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import load_scenario
from clutch_hil.bench.simulate import Simulation
from clutch_hil.command import make_application
from clutch_hil.discrepancy.models.named import find_model
from clutch_hil.live.conversion import convert
from clutch_hil.live.monitor.collector import Collector
from clutch_hil.live.monitor.monitor_screen import draw_snapshot, format_snapshot
from clutch_hil.live.monitor.snapshot import make_document
from clutch_hil.live.recording import recorder
from clutch_hil.live.recording.recorder import Recorder
from clutch_hil.live.run_replay import run_batches
from clutch_hil.live.tuning import tune
from clutch_hil.live.viewer.blueprint import build_blueprint
from clutch_hil.live.viewer.dashboard import list_places
from clutch_hil.live.viewer.rrd_reader import read_rrd
from clutch_hil.live.viewer.screen import Screen
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.node import Column
from protocols.telemetry.batch import Batch, list_run_columns
from protocols.telemetry.keys import Keys, make_bench_name
from protocols.telemetry.session import open_publisher_session
from tests.processes import list_errors, play_here

SECONDS = 1.0  # of a run: clutch a closes, nothing is handed over yet
HANDED_OVER = 5.2  # s by which the shipped scenario has handed its torque over
RATE = 500  # Hz, of the shipped scenario
NODES = ("plant", *CONTROLLERS)
PIECE = 100  # rows of a batch
BLIND = "a run of two clutches cannot be blind: its verdict needs the true output torque, which no sensor measures"


@pytest.fixture(scope="module")
def run_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated run of the shipped hand-over, cut."""
    out = tmp_path_factory.mktemp("run")
    scenario = load_scenario("shift", {"seconds": SECONDS, "out": out})
    Simulation(replace(scenario, limits=())).run(lambda done, total: None)
    (path,) = out.glob("*.parquet")
    return path


@pytest.fixture(scope="module")
def run(run_file: Path) -> Run:
    return read_run(run_file)


def invoke_command(*words: object) -> Any:
    return CliRunner().invoke(make_application(), list(map(str, words)))


def find_refusal(*words: object) -> str:
    error = invoke_command(*words).exception
    assert isinstance(error, InputError), error
    assert "\n" not in str(error)
    return str(error)


# from Python, and sweeps


def test_simulated_from_python_it_is_the_run_file(run: Run) -> None:
    simulated = ch.simulate("shift", seconds=SECONDS)
    assert list(simulated.columns) == list(run.columns)
    for name, values in run.columns.items():
        assert np.array_equal(simulated[name], values, equal_nan=True), name
    assert (simulated.units, simulated.meanings) == (run.units, run.meanings)
    assert simulated.metadata["controller_b_parameters"] == run.metadata["controller_b_parameters"]


def test_read_from_python_it_is_the_run_file(run: Run, run_file: Path) -> None:
    assert list(ch.read_run(run_file).columns) == list(run.columns)


def test_an_effect_is_of_one_clutch() -> None:
    weak = ch.simulate("shift", seconds=0.2, effects={"b.friction_level": {"level": 0.8}})
    assert weak.metadata["effects"] == ["b.friction_level"]


def test_a_sweep_has_the_measures_of_the_hand_over(tmp_path: Path) -> None:
    words = (
        "simulate",
        "shift",
        "--vary",
        "b.friction_level.level=0.8:1:2",
        "--seconds",
        HANDED_OVER,
        "--out",
        tmp_path,
    )
    done = invoke_command(*words)
    assert done.exit_code == 1, done.output  # with 0.8 the gap breaks its limit
    (path,) = tmp_path.glob("*.csv")
    head, weak, whole = path.read_text().splitlines()
    assert head == "b.friction_level.level,seed,torque_gap,shift_time_s"
    assert float(weak.split(",")[2]) > 0.15 > 0.08 > float(whole.split(",")[2])
    assert "verdict: 2 runs, 1 broke a limit" in done.output


def test_a_sweep_from_python_has_them_too() -> None:
    table = ch.sweep([{"a.friction_level.level": 0.9}], "shift", seconds=0.2, workers=1)
    assert table.column_names == ["a.friction_level.level", "seed", "torque_gap", "shift_time_s", "fault"]
    assert table["fault"].to_pylist() == ["none"]


# files and pictures


def test_it_is_converted_there_and_back(run: Run, run_file: Path, tmp_path: Path) -> None:
    convert(run_file, tmp_path / "run.mf4")
    convert(tmp_path / "run.mf4", tmp_path / "run.parquet")
    again = read_run(tmp_path / "run.parquet")
    assert again.metadata == run.metadata
    for name, values in run.columns.items():
        assert np.array_equal(again[name], values, equal_nan=True), name


def test_the_view_has_every_value_of_all_three_nodes(run: Run, run_file: Path, tmp_path: Path) -> None:
    assert [batch.node for batch in run_batches(run)] == list(NODES)
    convert(run_file, tmp_path / "run.rrd")
    tables = read_rrd(tmp_path / "run.rrd")
    assert sorted(tables) == sorted(NODES)
    result = {name: table[name] for table in tables.values() for name in table}
    assert set(result) == set(run.columns)
    for name, values in run.columns.items():
        assert np.array_equal(result[name], values, equal_nan=True), name


def test_both_clutches_stand_in_the_plots_of_one(run: Run) -> None:
    shown = {place.path: place.labels for batch in run_batches(run) for place in list_places(batch.node, batch.columns)}
    assert shown["torque/plant"] == ["true a [Nm]", "true b [Nm]"]
    assert shown["torque/controller_b"] == ["estimate b [Nm]"]
    assert shown["pressure/controller"] == ["demand [bar]"]
    assert {"measured a [bar]", "true b [bar]"} <= set(shown["pressure/plant"])


# live


def play_shift() -> Played:
    scenario = load_scenario("shift", {"seconds": SECONDS})
    return Simulation(scenario).play(scenario.plant, 1)


class ScriptedFeed:
    """What a feed gives of a bench of two clutches, whose services describe themselves."""

    bench = "local:script@here"
    rejections = ""

    def __init__(self, run: Played) -> None:
        clock = Column("clock_s", "s", "clock")
        controllers = (
            list_run_columns(n, (*c, clock)) for n, c in zip(CONTROLLERS, run.controller_columns, strict=True)
        )
        plant = (*run.plant_columns, Column("plant_clock_s", "s", "clock"))
        self.columns = dict(zip(NODES, (plant, *controllers), strict=True))
        self.lost, self.alive = dict.fromkeys(NODES, 0), dict.fromkeys(NODES, True)
        times = 1000.0 + np.arange(len(run.plant)) / RATE
        rows = {n: np.column_stack([r, times]) for n, r in zip(NODES, (run.plant, *run.controllers), strict=True)}
        self.steps = [
            [Batch(n, 1, k, float(RATE), 1.7e9, 0, self.columns[n], rows[n][k : k + PIECE]) for n in NODES]
            for k in range(0, len(times), PIECE)
        ]

    def read(self, timeout: float = 0.0) -> list[Batch]:
        return self.steps.pop(0) if self.steps else []

    def take_events(self) -> list[dict[str, Any]]:
        return []

    def read_requests(self) -> list[dict[str, Any]]:
        return []

    def read_clock(self, node: str) -> float:
        return -np.inf

    def describe(self, node: str) -> dict[str, Any]:
        rig = {"rig": "power_shift", "controllers": list(CONTROLLERS)} if node == "plant" else {}
        return {"columns": [c._asdict() for c in self.columns[node]], "session": 1, "versions": {}} | rig


def test_a_recording_has_both_controllers_and_the_rig_that_the_plant_names(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        recorder, "request_parameters", lambda session, bench, node: [{"name": f"{node}.x", "value": 1.0}]
    )
    feed: Any = ScriptedFeed(play_shift())
    session: Any = None
    with Recorder(session, feed, tmp_path / "run.parquet") as made:
        for _ in range(len(feed.steps)):
            made.step()
        made.finish()
    again = read_run(tmp_path / "run.parquet")
    assert again.metadata["rig"] == "power_shift"
    for node in NODES:
        assert again.metadata[f"{node}_parameters"] == {f"{node}.x": 1.0}
    for name, values in run.columns.items():
        assert np.array_equal(again[name], values, equal_nan=True), name
    with (
        pytest.raises(InputError, match=BLIND),
        Recorder(session, ScriptedFeed(play_shift()), tmp_path / "blind.parquet", blind=True) as blind,  # type: ignore[arg-type]
    ):
        blind.step()


def test_parameters_of_both_controllers_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "list_live_nodes", lambda session, bench: list(NODES))
    monkeypatch.setattr(
        tune, "request_parameters", lambda session, bench, node: [{"name": "torque.gain", "value": 1.0}]
    )
    session: Any = None
    assert sorted(tune.list_parameters(session, "local:script@here").entries) == sorted(
        f"{n}.torque.gain" for n in NODES
    )


def render_screen(width: int) -> list[str]:
    """Lines of the monitor's screen, of the whole run, in a terminal of this width."""
    feed = ScriptedFeed(play_shift())
    collector = Collector(feed.bench)
    collector.alive = feed.alive
    while feed.steps:
        collector.take(feed.read(), 0.0)
    change = {"node": "controller_b", "name": "torque.integral_gain", "old": 0.0, "new": 1.0, "unit": "1", "row": 1}
    collector.add_changes([change | {"time": float(time)} for time in range(5)])
    console = Console(width=width, record=True, file=io.StringIO(), force_terminal=True)
    console.print(draw_snapshot(collector.make_snapshot(0.0), width))
    return console.export_text().splitlines()


@pytest.mark.parametrize("width", [80, 120])
def test_the_monitor_shows_both_clutches_on_one_screen(width: int) -> None:
    lines = render_screen(width)
    assert len(lines) <= 24
    assert max(map(len, lines)) <= width
    assert [line.split()[:3] for line in lines if line.startswith(("a  ", "b  "))] == [
        ["a", "phase", "slip"],
        ["b", "phase", "idle"],
    ]
    (torque,) = (line for line in lines if line.startswith("torque true"))
    name, of_a, of_b, unit = torque.split()[1:5]
    assert (name, unit) == ("true", "Nm")
    assert float(of_a) > 1.0 > abs(float(of_b))
    assert [line.split()[0] for line in lines].count("controller_b") == 2  # services, and loop timing
    for line in lines:
        assert "…" not in line, line


def test_the_monitor_says_both_on_a_line_and_in_json() -> None:
    feed = ScriptedFeed(play_shift())
    collector = Collector(feed.bench)
    collector.alive = feed.alive
    while feed.steps:
        collector.take(feed.read(), 0.0)
    snapshot = collector.make_snapshot(0.0)
    assert "  a: slip control  sliding  fault none" in format_snapshot(snapshot)
    assert "  b: idle  open  fault none" in format_snapshot(snapshot)
    clutches = json.loads(json.dumps(make_document(snapshot)))["clutches"]
    assert [(name, clutch["phase"]) for name, clutch in clutches.items()] == [("a", "slip control"), ("b", "idle")]


def draw_live(feed: ScriptedFeed, path: Path) -> None:
    """What a live view logs of a bench, in a file."""
    recording = rr.RecordingStream("clutch-hil")
    recording.save(path, default_blueprint=build_blueprint())
    screen = Screen(recording)
    screen.open()
    while feed.steps:
        for batch in feed.read():
            screen.log(batch)
    recording.flush()
    recording.disconnect()


def test_the_live_scene_curves_and_states_are_of_both_clutches(tmp_path: Path) -> None:
    draw_live(ScriptedFeed(play_shift()), tmp_path / "live.rrd")
    cells: dict[str, list[Any]] = {}
    static = set()
    for chunk in RrdReader(tmp_path / "live.rrd").stream():
        rows = chunk.to_record_batch()
        if chunk.is_static:
            static.add(chunk.entity_path)
        else:
            last = {name.partition(":")[2]: rows[name].to_pylist()[-1] for name in rows.schema.names}
            cells.setdefault(chunk.entity_path, []).append(last)
    moved_a, moved_b = (cells[f"/scene/{clutch}/piston"][-1]["translation"][0][0] for clutch in "ab")
    assert moved_a > 0.4 > 0.1 > moved_b  # a is filled, b rests
    assert {f"/scene/{clutch}/{part}" for clutch in "ab" for part in ("oil", "name", "rotor/shaft")} <= static
    for path in (
        "states/phase", "states/phase_b", "flags/saturated_b", "torque/demand", "torque/demand_b", "torque_error/true_b",
        "torque_over_pressure/data/true", "torque_over_pressure/data/true_b", "torque_over_slip/data/estimate_b",
    ):  # fmt: skip
        assert f"/{path}" in cells, path
    assert [cells[f"/states/{name}"][-1]["state"] for name in ("phase", "phase_b")] == [["slip control"], ["idle"]]


# what cannot be


@pytest.mark.parametrize("words", [("simulate", "shift"), ("up", "shift"), ("plant", "--scenario", "shift")])
def test_it_cannot_be_blind(words: tuple[str, ...]) -> None:
    assert BLIND in find_refusal(*words, "--blind")


def test_the_model_of_one_clutch_is_not_compared_with_it(run_file: Path, tmp_path: Path) -> None:
    message = find_refusal("discrepancy", run_file, "--out", tmp_path)
    assert message == (
        f"run {run_file} is a run of two clutches, of the rig power_shift, which the model wet_clutch does not describe;"
        " one of its clutches is compared by --rig power_shift.a or --rig power_shift.b"
    )


def test_it_has_no_model_and_no_experiments(tmp_path: Path) -> None:
    message = "rig power_shift, whose run is a run of two clutches, has no discrepancy model"
    with pytest.raises(InputError, match=message):
        find_model("power_shift")
    assert find_refusal("experiment", "crawl", "--scenario", "shift", "--out", tmp_path) == message


def test_a_running_bench_refuses_experiments_at_once(tmp_path: Path, local_bus: str) -> None:
    out = tmp_path / "runs"
    described = json.dumps(ScriptedFeed(play_shift()).describe("plant"))
    keys = Keys(make_bench_name(local_bus), "plant")
    with open_publisher_session(None) as session:
        token = session.liveliness().declare_token(keys.alive)
        answers = session.declare_queryable(keys.describe, lambda query: query.reply(keys.describe, described))
        words = ("experiment", "crawl", "--running", "--bus", local_bus, "--out", out)
        done = play_here(*words)
        answers.undeclare()
        token.undeclare()
    assert done.returncode == 2, done.stderr
    sentence = "rig power_shift, whose run is a run of two clutches, has no discrepancy model"
    assert list_errors(done.stderr) == [f"error: {sentence}"]
    assert not out.exists()

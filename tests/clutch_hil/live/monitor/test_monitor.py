"""`clutch-hil monitor`: what it tells of rows with known content, and of a running, stalled and absent bench."""

import io
import json
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from rich.color import Color
from rich.console import Console

from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.bars import draw_bar, draw_sparkline
from clutch_hil.live.monitor.collector import WINDOW, Collector
from clutch_hil.live.monitor.monitor_screen import draw_snapshot, format_snapshot
from clutch_hil.live.monitor.snapshot import Snapshot, make_document
from protocols.can.claim import CONTESTED_TEXT, Supervision
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import Batch
from protocols.telemetry.feed import list_live_nodes
from protocols.telemetry.keys import make_bench_name
from protocols.telemetry.session import open_consumer_session
from tests.clutch_hil.live.running import RATE, Running, run_command, running_bench
from tests.processes import PATIENCE, service

HZ = 1000.0
RATE_ERROR = 0.2  # of the nominal rate: a machine that stands still now and then loses cycles, and the monitor says so
NOW = 500.0  # s
CONTROLLER = (
    "controller_phase", "controller_fault", "controller_clutch_state", "controller_torque_demand_nm",
    "controller_torque_estimate_nm",
    "controller_pressure_demand_bar", "controller_pressure_bar", "controller_slip_rad_s", "controller_temperature_degc",
    "controller_friction_level", "controller_clock_s", "controller_wake_us", "controller_work_us", "controller_late_cycles",
)  # fmt: skip
PLANT = ("truth_clutch_torque_nm", "plant_clock_s", "plant_wake_us", "plant_work_us", "plant_late_cycles")


def make_batch(node: str, first: int, count: int, session: int = 1, **columns: object) -> Batch:
    """`count` rows from number `first` on; columns that are not given are 0, the clock runs at HZ."""
    names = PLANT if node == "plant" else CONTROLLER
    clock = (first + np.arange(count)) / HZ
    values = {name: np.zeros(count) for name in names} | {f"{node}_clock_s": clock}
    values |= {name: np.broadcast_to(np.asarray(value, float), count) for name, value in columns.items()}
    rows = np.column_stack(list(values.values()))
    return Batch(node, session, first, HZ, 0.0, 0, tuple(Column(name, "", "") for name in values), rows)


def make_collector(*batches: Batch, at: float = NOW) -> Collector:
    """A collector of a bench on which both services live."""
    made = Collector("local:bench@here")
    made.alive = {"plant": True, "controller": True}
    made.take(batches, at)
    return made


def render_screen(snapshot: Snapshot) -> list[str]:
    console = Console(width=80, height=24, record=True, file=io.StringIO(), force_terminal=True)
    console.print(draw_snapshot(snapshot))
    return console.export_text().splitlines()


def test_values_are_the_newest() -> None:
    first = make_batch("controller", 0, 20, controller_torque_demand_nm=1.0)
    second = make_batch(
        "controller", 20, 20, controller_torque_demand_nm=np.linspace(1.0, 7.0, 20), controller_phase=2.0
    )
    snapshot = make_collector(first, second, make_batch("plant", 0, 40, truth_clutch_torque_nm=6.9)).make_snapshot(NOW)
    assert snapshot.clutches[0].values["torque demand"] == 7.0
    assert snapshot.clutches[0].values["torque true"] == 6.9
    assert (snapshot.clutches[0].phase, snapshot.clutches[0].fault) == ("slip control", "none")


def test_percentiles_are_of_the_last_ten_seconds() -> None:
    rows = 100
    pieces = [make_batch("plant", k * rows, rows, plant_work_us=900.0) for k in range(50)]
    pieces += [make_batch("plant", k * rows, rows, plant_work_us=np.arange(1.0, 101.0)) for k in range(50, 150)]
    state = make_collector(*pieces).make_snapshot(NOW).nodes["plant"]
    assert state.cycles == WINDOW * HZ
    assert state.work.maximum == 100.0
    assert state.work.p50 == pytest.approx(50.5)
    assert state.work.p99 == pytest.approx(np.percentile(np.arange(1.0, 101.0), 99.0), abs=1.0)


def test_late_cycles_are_those_of_the_last_ten_seconds() -> None:
    before = make_batch("plant", 0, 10_000, plant_late_cycles=7.0)
    after = make_batch("plant", 10_000, 9_999, plant_late_cycles=np.where(np.arange(9_999) < 100, 7.0, 9.0))
    assert make_collector(before, after).make_snapshot(NOW).nodes["plant"].late == 2


def test_the_measured_rate_counts_what_was_slept_through() -> None:
    clock = np.arange(1000) / HZ
    clock[500:] += 1.0
    state = make_collector(make_batch("plant", 0, 1000, plant_clock_s=clock)).make_snapshot(NOW).nodes["plant"]
    assert state.rate == pytest.approx(999 / 1.999)  # 1000 rows, 999 periods of 1 ms and the pause of 1 s


def test_a_service_without_new_rows_is_stalled() -> None:
    watched = make_collector(make_batch("plant", 0, 20), make_batch("controller", 0, 20))
    assert not watched.make_snapshot(NOW + 0.1).list_troubles()
    watched.take([make_batch("controller", 20, 20)], NOW + 2.0)
    snapshot = watched.make_snapshot(NOW + 2.1)
    assert (snapshot.nodes["plant"].state, snapshot.nodes["controller"].state) == ("stalled", "running")
    assert snapshot.nodes["plant"].age == pytest.approx(2.1)
    assert snapshot.list_troubles() == ["the plant is stalled"]


def test_who_lives_without_a_row_waits_or_was_stalled_before() -> None:
    watched = make_collector(make_batch("controller", 0, 20))
    assert watched.list_silent() == ["plant"]
    assert watched.make_snapshot(NOW).nodes["plant"].state == "waiting"
    watched.last_rows["plant"] = 4711
    assert watched.make_snapshot(NOW).nodes["plant"].state == "stalled"


def test_a_service_that_ends_is_gone() -> None:
    watched = make_collector(make_batch("plant", 0, 20), make_batch("controller", 0, 20))
    watched.alive = {"plant": True, "controller": False}
    assert watched.make_snapshot(NOW).list_troubles() == ["the controller is gone"]


def test_a_bench_without_a_plant_is_well() -> None:
    watched = Collector("can0@rig")
    watched.alive = {"controller": True}
    watched.take([make_batch("controller", 0, 20)], NOW)
    snapshot = watched.make_snapshot(NOW)
    assert snapshot.nodes["plant"].state == "absent"
    assert not snapshot.list_troubles()
    assert np.isnan(snapshot.clutches[0].values["torque true"])


def test_without_a_controller_phase_and_fault_are_unknown() -> None:
    watched = Collector("local:bench@here")
    watched.alive = {"plant": True}
    watched.take([make_batch("plant", 0, 20)], NOW)
    snapshot = watched.make_snapshot(NOW)
    assert snapshot.list_troubles() == ["controller absent: phase and fault unknown"]
    assert make_document(snapshot)["fault"] is None


def test_the_last_phase_of_a_controller_that_is_gone_is_not_told_as_its_phase() -> None:
    watched = make_collector(make_batch("plant", 0, 20), make_batch("controller", 0, 20, controller_phase=2.0))
    watched.alive = {"plant": True, "controller": False}
    gone = watched.make_snapshot(NOW)
    assert (gone.clutches[0].phase, gone.clutches[0].fault, gone.clutches[0].state) == (None, None, None)


def test_a_restarted_service_begins_anew() -> None:
    watched = make_collector(make_batch("plant", 0, 5000, plant_work_us=900.0))
    watched.take([make_batch("plant", 0, 100, session=2, plant_work_us=10.0)], NOW)
    assert watched.make_snapshot(NOW).nodes["plant"].work.maximum == 10.0
    assert watched.make_snapshot(NOW).nodes["plant"].cycles == 100


def test_rows_lost_in_the_ring_never_came_and_count_once() -> None:
    watched = make_collector(make_batch("plant", 0, 20), replace(make_batch("plant", 60, 20), rows_lost=40))
    watched.lost = {"plant": 40}
    assert watched.make_snapshot(NOW).nodes["plant"].lost == 40


def test_a_fault_is_told_by_name() -> None:
    locked = make_collector(
        make_batch("controller", 0, 20, controller_phase=5.0, controller_clutch_state=3.0)
    ).make_snapshot(NOW)
    assert (locked.clutches[0].phase, locked.clutches[0].state) == ("lock", "locked")
    snapshot = make_collector(
        make_batch("controller", 0, 20, controller_phase=4.0, controller_fault=6.0)
    ).make_snapshot(NOW)
    assert (snapshot.clutches[0].phase, snapshot.clutches[0].fault) == ("fault", "pressure lost")
    assert any("pressure lost: the pressure fell" in trouble for trouble in snapshot.list_troubles())


def test_a_refused_supervisor_is_told() -> None:
    """By the controller's column, which a service of before lacks."""
    for supervisor, sentence in ((Supervision.CLAIMED, False), (Supervision.CONTESTED, True), (np.nan, False)):
        batch = make_batch("controller", 0, 10, controller_supervisor=float(supervisor))
        snapshot = make_collector(batch).make_snapshot(NOW)
        assert (snapshot.clutches[0].notice == CONTESTED_TEXT) is sentence
        assert (CONTESTED_TEXT in snapshot.list_troubles()) is sentence


def test_columns_that_are_not_there_are_unknown() -> None:
    full = make_batch("controller", 0, 20, controller_torque_demand_nm=3.0)
    bare = Batch("controller", 1, 0, HZ, 0.0, 0, full.columns[:4], full.rows[:, :4])
    snapshot = make_collector(bare).make_snapshot(NOW)
    assert snapshot.clutches[0].values["torque demand"] == 3.0
    assert np.isnan(snapshot.clutches[0].values["pressure"])
    assert np.isnan(snapshot.nodes["controller"].wake.p99)
    assert len(render_screen(snapshot)) <= 24


def test_a_trace_ends_now_and_begins_ten_seconds_ago() -> None:
    ramp = np.arange(20_000) / HZ
    trace = (
        make_collector(make_batch("plant", 0, 20_000, truth_clutch_torque_nm=ramp))
        .make_snapshot(NOW)
        .clutches[0]
        .traces["torque true"]
    )
    assert trace[-1] == ramp[-1]
    assert trace[0] == pytest.approx(ramp[-1] - WINDOW, abs=WINDOW / len(trace))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_demand_is_drawn_the_way_round_the_clutch_slips_and_told_as_it_is(way: float) -> None:
    rows = make_batch("controller", 0, 10_000, controller_torque_demand_nm=10.0, controller_torque_estimate_nm=way * 9.9,
                 controller_slip_rad_s=way * 12.0)  # fmt: skip
    snapshot = make_collector(rows).make_snapshot(NOW)
    assert (snapshot.clutches[0].traces["torque demand"] == way * 10.0).all()
    assert snapshot.clutches[0].values["torque demand"] == 10.0


def test_a_quantity_and_a_state_have_the_colours_of_the_pictures() -> None:
    console = Console(width=80, record=True, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    rows = make_batch(
        "controller", 0, 20, controller_torque_estimate_nm=15.0, controller_phase=2.0, controller_clutch_state=2.0
    )
    console.print(draw_snapshot(make_collector(rows).make_snapshot(NOW)))
    styles = {part.text.strip(): part.style for part in console._record_buffer if part.text.strip() and part.style}
    for word in ("slip control", "sticking"):
        assert styles[word].bgcolor == Color.parse(palette.choose_state_colour(word)), word
    bars = [
        part.style.color for part in console._record_buffer if set(part.text) <= {"━", "╸"} and part.text and part.style
    ]
    assert Color.parse(palette.ESTIMATE) in bars


def test_noise_below_zero_has_no_sign() -> None:
    batch = make_batch("controller", 0, 20, controller_pressure_bar=-0.004, controller_torque_estimate_nm=-0.004)
    snapshot = make_collector(make_batch("plant", 0, 20), batch).make_snapshot(NOW)
    for text in (*render_screen(snapshot), format_snapshot(snapshot)):
        assert "-0.00" not in text


def test_only_the_last_changes_are_kept_in_the_order_of_time() -> None:
    watched = make_collector(make_batch("plant", 0, 20))
    change = {"node": "plant", "name": "clutch.coulomb_slope", "old": 10.8, "new": 11.0, "unit": "Nm/bar", "row": 1}
    watched.add_changes([change | {"time": float(time)} for time in (5, 1, 3)])
    watched.add_changes([change | {"time": 4.0}])
    watched.add_changes([change | {"time": 4.0}])
    watched.add_changes([change | {"time": 6.0, "name": "friction_level.level", "unit": "1"}])
    assert any(
        line.endswith("plant.friction_level.level  10.8 -> 11") for line in render_screen(watched.make_snapshot(NOW))
    )
    assert [change["time"] for change in watched.make_snapshot(NOW).changes] == [4.0, 5.0, 6.0]


def test_the_screen_fits_80_columns_and_24_rows() -> None:
    busy = {"wake_us": 123456.0, "work_us": 123456.0, "late_cycles": np.arange(10_000.0)}
    watched = make_collector(
        make_batch("plant", 0, 10_000, truth_clutch_torque_nm=-30.0, **{f"plant_{k}": v for k, v in busy.items()}),
        make_batch("controller", 0, 10_000, controller_phase=4.0, controller_fault=7.0,
              **{f"controller_{k}": v for k, v in busy.items()}),
    )  # fmt: skip
    watched.lost = {"plant": 123456, "controller": 123456}
    watched.add_changes(
        {"node": "controller", "name": "torque.proportional_gain" * 3, "old": 0.0, "new": 1.0, "unit": "bar/Nm", "row": 1,
         "time": float(time)} for time in range(9)
    )  # fmt: skip
    lines = render_screen(watched.make_snapshot(NOW + 100.0))
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "torque implausible" in text
    assert "lost 123456" in text
    assert "newest row 100.0 s ago" in text


def test_a_document_is_made_of_json() -> None:
    text = json.dumps(make_document(make_collector(make_batch("controller", 0, 20)).make_snapshot(NOW)))
    assert json.loads(text)["values"]["slip"]["unit"] == "rad/s"


def test_a_line_tells_states_torque_and_losses() -> None:
    text = format_snapshot(
        make_collector(
            make_batch("plant", 0, 20, truth_clutch_torque_nm=4.25), make_batch("controller", 0, 20)
        ).make_snapshot(NOW)
    )
    assert "plant running" in text
    assert "true 4.25 Nm" in text
    assert "lost 0" in text


def test_bars_and_sparklines_keep_their_width() -> None:
    for value in (None, float("nan"), -5.0, 0.0, 3.0, 10.0, 99.0):
        assert len(draw_bar(value, 10.0, 8, "").plain) == 8
    assert draw_bar(5.0, 10.0, 8, "").plain == "━━━━────"
    assert draw_sparkline(np.array([np.nan, 0.0, 0.5, 1.0, 7.0]), 0.0, 1.0) == " ▁▄▇▇"
    assert draw_sparkline(np.array([2.0, 2.0]), 2.0, 2.0) == "▁▁"


@pytest.fixture(scope="module")
def bench() -> Iterator[Running]:
    with running_bench(telemetry=True) as running:
        yield running


def look(bus: str, wanted: Callable[[dict], bool]) -> tuple[int, dict]:
    """The first look of a new monitor that is as `wanted`; the last one when none is."""
    deadline = time.monotonic() + PATIENCE
    while True:
        done = run_command("monitor", "--once", "--json", "--bus", bus)
        sentence = json.loads(done.stdout)
        if wanted(sentence) or time.monotonic() > deadline:
            return done.exit_code, sentence


def test_a_running_bench_is_well(bench: Running) -> None:
    code, sentence = look(bench.bus, lambda sentence: not sentence["troubles"])
    assert code == 0
    assert (sentence["phase"], sentence["fault"]) == ("idle", "none")
    for node in ("plant", "controller"):
        assert sentence["nodes"][node]["state"] == "running"
        assert sentence["nodes"][node]["rate"] == pytest.approx(RATE, rel=RATE_ERROR)
        assert 0.0 < sentence["nodes"][node]["work"]["p50"] < sentence["nodes"][node]["period_us"]


def test_without_a_terminal_lines_come(bench: Running) -> None:
    done = run_command("monitor", "--seconds", "2.5", "--bus", bench.bus)
    lines = done.stdout.splitlines()
    assert any(line.startswith("plant running  controller running  ") for line in lines)
    assert lines[-1].startswith("verdict: plant running, controller running")


def test_a_plant_without_a_controller_is_not_well(local_bus: str) -> None:
    arguments = ("plant", "--bus", local_bus, "--rate", str(RATE), "--telemetry")
    with service(*arguments), open_consumer_session() as session:
        deadline = time.monotonic() + PATIENCE
        while list_live_nodes(session, make_bench_name(local_bus)) != ["plant"]:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        done = run_command("monitor", "--once", "--bus", local_bus)
    assert done.exit_code == 1
    assert done.stdout.splitlines()[-1] == "verdict: controller absent: phase and fault unknown"


def test_without_a_bench_one_sentence_is_told() -> None:
    done = run_command("monitor", "--once", "--bus", "local:nobody")
    assert isinstance(done.exception, InputError)
    assert str(done.exception).startswith("no bench on local:nobody publishes telemetry")


def test_a_stopped_plant_is_seen_by_a_monitor_that_comes_later(bench: Running) -> None:
    bench.plant.send_signal(signal.SIGSTOP)
    try:
        code, sentence = look(bench.bus, lambda sentence: sentence["nodes"]["plant"]["state"] == "stalled")
    finally:
        bench.plant.send_signal(signal.SIGCONT)
    assert code == 1
    stalled, fault = sentence["troubles"]
    assert stalled == "the plant is stalled"
    assert "stale sensors: no plausible sample for " in fault


def test_a_change_whose_value_before_is_not_told_is_shown_without_it() -> None:
    collector = Collector("local:b@host")
    change = {"node": "plant", "name": "friction_level.level", "unit": "1", "new": 1.2, "time": 1.7e9, "row": 3}
    collector.add_changes([change | {"old": None}, change | {"old": 1.0, "row": 4}])
    console = Console(width=80)
    with console.capture() as capture:
        console.print(draw_snapshot(collector.make_snapshot(0.0)))
    assert "plant.friction_level.level  -> 1.2" in capture.get()
    assert "plant.friction_level.level  1 -> 1.2" in capture.get()

"""A live bench from Python: driven, tuned and disturbed by a program; its processes end however it is left."""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

import clutch_hil as ch
from clutch_hil.live import live_bench
from clutch_hil.live.driving.supervisor import Supervisor
from protocols.files.run import Run
from tests.clutch_hil.live.running import RATE

SETTLED = 1.5  # s: the torque loop rises in 0.25 s
TORQUE = 0.8  # Nm: what `clutch-hil demand` takes for reached of 8 Nm
PRESSURE = 0.03  # bar: three times the noise and the resolution of the sensor, 5 mbar each
SHORT = {"profile": "engagement", "seconds": 1.5, "rate": 500}


def list_services() -> list[psutil.Process]:
    """Plants and controllers that this process has started and that live."""
    children = [child for child in psutil.Process().children() if child.status() != psutil.STATUS_ZOMBIE]
    return [child for child in children if {"plant", "controller"} & set(child.cmdline())]


@pytest.fixture
def bench(local_bus: str) -> Iterator[ch.LiveBench]:
    with ch.start_bench(bus=local_bus, rate=RATE, plant={"friction_level.level": 0.95}) as started:
        yield started
    assert not list_services()
    assert not [one for one in threading.enumerate() if one.name.startswith("clutch-hil")]


def test_a_program_drives_tunes_and_disturbs_it(bench: ch.LiveBench) -> None:
    bench.demand_torque(8.0)
    bench.wait(SETTLED)
    assert bench.values()["clutch_torque_nm"] == pytest.approx(8.0, abs=TORQUE)
    (change,) = bench.tune({"torque.integral_gain": 0.2})
    assert (change["node"], change["new"]) == ("controller", 0.2)
    assert bench.parameters()["controller.torque.integral_gain"] == 0.2
    assert bench.parameters()["plant.friction_level.level"] == 0.95
    (leak,) = bench.inject({"internal_leakage": {"conductance": 1e-6}}, after=0.1, ramp=0.2)
    bench.demand_torque(4.0)
    bench.wait(SETTLED)
    assert bench.values()["clutch_torque_nm"] == pytest.approx(4.0, abs=TORQUE)
    bench.demand_pressure(3.0)
    bench.wait(SETTLED)
    assert bench.values()["cylinder_pressure_bar"] == pytest.approx(3.0, abs=PRESSURE)
    bench.release()
    run = bench.stop()
    assert run.metadata["parameter_changes"] == [change]
    assert [one["row"] for one in run.metadata["injections"]] == [leak["row"]]
    assert run.metadata["plant_parameters"]["friction_level.level"] == 0.95
    assert ch.measure_run(run)["fault"] == "none"
    np.testing.assert_allclose(np.diff(run["time_s"]), 1.0 / RATE, rtol=1e-6)
    assert np.nanmax(run["controller_torque_demand_nm"]) == 8.0


def test_a_clutch_that_is_driven_on_is_not_let_go_between_demands(bench: ch.LiveBench) -> None:
    for torque in (5.0, 8.0, 3.0):
        bench.demand_torque(torque)
        bench.wait(0.6)
    for seconds in (-1.0, float("nan"), "1"):
        with pytest.raises(ch.InputError, match=r"^seconds is "):
            bench.wait(seconds)  # type: ignore[arg-type]
    run = bench.stop()
    calls = (
        bench.stop,
        bench.values,
        bench.release,
        bench.parameters,
        lambda: bench.demand_torque(3.0),
        lambda: bench.wait(0.1),
    )
    for call in (*calls, lambda: bench.tune({"torque.integral_gain": 0.2}), lambda: bench.inject("internal_leakage")):
        with pytest.raises(ch.InputError, match=r"^this bench has been stopped; start another one$"):
            call()
    closed = np.flatnonzero(run["controller_phase"] == 2.0)
    let_go = np.flatnonzero(run["controller_phase"] == 3.0)
    assert not np.any((let_go > closed[0]) & (let_go < closed[-1]))


def test_a_fault_is_raised_until_it_is_acknowledged(bench: ch.LiveBench) -> None:
    bench.demand_torque(5.0)
    bench.wait(1.0)
    bench.inject(bias={"temperature": 100.0})  # K: with the oil at 70 degC beyond the guard's limit of 150 degC
    with pytest.raises(ch.InputError, match=r"fault: .*; acknowledge it with release\(\)"):
        bench.wait(2.0)
    with pytest.raises(ch.InputError, match="fault"):
        bench.demand_torque(5.0)
    with pytest.raises(ch.InputError, match="does not become idle: fault: overtemperature"):
        bench.release()
    bench.inject(bias={"temperature": 0.0})
    bench.release()
    bench.demand_torque(5.0)
    bench.wait(1.0)
    assert ch.measure_run(bench.stop())["fault"] == "overtemperature"


REFUSED = [
    (lambda bench: bench.demand_torque(99.0), "torque 99 Nm is outside 0..30 Nm"),
    (lambda bench: bench.demand_torque("8"), "torque is '8'; a number is needed"),
    (lambda bench: bench.demand_torque(True), "torque is True; a number is needed"),
    (lambda bench: bench.demand_pressure(None), "pressure is None; a number is needed"),
    (lambda bench: bench.demand_lock("fast"), "speed is 'fast'; a number is needed"),
    (lambda bench: bench.demand_pressure(3.0, speed=99.0), "speed 99 rad/s is outside"),
    (lambda bench: bench.demand_profile("no_such"), "profile 'no_such' does not exist"),
    (lambda bench: bench.tune({"torque.no_such": 1.0}), "torque.no_such"),
    (lambda bench: bench.tune({"torque.integral_gain": 1e9}), "torque.integral_gain"),
    (lambda bench: bench.inject("warp_drive"), "effect 'warp_drive' is unknown"),
    (lambda bench: bench.inject("internal_leakage", at=-1.0), "-1"),
    (lambda bench: bench.wait(), "give seconds"),
]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"bus": None}, "bus is None; allowed is the name of a bus"),
        ({"plant_parameters": 5}, "plant_parameters is 5; the path of a file is needed"),
        ({"profile": 5}, "profile is 5; the path of a file is needed"),
    ],
)
def test_a_bench_of_wrong_arguments_is_refused_in_one_sentence(arguments: dict, sentence: str) -> None:
    with pytest.raises(ch.InputError, match=sentence):
        ch.start_bench(**arguments)
    assert not list_services()


def test_what_cannot_be_is_refused_in_one_sentence_and_the_bench_goes_on(bench: ch.LiveBench) -> None:
    for call, sentence in REFUSED:
        with pytest.raises(ch.InputError) as error:
            call(bench)
        assert sentence in str(error.value)
        assert "\n" not in str(error.value)
    bench.demand_lock()
    bench.wait(SETTLED)
    assert ch.measure_run(bench.stop())["locked_s"] > 0.0


def test_in_lock_step_it_is_simulate_to_the_bit_and_nothing_is_written(
    local_bus: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = SHORT | {
        "seed": 3, "effects": ["internal_leakage"], "plant": {"friction_level.level": 0.95},
        "controller": {"torque.integral_gain": 0.2},
    }  # fmt: skip
    with ch.start_bench(bus=local_bus, lockstep=True, **settings) as bench:
        bench.wait()
        with pytest.raises(ch.InputError, match="plays its profile"):
            bench.demand_torque(5.0)
        run = bench.stop()
    expected = ch.simulate(**settings)
    assert set(run.columns) >= set(expected.columns)  # those of the services' clocks come with it
    for name, column in expected.columns.items():
        np.testing.assert_array_equal(run[name], column, err_msg=name)
    assert run.metadata["effects"] == expected.metadata["effects"] == ["friction_level", "internal_leakage"]
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_too_long_to_be_read_is_kept(local_bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path) -> Run:
        raise ch.InputError(f"recording {path} needs 1.2 GiB")

    with ch.start_bench(profile="engagement", bus=local_bus, lockstep=True, seconds=0.2) as bench:
        bench.wait()
        monkeypatch.setattr(live_bench, "read_run", refuse)
        with pytest.raises(
            ch.InputError, match=r"^recording /\S+\.parquet needs 1\.2 GiB; it is kept there$"
        ) as refused:
            bench.stop()
    path = Path(str(refused.value).split()[1])
    assert len(ch.read_run(path).columns["time_s"]) == 200
    path.unlink()
    path.parent.rmdir()


def test_an_exception_ends_its_processes(local_bus: str) -> None:
    def leave(bench: ch.LiveBench) -> None:
        with bench:
            assert len(list_services()) == 2
            raise ZeroDivisionError

    bench = ch.start_bench(bus=local_bus, rate=RATE)
    with pytest.raises(ZeroDivisionError):
        leave(bench)
    assert not list_services()


def test_a_service_that_is_killed_is_told(local_bus: str) -> None:
    with ch.start_bench(bus=local_bus, rate=RATE) as bench:
        next(one for one in list_services() if "controller" in one.cmdline()).kill()
        with pytest.raises(ch.InputError, match="the controller was killed by SIGKILL"):
            bench.wait(10.0)


def test_a_bench_that_cannot_be_started_leaves_nothing(local_bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ch.InputError, match="profile 'manual' cannot be played in lock-step"):
        ch.start_bench(bus=local_bus, lockstep=True)

    def refuse(self: Supervisor) -> Supervisor:
        raise ch.InputError("another supervisor")

    monkeypatch.setattr(Supervisor, "__enter__", refuse)
    with pytest.raises(ch.InputError, match="another supervisor"):
        ch.start_bench(bus=local_bus, rate=RATE)
    assert not list_services()

"""A scenario file says all that a run needs, and what is wrong in one is told before anything runs, by name."""

from collections.abc import Callable
from pathlib import Path

import pytest

from clutch_hil.bench.faults.catalogue import PlannedHostFault
from clutch_hil.bench.faults.process_fault import ProcessFault
from clutch_hil.bench.scenario import Scenario, find_shipped_scenarios, load_scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.simulate import Simulation
from clutch_hil.bench.up import Bench
from plant_sim.node.injection import Injection
from protocols.errors import InputError
from tests.clutch_hil.bench.scenario_files import FULL, invoke_command, make_writer


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    return make_writer(tmp_path)


def test_a_calibration_of_plant_and_controller_is_named_once() -> None:
    both = RunSettings(plant_parameters=Path("mine.toml"), controller_parameters=Path("mine.toml"))
    assert both.describe_changes() == ", changed by mine.toml"
    two = RunSettings(plant_parameters=Path("rig.toml"), controller_parameters=Path("mine.toml"))
    assert two.describe_changes() == ", changed by rig.toml and mine.toml"


def test_a_scenario_holds_what_its_file_says(written) -> None:
    path = written(FULL)
    scenario = load_scenario(str(path))
    s = scenario.settings
    assert (scenario.name, scenario.title, scenario.about, scenario.rig.name) == (
        "case",
        "Everything",
        "All there is.",
        "wet_clutch",
    )
    assert (s.rate, s.seconds, s.seed, s.temperature, s.law, s.adaptation) == (500, 0.9, 3, 50.0, "feedforward", False)
    assert scenario.load_profile().duration == 0.9
    assert s.make_controller().parameters["pressure.proportional_gain"].value == 0.5
    assert scenario.plant["valve.gain"].value == 2.4
    assert scenario.plant["piston_seal_friction.force"].value == 50.0
    assert scenario.plant["friction_level.level"].value == 0.85  # typical
    assert scenario.injections == (
        Injection({"internal_leakage.conductance": 1e-6, "pressure_sensor_offset.offset": 0.1}, 0.5, 0.1, 0.7),
        Injection({"friction_level.level": 1.0, "friction_level.drift": 0.0}, 0.6),
        Injection({"sensor_freeze.temperature": 1.0, "oil.sump_temperature": 80.0}, 0.65),
    )
    assert [str(limit) for limit in scenario.limits] == [
        "rise_time_s <= 0.5 s",
        "7 <= peak_torque_nm <= 12.5 Nm",
        "fault = none",
    ]


def test_a_scenario_without_anything_is_the_bench_as_it_is(written) -> None:
    scenario, plain = load_scenario(str(written('title = "x"'))), Scenario.of(RunSettings())
    assert (scenario.settings, scenario.plant, scenario.limits) == (plain.settings, plain.plant, ())


def test_options_override_the_file(written) -> None:
    given = {"rate": 250, "seed": 9, "adaptation": True}
    settings = load_scenario(str(written(FULL)), given).settings
    assert (settings.rate, settings.seed, settings.adaptation, settings.law) == (250, 9, True, "feedforward")


def test_parameter_files_have_the_last_word(written, tmp_path: Path) -> None:
    plant, controller = tmp_path / "plant.toml", tmp_path / "controller.toml"
    plant.write_text("[valve]\ngain = 2.6\n")
    controller.write_text("[pressure]\nproportional_gain = 0.4\n")
    given = {"plant_parameters": plant, "controller_parameters": controller}
    scenario = load_scenario(str(written(FULL)), given)
    assert scenario.plant["valve.gain"].value == 2.6
    assert scenario.plant["piston_seal_friction.force"].value == 50.0
    assert scenario.settings.make_controller().parameters["pressure.proportional_gain"].value == 0.4


def test_the_controllers_process_gets_what_the_file_changes(written, tmp_path: Path) -> None:
    settings = load_scenario(str(written(FULL))).settings
    alone = RunSettings(rate=500, controller_parameters=settings.write_controller_file(tmp_path)).make_controller()
    assert alone.parameters.as_values() == settings.make_controller().parameters.as_values()


def test_a_run_without_a_scenario_gives_the_controller_its_own_file(tmp_path: Path) -> None:
    assert RunSettings().write_controller_file(tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_injections_act_at_their_time(written) -> None:
    text = """
    title = "x"
    [run]
    profile = "short.csv"
    [[inject]]
    at = 0.7
    bias = { pressure = 0.2 }
    """
    scenario = load_scenario(str(written(text)))
    columns = Simulation(scenario).play(scenario.plant, 1).make_columns()
    wrong = columns["cylinder_pressure_bar"] - columns["truth_cylinder_pressure_bar"]
    noise = 0.005  # bar, standard deviation (docs/rig.md, 9)
    assert abs(wrong[300:700].mean()) < noise
    assert abs(wrong[702:].mean() - 0.2) < noise


@pytest.mark.parametrize(
    ("text", "sentence"),  # the sentence's end is left out where it lists what comes close
    [
        ("title = ", "file {path} cannot be read: Invalid value (at end of document)"),
        ("", "entry title is missing; text is needed"),
        ("title = 3", "title is 3; allowed is text"),
        ("title = 'x'\nrigg = 'y'", "entry rigg is unknown; did you mean rig?"),
        ("title = 'x'\nrig = 'lorry'", "rig is 'lorry'; allowed are power_shift, wet_clutch"),
        ("title = 'x'\nrun = 3", "run is 3; allowed is a table"),
        ("title = 'x'\n[run]\nrat = 3", "entry run.rat is unknown; did you mean rate"),
        ("title = 'x'\n[run]\nrate = 1000.0", "run.rate is 1000.0; allowed is a whole number"),
        ("title = 'x'\n[run]\nrate = true", "run.rate is True; allowed is a whole number"),
        ("title = 'x'\n[run]\nseconds = nan", "run.seconds is nan; allowed is a number"),
        (
            "title = 'x'\n[plant.friction_level]\nlevel = 0.9\n[effects]\nfriction_level = {}",
            "effect friction_level is in both [plant] and [effects]; only one of them is allowed",
        ),
        ("title = 'x'\n[run]\nadaptation = 'no'", "run.adaptation is 'no'; allowed is true or false"),
        (
            "title = 'x'\n[run]\nrate = 20000",
            "rate 20000 Hz is not possible; allowed are 50 to 10000 Hz with a period of whole ns, such as 10000",
        ),
        ("title = 'x'\n[run]\nseed = -1", "run.seed is -1; allowed are 0 and more"),
        ("title = 'x'\n[run]\nseconds = -1", "a run of -1 s is not possible; it must last 0.1 s or more"),
        ("title = 'x'\n[run]\ntemperature = 20", "oil temperature 20 degC is outside 35..150 degC"),
        ("title = 'x'\n[run]\nlaw = 'best'", "control law 'best' is unknown; allowed are both, feedforward, feedback"),
        (
            "title = 'x'\n[plant.valve]\ngian = 2",
            "parameter 'valve.gian' is unknown; did you mean valve.gain or",
        ),
        (
            "title = 'x'\n[plant.valve]\ngain = 99",
            "parameter valve.gain = 99 bar/V is outside 0.1..25",
        ),
        ("title = 'x'\n[plant.valve]\ngain = '2'", "plant.valve.gain is '2'; allowed is a number"),
        (
            "title = 'x'\n[controller.torque]\nintegral = 1",
            "parameter 'torque.integral' is unknown; did you mean torque.integral_gain or",
        ),
        (
            "title = 'x'\n[controller.guard]\nvoltage = 1",
            "parameter guard.voltage is fixed while the controller runs: the guard's limits are set at the start",
        ),
        (
            "title = 'x'\n[effects]\npiston_friction = {}",
            "effect 'piston_friction' is unknown; did you mean piston_seal_friction or",
        ),
        ("title = 'x'\n[effects]\nfriction_level = 0.8", "effects.friction_level is 0.8; allowed is a table"),
        (
            "title = 'x'\n[effects]\nfriction_level = { leval = 0.8 }",
            "effect friction_level has no parameter 'leval'; did you mean level?",
        ),
        (
            "title = 'x'\n[effects]\nfriction_level = { level = 9 }",
            "parameter friction_level.level = 9 is outside 0.3..3",
        ),
        ("title = 'x'\n[[inject]]\neffect = 'friction_level'", "entry inject 1.at is missing; a number is needed"),
        ("title = 'x'\n[inject]\nat = 1", "inject is {{'at': 1}}; allowed is a list of tables"),
        ("title = 'x'\n[[inject]]\nat = 1", "inject 1: an injection changes nothing; give a parameter and its value"),
        (
            "title = 'x'\n[[inject]]\nat = 1\nwhen = 2",
            "entry inject 1.when is unknown; known are at, ramp, until, clutch,",
        ),
        ("title = 'x'\n[[inject]]\nat = 1\noff = true", "inject 1 has off without effect; add effect"),
        (
            "title = 'x'\n[[inject]]\nat = 1\neffect = 'friction_level'\noff = true\nvalues = { level = 1 }",
            "inject 1 has both off and values of effect friction_level; only one of them is allowed",
        ),
        ("title = 'x'\n[[inject]]\nat = 1\nfreeze = 'presure'", "sensor 'presure' is unknown; did you mean pressure"),
        (
            "title = 'x'\n[[inject]]\nat = 2\nramp = 1\nuntil = 2.5\nfreeze = 'pressure'",
            "inject 1: injection until 2.5 s is not possible; its ramp ends at 3 s",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nbus_fault = 'frame_los'",
            "inject 1.bus_fault is 'frame_los'; did you mean frame_loss",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\neffect = 'frame_loss'",
            "inject 1.effect is 'frame_loss'; ",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nbus_fault = 'frame_loss'\neffect = 'friction_level'",
            "inject 1 has both effect and bus_fault; only one of them is allowed",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nbus_fault = 'frame_loss'\nvalues = { xyz = 1 }",
            "bus fault frame_loss has no parameter 'xyz'; known are commands, samples",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nbus_fault = 'frame_loss'\nvalues = { commands = 2 }",
            "parameter frame_loss.commands = 2 is outside 0..1",
        ),
        (
            "title = 'x'\n[effects]\nframe_loss = {}",
            "effects.frame_loss is a fault of the bus; it is allowed in [[inject]], as bus_fault",
        ),
        ("title = 'x'\n[[inject]]\nat = 1\nsignal = 'kill'", "inject 1 has signal without process; add process"),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'controler'",
            "inject 1: process is 'controler'; did you mean controller",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'controller_b'",
            "inject 1.process is 'controller_b'; the rig wet_clutch has one controller",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'plant'\nsignal = 'term'",
            "inject 1: signal is 'term'; allowed are kill and stop",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'plant'\nuntil = 2",
            "inject 1: until is 2 s, and plant is killed and cannot continue; leave until out",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'plant'\nsignal = 'stop'\nuntil = 1",
            "inject 1: until is 1 s; allowed are times after 1 s",
        ),
        (
            "title = 'x'\n[[inject]]\nat = -1\nprocess = 'plant'",
            "inject 1: at is -1 s; allowed is 0 and more",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'plant'\nramp = 1",
            "inject 1 has process and ramp; allowed with it are at, signal, until",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nprocess = 'plant'\nhost_fault = 'disk_full'",
            "inject 1 has process and host_fault; allowed with it are at, signal, until",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nhost_fault = 'disk_full'\nsignal = 'kill'",
            "inject 1 has host_fault and signal; allowed with it are at, until, values",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nhost_fault = 'disk_ful'",
            "inject 1: host_fault is 'disk_ful'; did you mean disk_full",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nhost_fault = 'disk_slow'\nvalues = { delay = 0 }",
            "inject 1: parameter disk_slow.delay = 0 ms is outside 1..10000",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 99\nhost_fault = 'disk_full'",
            "the fault 'disk_full' begins at 99 s, when the run of 12 s is over; allowed are earlier times",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 12\nfreeze = 'pressure'",
            "inject 1 begins at 12 s, when the run of 12 s is over; allowed are earlier times",
        ),
        (
            "title = 'x'\n[[inject]]\nat = 1\nparameters = { 'valve.gain' = 99 }",
            "parameter valve.gain = 99 bar/V is outside 0.1..25",
        ),
        (
            "title = 'x'\n[limits]\nregime_eror_nm = { most = 1 }",
            "measure 'regime_eror_nm' is unknown on the rig wet_clutch; did you mean regime_error_nm or",
        ),
        ("title = 'x'\n[limits]\nrise_time_s = 1", "limits.rise_time_s is 1; allowed is a table"),
        (
            "title = 'x'\n[limits]\nrise_time_s = { max = 1 }",
            "entry limits.rise_time_s.max is unknown; known are least, most",
        ),
        (
            "title = 'x'\n[limits]\nrise_time_s = {}",
            "limit rise_time_s has neither least nor most; one of them is needed, in s",
        ),
        (
            "title = 'x'\n[limits]\nrise_time_s = { least = 2, most = 1 }",
            "limit rise_time_s has least = 2 above most = 1; no value would be allowed",
        ),
        (
            "title = 'x'\n[limits]\nfault = 'bad luck'",
            "limit fault is 'bad luck'; allowed are none, stale sensors, overpressure, overtemperature, overspeed,"
            " fill timeout, pressure lost, torque implausible",
        ),
    ],
)
def test_what_is_wrong_is_told_by_name(text: str, sentence: str, written) -> None:
    path = written(text)
    with pytest.raises(InputError) as error:
        Simulation(load_scenario(str(path)))
    message = sentence.format(path=path)
    assert str(error.value).startswith(message if message.startswith("file ") else f"scenario {path}: {message}")


def test_faults_of_bus_processes_and_computer_are_read(written) -> None:
    path = written(
        "title = 'x'\n[[inject]]\nat = 1\nuntil = 2\nbus_fault = 'frame_delay'\nvalues = { commands = 5 }\n"
        "[[inject]]\nat = 3\nprocess = 'controller'\nsignal = 'stop'\nuntil = 4\n"
        "[[inject]]\nat = 5\nprocess = 'plant'\n"
        "[[inject]]\nat = 6\nhost_fault = 'disk_slow'\nuntil = 7\nvalues = { delay = 20 }\n"
    )
    scenario = load_scenario(str(path))
    assert scenario.injections == (Injection({"frame_delay.commands": 5.0}, 1.0, until=2.0),)
    assert scenario.bench_faults == (
        ProcessFault("controller", "stop", at=3.0, until=4.0),
        ProcessFault("plant", "kill", at=5.0),
        PlannedHostFault("disk_slow", {"delay": 20.0}, at=6.0, until=7.0),
    )
    with pytest.raises(InputError, match="has the fault 'controller stopped', but a simulation has one process"):
        Simulation(scenario).play_with_metadata()
    with pytest.raises(InputError, match="has the fault 'controller stopped', which --lockstep does not allow"):
        Bench(scenario, "local:x", lockstep=True)


def test_a_missing_profile_is_told_with_its_path(written, tmp_path: Path) -> None:
    path = written("title = 'x'\n[run]\nprofile = 'lost.csv'")
    with pytest.raises(InputError, match=rf"^scenario {path}: profile {tmp_path}/lost.csv does not exist"):
        Simulation(load_scenario(str(path)))


def test_a_rate_that_the_bus_cannot_carry_is_refused(written) -> None:
    path = written("title = 'x'\n[run]\nrate = 2000")
    with pytest.raises(InputError, match=r"run.rate is 2000 Hz: its frames would fill 1\d\d % of a bus of 1000 kbit/s"):
        load_scenario(str(path))


def test_a_rig_too_fast_to_integrate_is_refused(written) -> None:
    path = written("title = 'x'\n[plant.piston]\ndamping = 5000\narea = 0.05")
    with pytest.raises(InputError, match=rf"^scenario {path}: the rig is too fast to integrate: .* allowed are"):
        Simulation(load_scenario(str(path)))


def test_effects_that_exclude_each_other_are_refused(written) -> None:
    path = written("title = 'x'\n[effects]\nmotor_torque_ripple = {}\nshaft_compliance = {}\nbacklash = {}")
    with pytest.raises(InputError, match=rf"^scenario {path}: effects \w+ and \w+ exclude each other"):
        Simulation(load_scenario(str(path)))


def test_an_unknown_scenario_is_told_with_what_comes_closest() -> None:
    with pytest.raises(
        InputError,
        match=r"^scenario 'engagment' is unknown, and the path of one ends with .toml; did you mean engagement",
    ):
        load_scenario("engagment")
    with pytest.raises(InputError, match=r"^file nowhere\.toml does not exist$"):
        load_scenario("nowhere.toml")


@pytest.mark.parametrize("name", ["mine.csv", "pressure_steps"])
def test_a_profile_is_not_taken_for_a_misspelt_scenario(name: str) -> None:
    with pytest.raises(InputError) as refusal:
        load_scenario(name)
    assert str(refusal.value) == (
        f"scenario {name!r} is a profile; give it by --profile {name}, or profile= from Python"
    )


def test_nothing_is_written_when_a_file_is_wrong(written, tmp_path: Path) -> None:
    path = written("title = 'x'\n[run]\nlaw = 'best'")
    result = invoke_command("simulate", "engagement", path, "--out", tmp_path / "runs", "--junit", tmp_path / "x.xml")
    assert isinstance(result.exception, InputError)  # exit code 2
    assert not (tmp_path / "runs").exists()
    assert not (tmp_path / "x.xml").exists()


@pytest.mark.parametrize(
    ("seconds", "expected_text"), [(1e9, "it must last 1e\\+06 s or less"), (2000, "does not fit into memory")]
)
def test_a_simulation_that_memory_cannot_hold_is_refused(seconds: float, expected_text: str) -> None:
    with pytest.raises(InputError, match=expected_text):
        Simulation(Scenario.of(RunSettings(seconds=seconds)))


def test_the_lock_of_an_editor_is_no_shipped_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.toml").touch()
    (tmp_path / ".#mine.toml").symlink_to("me@host.123:456")
    monkeypatch.setattr("clutch_hil.bench.scenario.FOLDER", tmp_path)
    assert list(find_shipped_scenarios()) == ["mine"]

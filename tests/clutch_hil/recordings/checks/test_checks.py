"""Checks of a recording: each speaks where it must and names column and rows; faults of real sensors are not refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from clutch_hil.recordings.checks.every_check import check_columns_alone, check_runs
from clutch_hil.recordings.checks.finding import Finding, refuse_hard
from clutch_hil.recordings.checks.knowledge import Knowledge, Limits, Recorded
from clutch_hil.recordings.checks.timing import LEAST_ROWS, LEAST_SECONDS, cut_at_fault
from clutch_hil.recordings.checks.values import find_outliers, find_spikes
from protocols.errors import InputError

PERIOD, ROWS, NOISE = 1e-3, 8000, 0.02  # s; rows; N
TIME = PERIOD * np.arange(ROWS)
PREDICTED = 3.0 * np.sin(2.3 * TIME) + np.sin(7.1 * TIME + 1.0)  # N
SOUND = PREDICTED + NOISE * np.random.default_rng(1).standard_normal(ROWS)

Alteration = Callable[[np.ndarray], np.ndarray]


def make_run(
    force: np.ndarray, predicted: np.ndarray = PREDICTED, clips: bool = False, position: np.ndarray = TIME
) -> Recorded:
    known = {
        "position_m": Knowledge("m", limits=Limits(span=10.0)),
        "force_n": Knowledge("N", NOISE, predicted, Limits(-50.0, 50.0), clips),
    }
    return Recorded("a run", {"time_s": TIME, "position_m": position, "force_n": force}, known, ("position_m",), 1.2)


def check_run(force: np.ndarray, **more: object) -> list[Finding]:
    return check_runs([make_run(force, **more)])  # type: ignore[arg-type]


def make_delay(by: float) -> Alteration:
    return lambda x: np.interp(TIME - by, TIME, x)


FREEZING = np.where((np.arange(ROWS) < 2000) | (np.arange(ROWS) > 5000), SOUND, SOUND[2000])
SPIKED = np.where(np.arange(ROWS) == 4321, 20.0, SOUND)
SLOWER_CLOCK = np.interp(TIME * 1.02, TIME, PREDICTED) + NOISE * np.random.default_rng(2).standard_normal(ROWS)


@pytest.mark.parametrize(
    ("force", "check", "message"),
    [
        (np.zeros(ROWS), "dead", "the channel is dead"),
        (np.full(ROWS, 1.7), "dead", "is 1.7 N throughout"),
        (-SOUND, "sign", "scale = -1.0"),
        (1e-3 * SOUND, "scale", "kN or position_m in mm? set its unit"),
        (9.0 * SOUND, "scale", "is 9 of what the rig can do"),
        (1e3 * SOUND, "range", "the rig has -50 to 50"),
        (SOUND + 6.0, "offset", "check its zero"),
        (FREEZING, "frozen", "froze"),
        (np.minimum(SOUND, 1.5), "saturated", "rests at its end, 1.5 N"),
        (make_delay(0.3)(SOUND), "delay", "is 0.3 s behind the baseline"),
        (make_delay(-0.2)(SOUND), "delay", "is 0.2 s before the baseline"),
        (SLOWER_CLOCK, "drift", "its clock is another one"),
        (np.random.default_rng(3).standard_normal(ROWS), "unrelated", "little in common"),
    ],
)  # fmt: skip
def test_an_altered_channel_is_refused_by_name(force: np.ndarray, check: str, message: str) -> None:
    findings = check_run(force)
    first = next(finding for finding in findings if finding.check == check)
    assert first.hard
    assert first.column == "force_n"
    assert message in first.text
    with pytest.raises(InputError, match=r"run a run: force_n, rows .* --force, force=True from Python, goes on"):
        refuse_hard(findings)


def test_rows_are_those_concerned() -> None:
    (frozen,) = (f for f in check_run(FREEZING) if f.check == "frozen")
    assert frozen.rows == (2000, 5000)
    (spike,) = (f for f in check_run(SPIKED) if f.check == "outliers")
    assert (spike.rows, spike.hard) == ((4321, 4321), False)
    assert ", row 4321, has 1 isolated sample" in str(spike)


def test_one_outlier_is_no_reason_to_refuse_a_short_run() -> None:
    rows = slice(4000, 4600)
    run = Recorded(
        "a run", {"force_n": SPIKED[rows], "position_m": TIME[rows], "time_s": TIME[rows]},
        {"force_n": Knowledge("N", NOISE, PREDICTED[rows])}, ("position_m",), 1.2,
    )  # fmt: skip
    (spike,) = find_outliers(run)
    assert not spike.hard
    two = np.where(np.isin(np.arange(ROWS), [4321, 4500]), 20.0, SOUND)[rows]
    (spike,) = find_outliers(replace(run, columns={**run.columns, "force_n": two}))
    assert spike.hard


def test_a_sample_that_the_baseline_has_is_no_outlier() -> None:
    """At 100 rows a second the motor's torque after a step of the speed may be a single one."""
    run = make_run(SPIKED, PREDICTED + np.where(np.arange(ROWS) == 4321, 15.0, 0.0))
    assert not find_outliers(run)


def test_the_peak_of_a_jump_is_not_alone() -> None:
    """A motor's torque jumps with its speed demand and decays with J/k_p, 10 ms, here at 500 Hz: the peak was taken out."""
    after = np.arange(ROWS) - 4321
    jump = np.where(after < 0, 6.2, 3.0 - 6.5 * np.exp(-0.2 * np.maximum(after, 0)))
    rows, _ = find_spikes(jump, NOISE)
    assert not len(rows)
    glitch = np.where(after == 900, 20.0, jump)
    assert list(find_spikes(glitch, NOISE)[0]) == [4321 + 900]


@pytest.mark.parametrize("step", [0.0, 0.02, 0.08])
def test_the_noise_of_a_rig_at_rest_is_no_spike(step: float) -> None:
    """An import knows no noise, and each step of a converter was 'far from the neighbours'."""
    noise = NOISE * np.random.default_rng(3).standard_normal(ROWS)
    rest = noise if step == 0.0 else step * np.round(noise / step + 0.3)
    assert not len(find_spikes(rest, 0.0)[0])
    assert list(find_spikes(np.where(np.arange(ROWS) == 4321, 2.0, rest), 0.0)[0]) == [4321]
    lost = np.arange(50, ROWS, 97)
    assert list(find_spikes(np.where(np.isin(np.arange(ROWS), lost), -20.0, SOUND), 0.0)[0]) == list(lost)


@pytest.mark.parametrize(
    "fault",
    [
        lambda x: x,
        lambda x: 1.9 * x,
        lambda x: 0.6 * x,
        lambda x: x + 1.5,
        make_delay(0.05),
        lambda x: 0.2 * np.round(5.0 * x),
        lambda x: x + 0.5 * np.random.default_rng(5).standard_normal(ROWS),
    ],
    ids=["none", "gain 1.9", "gain 0.6", "offset", "50 ms late", "coarse", "noise"],
)
def test_what_a_real_sensor_does_is_not_refused(fault: Alteration) -> None:
    assert not [str(finding) for finding in check_run(fault(SOUND)) if finding.hard]


TRIANGLE = np.where(TIME < 0.5, 0.0, 1.0 + np.abs((TIME / 4.0) % 2.0 - 1.0))  # after a fill
SLOWING = np.abs((np.log(0.15 + 0.1 * TIME) / 0.2) % 2.0 - 1.0)  # a triangle with slower and slower flanks


@pytest.mark.parametrize(
    ("predicted", "half_width"), [(TRIANGLE, 0.1), (TRIANGLE, 0.05), (SLOWING, 0.05), (SLOWING, 0.15)]
)
def test_a_valve_with_hysteresis_has_no_other_clock(predicted: np.ndarray, half_width: float) -> None:
    """It is late where the movement is slow; a clock is late in all of a run."""
    held, played = predicted[0], []
    for value in predicted:
        held = min(max(held, value - half_width), value + half_width)
        played.append(held)
    force = np.array(played) + NOISE * np.random.default_rng(6).standard_normal(ROWS)
    assert not [str(f) for f in check_run(force, predicted=predicted) if f.check in ("delay", "drift")]


def test_a_channel_that_agrees_with_the_baseline_has_its_clock() -> None:
    """A small movement in noise may look more like a large one nearby than like itself."""
    third = TIME[-1] / 3.0
    bumps = [(0.5, 3.0), (1.1, 0.05), (1.5 * third, 3.0), (3.0 * third - 1.1, 0.05), (3.0 * third - 0.5, 3.0)]
    predicted = np.sum([size * np.exp(-(((TIME - at) / 0.05) ** 2)) for at, size in bumps], axis=0)
    force = predicted + NOISE * np.random.default_rng(7).standard_normal(ROWS)
    assert check_run(force, predicted=predicted) == []


def test_a_sound_run_says_nothing() -> None:
    assert check_run(SOUND) == []


def test_dips_that_the_steps_of_a_converter_cut_are_not_called_saturated() -> None:
    """The slip of a small clutch was: its dips, after each step of the pressure, were five counts of the encoder."""
    dips = -6.0 * np.exp(-5.0 * (TIME % 1.0))
    assert np.mean(np.round(dips) == -6.0) > 0.015
    assert not [one for one in check_run(np.round(dips), predicted=2.0 * dips) if one.check == "saturated"]
    cut = np.maximum(np.round(dips), -3.0)
    assert [one for one in check_run(cut, predicted=2.0 * dips) if one.check == "saturated"]


def test_a_saturated_channel_that_discovery_can_name_is_only_told() -> None:
    (saturated,) = check_run(np.clip(SOUND, -1.5, 1.5), clips=True)[:1]
    assert (saturated.check, saturated.hard) == ("saturated", False)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_without_a_baseline_a_channel_that_has_lost_its_noise_at_its_end_is_told(sign: float) -> None:
    (sentence,) = check_columns_alone(
        "a run", {"time_s": TIME, "force_n": sign * np.minimum(SOUND, 1.5)}, {"force_n": "N"}
    )
    assert (sentence.check, sentence.hard) == ("saturated", False)
    assert f"rests at its end, {sign * 1.5:g} N" in sentence.text
    assert "without its noise" in sentence.text


@pytest.mark.parametrize(
    "force",
    [
        SOUND,
        np.maximum(SOUND, 0.0),  # a sensor that shows nothing below 0
        0.2 * np.round(5.0 * SOUND),  # a converter whose steps are coarser than the noise
        np.minimum(PREDICTED, 1.5),  # a command without noise, at its limit
        np.clip(np.round(SOUND / NOISE) * NOISE, None, SOUND.max() - 1e-3),  # a peak that is cut off
        np.repeat(SOUND[::50], 50),  # held samples of a slow bus
    ],
    ids=["sound", "unipolar", "coarse", "command", "peak", "held"],
)
def test_a_channel_that_rests_for_another_reason_is_not_called_saturated(force: np.ndarray) -> None:
    sentence = check_columns_alone("a run", {"time_s": TIME, "force_n": force}, {"force_n": "N"})
    assert [str(finding) for finding in sentence if finding.check == "saturated"] == []


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_an_input_in_another_unit_is_named(factor: float) -> None:
    first = check_run(SOUND, position=factor * TIME)[0]
    assert (first.check, first.column, first.hard) == ("range", "position_m", True)


def test_an_input_that_is_dead_or_froze_is_told_from_a_slow_rig() -> None:
    still = check_run(SOUND, predicted=np.zeros(ROWS), position=np.zeros(ROWS))
    assert [(f.check, f.column) for f in still if f.hard] == [("range", "position_m"), ("input", "force_n")]
    half = np.arange(ROWS) < ROWS // 2
    frozen = check_run(
        SOUND, predicted=np.where(half, PREDICTED, PREDICTED[ROWS // 2]), position=np.where(half, TIME, TIME[ROWS // 2])
    )
    assert any(f.check == "input" and f.column == "position_m" and f.rows == (ROWS // 2, ROWS - 1) for f in frozen)


def cut(rows: int) -> Recorded:
    run = make_run(SOUND)
    known = {
        n: Knowledge(k.unit, k.floor, None if k.predicted is None else k.predicted[:rows]) for n, k in run.known.items()
    }
    return Recorded("short", {n: v[:rows] for n, v in run.columns.items()}, known, run.inputs)


@pytest.mark.parametrize("rows", [2, 3, LEAST_ROWS, round(0.3 / PERIOD), round(LEAST_SECONDS / PERIOD) - 1])
def test_a_short_run_is_one_sentence(rows: int) -> None:
    (short,) = check_runs([cut(rows)])
    assert (short.check, short.hard) == ("length", True)
    assert f"with {rows} rows" in short.text


def test_runs_that_are_short_together_are_refused() -> None:
    one = round(1.2 / PERIOD)
    assert [f.check for f in check_runs([cut(one)]) if f.hard] == ["length"]
    assert not [f for f in check_runs([cut(one), cut(one)]) if f.check == "length"]


def test_a_rig_at_rest_shows_nothing() -> None:
    noise = NOISE * np.random.default_rng(4).standard_normal(ROWS)
    assert [f.check for f in check_run(noise, predicted=np.zeros(ROWS))] == ["excitation"]


def test_a_faulted_stretch_is_cut_off() -> None:
    columns = {"time_s": TIME, "force_n": SOUND, "controller_fault": np.where(TIME < 5.0, 0.0, 2.0)}
    kept, finding = cut_at_fault(columns)
    assert finding is not None
    assert {len(values) for values in kept.values()} == {5000}
    assert finding.rows == (5000, ROWS - 1)
    assert cut_at_fault({**columns, "controller_fault": np.zeros(ROWS)})[1] is None


def test_an_imported_run_is_told_what_stands_out_and_refused_nothing() -> None:
    columns = {
        "time_s": TIME,
        "force_n": FREEZING,
        "dead_v": np.zeros(ROWS),
        "gear_1": np.repeat([1.0, 2.0], ROWS // 2),
    }
    findings = check_columns_alone("a run", columns, {"force_n": "N"})
    assert {(f.check, f.column) for f in findings} == {("frozen", "force_n"), ("dead", "dead_v")}
    assert not any(f.hard for f in findings)


def check_angle(angle: np.ndarray, unit: str = "rad") -> list[Finding]:
    known = {"shaft_angle_rad": Knowledge(unit)}
    return [f for f in check_runs([Recorded("a run", {"time_s": TIME, "shaft_angle_rad": angle}, known)]) if f.hard]


@pytest.mark.parametrize("number", [-9999.0, 1e37, 32767.0])
def test_a_number_that_stands_for_no_value_is_told(number: float) -> None:
    force = np.where((TIME > 2.0) & (TIME < 2.01), number, SOUND)
    (finding,) = check_columns_alone("a run", {"time_s": TIME, "force_n": force}, {"force_n": "N"})
    assert (finding.check, finding.rows, finding.hard) == ("placeholder", (2001, 2009), False)
    assert f"is {number:.6g} in 9 rows" in str(finding)
    assert "set missing for this column in the import map" in str(finding)


def test_a_number_that_stands_for_no_value_is_told_in_a_short_run() -> None:
    force = np.where((TIME > 0.2) & (TIME < 0.21), -9999.0, SOUND)[:500]
    findings = check_columns_alone("a run", {"time_s": TIME[:500], "force_n": force}, {"force_n": "N"})
    assert [finding.check for finding in findings] == ["length", "placeholder"]


@pytest.mark.parametrize(
    "column",
    [
        np.where(TIME < 4.0, 0.0, 5.0),
        np.round(np.clip(40.0 * np.sin(TIME), 0.0, 20.0)),
        np.where(TIME < 4.0, SOUND, 30.0),
    ],
    ids=["two states", "saturated", "frozen far away"],
)
def test_a_state_or_an_end_is_not_taken_for_no_value(column: np.ndarray) -> None:
    findings = check_columns_alone("a run", {"time_s": TIME, "force_n": column}, {"force_n": "N"})
    assert not [finding for finding in findings if finding.check == "placeholder"]


@pytest.mark.parametrize(
    ("angle", "turn"),
    [
        (np.mod(20.0 * TIME, 2.0 * np.pi), "6.283"),
        (np.mod(-20.0 * TIME + 1.0, 2.0 * np.pi) - np.pi, "6.283"),
        (np.mod(20.0 * TIME + 3.0 * np.sin(TIME), 1.6 * 2.0 * np.pi), "10.05"),
        (np.mod(7.0 * np.sin(1.5 * TIME), 2.0 * np.pi), "6.283"),
    ],
)
def test_an_angle_that_begins_anew_is_told_with_its_turn(angle: np.ndarray, turn: str) -> None:
    (finding,) = check_angle(angle)
    assert finding.check == "wrapped"
    assert f"jumps by {turn} rad" in finding.text
    assert "wraps_at" in finding.text


@pytest.mark.parametrize(
    ("angle", "unit"),
    [
        (20.0 * TIME, "rad"),
        (0.5 * np.sin(5.0 * TIME), "rad"),
        (np.where(TIME > 4.0, 3.0, 0.0) + 1e-3 * np.sin(TIME), "rad"),
        (np.mod(TIME, 0.5), "N"),
        (np.random.default_rng(1).standard_normal(ROWS), "rad"),
    ],
)
def test_what_turns_on_or_is_no_angle_is_not_said_to_begin_anew(angle: np.ndarray, unit: str) -> None:
    assert not any(finding.check == "wrapped" for finding in check_angle(angle, unit))

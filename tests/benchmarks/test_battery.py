"""The battery: a quick subset of it that must come right, and what counts its answers."""

from dataclasses import replace
from math import isnan
from pathlib import Path

import pytest

from benchmarks.battery import run as running
from benchmarks.battery import table, validity
from benchmarks.battery.judgement import judge
from benchmarks.battery.run import Cache, select_cases
from benchmarks.battery.score import (
    Measure,
    check_claims,
    compute_closed_share,
    compute_localisation_f1,
    compute_wilson_interval,
    is_at_floor,
    is_worse,
    list_parameter_errors,
    score_answers,
)
from benchmarks.battery.short_case import make_short_case
from benchmarks.battery.thresholds import Constants, decide_again, propose_constants
from benchmarks.battery.truth_laws import LAWS
from benchmarks.battery.validity import CHECKED_CASES, format_engine_name, is_valid, list_differences
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, Result
from clutch_hil.discrepancy.search import investigate
from tests.benchmarks.battery_answers import make_answer

SEAL, WAVES, GAIN = "piston_seal_friction", "plate_waviness", "torque_sensor_gain"
SINGLE = f"single/{SEAL}/2.0/0.02/s1"


def measure(answers, name) -> Measure:
    return next(one for one in score_answers(answers) if one.name == name)


def test_wilson_interval_of_nine_in_ten():
    assert compute_wilson_interval(9, 10) == pytest.approx(
        (0.5958, 0.9821), abs=1e-4
    )  # Wilson 1927; statsmodels gives the same
    assert all(isnan(end) for end in compute_wilson_interval(0, 0))


def test_the_first_name_counts_and_an_alias_is_told_apart():
    answers = [
        make_answer(SINGLE, (SEAL,)),
        make_answer(SINGLE, ("valve_hysteresis", SEAL), "one_of"),
        make_answer(SINGLE, (WAVES,)),
        make_answer(SINGLE, (), "none_of_these"),
        make_answer(f"single/{SEAL}/1.3/0.02/s1", (WAVES,)),  # too small a gap to count
    ]
    top, alias, inside = (measure(answers, n) for n in ("top-1 name", "alias group right", "truth in the reported set"))
    assert (top.good, top.count) == (1, 4)
    assert (alias.good, inside.good) == (2, 2)
    assert top.reached is False


def test_a_name_where_nothing_is_hidden_is_counted():
    answers = [
        make_answer("null/none/1.0/0.02/s1", (GAIN,)),
        make_answer("null/none/1.0/0.02/s2", (), "nothing_missing"),
    ]
    result = measure(answers, "a name where nothing is hidden")
    assert (result.good, result.count, result.reached) == (1, 2, False)


def test_an_unknown_effect_must_not_be_named():
    case = "unknown/pump_ripple/2.0/0.02/s1"
    answers = [
        make_answer(case, (), "none_of_these"),
        make_answer(case, (GAIN, WAVES), "one_of"),
        make_answer(case, (), "nothing_missing"),
    ]
    assert measure(answers, "unknown effect: none_of_these").good == 1
    assert measure(answers, "unknown effect: a name").good == 1


def test_a_name_beside_the_right_one_is_counted():
    answers = [
        make_answer(SINGLE, (SEAL, GAIN)),
        make_answer(SINGLE, (SEAL,)),
        make_answer(SINGLE, (GAIN, WAVES)),  # neither is right
        make_answer(SINGLE, (SEAL, GAIN), "one_of"),
    ]
    assert measure(answers, "one named beside it that is not hidden").good == 1


def test_pairs_need_both_names():
    case = f"pair/{SEAL}+{GAIN}/2.0/0.02/s1"
    answers = [make_answer(case, (SEAL, GAIN)), make_answer(case, (SEAL,)), make_answer(case, (SEAL, GAIN), "one_of")]
    assert measure(answers, "pairs: both named").good == 1


def test_a_claim_is_right_by_block_size_and_regime():
    right = {
        "block": "piston",
        "regime": "direction=release",
        "times_floor": 2.0,
        "density": 3.0,
        "concentrated": False,
    }
    claims = [
        right,
        right | {"block": "valve"},
        right | {"times_floor": 0.1},
        right | {"density": 1.1},
        right | {"density": 1.1, "concentrated": True},
        right | {"regime": "all"},  # it is concentrated elsewhere
    ]
    answer = make_answer(SINGLE, (SEAL,), claims=claims)
    assert check_claims(answer) == [True, False, False, False, True, False]
    assert compute_localisation_f1([answer]) == pytest.approx(2 * (2 / 6) * 1.0 / (2 / 6 + 1.0))
    assert compute_localisation_f1([answer, make_answer(SINGLE, (SEAL,))]) == pytest.approx(
        2 * (2 / 6) * 0.5 / (2 / 6 + 0.5)
    )  # one effect not found


def test_gap_closed_at_the_floor_and_worse():
    answer = make_answer(SINGLE, (SEAL,))
    assert compute_closed_share(answer) == pytest.approx(1.0)
    assert is_at_floor(answer)
    assert not is_worse(answer)
    answer["gap"]["clutch_torque_nm"]["after"] = 5.0
    assert compute_closed_share(answer) == pytest.approx((16.0 - 28.0) / 12.0)
    assert not is_at_floor(answer)
    assert is_worse(answer)


def test_a_parameter_is_compared_where_the_laws_share_it():
    estimate = {"name": f"{SEAL}.force", "value": 1.2, "ci95": [0.9, 1.5]}
    answer = make_answer(SINGLE, (SEAL,), parameters=[estimate])
    answer["truth"]["effects"][0]["law"] = 0
    assert list_parameter_errors(answer) == [(pytest.approx(0.2), True)]
    answer["truth"]["effects"][0]["law"] = 1  # its level is no force of the catalogue's
    assert list_parameter_errors(answer) == []
    gain = make_answer(
        f"single/{GAIN}/2.0/0.02/s1", (GAIN,), parameters=[{"name": f"{GAIN}.gain", "value": 1.5, "ci95": [1.4, 1.6]}]
    )
    gain["truth"]["effects"][0] |= {"law": 0, "strength": 0.4}
    assert list_parameter_errors(gain) == [(pytest.approx(0.25), True)]
    gain["truth"]["effects"][0]["law"] = 1  # grows as it warms: 1.5 is right at 95 degC
    gain["truth"]["celsius"] = 95.0
    assert list_parameter_errors(gain) == [(pytest.approx(0.0, abs=1e-12), True)]


def test_a_case_that_broke_the_engine_is_counted():
    result = score_answers(
        [{"case": SINGLE, "truth": make_answer(SINGLE)["truth"], "error": "ValueError"}, make_answer(SINGLE, (SEAL,))]
    )
    assert (result[0].good, result[0].count, result[0].reached) == (1, 2, False)


def test_thresholds_decide_as_the_engine_and_learn_from_a_null_case():
    strong = make_answer(SINGLE, (SEAL,))
    assert decide_again(strong, Constants()) == ("named", [SEAL])
    assert decide_again(strong, replace(Constants(), closed=0.99, excess=0.05)) == ("none_of_these", [])
    weak = make_answer("null/none/1.0/0.02/s1", (GAIN,))
    weak["weighed"] |= {"base": 103.0, "best": 99.0, "gain": 0.04, "excess": 0.01, "rest": 0.0, "costs": {GAIN: 99.0}}
    assert decide_again(weak, Constants())[0] == "named"
    learned = propose_constants([strong, weak])
    assert learned.gain > 0.04
    assert decide_again(weak, learned) == ("nothing_missing", [])
    assert decide_again(strong, learned) == ("named", [SEAL])


def test_what_was_done_is_not_done_again(tmp_path: Path):
    cache, names = Cache(tmp_path), [SINGLE, "null/none/1.0/0.02/s1"]
    for name in names:
        cache.write(make_answer(name, (SEAL,)))
    (tmp_path / "null/none/1.0/0.02/s1.json").write_text("{", encoding="utf-8")  # half-written

    def judge(name):
        raise AssertionError(name)

    assert [answer["case"] for answer in running.run_cases(names[:1], cache, 1, judge)] == names[:1]
    assert cache.read(names[1]) is None


def test_subsets_are_chosen_in_the_order_asked_for():
    names = [case.name for case in select_cases("development", only=("pair/*/2.0/0.02/*", "null/*/s2"))]
    assert {name.partition("/")[0] for name in names[-3:]} == {"null"}
    assert all(name.startswith("pair") for name in names[:-3])
    quick = select_cases("evaluation", quick=True)
    assert {case.noise for case in quick} == {0.02}
    assert {case.severity for case in quick} == {1.0, 2.0}


def test_the_page_says_which_part_was_run(tmp_path: Path):
    answers = [make_answer(SINGLE, (SEAL,)), make_answer("null/none/1.0/0.02/s1", (), "nothing_missing")]
    guessed = [make_answer(SINGLE, ("friction_level",), leads=SEAL), answers[1]]
    page, confusion, calibration = table.write_page(answers, "development", tmp_path, "0123", {"guess": guessed})
    words = page.read_text(encoding="utf-8")
    assert "**Not the whole split development: 2 of" in words
    assert "| top-1 name | 100.0 % | 1/1 |" in words
    assert (
        "| guess | 0.0 %, 100.0 % (of 1) | 0.0 %, 0.0 % (of 1) | -, - (of 0) | -, - (of 0) | +100.0 | 100.0 % |"
        in words
    )
    assert min(confusion.stat().st_size, calibration.stat().st_size) > 5000


def test_the_page_tells_answers_of_an_earlier_engine(tmp_path: Path):
    answers = [make_answer(SINGLE, (SEAL,)) | {"engine": f"engine-{number}"} for number in (4, 5, 5)]
    table.write_page(answers, "development", tmp_path, "engine-5")
    assert "**1 of these 3 answers are of an earlier version" in (tmp_path / "battery.md").read_text(encoding="utf-8")
    table.write_page(answers[1:], "development", tmp_path, "engine-5")
    assert "earlier version" not in (tmp_path / "battery.md").read_text(encoding="utf-8")


def test_the_page_names_candidates_that_no_case_hides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A new candidate, without a law in the truth yet, is named in an answer: the page and its picture are still made."""
    monkeypatch.setattr(table, "CATALOGUE_LAWS", [law for law in table.CATALOGUE_LAWS if law.name != SEAL])
    answers = [make_answer("single/friction_level/2.0/0.02/s1", (SEAL,))]
    page, confusion, _ = table.write_page(answers, "development", tmp_path, "0123")
    lacking = (
        f"anti_alias_filter, motor_torque_sensor_gain, motor_torque_sensor_lag, motor_torque_sensor_offset, {SEAL}"
    )
    assert f"the truth has no law for them: {lacking}.\n" in page.read_text(encoding="utf-8")
    assert confusion.stat().st_size > 5000


# Hidden strengths, effects with the second law; what must be said. One alone is named where friction builds up at rest, too
QUICK = {
    "nothing": ({}, (), NOTHING),
    "two, the seal by LuGre": ({SEAL: 80.0, "torque_sensor_offset": 1.2}, (SEAL,), NAMED),
    "in no catalogue": ({"hydrodynamic_lift": 6e-4}, (), NONE_OF_THESE),
}
LETTER = {"nothing": ({}, NOTHING), "ripple": ({"shaft_angle_ripple": 0.08}, NAMED)}
ROWS, HELD_OUT_ROWS = 5500, 4500  # of 1 ms, of each run of a short case: about two thirds of it are enough to be right


def investigate_short(strengths: dict[str, float], second: tuple[str, ...] = (), lag: float = 0.0) -> Result:
    """What the engine says of the first rows of a short case."""
    fitted, held_out = make_short_case(strengths, second, lag=lag)
    parts = (
        {name: {column: values[:rows] for column, values in run.items()} for name, run in runs.items()}
        for runs, rows in ((fitted, ROWS), (held_out, HELD_OUT_ROWS))
    )
    return investigate(WetClutch(), *parts)


@pytest.mark.parametrize("name", QUICK)
def test_the_engine_is_right_on_the_quick_subset(name: str):
    strengths, second, verdict = QUICK[name]
    result = investigate_short(strengths, second)
    assert result.verdict == verdict
    assert set(result.effects) == (set(strengths) if verdict == NAMED else set())


@pytest.mark.parametrize("name", LETTER)
def test_a_rig_whose_friction_builds_up_at_rest_too_lacks_nothing_by_that(name: str):
    """Equation 6.9 to the letter, with no plates that stick, is another reading of the baseline, and no effect."""
    strengths, verdict = LETTER[name]
    result = investigate_short(strengths, lag=1.0)
    assert (result.verdict, set(result.effects)) == (verdict, set(strengths))
    assert any("builds up by eq. 6.9" in note for note in result.notes)


def test_answers_that_were_kept_count_on_another_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(running, "_KEPT_FOLDER", tmp_path / "kept")
    answer = [make_answer(SINGLE, (SEAL,)), make_answer("null/none/1.0/0.02/s1", (), "nothing_missing")]
    running.keep_answers(answer[:1], "0123")
    running.keep_answers([*answer[1:], {"case": "broken", "error": "Traceback"}], "0123")
    result = Cache(tmp_path / "nothing", running.read_kept_answers("0123"))
    assert [one["case"] for one in result.read_all()] == sorted(one["case"] for one in answer)
    assert {m.name: m.good for m in score_answers(result.read_all())} == {m.name: m.good for m in score_answers(answer)}
    rival = {key: answer[0][key] for key in ("case", "content", "truth", "verdict", "effects")}
    running.keep_answers([rival | {"ranking": [(SEAL, 1.0)]}], "0123", "guess")
    other = rival | {key: answer[1][key] for key in ("case", "content", "truth")}
    assert set(running.read_kept_answers("0123", "guess")[SINGLE]) == set(rival)
    running.keep_answers([other], "0123", "guess")
    assert list(running.read_kept_answers("0123", "guess")) == [other["case"]], (
        "answers by the limits of another run are gone"
    )
    assert len(running.read_kept_answers("0123")) == 2
    assert running.read_kept_answers("4567") == {}
    running.keep_answers([answer[0] | {"content": "of laws that it had before"}], "0123")
    assert list(running.read_kept_answers("0123")) == [answer[1]["case"]]


@pytest.mark.parametrize("name", CHECKED_CASES[:2])
def test_the_engine_says_what_was_kept_of_it(name: str):
    """Else ENGINE_VERSION or TRUTH_VERSION is to be raised: what is kept is another's. `--check` of the battery plays more."""
    assert list_differences(running.read_kept_answers(format_engine_name())[name], judge(name)) == []


def test_every_case_of_the_evaluation_has_a_valid_answer():
    assert running.read_kept_answers(format_engine_name()).keys() == {case.name for case in select_cases("evaluation")}


def test_a_kept_answer_that_differs_is_told():
    estimate = {"name": f"{SEAL}.force", "value": 1.2, "ci95": [0.9, 1.5]}
    before = make_answer(SINGLE, (SEAL,), parameters=[estimate])
    assert list_differences(before, make_answer(SINGLE, (SEAL,), parameters=[estimate | {"value": 1.4}])) == []
    assert len(list_differences(before, make_answer(SINGLE, (SEAL,), parameters=[estimate | {"value": 1.6}]))) == 1
    assert len(list_differences(before, make_answer(SINGLE, (WAVES,)))) == 1
    assert len(list_differences(before, make_answer(SINGLE, (SEAL,), "one_of"))) == 3
    assert list_differences(before, {"error": "Traceback\nValueError: no"}) == ["the engine broke: ValueError: no"]


def test_an_answer_holds_while_its_own_laws_do(monkeypatch: pytest.MonkeyPatch):
    answer, other = make_answer(SINGLE, (SEAL,)), make_answer("null/none/1.0/0.02/s1", (), "nothing_missing")
    assert is_valid(answer)
    monkeypatch.setitem(LAWS, SEAL, replace(LAWS[SEAL], most=2.0))
    assert not is_valid(answer)
    assert is_valid(other)
    monkeypatch.setattr(validity, "TRUTH_VERSION", validity.TRUTH_VERSION + 1)
    assert not is_valid(other)


def test_what_is_left_to_do_is_done_seed_by_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    names = [f"single/{SEAL}/2.0/0.02/s{seed}" for seed in (2, 1)] + ["null/none/1.0/0.02/s1"]

    monkeypatch.setattr(running, "compute", lambda judge, missing, *_: enumerate(map(judge, missing)))
    done = [
        answer["case"]
        for answer in running.run_cases(names, Cache(tmp_path), 1, lambda name: make_answer(name, (SEAL,)))
    ]
    assert sorted(done[:2]) == sorted(names[1:])
    assert done[2] == names[0]

"""The report of a result: page, pictures, report.json and recording say the same, for each verdict and for any names."""

import json
import math
import re
from dataclasses import replace
from io import BytesIO
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from clutch_hil.discrepancy.report import ATLAS, EVIDENCE, GAP, JSON, PAGE, write_report
from clutch_hil.discrepancy.report.html_page import compose_page
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.residuals import Residuals
from clutch_hil.discrepancy.report.wording import make_verdict_sentence
from clutch_hil.discrepancy.result import (
    IDENTIFY_FIRST,
    NAMED,
    NONE_OF_THESE,
    NOTHING,
    ONE_OF,
    Claim,
    Estimate,
    Gap,
    Result,
    Rival,
    Trace,
)  # fmt: skip
from clutch_hil.page.wording import format_column, format_interval, format_number
from clutch_hil.recordings.checks.finding import Finding
from protocols.errors import InputError
from tests.clutch_hil.discrepancy import results
from tests.clutch_hil.discrepancy.page_content import Content, parse_number

COLOURS = 40  # of a picture with a line in it; an empty figure has 1, empty axes with labels about 20
ROUNDING = 6e-3  # of a number that is told with three digits: 0.5 %; of one with two digits ten times as much
HEADINGS = 7
HOSTILE = "<script>alert('x')</script>&\"`$\\frac{ |_*"
WIDE = 1000  # pixels: a picture fills the page

_TEXTS = {
    NAMED: (
        "The model lacks piston seal friction (confidence 97 %): with it the error of",
        "Missing physics, and why not the other candidates", "dF = k dx while |F| &lt; W", "58.0", "54.3", "61.7",
        "The closest alternative: valve hysteresis", "The gap before and after, on runs that were not fitted",
        "after: with piston seal friction", "the verdict needs no further experiment",
    ),
    NOTHING: (
        "Nothing is missing from the model (confidence more than 99.9 %): on runs that were not fitted every output is within",
        "none of the 14 candidates explains more than chance", "No output disagrees beyond what noise explains",
        "Nothing was added to the model", "no question open",
    ),
    ONE_OF: (
        "The model lacks one of piston seal friction or valve hysteresis, but these runs cannot decide which (confidence 97 %",
        "the experiment below separates them", "Hold the pressure and let the slip run through a sine.",
        "<h3>valve hysteresis</h3>", "w_i = min(max(w_i, u - r_i), u + r_i)", "0.0660",
        "clutch-hil experiment --for report.json",
    ),
    NONE_OF_THESE: (
        "Something is missing that none of the 14 candidates explains (confidence 93 %)", "closes 37 % of the gap",
        "higher while the pressure falls", "sign(dp/dt)", "−0.062", "All were refused.", "No experiment is proposed.",
    ),
    IDENTIFY_FIRST: (
        "Identify the rig first (confidence 90 %): another calibration explains 100.0 % of the disagreement;",
        "clutch.coulomb_slope and clutch.viscous_exponent move beyond their stated uncertainties.", "Missing: a calibration",
        "clutch-hil identify RUN... --out FOLDER", "17.02", "20.7", "identify the rig first",
    ),
}  # fmt: skip


def make_report(kind):
    """A result; small but for the verdict that all files are written of."""
    return results.make_result(kind) if kind == NAMED else results.make_result(kind, runs=2, seconds=4.0, outputs=2)


def write_page(result, regimes=results.make_regimes):
    """The page alone."""
    return compose_page(Pictures(Residuals(result, regimes)), [], "")


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures of one pixel, for tests that do not look at them."""
    target = BytesIO()
    matplotlib.image.imsave(target, np.zeros((1, 1, 3)), format="png")
    monkeypatch.setattr("clutch_hil.discrepancy.report.pictures.render_png", lambda figure: target.getvalue())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All files of a result that names an effect."""
    folder = tmp_path_factory.mktemp("named") / "out"
    written = write_report(
        results.make_result(NAMED), folder, results.make_regimes, "clutch-hil discrepancy *.parquet --out out"
    )
    assert sorted(written) == sorted(folder.iterdir())
    return folder


@pytest.fixture(scope="module")
def pages(folder):
    """The page of each verdict."""
    others = {kind: write_page(make_report(kind)) for kind in (NOTHING, ONE_OF, NONE_OF_THESE, IDENTIFY_FIRST)}
    return {NAMED: (folder / PAGE).read_text(encoding="utf-8")} | others


@pytest.mark.parametrize("kind", list(_TEXTS))
def test_page_says_what_was_found(kind, pages):
    text = pages[kind]
    missing = [sentence for sentence in _TEXTS[kind] if sentence not in text]
    assert not missing
    content = Content(text)
    assert content.open == []
    assert content.tags.count("h2") == HEADINGS
    assert content.text.count(make_verdict_sentence(make_report(kind))) == 1
    for name in ("run-0.parquet", "run-2 begins with the clutch filled.", "31.0", "SHA-256", f"{1:064x}", "held out"):
        assert name in content.text


def test_page_of_one_verdict_does_not_tell_another(pages):
    for kind, texts in _TEXTS.items():
        assert all(texts[0] not in text for other, text in pages.items() if other != kind)


@pytest.mark.parametrize("kind", list(_TEXTS))
def test_every_picture_shows_something(kind, pages):
    pictures = Content(pages[kind]).pictures
    assert len(pictures) >= 7
    for png in pictures:
        assert _read_pixels(png).shape[1] > WIDE
        assert _count_colours(png) > COLOURS


def test_posters_show_something(folder):
    for name in (ATLAS, GAP):
        assert _count_colours((folder / name).read_bytes()) > COLOURS


@pytest.mark.parametrize("kind", list(_TEXTS))
def test_page_needs_no_network(kind, pages):
    content = Content(pages[kind])
    assert content.addresses
    assert all(address.startswith("data:image/png;base64,") for address in content.addresses)
    assert not {"script", "link", "iframe", "object", "embed", "base", "form"} & set(content.tags)
    assert not re.search(r"https?://|@import|url\(", pages[kind])
    assert "default-src 'none'" in pages[kind]


def test_page_and_report_json_tell_the_same_numbers(folder, pages):
    document = json.loads((folder / JSON).read_text(encoding="utf-8"))
    message = [exact for exact, _ in Content(pages[NAMED]).numbers]
    estimates = [(e["value"], *e["ci95"]) for e in document["parameters"] + document["baseline"]]
    claims = [tuple(claim[key] for key in ("size", "times_floor", "p_value")) for claim in document["where"]]
    holdout = [
        *document["gap"]["holdout"].values(),
        *(g for r in document["gap_by_regime"].values() for g in r.values()),
    ]
    gaps = [tuple(gap[key] for key in ("before", "after", "floor")) for gap in holdout]
    rivals = [(rival["closed"], rival["gain"]) for rival in document["rivals"]]
    rows = [*estimates, *claims, *gaps, *rivals, (document["seconds"],)]
    assert len(rows) > 50
    assert not [row for row in rows if not _follow(row, message)]


def test_fitted_values_of_rivals_have_units(pages):
    assert "width = 0.06 bar" in pages[NAMED]
    assert "load_lag = 5 ms" in pages[NAMED]


@pytest.mark.parametrize("kind", list(_TEXTS))
def test_numbers_are_rounded_and_not_wrong(kind, pages):
    for exact, text in Content(pages[kind]).numbers:
        digits = len(re.sub(r"[^\d]", "", text.partition("·")[0]).lstrip("0"))
        assert parse_number(text) == pytest.approx(
            exact, rel=ROUNDING * 10 ** max(0, 3 - digits), abs=6e-4 if "%" in text else 0.0
        )


def test_report_json_is_what_the_result_says(folder):
    assert json.loads((folder / JSON).read_text(encoding="utf-8")) == json.loads(
        json.dumps(results.make_result(NAMED).as_json())
    )


def test_report_json_has_null_where_there_is_no_number(tmp_path, undrawn):
    result = replace(
        results.make_result(NOTHING, 2, 2.0), confidence=math.nan, rivals=[Rival("a", math.nan, -math.inf, {}, "x", 1)]
    )
    write_report(result, tmp_path)
    document = json.loads((tmp_path / JSON).read_text(), parse_constant=lambda name: pytest.fail(name))
    assert document["confidence"] is None
    assert document["rivals"][0]["gain"] is None


def test_recording_holds_every_sample(folder):
    result = results.make_result(NAMED)
    chunks = {}
    for chunk in RrdReader(folder / EVIDENCE).stream():
        if not chunk.is_static:
            chunks.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    for trace in result.traces:
        for column in result.units:
            path = f"/{trace.name}/{column}"
            table = pa.Table.from_batches(chunks[path]).sort_by("rig_time")
            values = table["Scalars:scalars"].combine_chunks().flatten().to_numpy().reshape(-1, 3)
            expected = [trace.before[column], trace.after[column], trace.measured[column]]
            assert np.array_equal(values, np.column_stack(expected))
            seconds = table["rig_time"].to_numpy().astype("timedelta64[ns]").astype(np.int64) / 1e9
            assert np.allclose(seconds, trace.columns["time_s"], atol=1e-9)


def test_an_alternative_without_intervals_has_its_fitted_values(undrawn):
    result = results.make_result(ONE_OF, 1, 2.0)
    name = result.alternatives[0][1]
    rivals = [rival for rival in result.rivals if rival.name != name]
    rivals.append(Rival(name, 0.9, 10.0, {f"{name}.width": 0.0715}, "", 1, {f"{name}.width": "bar"}))
    alone = [estimate for estimate in result.parameters if not estimate.name.startswith(f"{name}.")]
    page = write_page(replace(result, parameters=alone, rivals=rivals))
    described = page.partition(f"<h3>{name.replace('_', ' ')}</h3>")[2].partition("</table>")[0]
    assert "0.0715" in described
    assert "bar" in described


@pytest.mark.parametrize(
    ("verdict", "next_step"),
    [(NAMED, "Identify the rig first, if it never was"), (ONE_OF, "clutch-hil experiment --for report.json")],
)
def test_a_calibration_that_explains_as_much_is_told_with_the_verdict(verdict, next_step, undrawn):
    calibration = replace(results.make_result(IDENTIFY_FIRST, 1, 2.0).recalibration, effects=0.02)
    result = replace(results.make_result(verdict, 1, 2.0), recalibration=calibration)
    page = write_page(result)
    assert make_verdict_sentence(result).endswith(" Another calibration explains as much: see below.")
    for expected in (
        "Or another calibration",
        "If this rig was never identified, run: clutch-hil identify",
        "17.02",
        next_step,
    ):
        assert expected in page
    other = replace(result, recalibration=replace(calibration, after=0.2))
    assert "calibration" not in make_verdict_sentence(other)
    assert "Or another calibration" not in write_page(other)


def test_verdict_tells_sets_of_alternatives():
    result = results.make_result(ONE_OF, 1, 2.0)
    expected_text = "The model lacks one of a, b or c, but"
    assert make_verdict_sentence(replace(result, alternatives=[["a", "b", "c"]])).startswith(expected_text)
    assert make_verdict_sentence(replace(result, alternatives=[["a"], ["b"], ["c"]])).startswith(expected_text)
    two = replace(result, effects=["x"], alternatives=[["a", "b"], ["c", "d"]])
    assert make_verdict_sentence(two).startswith("The model lacks x, one of a or b and one of c or d, but")


@pytest.mark.parametrize(("times", "message"), [(2.0, True), (1.0, False)])
def test_what_the_rows_of_a_logger_leave_is_told_where_nothing_is_missing(times, message):
    result = results.make_result(NOTHING, 1, times)
    gap = {name: replace(one, before=times * one.floor, after=times * one.floor) for name, one in result.gap.items()}
    logged = replace(
        result, gap=gap, checks=[Finding("logged", "time_s", (0, 99), "are taken as a logger's", False, "run")]
    )
    assert ("the low rate of a logger alone can" in make_verdict_sentence(logged)) == message
    assert "logger" not in make_verdict_sentence(replace(logged, checks=[]))


def test_experiment_that_separates_nothing_is_not_offered(undrawn):
    none = {"profile": None, "why": "none of 14 experiments separates them", "seconds": 0.0, "settings": {}}
    text = Content(write_page(replace(results.make_result(ONE_OF, 1, 2.0), experiment=none))).text
    assert "None of 14 experiments separates them." in text
    assert "below separates them" not in text
    assert "--for report.json" not in text


def test_nothing_missing_shows_no_model_after(undrawn):
    result = results.make_result(NOTHING, 2, 2.0)
    other = [replace(trace, after={c: v + 0.01 for c, v in trace.after.items()}) for trace in result.traces]
    text = write_page(replace(result, traces=other))
    assert "Nothing was added to the model" in text
    assert "after" not in Content(text).text.replace("below 0.2 after", "")


def test_regimes_are_marked(pages):
    result = results.make_result(NAMED)
    column = Residuals(result).disagreeing_outputs[0]
    without, marked = (
        Pictures(Residuals(result, regimes)).draw_stretch(column) for regimes in (None, results.make_regimes)
    )
    shade = np.array([0xFB, 0xE9, 0xB7])  # of a regime
    shares = [
        np.mean(np.all(np.rint(_read_pixels(png)[..., :3] * 255.0) == shade, axis=-1)) for png in (without, marked)
    ]
    assert shares[0] == 0.0
    assert shares[1] > 0.1


def test_worst_stretch_is_where_the_error_is():
    trace = results.make_result(NOTHING, 1, 4.0).traces[0]
    bent = trace.measured["clutch_torque_nm"].copy()
    bent[3000:3100] += 5.0
    trace = replace(trace, measured=trace.measured | {"clutch_torque_nm": bent})
    stretch = Residuals(replace(results.make_result(NOTHING, 1, 4.0), traces=[trace])).find_worst("clutch_torque_nm")
    assert stretch.begin <= 3000
    assert stretch.end >= 3100
    assert stretch.end - stretch.begin == 400


def test_map_tells_rising_from_falling():
    time = np.arange(8000) / 1000.0
    over = np.sin(time)
    residual = np.where(np.cos(time) >= 0.0, 1.0, -1.0)
    residuals = Residuals(_make_small_result(time, residual, {"position_m": over}))
    outcome = residuals.compute_map("force_n", "position_m", "before")
    inner = slice(2, -2)  # at the ends the direction changes
    assert np.allclose(outcome.rising[inner], 1.0, atol=0.1)
    assert np.allclose(outcome.falling[inner], -1.0, atol=0.1)
    assert outcome.explained > 0.9


def test_order_of_a_ripple_is_found():
    time = np.arange(20000) / 1000.0
    angle = 20.0 * time
    residuals = Residuals(_make_small_result(time, 0.3 * np.cos(7.0 * angle), {"shaft_angle_rad": angle}))
    orders, amplitudes = residuals.compute_orders("force_n", "before")
    assert orders[np.argmax(amplitudes)] == pytest.approx(7.0, abs=0.1)
    assert amplitudes.max() == pytest.approx(0.3, rel=0.05)
    assert residuals.has_order("force_n")
    fading = np.convolve(np.random.default_rng(0).standard_normal(len(time)), np.exp(-np.arange(500) / 100.0))[
        : len(time)
    ]
    assert not Residuals(_make_small_result(time, fading, {"shaft_angle_rad": angle})).has_order("force_n")


def test_model_of_somebody_else_is_shown(tmp_path):
    time = np.arange(4000) / 500.0
    random = np.random.default_rng(0)
    residual = np.sign(np.cos(time)) + 0.01 * random.standard_normal(len(time))
    columns = {"position_m": np.sin(time), "motor_force_n": np.cos(time), "bad": np.full(len(time), np.nan)}
    write_report(_make_small_result(time, residual, columns), tmp_path, None)
    content = Content((tmp_path / PAGE).read_text(encoding="utf-8"))
    assert "Most of all in force (block: friction): off by 1.00 N" in content.text
    assert "wet" not in content.text


def test_result_without_traces_is_shown(tmp_path, undrawn):
    empty = Result(
        "PATH.py:Mine", NONE_OF_THESE, [], [], 0.5, [], [], [], {}, {}, [], None, None, {}, {}, {}, {}, 1.0,
    )  # fmt: skip
    write_report(empty, tmp_path)
    text = Content((tmp_path / PAGE).read_text(encoding="utf-8")).text
    assert "Something is missing that no candidate explains (confidence 50 %)." in text
    assert "No trace of a run was kept." in text


def test_hostile_names_are_only_text(tmp_path):
    base = results.make_result(ONE_OF, 2, 2.0)
    column = f"clutch{HOSTILE}_nm"
    traces = [
        replace(
            t, name=HOSTILE + t.name, columns=t.columns | {f"state{HOSTILE}": t.columns["cylinder_pressure_bar"]},
            measured={column: t.measured["clutch_torque_nm"]}, before={column: t.before["clutch_torque_nm"]},
            after={column: t.after["clutch_torque_nm"]},
        )
        for t in base.traces
    ]  # fmt: skip
    gap = Gap(1.0, 0.1, 0.05)
    result = replace(
        base, rig=HOSTILE, effects=[HOSTILE], alternatives=[[HOSTILE], [HOSTILE]], traces=traces, gap={column: gap},
        where=[Claim(HOSTILE, column, f"{HOSTILE}={HOSTILE}", 1.0, HOSTILE, 20.0, 0.001)],
        parameters=[Estimate(f"{HOSTILE}.{HOSTILE}", 1.0, HOSTILE, (0.9, 1.1), 0.0)],
        baseline=[Estimate(HOSTILE, 1.0, HOSTILE, (0.9, 1.1), 0.0, 1.0)], gap_by_regime={column: {HOSTILE: gap}},
        rivals=[Rival(HOSTILE, 0.5, 1.0, {HOSTILE: 1.0}, HOSTILE, 1), Rival(HOSTILE, 0.1, 1.0, {}, HOSTILE, 2)],
        surrogate={HOSTILE: [HOSTILE]}, experiment={"why": HOSTILE, HOSTILE: [{HOSTILE: HOSTILE}], "n": [1.0] * 20},
        floors={column: 0.05}, units={column: HOSTILE}, equations={HOSTILE: HOSTILE}, hashes={HOSTILE: HOSTILE},
        held_out=HOSTILE, notes=[HOSTILE],
    )  # fmt: skip
    write_report(result, tmp_path, None, HOSTILE)
    content = Content((tmp_path / PAGE).read_text(encoding="utf-8"))
    assert "script" not in content.tags
    assert content.open == []
    assert content.text.count(HOSTILE) > 10


def test_folder_that_cannot_be_written_is_told(tmp_path, undrawn):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match="cannot be written"):
        write_report(_make_small_result(np.arange(400) / 100.0, np.ones(400), {}), tmp_path / "file")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (0.0507, "0.0507"), (0.9996, "1.00"), (41230.0, "41200"), (-0.25, "−0.250"), (5e-6, "5.00 · 10⁻⁶"),
        (9.996e-4, "0.00100"), (2.5e7, "2.50 · 10⁷"), (math.nan, "–"), (math.inf, "∞"),
    ],
)  # fmt: skip
def test_numbers_read_as_people_write_them(value, text):
    assert format_number(value) == text


def test_interval_has_two_digits_of_its_half_width():
    assert format_interval(58.0231, (54.3123, 61.7339)) == ("58.0", "54.3", "61.7")
    assert format_interval(5.02e-6, (4.4e-6, 5.64e-6)) == (
        "5.02 · 10⁻⁶",
        "4.40 · 10⁻⁶",
        "5.64 · 10⁻⁶",
    )
    assert format_interval(12345.0, (11000.0, 13700.0)) == ("12300", "11000", "13700")
    assert format_interval(10.94, (-37000.0, 37000.0)) == ("11", "−37000", "37000")  # it is not 0
    assert format_interval(0.0, (-0.4, 0.4)) == ("0.00", "−0.40", "0.40")


def test_column_is_spoken_without_its_unit():
    assert format_column("clutch_torque_nm") == "clutch torque"
    assert format_column("slip_speed_rad_s", "rad/s") == "slip speed"
    assert format_column("mine", "N") == "mine"


def _make_small_result(time, residual, columns):
    """A result of one run with one output `force_n` that is off by `residual`."""
    zero = np.zeros(len(time))
    size = float(np.sqrt(np.mean(residual**2)))
    trace = Trace(
        "mine.csv", False, {"time_s": time, **columns}, {"force_n": residual}, {"force_n": zero}, {"force_n": zero}
    )
    return Result(
        rig="position_axis", verdict=NONE_OF_THESE, effects=[], alternatives=[], confidence=0.9,
        where=[Claim("friction", "force_n", "all", size, "N", size / 0.1, 0.01)], parameters=[], baseline=[],
        gap={"force_n": Gap(size, size, 0.1)}, gap_by_regime={}, rivals=[], surrogate=None, experiment=None,
        floors={"force_n": 0.1}, units={"force_n": "N"}, equations={}, hashes={}, seconds=1.0, held_out="in turn",
        traces=[trace],
    )  # fmt: skip


def _read_pixels(png):
    return matplotlib.image.imread(BytesIO(png), format="png")


def _count_colours(png):
    """Number of different colours in a picture."""
    bits = np.rint(_read_pixels(png)[..., :3] * 255.0).astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
    return len(np.unique(bits))


def _follow(row, message):
    """Whether the numbers of `row` stand one after the other in `told`."""
    return any(tuple(message[i : i + len(row)]) == row for i in range(len(message)))


def test_evidence_is_not_begun_on_a_full_disk(tmp_path, undrawn, monkeypatch):
    """There rerun's writer of files may block for ever."""
    monkeypatch.setattr("os.statvfs", lambda path: SimpleNamespace(f_bavail=1 << 20, f_frsize=1))
    with pytest.raises(InputError, match=r"evidence\.rrd cannot be written: No space left on device"):
        write_report(_make_small_result(np.arange(400) / 100.0, np.ones(400), {}), tmp_path)
    assert not (tmp_path / "evidence.rrd").exists()


def test_a_page_that_names_an_effect_without_a_certain_place_does_not_say_that_nothing_disagrees() -> None:
    result = results.make_result(NAMED)
    page = write_page(replace(result, where=[replace(claim, p_value=0.5) for claim in result.where]))
    assert "All runs together show the disagreement. No single place is certain" in page
    assert "No output disagrees beyond what noise explains" not in page

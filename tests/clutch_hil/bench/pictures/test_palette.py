"""One meaning, one colour: everywhere the same, readable on paper and on a dark screen, and declared in one place."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from clutch_hil.bench import clutch_state
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.lanes import list_lanes
from clutch_hil.live.monitor.snapshot import QUANTITIES
from clutch_hil.live.viewer import curves
from clutch_hil.live.viewer.dashboard import PLOTS, list_places
from protocols.node import Column

PACKAGE = Path(palette.__file__).parents[2]
# Figures of the thesis tell their curves apart by colours of their own; the page of a discrepancy has before and after.
ELSEWHERE = ("thesis", "discrepancy")
COLOUR = re.compile(
    r"#[0-9a-f]{6}|(tab:\w+|C\d|(on )?(bold )?(black|white|red|green|blue|cyan|magenta|yellow|orange|gr[ae]y|bright_\w+))$",
    re.I,
)
DRAWS = re.compile(r"matplotlib|rerun|from rich|palette")
DARK_SCREEN = "#0d1011"  # rerun's
LEGIBLE = 3.0  # contrast of graphics, WCAG 2.1, 1.4.11
ON_STATES = 3.5  # of the white words in lanes, which are bold enough at their size
MEANINGS = ("DEMAND", "TRUE", "ESTIMATE", "MEASURED", "COMMAND", "LIMIT")


def list_sources() -> Iterator[Path]:
    for path in PACKAGE.rglob("*.py"):
        if (
            path.relative_to(PACKAGE).parts[0] not in ELSEWHERE
            and path.name != "palette.py"
            and DRAWS.search(path.read_text())
        ):
            yield path


def compute_contrast(one: str, other: str) -> float:
    """By WCAG 2.1."""

    def luminance(colour: str) -> float:
        parts = [value / 255.0 for value in palette.split_colour(colour)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("path", list(list_sources()), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_colour_stands_in_the_palette_only(path: Path) -> None:
    text = path.read_text()
    strings = [n.value for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    assert [string for string in strings if COLOUR.match(string)] == []
    assert re.findall(r"0x[0-9a-fA-F]{6}(?:[0-9a-fA-F]{2})?\b", text) == []


def test_a_meaning_has_a_colour_of_its_own() -> None:
    colours = [*(getattr(palette, name) for name in MEANINGS), *palette.CYCLE]
    assert len(set(colours)) == len(colours)


@pytest.mark.parametrize("colour", [*(getattr(palette, name) for name in MEANINGS), *palette.CYCLE])
def test_a_colour_is_read_on_paper_and_on_a_dark_screen(colour: str) -> None:
    assert compute_contrast(colour, palette.PAPER) >= LEGIBLE
    assert compute_contrast(colour, DARK_SCREEN) >= LEGIBLE


def test_words_are_read_on_their_states() -> None:
    for colour in {*palette.STATES.values(), palette.choose_state_colour("torque implausible")}:
        assert compute_contrast(palette.PAPER, colour) >= ON_STATES, colour


def test_the_same_column_has_one_colour_in_plots_curves_and_monitor() -> None:
    screen: dict[str, str] = {}
    for node in ("plant", "controller"):
        columns = [Column(line.column, "1", "") for plot in PLOTS for line in plot.lines]
        for place in list_places(node, columns):
            for line, colour in zip(place.lines, place.colours, strict=True):
                assert screen.setdefault(line.column, colour) == colour
    for trail in (trail for curve in curves.make_curves() for trail in curve.trails):
        assert screen[trail.y] == palette.choose_colour(trail.y)
    for quantity in QUANTITIES:
        assert screen.get(quantity.column, palette.choose_colour(quantity.column)) == palette.choose_colour(
            quantity.column
        )


def test_what_is_asked_for_true_believed_and_measured_looks_so_whatever_it_is() -> None:
    for column, colour in (
        ("torque_demand_nm", palette.DEMAND),
        ("controller_pressure_demand_bar", palette.DEMAND),
        ("motor_speed_demand_rad_s", palette.DEMAND),
        ("truth_clutch_torque_nm", palette.TRUE),
        ("truth_cylinder_pressure_bar", palette.TRUE),
        ("truth_slip_speed_rad_s", palette.TRUE),
        ("controller_torque_estimate_nm", palette.ESTIMATE),
        ("controller_slip_rad_s", palette.ESTIMATE),
        ("clutch_torque_nm", palette.MEASURED),
        ("cylinder_pressure_bar", palette.MEASURED),
        ("slip_speed_rad_s", palette.MEASURED),
    ):
        assert palette.choose_colour(column) == colour, column


def test_lines_of_one_plot_differ() -> None:
    for plot in PLOTS:
        colours = [palette.choose_colour(line.column, place) for place, line in enumerate(plot.lines)]
        assert len(set(colours)) == len(colours), plot.path


def test_every_state_has_a_colour_and_only_what_is_wrong_is_red() -> None:
    phase, clutch, fault = list_lanes()
    wrong = palette.choose_state_colour("fault")
    assert {word for word in phase.words.values() if palette.choose_state_colour(word) == wrong} == {"fault"}
    assert {word for word in clutch.words.values() if palette.choose_state_colour(word) == wrong} == set()
    assert {word for word in fault.words.values() if palette.choose_state_colour(word) != wrong} == {"none"}
    assert len({palette.choose_state_colour(word) for word in clutch_state.STATES}) == len(clutch_state.STATES)

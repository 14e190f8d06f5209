"""Pictures of an identification report."""

import pytest
from matplotlib.figure import Figure

from clutch_hil.identify.calibration import Identified
from clutch_hil.identify.report import report_pictures
from clutch_hil.identify.report.report_pictures import draw_parameters

GAIN = Identified("valve.gain", 1.5, 0.01, "bar/V", 2.5)
SLOPE = Identified("clutch.coulomb_slope", 12.0, 0.3, "Nm/bar", 10.8)
UNKNOWN = Identified("clutch.stribeck_speed", 10.9, 37000.0, "rad/s", 11.5)  # which the runs do not excite
LARGER = Identified("clutch.coulomb_slope", 66.0, 0.3, "Nm/bar", 10.8)


@pytest.mark.parametrize(
    ("parameters", "width", "arrows"),
    [((GAIN, SLOPE), 60.0, 0), ((GAIN, SLOPE, UNKNOWN), 60.0, 2), ((GAIN, LARGER, UNKNOWN), 7.5, 2)],
)
def test_an_interval_that_goes_on_does_not_hide_the_others(
    parameters: tuple[Identified, ...], width: float, arrows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """width: of the axis, in percent, or a factor where one parameter is far from its stated value."""
    drawn: list[Figure] = []
    monkeypatch.setattr(report_pictures, "render_png", lambda figure: drawn.append(figure) or b"")
    draw_parameters(parameters)
    (axes,) = drawn[0].axes
    left, right = axes.get_xlim()
    assert right - left < width
    assert sum(line.get_marker() in ("<", ">") for line in axes.lines) == arrows

"""Appendix C: measuring constant loads with a piezo force sensor that leaks, by DC restoration.

The thesis prints neither t_98 nor the sensitivity of the sensor. They are chosen to fit the axes of its figures: see NOTES.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import curve_fit

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.blocks.adc import counts
from plant_sim.blocks.dc_restoration import DcRestoration
from plant_sim.blocks.icp_sensor import IcpSensor

STEP = 1e-3  # s; chosen: the rate of the rig's data acquisition
GRAVITY = 9.81  # m/s^2
T_98 = 10.0  # s; chosen: in fig C.3 the output is near 0 well before the end of the axis at 20 s
NOISE = 0.3e-3  # V before the converter; chosen: one step of 16 bit
_RANGE, _BITS = 10.0, 16  # V, sec. 3.9.4: dSPACE 1103
_DISPLAY_SCALE = 0.1  # dSPACE shows +-10 V as +-1: "the unity is [V/10]", sec. C.3

SENSOR = IcpSensor(time_constant=1.0 / DcRestoration.from_decay_time(T_98).decay_rate)
NOTES = (
    f"t_98 = {T_98:g} s and the noise of 0.3 mV are chosen here; 2.25 mV/N (10 mV/lb) is chosen here "
    "too: with it the loads of 0.5 and 2 kg"
    " give the values on the axes of figs C.3, C.5 and C.8",
)


def sample_output(sensor: IcpSensor, force: np.ndarray, warming: np.ndarray | float = 0.0, seed: int = 1) -> np.ndarray:
    """Sample the output (n,) [V] of the sensor with noise and rounding, under force (n,) [N] and warming [K]."""
    voltage = sensor.measure(force, STEP, warming)[0]
    noisy = voltage + NOISE * np.random.default_rng(seed).standard_normal(voltage.size)
    codes = [counts(v, _RANGE, _BITS, _BITS) for v in noisy.tolist()]
    return np.array(codes) * (_RANGE / 2 ** (_BITS - 1))


def make_loads(seconds: float, *changes: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Make time (n,) [s] and force (n,) [N]; each change is (time [s], mass from then on [kg])."""
    time = np.arange(round(seconds / STEP)) * STEP
    mass = np.zeros(time.size)
    for at, value in changes:
        mass[time >= at] = value
    return time, mass * GRAVITY


def make_restoration(sensor: IcpSensor, voltage: np.ndarray, idle: float = 1.0) -> DcRestoration:
    """Make the restoration for `sensor`; its zero is the mean of `voltage` (n,) [V] over the first `idle` [s]."""
    return DcRestoration(sensor.decay_rate).with_zero_from(voltage[: round(idle / STEP)])


def average_after(time: np.ndarray, signal: np.ndarray, at: float, width: float = 0.2) -> float:
    """Average `signal` over the `width` [s] after `at` [s]."""
    return float(signal[(time >= at) & (time < at + width)].mean())


def note_own_values(sheet: Sheet) -> None:
    """Name the values that the thesis does not give."""
    for text in NOTES:
        sheet.note(text)


@register_reproduction(
    "figure-C.3",
    "Exponential drift of the piezo cell under a constant load",
    claim="a constant force decays exponentially to the initial value; a follows from the decay",
)
def reproduce_figure_c_3(sheet: Sheet) -> None:
    """2 kg put on, and the decay rate from the fit and from t_98."""
    time, force = make_loads(20.0, (1.0, 2.0))
    trace = sample_output(SENSOR, force) * _DISPLAY_SCALE
    on = time >= 1.0
    (height, rate), _ = curve_fit(lambda t, o, a: o * np.exp(-a * t), time[on] - 1.0, trace[on], (0.5, 0.3))  # sec. C.2
    window = np.convolve(trace[on], np.full(100, 0.01), mode="valid")  # means over 0.1 s
    t_98 = float(time[np.argmax(window < 0.02 * window[0])])
    axes = sheet.make_axes(1, 1, width=8, height=4.5)
    axes.plot(time, trace, lw=1.0, label="output")
    axes.plot(
        time[on],
        height * np.exp(-rate * (time[on] - 1.0)),
        color=REFERENCE_COLOUR,
        lw=1.0,
        ls="--",
        label="O_0 exp(-a t)",
    )
    axes.legend(frameon=False)
    label_axes(axes, "time [s]", "output [V/10]")
    a = SENSOR.decay_rate
    sheet.check("decays exponentially: a from the fit within 1 % of 1/tau [1/s]", abs(rate / a - 1) < 0.01, (rate, a))
    by_eye = DcRestoration.from_decay_time(t_98).decay_rate
    sheet.check("a = -ln(0.02)/t_98, read off the curve, within 5 % [1/s]", abs(by_eye / a - 1) < 0.05, by_eye)
    end = average_after(time, trace, 19.5)
    sheet.check("it ends near the initial value, within 1 % of the step [V/10]", abs(end) < 0.01 * height, end, "0")
    sheet.check(
        "2 kg start within the axis of the figure, 0.4 to 0.45 [V/10]", 0.4 < height < 0.45, height, "0.4 to 0.45"
    )
    note_own_values(sheet)


@register_reproduction(
    "figure-C.4",
    "Effect of zeroing on the restored output",
    claim="an offset of the output gives a linear drift in the restored signal; zeroing reduces it to a minimum",
)
def reproduce_figure_c_4(sheet: Sheet) -> None:
    """Unloaded sensor with a zero error of the power unit, restored with and without zeroing."""
    # V; chosen: 20 s then drift by 0.04 V/10, the height of the figure's lower axis
    sensor = replace(SENSOR, offset=0.05)
    time, force = make_loads(20.0)
    voltage = sample_output(sensor, force)
    plain, _ = DcRestoration(sensor.decay_rate).restore(voltage, STEP)
    clean, _ = make_restoration(sensor, voltage).restore(voltage, STEP)
    axes = sheet.make_axes(1, 1, width=8, height=4.5)
    for signal, name in ((voltage, "output of the power unit"), (plain, "restored"), (clean, "restored after zeroing")):
        axes.plot(time, signal * _DISPLAY_SCALE, lw=1.0, label=name)
    axes.legend(loc="upper left", frameon=False)
    label_axes(axes, "time [s]", "[V/10]")
    slopes = [float(np.polyfit(time, signal, 1)[0]) for signal in (plain, clean)]
    expected = sensor.offset * sensor.decay_rate
    sheet.check("slope of the drift is offset times a, within 2 % [mV/s]", abs(slopes[0] / expected - 1) < 0.02,
                (1e3 * slopes[0], 1e3 * expected), "linear drift")  # fmt: skip
    line = np.polyval(np.polyfit(time, plain, 1), time)
    bend = float(np.abs(plain - line).max() / np.ptp(plain))
    sheet.check("the drift is a straight line within 5 % of its height [%]", bend < 0.05, 100 * bend, "linear")
    ratio = abs(slopes[0] / slopes[1])
    sheet.check("zeroing makes the drift at least 50 times slower [times]", ratio >= 50.0, ratio, "to a minimum")
    sheet.note(
        "the offset of 50 mV is chosen here; the drift over 20 s then is the height of the figure's "
        "lower axis, 0.08 to 0.12 V/10"
    )
    note_own_values(sheet)


@register_reproduction(
    "figure-C.5",
    "Loads put on one by one or at once, and taken off one by one",
    claim="levels are the same either way: linear, no memory; every load of 500 g, put on or taken off, is found within the 6 "
    "g of the thesis; unrestored it fades",
)
def reproduce_figure_c_5(sheet: Sheet) -> None:
    """Four weights of 500 g in both orders, amplifier x100."""
    one_by_one = [(1.0 + k, 0.5 * (k + 1)) for k in range(4)]
    taken_off = [(8.0 + 2.0 * k, 1.5 - 0.5 * k) for k in range(4)]
    axes = sheet.make_axes(1, 2, width=11, height=4.5, sharey=True)
    levels, steps = [], []
    for k, (putting, name) in enumerate(((one_by_one, "put on one by one"), ([(1.0, 2.0)], "put on at once"))):
        time, force = make_loads(20.0, *putting, *taken_off)
        voltage = sample_output(SENSOR, force, seed=k + 1)
        back, _ = make_restoration(SENSOR, voltage).restore(voltage, STEP)
        axes[k].plot(time, back * _DISPLAY_SCALE, lw=1.0, label="restored")
        axes[k].plot(time, voltage * _DISPLAY_SCALE, lw=1.0, label="output")
        label_axes(axes[k], "time [s]", "[V/10]" if k == 0 else "", name)
        kilograms = back / (SENSOR.scale * GRAVITY)  # the data sheet's sensitivity
        levels.append([average_after(time, kilograms, at + 0.1) for at in (7.0, 8.0, 10.0, 12.0, 14.0)])
        for at, _ in (*(putting if k == 0 else ()), *taken_off):  # of 500 g each
            steps.append(abs(average_after(time, kilograms, at + 0.01) - average_after(time, kilograms, at - 0.21)))
        if k == 1:
            unrestored = average_after(time, voltage, 19.0) * _DISPLAY_SCALE
    axes[0].legend(loc="upper right", frameon=False)
    expected = np.array([2.0, 1.5, 1.0, 0.5, 0.0])
    apart = 1e3 * float(np.abs(np.subtract(levels[0], levels[1])).max())
    off = 1e3 * float(np.abs(np.array(levels) - expected).max())
    sheet.check("same levels both ways within 6 g [g]", apart < 6.0, apart, "same values, no memory effect")
    sheet.check("every level from 0 to 2 kg within 6 g [g]", off < 6.0, off, "linear")
    error = 1e3 * float(np.abs(np.array(steps) - 0.5).max())
    sheet.check(f"each of {len(steps)} loads of 500 g, at once, within 6 g: largest error [g]", error < 6.0, error,
                "6 g, measured")  # fmt: skip
    sheet.check("the output itself fades and is below zero after unloading [V/10]", unrestored < 0.0, unrestored,
                "drifts away")  # fmt: skip
    sheet.note(
        "the 6 g (1.2 %) are the deviation of the thesis's sensor from its data sheet. The simulated sensor has "
        "that sensitivity exactly: its error is"
        " noise, quantisation and the remaining zero error"
    )
    note_own_values(sheet)


@register_reproduction(
    "figure-C.6",
    "Alternating load on a constant one",
    claim="the constant part fades in the output and stays in the restored signal; the alternating part is the same in both",
)
def reproduce_figure_c_6(sheet: Sheet) -> None:
    """2 kg with 1.5 kg at 1 Hz."""
    time, force = make_loads(20.0, (1.0, 2.0))
    frequency = 1.0  # Hz; chosen by judgement: the thesis names none
    force += 1.5 * GRAVITY * np.sin(2 * np.pi * frequency * (time - 1.0)) * (time >= 1.0)
    voltage = sample_output(SENSOR, force)
    back, _ = make_restoration(SENSOR, voltage).restore(voltage, STEP)
    axes = sheet.make_axes(1, 1, width=8, height=4.5)
    axes.plot(time, back * _DISPLAY_SCALE, lw=1.0, label="restored")
    axes.plot(time, voltage * _DISPLAY_SCALE, lw=1.0, label="output")
    axes.set_ylim(-0.45, 1.1)
    axes.legend(loc="upper right", ncols=2, frameon=False)
    label_axes(axes, "time [s]", "[V/10]")
    late = time >= 12.0  # 8 whole periods
    turns = np.exp(-2j * np.pi * frequency * time[late])
    parts = [2.0 * np.mean((s - s.mean())[late] * turns) for s in (voltage, back)]
    held, gone = (float(signal[late].mean() / SENSOR.scale / GRAVITY) for signal in (back, voltage))
    sheet.check("restored keeps the constant 2 kg within 1.2 % [kg]", abs(held / 2.0 - 1.0) < 0.012, held, "no drift")
    sheet.check("in the output less than 2 % of it is left after 11 s [kg]", abs(gone) < 0.04, gone, "drifts away")
    ratio = complex(parts[0] / parts[1])
    sheet.check("alternating amplitudes agree within 1.2 % [output/restored]", abs(abs(ratio) - 1) < 0.012, abs(ratio),
                "the same for both")  # fmt: skip
    turned = float(np.degrees(np.angle(ratio)))
    sheet.check("their phases within 5 deg [deg]", abs(turned) < 5.0, turned, "the same")
    lead = np.degrees(np.arctan(SENSOR.decay_rate / (2 * np.pi * frequency)))
    sheet.note(f"1 Hz and 1.5 kg are chosen here; the high-pass leads by atan(a/w) = {lead:.1f} deg there")
    note_own_values(sheet)


@register_reproduction(
    "figure-C.7",
    "Temperature effect on the sensor",
    claim="gently holding the sensor changes the restored signal by a quarter of a 4 kg load, 1 kg",
)
def reproduce_figure_c_7(sheet: Sheet) -> None:
    """4 kg, blowing twice, holding: warming of the sensor acts as a load."""
    sensor = replace(SENSOR, warming_load=-1.0 * GRAVITY / 5.0)  # N/K; chosen: 5 K of warming take off 1 kg
    time, force = make_loads(200.0, (20.0, 4.0))
    warming = np.zeros(time.size)
    for begin, end, kelvin, lag in ((60.0, 65.0, 3.0, 3.0), (90.0, 95.0, 3.0, 3.0), (130.0, 160.0, 5.0, 5.0)):
        during, after = (time >= begin) & (time < end), time >= end
        reached = 1.0 - np.exp(-(end - begin) / lag)
        warming[during] += kelvin * (1.0 - np.exp(-(time[during] - begin) / lag))
        warming[after] += kelvin * reached * np.exp(-(time[after] - end) / 15.0)  # cools slower, in air
    voltage = sample_output(sensor, force, warming)
    back, _ = make_restoration(sensor, voltage, 10.0).restore(voltage, STEP)
    axes = sheet.make_axes(1, 1, width=8, height=4.5)
    axes.plot(time, -back * _DISPLAY_SCALE, lw=1.0, label="restored")
    axes.plot(time, -voltage * _DISPLAY_SCALE, lw=1.0, label="output")
    axes.set_ylim(-1.2, 1.15)
    axes.legend(loc="upper right", ncols=2, frameon=False)
    for at, height, text in ((21.0, 0.1, "4 kg"), (58.0, -0.55, "blow"), (88.0, -0.55, "blow"), (135.0, -0.45, "hold")):
        axes.text(at, height, text, fontsize=9)
    label_axes(axes, "time [s]", "[V/10], compression negative")
    before, held = average_after(time, back, 125.0), average_after(time, back, 158.0)
    load = average_after(time, back, 50.0)
    share = (before - held) / load
    sheet.check("holding changes the restored signal by a quarter of the 4 kg, 0.25 +- 0.05 [-]", abs(share - 0.25) < 0.05,
                share, "about one fourth")  # fmt: skip
    moved = float(np.ptp(voltage[(time > 125.0) & (time < 158.0)])) / load
    sheet.check("the leak hides part of the slow warming in the output: less than in the restored signal [-]", moved < share,
                moved)  # fmt: skip
    sheet.note(
        "warming of 5 K by the hand and 2 N/K are chosen here, together for the thesis's 1 kg: the quarter is not a prediction"
    )
    note_own_values(sheet)


@register_reproduction(
    "figure-C.8",
    "Error of the restored signal over time, amplifier x10 and x100",
    claim="x10, 2 kg: because of the zero error that remains, the error grows in a straight line from below 1 % at"
    " once (thesis 0.55 %) to 3.5 % after 65 s; x100 stays below 1.2 %",
)
def reproduce_figure_c_8(sheet: Sheet) -> None:
    """2 kg put on after 15 s; the only error is the zero left by zeroing, chosen to give the 3.5 % of the thesis."""
    put_on, read = 15.0, 80.0  # s: sec. C.3, "after about 15 seconds", and 65 s on the load
    load, rate, step = 2.0 * GRAVITY, SENSOR.decay_rate, _RANGE / 2 ** (_BITS - 1)
    left = 0.035 * 10.0 * SENSOR.sensitivity * load / (1.0 + rate * read)  # V at the output: 3.5 % at x10 when read
    axes = sheet.make_axes(1, 1, width=8, height=4.5)
    errors = {}
    for gain in (10.0, 100.0):
        sensor = replace(SENSOR, gain=gain, offset=left)
        time, force = make_loads(100.0, (put_on, 2.0))
        back, _ = DcRestoration(rate).restore(sample_output(sensor, force), STEP)
        off = 100.0 * (back / (sensor.scale * load) - 1.0)  # %
        tenth = (time >= put_on).nonzero()[0].reshape(-1, 100)  # in tenths of a second
        axes.plot(time[tenth].mean(axis=1), off[tenth].mean(axis=1), lw=1.2, label=f"x{gain:g}, means over 0.1 s")
        errors[gain] = [average_after(time, off, at) for at in (put_on, 0.5 * (put_on + read), read)]
    axes.plot([put_on, read], [0.55, 3.5], "o", color=REFERENCE_COLOUR, label="thesis, x10")
    axes.legend(loc="upper left", frameon=False)
    label_axes(axes, "time [s]", "error of the restored load [%]")
    at_once, middle, late = errors[10.0]
    sheet.check("x10: error at once, from the zero error chosen for 3.5 % after 65 s, above 0 and below 1 % [%]",
                0.0 < at_once < 1.0, at_once, 0.55)  # fmt: skip
    bend = middle - 0.5 * (at_once + late)
    sheet.check("x10: halfway in time, halfway in error, +- 0.1: the drift is linear [%]", abs(bend) < 0.1, middle)
    sheet.check("the zero error for this is below two steps of the converter: zeroing cannot do much better [mV]",
                left < 2.0 * step, (1e3 * left, 1e3 * step), "function of the accuracy of the zeroing")  # fmt: skip
    sheet.check("x100: the same zero error at the output stays below 1.2 % for 65 s [%]", errors[100.0][2] < 1.2,
                errors[100.0][2], "about 1.2 at once")  # fmt: skip
    sheet.note(
        "the 1.2 % of the thesis at x100 are the 6 g of 500 g of figure-C.5, the deviation of its sensor from the data sheet; "
        "the simulated sensor has no such deviation, and a"
        " zero error alone has at x100 a tenth of its effect at x10"
    )
    sheet.note(f"the zero error of {1e3 * left:.2f} mV at the output is chosen for the 3.5 %; the thesis gives none")
    sheet.note("'after about 65 seconds' is read as 65 s on the load")
    note_own_values(sheet)

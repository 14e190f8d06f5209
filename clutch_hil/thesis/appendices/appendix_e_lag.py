"""Reproductions of appendix E: how lift-up force and film follow speed and acceleration, and the friction lag that results."""

import numpy as np

from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.appendices.appendix_e import DT, LAG, LOAD, MODEL, SIZES, Cycle, check_butterfly, simulate_steady
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet, label_axes
from plant_sim.friction.lift_up import LiftingXGMS
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.xgms import XGMS


@register_reproduction(
    "figure-E.6",
    "Rate of the lift-up force over velocity and acceleration",
    claim="dF_N/dt is zero at constant speed and at very high speed, and of the sign of the acceleration at low speed",
)
def reproduce_figure_e_6(sheet: Sheet) -> None:
    axes = sheet.make_axes(1, 1, 8, 5)
    velocities, accelerations = np.linspace(0.02, 0.8, 40), np.linspace(-5.0, 5.0, 41)
    rates = np.array([[_measure_rate(v, a) for v in velocities] for a in accelerations])
    limit = float(np.abs(rates).max())
    mesh = axes.pcolormesh(
        velocities, accelerations, rates, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="nearest", rasterized=True
    )
    axes.contour(
        velocities, accelerations, rates, levels=np.linspace(-limit, limit, 15), colors=REFERENCE_COLOUR, linewidths=0.5
    )
    axes.figure.colorbar(mesh, ax=axes, label=r"$dF_N/dt$ [N/s]")
    label_axes(axes, r"$v_T$ [m/s]", r"$a_T$ [m/s$^2$]")
    middle = len(accelerations) // 2
    unaccelerated = float(np.abs(rates[middle]).max() / limit)
    sheet.check(
        "zero without acceleration, of the largest rate",
        unaccelerated < 1e-9,
        unaccelerated,
        "no force variation at constant speed",
    )
    fast = float(np.abs(rates[:, -1]).max() / limit)
    sheet.check(
        "at 0.8 m/s any acceleration gives less than 1 % of the largest rate",
        fast < 0.01,
        fast,
        "zero at very high speed",
    )
    moving = np.abs(accelerations) > 1e-9
    signs = bool(np.all((rates * accelerations[:, None])[moving][:, velocities < 0.5] > 0.0))
    sheet.check("below 0.5 m/s the rate has the sign of the acceleration", signs, "all points" if signs else "not all")
    mirrored = max(
        abs(_measure_rate(-v, -a) - _measure_rate(v, a)) / limit for v, a in ((0.05, 5.0), (0.2, -5.0), (0.5, 2.0))
    )
    sheet.check("mirrored motion gives the same rate, of the largest", mirrored < 1e-9, mirrored, "line symmetric")
    sheet.note(
        f"from steady sliding at v, mean rate over the first {LAG * 1e3:g} ms of the acceleration, which is the lag. {SIZES}"
    )


def _measure_rate(velocity: float, acceleration: float) -> float:
    """Measure the mean dF_N/dt [N/s] over the first LAG of `acceleration` [m/s^2] from steady sliding at `velocity` [m/s]."""
    dt = 1e-4
    before, after = round(0.15 / dt), round(LAG / dt)
    time = dt * np.arange(-before, after + 1)
    position = velocity * time + 0.5 * acceleration * np.maximum(time, 0.0) ** 2
    force = MODEL.lift_force(MODEL.trace(position, dt, LOAD).state)
    return float((force[-1] - force[before]) / (LAG))


@register_reproduction(
    "figure-E.7",
    "Butterfly lift-up curves, and the friction lag that follows",
    claim="the signal with the highest amplitude, so the highest speed, reaches the highest lift-up; the film is thinner "
    "accelerating than decelerating, and the friction higher",
)
def reproduce_figure_e_7(sheet: Sheet) -> None:
    left, right = sheet.make_axes(1, 2, width=12, height=5)
    amplitudes = np.array([0.5, 1.0, 2.0, 4.5]) * 1e-3
    cycles = [Cycle(amplitude) for amplitude in amplitudes]
    for amplitude, cycle in zip(amplitudes, cycles, strict=True):
        name = f"{amplitude * 1e3:g} mm, {cycle.velocity.max() * 1e3:.0f} mm/s"
        left.plot(cycle.position * 1e3, cycle.lift * 1e6, label=name)
        forward = cycle.velocity > 0.0
        order = np.argsort(np.flatnonzero(forward) - len(forward) * (np.flatnonzero(forward) > len(forward) // 2))
        right.plot(cycle.velocity[forward][order], cycle.friction[forward][order])
    left.figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    label_axes(left, r"$x_T$ [mm]", r"$h_N$ [um]", "Lift-up")
    label_axes(right, r"$v_T$ [m/s]", "friction [N]", "Friction, forward stroke")
    tops = [float(cycle.lift.max()) * 1e6 for cycle in cycles]
    sheet.check(
        "highest lift-up [um] grows with the peak speed",
        bool(np.all(np.diff(tops) > 0.0)),
        tops,
        "highest amplitude highest",
    )
    for amplitude, cycle in zip(amplitudes, cycles, strict=True):
        check_butterfly(sheet, cycle, cycle.lift, f"{amplitude * 1e3:g} mm")
    cycle = cycles[-1]
    quarter = len(cycle.position) // 4
    slowing, faster = slice(0, quarter), slice(3 * quarter, 4 * quarter)  # forward, from the middle and to the middle
    speeds = np.linspace(0.2, 0.9, 15) * cycle.velocity.max()
    thin = np.interp(speeds, cycle.velocity[faster], cycle.lift[faster])
    thick = np.interp(speeds, cycle.velocity[slowing][::-1], cycle.lift[slowing][::-1])
    even = np.array([simulate_steady(v)[1] for v in speeds])
    sheet.check("the film is thinner accelerating than steady, and thicker decelerating, at 15 equal speeds",
                bool(np.all(thin < even) and np.all(even < thick)),
                f"thinner by up to {(even - thin).max() * 1e6:.2f} um, thicker by up to {(thick - even).max() * 1e6:.2f} um",
                "Sugimura [36]")  # fmt: skip
    up = np.interp(speeds, cycle.velocity[faster], cycle.friction[faster])
    down = np.interp(speeds, cycle.velocity[slowing][::-1], cycle.friction[slowing][::-1])
    sheet.check("friction accelerating is above friction decelerating at these speeds [N]", bool(np.all(up > down)),
                f"{(up - down).min():.2f} to {(up - down).max():.2f}", "higher accelerating")  # fmt: skip
    flat = LiftingXGMS(XGMS(Amontons(0.25), np.full(10, 1e5), np.full(10, 0.1)), MODEL.normal)
    lagged = flat.trace(np.tile(cycle.position, 3), DT, LOAD).force[-len(cycle.position) :]
    up = np.interp(speeds, cycle.velocity[faster], lagged[faster])
    down = np.interp(speeds, cycle.velocity[slowing][::-1], lagged[slowing][::-1])
    sheet.check("the lift alone, over Coulomb friction without any Stribeck curve or lag of its own, makes that difference [N]",
                bool(np.all(up > down)), f"{(up - down).min():.2f} to {(up - down).max():.2f}", "directly related")  # fmt: skip
    sheet.note(
        "compared from 0.2 to 0.9 of the peak speed: below, the contact is still in pre-sliding. It takes damping: at 0.05 of "
        "critical the film rings at the contact's resonance after each start, and the statements fail at some speeds"
    )
    sheet.note(SIZES)

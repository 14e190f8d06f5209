"""Effects on the drive: two inertias with a shaft or a clearance between them, and an uneven motor."""

from math import exp, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_sim.effects.signals import DRIVE
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.units import ZERO_CELSIUS
from tests.plant_sim.effects.lone_effect import LoneEffect
from tests.plant_sim.effects.pressed_rig import HEAVY, STEP, find_pressing_voltage, make_rig, press_rig, simulate_states

EXACT = 1e-10  # relative: thousands of roundings of doubles
TWO_INERTIAS = 1e-2  # of the swing: motor control sees the lead at the step's beginning; measured 5e-3
BOUNCES = 1e-3  # of the first speed: flanks are met within a sub-step of 12.5 us; after a dozen crossings measured 1e-4
FRICTION_SLOPE = 0.15  # relative: friction, too, changes with the plate's speed; measured 0.07
J = 0.05  # kg m^2
REF = 70.0 + ZERO_CELSIUS  # K


class Drive:
    """A lone effect between motor and plate, both free but for the torques given; it begins slack."""

    def __init__(self, name: str, **changed: float) -> None:
        self.effect = LoneEffect(name, **changed)
        share = self.effect.p.share
        self.plate_inertia, self.motor_inertia = share * J, (1 - share) * J
        self.reduced = share * (1 - share) * J
        self.effect.x.wound = 1.0
        self.speed = 0.0  # rad/s, of the plate

    def step(self, motor_torque: float = 0.0, torque: float = 0.0, h: float = STEP) -> float:
        """Mean torque in the shaft over a step, or with h = 0 that of now [Nm]."""
        asked = {
            "motor_torque": motor_torque,
            "drive_torque": motor_torque,
            "torque": torque,
            "inertia": J,
            "lead": 0.0,
        }
        s = self.effect(DRIVE, h, **asked)
        assert s.motor_torque == motor_torque
        assert s.inertia == pytest.approx(self.plate_inertia, rel=EXACT)
        assert s.lead == self.lead
        self.speed += h * (s.drive_torque - torque) / s.inertia
        return float(s.drive_torque)

    @property
    def lead(self) -> float:
        return self.effect.x.lead

    @property
    def momentum(self) -> float:
        return self.plate_inertia * self.speed + self.motor_inertia * (self.speed + self.lead)


def make_slack_state(of: wet_clutch.Rig, speed: float) -> wet_clutch.Whole:
    """The rig at rest, its effects on for a step in which no torque acts."""
    return of.advance(of.make_rest_state(speed, REF), 0.0, speed, 1e9, STEP, 1)


# --- shaft ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("compliance", "share", "damping"), [(3e-3, 0.2, 0.03), (1e-5, 0.05, 0.001), (0.1, 0.95, 0.5), (1e-8, 0.2, 0.03)]
)
def test_free_shaft_swings_at_its_eigenfrequency_and_dies_with_its_damping(
    compliance: float, share: float, damping: float
) -> None:
    drive = Drive("shaft_compliance", compliance=compliance, share=share, damping=damping)
    frequency = 1.0 / sqrt(compliance * share * (1 - share) * J)
    swing = frequency * sqrt(1 - damping**2)
    drive.effect.x.spring = 5.0
    for k in range(1, 101):
        drive.step()
        left, angle = exp(-damping * frequency * k * STEP), swing * k * STEP
        expected = 5.0 * left * (np.cos(angle) + damping * frequency / swing * np.sin(angle))
        assert drive.effect.x.spring == pytest.approx(expected, abs=5.0 * 1e-9)
    assert drive.momentum == pytest.approx(0.0, abs=1e-12)


def test_shaft_of_the_typical_values_swings_at_32_hz() -> None:
    drive = Drive("shaft_compliance")
    assert 1.0 / sqrt(drive.effect.p.compliance * drive.reduced) / (2 * pi) == pytest.approx(32.5, abs=0.1)


@pytest.mark.parametrize("name", ["shaft_compliance", "backlash"])
def test_momentum_is_what_motor_and_clutch_gave(name: str) -> None:
    drive, given = Drive(name), 0.0
    for motor, clutch in np.random.default_rng(5).normal(0.0, 20.0, (2000, 2)):
        drive.step(motor, clutch)
        given += STEP * (motor - clutch)
    assert abs(drive.lead) > 0.01
    assert drive.momentum == pytest.approx(given, abs=1e-10)


@pytest.mark.parametrize("name", ["shaft_compliance", "backlash"])
def test_against_a_plate_that_rests_the_motor_swings_alone(name: str) -> None:
    """The clutch holds whatever comes: the torque of the clutch has no effect, and the lead is the motor's speed."""
    changed = {"gap": 1e-9, "stiffness": 1e3} if name == "backlash" else {"compliance": 1e-3, "damping": 0.05}
    lone, given, passed, crossings, before = LoneEffect(name, share=0.4, **changed), 0.0, 0.0, [], 0.0
    lone.x.wound = 1.0
    motor_inertia = 0.6 * J
    for k in range(4000):
        asked = {"motor_torque": 5.0, "drive_torque": 5.0, "torque": float(k % 7), "inertia": J, "still": 1.0}
        s = lone(DRIVE, STEP, **asked)
        given, passed = given + STEP * 5.0, passed + STEP * s.drive_torque
        if before < 5.0 <= s.drive_torque:
            crossings.append(k * STEP)
        before = s.drive_torque
    assert motor_inertia * lone.x.lead == pytest.approx(given - passed, abs=1e-10)
    assert passed / (4000 * STEP) == pytest.approx(5.0, rel=0.05)  # it swings about the motor's torque
    assert np.diff(crossings[:5]).mean() == pytest.approx(2.0 * pi / sqrt(1e3 / motor_inertia), rel=0.02)


@pytest.mark.parametrize("name", ["shaft_compliance", "backlash"])
def test_asking_a_shaft_moves_nothing(name: str) -> None:
    drive = Drive(name)
    for _ in range(30):
        drive.step(10.0, -3.0)
    before = vars(drive.effect.x).copy()
    now = drive.step(10.0, -3.0, 0.0)
    assert vars(drive.effect.x) == before
    assert now == pytest.approx(drive.step(10.0, -3.0, 1e-7), abs=1e-3), "a step that is next to none says the same"


def test_shaft_step_does_not_depend_on_its_length() -> None:
    one, many = Drive("shaft_compliance"), Drive("shaft_compliance")
    mean = one.step(15.0, 4.0, 5e-3)
    parts = [many.step(15.0, 4.0, 5e-5) for _ in range(100)]
    assert np.mean(parts) == pytest.approx(mean, rel=EXACT)
    assert many.lead == pytest.approx(one.lead, rel=EXACT)


def test_rig_with_a_shaft_agrees_with_an_independent_integration_of_two_inertias() -> None:
    """Open clutch, a step of the speed demand: motor under PI control within its limit, shaft, plate."""
    compliance, share, damping = 3e-3, 0.3, 0.02
    of = make_rig({f"shaft_compliance.{k}": v for k, v in zip(("compliance", "share", "damping"), (compliance, share, damping),
                                                        strict=True)})  # fmt: skip
    plate, motor = share * J, (1 - share) * J
    viscous = 2 * damping * sqrt(plate * motor / J / compliance)

    def rates(t: float, y: np.ndarray) -> list[float]:
        twist, fast, slow, integral = y
        error = 15.0 - fast
        spring = twist / compliance + viscous * (fast - slow)
        return [fast - slow, (4.0 * error + 40.0 * integral - spring) / motor, spring / plate, error]

    time = np.arange(2001) * STEP
    solution = solve_ivp(rates, (0, time[-1]), [0, 10.0, 10.0, 0], t_eval=time, rtol=1e-10, atol=1e-12)
    y, _ = simulate_states(of, make_slack_state(of, 10.0), 0.0, 15.0, 0.2)
    swing = np.ptp(solution.y[1] - solution.y[2])
    assert swing > 1.0
    assert y["slip_speed"] == pytest.approx(solution.y[2], abs=TWO_INERTIAS * swing)
    assert y["lead"] == pytest.approx(solution.y[1] - solution.y[2], abs=TWO_INERTIAS * swing)
    asked = 4.0 * (15.0 - solution.y[1]) + 40.0 * solution.y[3]
    assert y["motor_torque"][1:] == pytest.approx(asked[1:], abs=4.0 * 2 * TWO_INERTIAS * swing), (
        "the motor's, not the shaft's"
    )


def test_nearly_rigid_shaft_is_a_rigid_one() -> None:
    stiff, rigid = (make_rig({"shaft_compliance.compliance": e, "shaft_compliance.damping": 0.9}) for e in (1e-9, 0.0))
    one, other = (
        simulate_states(
            of, of.make_rest_state(10.0, REF), find_pressing_voltage(3.4), lambda t: 10.0 + 10.0 * (t > 0.2), 0.4
        )[0]
        for of in (stiff, rigid)
    )
    assert one["slip_speed"] == pytest.approx(other["slip_speed"], abs=0.01)
    assert one["clutch_torque"] == pytest.approx(other["clutch_torque"], abs=0.01)
    assert other["clutch_torque"][-1] > 10.0


@pytest.mark.parametrize("name", ["shaft_compliance.compliance", "backlash.gap"])
def test_a_shaft_that_is_switched_on_under_torque_gives_no_jolt(name: str) -> None:
    plain, elastic = make_rig({}), make_rig({name: 3e-3})
    begin = plain.fill(10.0, REF)
    begin = plain.advance(begin, find_pressing_voltage(3.4), 10.0, 1e9, 1.0, 10_000)
    y, _ = simulate_states(
        elastic, wet_clutch.Whole(begin.y, elastic.table.make_rest_states()), find_pressing_voltage(3.4), 10.0, 0.2
    )
    assert y["motor_torque"][0] > 10.0
    assert np.abs(y["slip_speed"] - 10.0).max() < 1e-3
    assert np.abs(y["motor_torque"] - y["motor_torque"][0]).max() < 0.01


def test_a_shaft_that_is_switched_off_leaves_no_lead() -> None:
    plain, elastic = make_rig({}), make_rig({"shaft_compliance.compliance": 0.01})
    state = elastic.advance(elastic.make_rest_state(10.0, REF), 0.0, 20.0, 1e9, 0.01, 100)
    assert abs(state.read().lead) > 0.1
    state = plain.advance(wet_clutch.Whole(state.y, plain.table.make_rest_states()), 0.0, 20.0, 1e9, STEP, 1)
    assert state.read().lead == 0.0


@pytest.mark.parametrize("share", [0.05, 0.95])
@pytest.mark.parametrize(
    "changed",
    [
        {"shaft_compliance.compliance": 1e-12, "shaft_compliance.damping": 0.001},
        {"shaft_compliance.compliance": 1e-5, "shaft_compliance.damping": 0.001},
        {"shaft_compliance.compliance": 0.1, "shaft_compliance.damping": 0.9},
        {"backlash.gap": 0.2, "backlash.stiffness": 1e5},
        {"backlash.gap": 1e-6, "backlash.stiffness": 1e5},
    ],
)  # fmt: skip
def test_plate_behind_a_shaft_stays_bounded_at_the_bounds(changed: dict[str, float], share: float) -> None:
    name = next(iter(changed)).partition(".")[0]
    of = make_rig(changed | {f"{name}.share": share})
    y, _ = simulate_states(
        of, of.make_rest_state(10.0, REF), find_pressing_voltage(3.2), lambda t: 10.0 + 10.0 * (t > 0.2), 0.6
    )
    late = y[4000:]
    assert np.abs(late["slip_speed"]).max() < 40.0
    assert np.abs(late["lead"]).max() < 40.0
    assert late["slip_speed"][-1000:].mean() == pytest.approx(20.0, abs=5.0)


# --- backlash ---------------------------------------------------------------------------------------------------------


def energy(drive: Drive) -> float:
    """Of the relative motion and the flanks [J]."""
    pressed_in = max(abs(drive.effect.x.twist) - 0.5 * drive.effect.p.gap, 0.0)
    return 0.5 * drive.reduced * drive.lead**2 + 0.5 * drive.effect.p.stiffness * pressed_in**2


def test_no_torque_passes_inside_the_gap() -> None:
    drive = Drive("backlash", gap=0.02)
    for _ in range(40):
        assert drive.step(motor_torque=10.0) == pytest.approx(0.0, abs=1e-10)
    assert drive.speed == pytest.approx(0.0, abs=1e-12)
    assert drive.lead == pytest.approx(10.0 / drive.motor_inertia * 40 * STEP, rel=EXACT)
    assert drive.effect.x.twist == pytest.approx(0.5 * 10.0 / drive.motor_inertia * (40 * STEP) ** 2, rel=EXACT)


def test_flank_at_rest_carries_what_the_plate_needs() -> None:
    drive = Drive("backlash", gap=0.02, stiffness=2000.0)
    for _ in range(5000):
        carried = drive.step(motor_torque=12.0, torque=12.0)
    assert carried == pytest.approx(12.0, rel=1e-6)
    assert drive.effect.x.twist == pytest.approx(0.01 + 12.0 / 2000.0, rel=1e-6)


def test_bouncing_flanks_never_gain_energy_and_lose_what_their_damping_takes() -> None:
    """Against an independent integration whose impacts are events."""
    drive = Drive("backlash", gap=0.02, stiffness=5000.0)
    drive.effect.x.lead = 4.0
    k, reduced, half = 5000.0, drive.reduced, 0.01
    d = 0.2 * sqrt(k * reduced)

    def torque(twist: float, lead: float) -> float:
        if abs(twist) <= half:
            return 0.0
        side = 1.0 if twist > 0 else -1.0
        return side * max(k * (abs(twist) - half) + d * side * lead, 0.0)

    events = [lambda t, y: y[0] - half, lambda t, y: y[0] + half]
    for event in events:
        event.terminal = True  # type: ignore[attr-defined]
    now, y, loss = 0.0, np.array([0.0, 4.0]), [energy(drive)]
    while now < 0.1:
        solution = solve_ivp(lambda t, y: [y[1], -torque(*y) / reduced], (now, 0.1), y, events=events, rtol=1e-10, atol=1e-13,
                             max_step=1e-4)  # fmt: skip
        now, y = solution.t[-1], solution.y[:, -1] + [1e-12 * np.sign(solution.y[1, -1]), 0.0]
    for _ in range(1000):
        drive.step()
        loss.append(energy(drive))
    assert np.diff(loss).max() <= 1e-9 * loss[0]
    assert loss[-1] < 0.5 * loss[0]
    assert abs(drive.lead) == pytest.approx(abs(y[1]), abs=BOUNCES * 4.0)


def test_motor_crosses_the_gap_before_the_plate_follows() -> None:
    changed = {"backlash.gap": 0.05, "motor.integral_gain": 0.0}
    of = make_rig(changed)
    y, _ = simulate_states(of, make_slack_state(of, 0.0), 0.0, 2.0, 0.05)
    reached = int(np.argmax(y["slip_speed"] > 1e-6))
    twist = np.cumsum(y["lead"]) * STEP
    assert twist[reached] == pytest.approx(0.025, rel=0.02)  # from the middle of the gap
    assert y["lead"][reached - 2] > 1.0
    assert np.abs(y["slip_speed"][: reached - 1]).max() < 1e-12


def test_shaft_and_backlash_exclude_each_other() -> None:
    with pytest.raises(InputError, match="exclude each other"):
        make_rig({"backlash.gap": 0.01, "shaft_compliance.compliance": 1e-3})


# --- motor ------------------------------------------------------------------------------------------------------------


def test_motor_torque_ripples_with_one_line_in_proportion_to_itself() -> None:
    name = "motor_torque_ripple"
    of = make_rig(
        HEAVY | {f"{name}.amplitude": 0.05, f"{name}.order": 7.0, f"{name}.phase": 0.4, "motor.integral_gain": 0.0}
    )
    y, _ = simulate_states(of, press_rig(of, 3.4, 20.0), find_pressing_voltage(3.4), 22.0, 0.314)
    asked = 4.0 * (22.0 - y["slip_speed"])
    ripple = 1.0 + 0.05 * np.cos(7.0 * y["angle"] + 0.4)
    assert y["motor_torque"][1:] == pytest.approx((asked * ripple)[1:], abs=1e-9)
    assert y["sensed_motor_torque"] == pytest.approx(y["motor_torque"], abs=1e-12)
    assert 10.0 * np.gradient(y["slip_speed"], STEP)[1:-1] == pytest.approx(
        (y["motor_torque"] - y["clutch_torque"])[1:-1], abs=0.02
    ), "the plate feels it"


def test_a_motor_at_rest_torque_does_not_ripple() -> None:
    ripple = LoneEffect("motor_torque_ripple", amplitude=0.3)
    s = ripple(DRIVE, STEP, motor_torque=0.0, drive_torque=0.0, angle=1.0, slip=10.0)
    assert s.motor_torque == s.drive_torque == 0.0


@pytest.mark.parametrize("offset", [0.3, -0.2])
@pytest.mark.parametrize("shaft", [{}, {"shaft_compliance.compliance": 1e-3}])
def test_a_drive_holds_a_speed_that_is_off_by_its_zero_error(offset: float, shaft: dict[str, float]) -> None:
    of = make_rig({"drive_speed_offset.offset": offset} | shaft)
    y, _ = simulate_states(of, press_rig(of, 3.4, 20.0), find_pressing_voltage(3.4), 20.0, 1.5)
    assert y["slip_speed"][-100:].mean() == pytest.approx(20.0 - offset, abs=1e-3)


def test_soft_shaft_keeps_the_motor_s_ripple_from_the_plate() -> None:
    """Above its eigenfrequency w_r a shaft lets M_m/(J w (w^2/w_r^2 - 1)) through to the plate's speed."""
    of = make_rig({"motor_torque_ripple.amplitude": 0.2, "shaft_compliance.compliance": 0.02})
    y, _ = simulate_states(of, press_rig(of, 3.4, 20.0), find_pressing_voltage(3.4), 20.0, 1.0)
    last = y[9000:]
    order, frequency = 24.0, 24.0 * 20.0
    basis = np.stack(
        [np.cos(order * last["angle"]), np.sin(order * last["angle"]), np.ones(last.size), last["time"]], axis=1
    )

    def amplitude(name: str) -> float:
        return float(np.hypot(*np.linalg.lstsq(basis, last[name], rcond=None)[0][:2]))

    above = frequency**2 * 0.02 * 0.2 * 0.8 * J
    expected = amplitude("motor_torque") / (J * frequency * (above - 1.0))
    assert amplitude("motor_torque") > 2.0
    assert amplitude("slip_speed") == pytest.approx(expected, rel=FRICTION_SLOPE)

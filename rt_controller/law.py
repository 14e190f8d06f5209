"""The control law of section 6.5: estimate, feedforward, torque feedback, pressure regulator, each term published.

Where a pressure is asked for, it is the demand of the pressure regulator; the estimate goes on.
"""

from math import exp, nan

from protocols.errors import InputError
from protocols.node import Column
from protocols.parameters import ParameterSet
from protocols.units import BAR, ZERO_CELSIUS
from rt_controller.adaptation import Adaptation, AdaptationSettings, LevelAdaptation, NoAdaptation
from rt_controller.estimator import Model, friction_state, torque_parts
from rt_controller.feedforward import ContactOnly, Feedforward, InverseModel
from rt_controller.lag import AT_REST, lagged
from rt_controller.phases import Phase
from rt_controller.regulator import EstimatedTorquePI, NoFeedback, TorqueFeedback, proportional_integral
from rt_controller.sample import Sample

LAWS = ("both", "feedforward", "feedback")  # the three rows of Table 6.6

TERMS = tuple(
    Column(*column)
    for column in (
        ("torque_demand_nm", "Nm", "M_d; not a number while a pressure is followed"),
        ("torque_estimate_nm", "Nm", "M_sim of eq. 6.9"),
        ("coulomb_part_nm", "Nm", "M_C m before the level"),
        ("viscous_part_nm", "Nm", "viscous part before level and correction"),
        ("friction_state", "1", "m of eq. 6.9"),
        ("feedforward_bar", "bar", "p_ff of eq. 6.8"),
        ("proportional_bar", "bar", "P of the torque feedback"),
        ("integral_bar", "bar", "I of the torque feedback"),
        ("pressure_demand_bar", "bar", "p_d"),
        ("pressure_bar", "bar", "measured cylinder pressure"),
        ("pressure_proportional_bar", "bar", "P of the pressure regulator"),
        ("pressure_integral_bar", "bar", "I of the pressure regulator"),
        ("voltage_v", "V", "asked of the valve, before the guard"),
        ("slip_rad_s", "rad/s", "observed slip speed"),
        ("slip_acceleration_rad_s2", "rad/s^2", "observed slip acceleration"),
        ("temperature_degc", "degC", "measured oil temperature"),
        ("observed_torque_nm", "Nm", "M_m - J alpha behind the slip observer's lag: what the adaptation learns from"),
        ("friction_level", "1", "adapted level"),
        ("viscous_correction", "1", "adapted correction of the viscous part"),
        ("adaptation_active", "1", "1 while the adaptation learns"),
        ("in_contact", "1", "1 while the plates are believed to touch"),
        ("frozen", "1", "1 while the torque integrator is held"),
        ("saturated", "1", "1 while pressure demand or voltage is at its limit"),
    )
)


class TorqueLaw:
    """Valve voltage for a torque demand, without a torque measurement, or for a pressure demand.

    `law` is one of LAWS, `adaptation` switches the adaptive level on. Attributes: `estimate` [Nm], `voltage` [V],
    `level` [-] and `terms`, in the order of TERMS, all of the last step.
    """

    def __init__(self, parameters: ParameterSet, law: str, adaptation: bool) -> None:
        if law not in LAWS:
            raise InputError(f"control law {law!r} is unknown; allowed are {', '.join(LAWS)}")
        self._feedback: TorqueFeedback = NoFeedback() if law == "feedforward" else EstimatedTorquePI()
        settings = AdaptationSettings(**parameters.si("adaptation"))
        self._adaptation: Adaptation = LevelAdaptation(settings) if adaptation else NoAdaptation(settings)
        self._contact_only = law == "feedback"
        self.configure(parameters)
        self.estimate = self.voltage = 0.0
        self.terms: tuple[float, ...] = (0.0,) * len(TERMS)
        self._coulomb = self._viscous = self._motor = AT_REST
        self._before = (0.0, 0.0, 0.0)  # Coulomb part, viscous part, motor torque of the sample before
        self._observed = 0.0
        self._m = 0.0
        self._contact = self._saturated = False
        self._pressure_integral = 0.0

    def configure(self, parameters: ParameterSet) -> None:
        """Take `parameters`; every state stays, so this may be done between two steps."""
        self.model = model = Model(**parameters.si("model"))
        torque, pressure, phases = (parameters.si(group) for group in ("torque", "pressure", "phases"))
        self._pressure_limit, self._pressure_floor = torque["pressure_limit"], pressure["floor"]
        self._k_p, self._k_i = pressure["proportional_gain"], pressure["integral_gain"]
        self._valve_gain, self._voltage_limit = pressure["valve_gain"], pressure["voltage_limit"]
        self._fill_pressure, self._contact_band = phases["fill_pressure"], phases["contact_band"]
        self._bandwidth, self._slip_hold = parameters["slip.bandwidth"].si, parameters["slip.hold"].si
        self._feedforward: Feedforward = ContactOnly(model) if self._contact_only else InverseModel(model)
        self._feedback.gains = torque["proportional_gain"], torque["integral_gain"]
        self._adaptation.settings = AdaptationSettings(**parameters.si("adaptation"))

    @property
    def level(self) -> float:
        """Adapted friction level [-]."""
        return self._adaptation.level

    @property
    def mismatch(self) -> float:
        """Torque observed at the motor minus estimate, both behind the lag of the slip observer [Nm]."""
        level, correction = self._adaptation.level, self._adaptation.viscous
        coulomb, viscous = self._coulomb[-1], self._viscous[-1]
        return self._observed - level * (coulomb + viscous) - correction * viscous

    def step(self, phase: Phase, demand: float, sample: Sample, step: float, followed: float | None = None) -> None:
        """Advance by `step` [s], 0 without a fresh sample, towards the torque `demand` [Nm].

        The demand is a magnitude; so are the estimate and the observed torque, whichever way the clutch slips.
        `followed` [Pa] is the pressure to be followed instead of the torque; None where there is none.
        """
        model, pressure, slip = self.model, sample.pressure, abs(sample.slip)
        closing = phase in (Phase.FILL, Phase.SLIP_CONTROL)
        floor = model.contact_pressure - (self._contact_band if self._contact else 0.0)
        self._contact = contact = closing and pressure >= floor

        # estimate, eq. 6.9; out of contact there is no torque and m is 0
        self._m = friction_state(model, self._m, pressure, slip, step) if contact else 0.0
        coulomb, viscous = torque_parts(model, self._m, pressure, slip, sample.temperature) if contact else (0.0, 0.0)
        self._adapt(phase, coulomb, viscous, sample, step)
        adaptation = self._adaptation
        level, correction = adaptation.level, adaptation.viscous
        self.estimate = level * (coulomb + viscous) + correction * viscous

        # torque loop: fig 6.16
        feedforward = wanted = least = 0.0
        frozen = not contact or self._saturated or step == 0.0
        held = frozen or slip < self._slip_hold
        if phase is Phase.SLIP_CONTROL and followed is not None:
            wanted, least = followed, self._pressure_floor
            if step > 0.0:
                # so that a request for the torque there is now asks for the pressure there is now
                known = contact and slip >= self._slip_hold
                self._feedback.follow(
                    pressure - self._feedforward(self.estimate, slip, level, correction) if known else 0.0
                )
        elif phase is Phase.SLIP_CONTROL:
            feedforward = self._feedforward(demand, slip, level, correction)
            wanted = feedforward + self._feedback(demand - self.estimate, step, held)
        else:
            self._feedback.follow(0.0)
            wanted = self._fill_pressure if phase is Phase.FILL else 0.0
        pressure_demand = min(max(wanted, least), self._pressure_limit)
        saturated = pressure_demand != wanted

        # pressure loop: rig.md
        error = pressure_demand - pressure if closing else 0.0
        p_term, i_term, self._pressure_integral = proportional_integral(
            self._pressure_integral if closing else 0.0, error, step, self._k_p, self._k_i, frozen
        )
        wanted = (pressure_demand + p_term + i_term) / self._valve_gain if closing else 0.0
        self.voltage = min(max(wanted, 0.0), self._voltage_limit)
        self._saturated = saturated or self.voltage != wanted
        self.terms = (
            demand if followed is None else nan, self.estimate, coulomb, viscous, self._m,
            feedforward / BAR, self._feedback.proportional / BAR, self._feedback.integral / BAR, pressure_demand / BAR,
            pressure / BAR, p_term / BAR, i_term / BAR, self.voltage,
            sample.slip, sample.acceleration, sample.temperature - ZERO_CELSIUS,
            self._observed, level, correction, adaptation.active, contact, held, self._saturated,
        )  # fmt: skip

    def _adapt(self, phase: Phase, coulomb: float, viscous: float, sample: Sample, step: float) -> None:
        """Compare both sides of the torque balance behind the same lag, and let the adaptation learn from it."""
        if step > 0.0:
            # The observer's second difference is centred on the sample before (lag.py).
            q = exp(-self._bandwidth * step)
            before, self._before = self._before, (coulomb, viscous, sample.motor_torque)
            self._coulomb = lagged(self._coulomb, before[0], q)
            self._viscous = lagged(self._viscous, before[1], q)
            self._motor = lagged(self._motor, before[2], q)
            observed = self._motor[-1] - self.model.motor_inertia * sample.acceleration  # torque balance, rig.md 8
            self._observed = observed if sample.slip >= 0.0 else -observed
        stuck = sample.motor_stuck > self._adaptation.settings.stuck_time
        sliding = phase is Phase.SLIP_CONTROL and self._contact and not stuck
        self._adaptation.update(
            self._coulomb[-1], self._viscous[-1], self._observed, sample.slip, sample.acceleration,
            sample.temperature, step, sliding,
        )  # fmt: skip

"""Gains of the pressure loop for the valve of a rig: those of the shipped rig, with all times longer by the same factor.

What            the controller's gains were designed for the shipped valve of 8 Hz. With a valve of 100 ms they wind up: the
                pressure passed the guard's limit, or swung below the contact pressure, and the clutch ended in a fault
Equation        lag of the valve and of the oil behind it, from the voltage to the pressure in the cylinder, while the plates
                touch:
                  T = max(2 zeta, 1/(2 zeta))/w + t_line,  t_line = (C_h + A^2/(k_stack + k_s))/G         docs/rig.md, 1 to 3
                factor of all times, for a dead time d:  r = max(1, (T + d)/(1.25 T_0)), T_0 = T of the shipped rig
                integral gains and rates of demands: the shipped ones over r; time-outs of fill and frozen pressure: times r
                share of a valve that swings:  s = min(1, zeta/0.7)
                proportional gain: the shipped one times min(s^2, T/(2 d)); integral gain of the pressure and proportional gain
                of the torque: times s
Why             a linear loop whose times are all r times as long, with the same proportional gains and integral gains over r,
                has the same response in the time t/r. So margins and overshoot stay as designed. It is lambda tuning with a
                closed-loop time in proportion to the lag. The torque loop is the outer one of the cascade and keeps its
                distance. 1/(2 zeta): the peak of a valve that swings. 1.25 and 0.7: two standard deviations of the shipped
                valve's parameters (frequency 6 %, damping 0.1); within them the gains are exactly the shipped ones.
                s: a PI loop swings from k_i = 2 zeta w (1 + k_p) on (Routh), the pressure's peak, about 1/(2 zeta), multiplies
                the gain of the torque loop, and k_p lowers the damping to zeta/sqrt(1 + k_p). s^2 is chosen: with s the error
                of `lock` is 1.4 times as large at a damping of 0.2
Assumptions     the sampling period is short against the lag; a valve that is faster than the shipped one keeps its gains
Valid range     on a grid of w 6..700 rad/s, zeta 0.1..3, d 0..50 ms, t_line 2..50 ms the loop is stable and its largest
                sensitivity is 1.50 (shipped rig: 1.16); with the shipped gains 199 of its 1440 cases are unstable
Not modelled    a step of the demand: the valve swings behind it by itself, at a damping of 0.1 by 2 Nm of 10 Nm in `lock`;
                stiction and hysteresis of the valve, the motion of the piston in a fill
References      Skogestad 2003, J. Process Control 13, 291-309 (gains from lag and dead time; its half rule sums lags);
                Astrom & Hagglund 2006, Advanced PID Control, secs. 4.2 and 6.2 (residence time 2 zeta/w + d; lambda tuning);
                the factors: chosen here, tests/rt_controller/test_valve_gains.py
"""

from dataclasses import dataclass

from protocols.files.parameters import ParameterSet

# Parameters that describe valve and line; the law itself does not use them
_FREQUENCY, _DAMPING, _DEAD_TIME, _LINE = (
    "pressure.valve_frequency", "pressure.valve_damping", "pressure.valve_delay", "pressure.line_lag",
)  # fmt: skip
VALVE = (_FREQUENCY, _DAMPING, _DEAD_TIME, _LINE)
_PROPORTIONAL = "pressure.proportional_gain"
_SWINGING = ("pressure.integral_gain", "torque.proportional_gain")
_SLOWER = ("pressure.integral_gain", "torque.integral_gain", "pressure.slow_rate", "lock.rate")
_LONGER = ("phases.frozen_dwell", "phases.fill_timeout")
# Two standard deviations of the shipped valve's lag, and the shipped damping less two; see Why
_DESIGNED_LAG, _DESIGNED_DAMPING = 1.25, 0.7
_DEAD_TIMES = 2.0  # lags over dead time below which the proportional gain falls: then its answer comes too late


@dataclass(frozen=True)
class Valve:
    """Valve and line as the pressure loop sees them: `frequency` [rad/s], `damping` [-], `dead_time` and `line` lag [s]."""

    frequency: float
    damping: float
    dead_time: float
    line: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> "Valve":
        """Return the valve that the controller's `parameters` describe."""
        return cls(*(parameters[name].si for name in VALVE))

    @property
    def lag(self) -> float:
        """T [s]: sum of the lags without the dead time; see Equation."""
        return max(2.0 * self.damping, 0.5 / self.damping) / self.frequency + self.line


def scale_gains(valve: Valve, designed: Valve) -> dict[str, float]:
    """Return factors of the controller's parameters by dotted name, for a `valve` other than the `designed` one; see Equation.

    Empty if the gains stay as they are.
    """
    slower = max(1.0, (valve.lag + valve.dead_time) / (_DESIGNED_LAG * (designed.lag + designed.dead_time)))
    share = min(1.0, valve.damping / _DESIGNED_DAMPING)
    proportional = share * share
    if valve.dead_time > 0.0:
        proportional = min(proportional, valve.lag / (_DEAD_TIMES * valve.dead_time))
    factors = dict.fromkeys(_SLOWER, 1.0 / slower) | dict.fromkeys(_LONGER, slower) | {_PROPORTIONAL: proportional}
    factors |= {name: share * factors.get(name, 1.0) for name in _SWINGING}
    return {name: factor for name, factor in factors.items() if factor != 1.0}

"""Claims of the thesis that do not hold here: which of their checks fail, and why."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Contradiction:
    """A claim that is known not to hold: `reason`, and the beginnings of the statements of its checks that fail.

    Its other checks must hold: a failure of one of them is news.
    """

    reason: str
    failing: tuple[str, ...]

    def list_news(self, failed: Sequence[str]) -> list[str]:
        """List the `failed` statements that are not known to fail, and the known ones that no longer do."""
        new = [statement for statement in failed if not statement.startswith(self.failing)]
        gone = [begin for begin in self.failing if not any(statement.startswith(begin) for statement in failed)]
        return new + gone


CONTRADICTED = {
    "figure-3.6": Contradiction(
        "misprints: both printed transfer functions contradict the printed system equations",
        ("tangential: transfer function as printed", "normal: transfer function as printed"),
    ),
    "figure-3.10": Contradiction(
        "a model in one direction has no tilting modes: two resonances below 500 Hz at own weight, not more",
        ("number of resonances up to 500 Hz under the own weight is above two",),
    ),
    "figure-3.11": Contradiction(
        "over the dynamometer torque, which is the friction, sliding is a damper: -22 dB/decade, not -40",
        ("dynamometer torque as input",),
    ),
    "figure-4.6": Contradiction(
        "eq 4.1 scales the viscous part with F_s too: one shape of the curve, one speed of its minimum at all loads",
        ("dry: the speed of the minimum grows with the load",),
    ),
    "figure-4.15": Contradiction(
        "eq 4.1 has one a_1 for all loads, and the simulator's lift-up takes more of a high "
        "load: depth falls with load",
        ("the Stribeck depth 1/a_1 grows with the load",),
    ),
    "figure-4.16": Contradiction(
        "the level 0.1148 to 0.113 is that of Table 6.3; Table 6.4, which the plant follows, gives 0.086 to 0.082",
        ("static: within 5 % of 0.1148",),
    ),
    "figure-4.18": Contradiction(
        "the simulator's film lifts by the speed alone, as much at every load: the butterfly "
        "is not clearest at the lowest",
        ("clearest at the lowest load",),
    ),
    "figure-4.13": Contradiction(
        "the simulator's lift-up is the same at every load, so speed shows at 280 N as much as at higher loads",
        ("the change with speed over that in a revolution",),
    ),
    "figure-6.8": Contradiction(
        "the axis of the figure contradicts eq 6.3 with Table 6.1, which the plant follows",
        ("mu at 52 and 147 degC lies within the axis",),
    ),
    "figure-6.9": Contradiction(
        "with gamma = 1/3 the viscous term is 18 % of the torque at 10 rpm, so temperature shows there",
        ("the change at 10 rpm is below what the sensor shows",),
    ),
    "table-6.3": Contradiction(
        "contradicts Tables 6.4 and 6.5 at 200 rpm, which the plant follows, by 6 % in slope",
        ("a_M [Nm/bar] within", "b_M [Nm] within", "mu [-] within"),
    ),
    "elements": Contradiction(
        "on a smooth curve without noise 10 elements err five times less than 4; on a measured contact they do not",
        ("pre-sliding: 4 elements err by at most a fifth more than 10",),
    ),
    "figure-D.4": Contradiction(
        "even error needs distances inverse to the root of the second derivative",
        ("largest error, inverse to f'' by equal distances",),
    ),
}

"""Adaptive feedforward on plants with other friction: the level is learnt from motor torque and slip acceleration.

The thesis names adaptive control with changing parameters as future work (chapter 7). Claim and cases are of this project.
"""

import numpy as np

from clutch_hil.bench.in_process import Played, play
from clutch_hil.thesis import register_reproduction
from clutch_hil.thesis.check_sheet import REFERENCE_COLOUR, Sheet
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.node import load_node

LEAST_GAIN = 5.0  # least factor by which adaptation must reduce the error; chosen: 20 % of friction become 4 %
SEEDS = 5  # of each case, for the noise of the sensors; chosen by judgement
FIRST_RISE_END = 0.5  # s, end of the first rise of the demand in the profile `engagement`
# change of plant parameters, oil temperature at the start [degC]
CASES: dict[str, tuple[dict[str, float], float]] = {
    "20 % low, falling 0.5 %/s": ({"friction_level.level": 0.8, "friction_level.drift": -0.005}, 70.0),
    "20 % high, rising 0.5 %/s": ({"friction_level.level": 1.2, "friction_level.drift": 0.005}, 70.0),
    "20 % low, cold oil warming up": ({"friction_level.level": 0.8}, 45.0),
    "viscous factor 30 % low": ({"clutch.viscous_slope": 1.869, "clutch.viscous_intercept": -4.543}, 70.0),
}


@register_reproduction(
    "adaptation",
    "Adaptive feedforward on a plant whose friction is 20 % off and drifting",
    claim="the regime error with adaptation is at most a fifth of the one without, in every case",
)
def reproduce_adaptation(sheet: Sheet) -> None:
    """Run every case with and without adaptation over all seeds."""
    profile = load_profile("engagement", 24.0)
    sheet.table = [("plant", "without [Nm]", "with [Nm]", "times better", "level at the end, true / learnt")]
    sheet.document = {"seeds": SEEDS, "cases": {}}
    first_pair: tuple[Played, Played] | None = None
    for i, (name, (values, temperature)) in enumerate(CASES.items()):
        parameters = wet_clutch.load_nominal().with_values(values)
        errors: dict[bool, list[float]] = {False: [], True: []}
        learnt = []
        for seed in range(SEEDS):
            pair = []
            for adaptive in (False, True):
                plant = PlantNode(parameters=parameters, profile=profile, seed=seed, temperature=temperature)
                pair.append(play(plant, load_node("controller")(adaptation=adaptive)))
                errors[adaptive].append(compute_regime_error(pair[-1]))
            learnt.append(float(pair[1]["controller_friction_level"][-1]))
            first_pair = first_pair or (pair[0], pair[1])
            sheet.progress(i * SEEDS + seed + 1, len(CASES) * SEEDS)
        without, with_it, learnt_level = (float(np.mean(v)) for v in (errors[False], errors[True], learnt))
        true = values.get("friction_level.level", 1.0) + values.get("friction_level.drift", 0.0) * profile.duration
        cells = (f"{without:.3f}", f"{with_it:.3f}", f"{without / with_it:.1f}", f"{true:.2f} / {learnt_level:.2f}")
        sheet.table.append((name, *cells))
        sheet.document["cases"][name] = {
            "without_nm": without,
            "with_nm": with_it,
            "level": true,
            "learnt": learnt_level,
        }
        sheet.check(
            f"times better, {name}",
            without >= LEAST_GAIN * with_it,
            without / with_it,
            f"at least {LEAST_GAIN:g} (this project)",
        )
    sheet.note(
        f"{profile.duration:g} s of the profile engagement, {SEEDS} seeds; mean absolute error of the true torque"
    )
    assert first_pair
    _draw(sheet, *first_pair)


def compute_regime_error(played: Played) -> float:
    """Compute the mean absolute error of the true torque [Nm] in the regime.

    The regime begins at the end of the first rise of the demand, because a plant with 20 % less friction never reaches 90 %.
    """
    time, demand = played["time_s"], played["controller_torque_demand_nm"]
    regime = (demand > 0.0) & (time >= FIRST_RISE_END)
    return float(np.mean(np.abs(played["truth_clutch_torque_nm"] - demand)[regime]))


def _draw(sheet: Sheet, without: Played, with_it: Played) -> None:
    error, level = sheet.make_axes(2, 1, height=6.0, sharex=True)
    for played, label in ((without, "without adaptation"), (with_it, "with adaptation")):
        difference = played["truth_clutch_torque_nm"] - played["controller_torque_demand_nm"]
        error.plot(played["time_s"], difference, lw=1.0, label=label)
    error.set_ylim(-6.0, 2.0)
    error.set_ylabel("true - demand [Nm]")
    error.legend(loc="lower right", ncols=2, frameon=False)
    error.set_title(f"friction {next(iter(CASES))}", loc="left", fontsize=10)
    time = with_it["time_s"]
    level.plot(time, 0.8 - 0.005 * time, color=REFERENCE_COLOUR, lw=1.0, ls="--", label="true level")
    level.plot(time, with_it["controller_friction_level"], color="#ff7f0e", label="learnt level")
    level.set_ylabel("friction level [-]")
    level.set_xlabel("time [s]")
    level.legend(loc="upper right", frameon=False)

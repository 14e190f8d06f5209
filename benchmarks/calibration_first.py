"""Calibration before discovery: rigs that lack nothing but a calibration. `python -m benchmarks.calibration_first`.

The rigs are those of benchmarks/identification.py, with all parameters off by at most 30, 10 or 3 %, or the five of the clutch
in docs/identify_method.md by at most 30 %. Each plays COURSES of `clutch-hil experiment identify`, by the battery's
truth, or with `--run` one closed loop of clutch-hil, which the checks of recordings may refuse. The search must name
nothing for such a rig.
"""

import argparse
import sys
from collections.abc import Sequence
from time import monotonic

import clutch_hil as ch
from benchmarks.identification import DRAWN, SUMP, draw, list_true_values, play
from clutch_hil.discrepancy.outcome import find_discrepancy
from clutch_hil.discrepancy.result import NAMED, ONE_OF
from protocols.errors import InputError
from protocols.files.run import Run

FIVE = (
    "clutch_coulomb_slope", "clutch_viscous_exponent", "clutch_stribeck_speed", "clutch_attraction", "piston_contact_pressure",
)  # fmt: skip
# chosen: they excite all parameters, and a search takes half as long as with all five
COURSES = "stribeck", "dynamics", "fills"
KINDS = {  # name: spread, parameters, spread of the sump [K]
    "all by 30 %": (0.3, DRAWN, SUMP),
    "all by 10 %": (0.1, DRAWN, SUMP / 3.0),
    "five by 30 %": (0.3, FIVE, 0.0),
    "all by 3 %": (0.03, DRAWN, SUMP / 10.0),  # only with --kind
}
FOLLOWED = ("table-6.6", "engagement")  # profiles with a torque demand; others were not tested
_REFUSED = "refused"
_TURNS = 3  # kinds that take turns


def play_closed_loop(seed: int, kind: str, profile: str) -> Run:
    """Return a closed-loop run on a rig of `KINDS`, with the shipped calibration and without adaptation."""
    true = list_true_values(draw(seed, *KINDS[kind]))
    plant = {name: value for name, value in true.items() if not name.startswith("sensors.")}
    return ch.simulate(profile=profile, plant=plant, adaptation=False)


def _play_runs(seed: int, kind: str, profile: str | None) -> list[Run]:
    if profile:
        return [play_closed_loop(seed, kind, profile)]
    return play(draw(seed, *KINDS[kind]), seed, names=COURSES)


def main(options: Sequence[str]) -> int:
    """Search in rigs, a line each, and the summary; exit code 1 if something was named."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.calibration_first", description=__doc__.partition("\n")[0]
    )
    parser.add_argument(
        "--rigs", type=int, default=30, help="number of rigs, 1 or more; the first three kinds take turns"
    )
    parser.add_argument("--first", type=int, default=1, help="seed of the first one")
    parser.add_argument("--kind", choices=KINDS, help="rigs of this kind alone")
    parser.add_argument("--run", choices=FOLLOWED, help="search in one closed loop of this profile, not in courses")
    given = parser.parse_args(options)
    if given.rigs < 1 or given.first < 0:
        parser.error(f"--rigs {given.rigs} and --first {given.first}: allowed are 1 or more, and 0 or more")
    named, verdicts = 0, {}
    for seed in range(given.first, given.first + given.rigs):
        kind = given.kind or list(KINDS)[seed % _TURNS]
        runs, begin = _play_runs(seed, kind, given.run), monotonic()
        try:
            outcome = find_discrepancy(runs, force=not given.run)
        except InputError as error:
            verdicts[_REFUSED] = verdicts.get(_REFUSED, 0) + 1
            print(f"rig {seed}, {kind}: refused: {error}", flush=True)
            continue
        verdict, recalibration = outcome.result.verdict, outcome.result.recalibration
        named += verdict in (NAMED, ONE_OF)
        verdicts[verdict] = verdicts.get(verdict, 0) + 1
        left = ""
        if recalibration:
            left = (
                f"; power above the floor: baseline {recalibration.before:.3g}, re-calibrated {recalibration.after:.3g},"
                f" best effects {recalibration.effects:.3g}"
            )
        print(f"rig {seed}, {kind}: {monotonic() - begin:.0f} s, {outcome}{left}", flush=True)
    print(f"named: {named} of {given.rigs}; {', '.join(f'{name} {count}' for name, count in verdicts.items())}")
    return int(named > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

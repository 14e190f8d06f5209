"""Memory: estimate what a search will allocate, from runs and model, before it starts.

Estimate        8 bytes a number; residuals are block means (evidence.py), counted over all runs and outputs
                columns    change by each strength of each candidate from each of its starts, twice while they are joined;
                           the sensitivities of the baseline, three times (start, base, fit)
                samples    columns of the runs, predicted outputs before and after, residuals: about five times the columns read
Not included    tests of claims, whose size depends on the regimes: atlas.py limits it
"""

from collections.abc import Sequence

from clutch_hil.fitting.evidence import BLOCK
from clutch_hil.fitting.model import Columns, Model
from protocols.errors import InputError
from protocols.files.bounds import MOST_BYTES

_NUMBER = 8  # bytes
_SAMPLE_COPIES = 5  # of the columns as read: see above
_BASELINE_COPIES = 3


def check_memory(model: Model, runs: Sequence[Columns], held_out: Sequence[Columns] = ()) -> None:
    """Raise InputError where a search in `runs` would take more memory than is allowed."""
    needed = estimate_memory(model, runs, held_out)
    if needed > MOST_BYTES:
        seconds = sum(float(run["time_s"][-1] - run["time_s"][0]) for run in runs)
        raise InputError(
            f"a search in these runs, {seconds:.4g} s with {len(model.candidates)} candidates, needs"
            f" {needed / (1 << 30):.3g} GiB of memory; allowed is {MOST_BYTES / (1 << 30):.3g} GiB: take some"
            f" {0.9 * seconds * MOST_BYTES / needed:.3g} s of them (clutch-hil convert RUN PART --from S --to S writes a part)"
        )


def estimate_memory(model: Model, runs: Sequence[Columns], held_out: Sequence[Columns] = ()) -> float:
    """Return the peak memory [bytes] of a search in `runs`, evaluated on `held_out`."""
    size = 0.0
    for run in runs:
        rows, period = len(run["time_s"]), float(run["time_s"][1] - run["time_s"][0])
        size += len(model.outputs) * rows / max(1, round(BLOCK / period))
    directions = 0
    for candidate in model.candidates:
        directions += len(candidate.strengths) * (1 + 2 * len(candidate.shapes))  # starts.collect_starts
    baseline = sum(p.uncertainty > 0.0 for p in model.parameters.values())
    samples = sum(len(run["time_s"]) * len(run) for run in (*runs, *held_out))
    return float(_NUMBER * (size * (2 * directions + _BASELINE_COPIES * baseline) + _SAMPLE_COPIES * samples))

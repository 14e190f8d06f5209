"""Plays the mutants of the safety path: `python -m tests.mutation [OPTIONS] [SUBJECT ...]`. 1 where one survives."""

import argparse
import ast
import importlib
import sys
import time
from collections.abc import Sequence

from tests.mutation.plain import leave_uncompiled

leave_uncompiled()  # before the bench is imported

import numpy as np  # noqa: E402

from protocols.errors import suggest_closest  # noqa: E402
from tests.mutation.by_hand import BY_HAND  # noqa: E402
from tests.mutation.mutants import (  # noqa: E402
    Check,
    is_killed,
    load_checks,
    load_mutant,
    make_mutants,
    mutated,
    parse_plain,
    read_source,
    run_checks,
)
from tests.mutation.subjects import SUBJECTS, Subject  # noqa: E402

_LEAST, _SHARE = 0.5, 3.0  # s, and multiple of what the checks of the unchanged module take: longest time of a mutant


def play(subject: Subject, share: int, words: Sequence[str], without_checks: bool) -> bool:
    """Play the mutants of a subject and print the result; return whether all were killed that must be.

    share: so many at least, evenly spread; 0 for all. words: only mutants whose label has one of them, if there are any.
    """
    module = importlib.import_module(subject.module)
    tree, checks = parse_plain(module), [] if without_checks else load_checks(subject.files, subject.argument)
    began = time.process_time()
    _run_unchanged(tree, checks)
    longest = _LEAST + _SHARE * (time.process_time() - began)
    population = make_mutants(module, tree, subject.only)
    chosen = population[:: max(1, len(population) // share)] if share else population
    if words:
        chosen = [mutant for mutant in population if any(word in mutant.label for word in words)]
    alive = []
    with np.errstate(all="ignore"):  # what a mutant divides by
        for mutant in chosen:
            with mutated(tree, mutant) as changed:
                if not is_killed(changed, checks, longest):
                    alive.append(mutant.label)
                    if mutant.label not in subject.equivalent:
                        print(f"  survives: {mutant.label}", flush=True)
    survivors = [label for label in alive if label not in subject.equivalent]
    not_alive = {mutant.label for mutant in chosen} - set(alive)
    wrong = [label for label in subject.equivalent if label in not_alive]
    wrong += [label for label in subject.equivalent if label not in {mutant.label for mutant in population}]
    print(
        f"{subject.module}: {len(population)} mutants, {len(chosen)} played by {len(checks)} checks,"
        f" {len(chosen) - len(alive)} killed, {len(alive) - len(survivors)} equivalent, {len(survivors)} survive,"
        f" {time.process_time() - began:.0f} s",
        flush=True,
    )
    for label in wrong:
        print(f"  listed as equivalent, but killed or gone: {label}")
    return not survivors and not wrong


def play_by_hand() -> bool:
    """Play the mutants set by hand and print the result; return whether all were killed."""
    all_killed = True
    for one in BY_HAND:
        module, subject = importlib.import_module(one.subject.module), one.subject
        source = read_source(module)
        assert source.count(one.old) == 1, one.what
        tree = parse_plain(module, source.replace(one.old, one.new))
        killed = is_killed(tree, load_checks(subject.files, subject.argument))
        print(f"{'killed' if killed else 'survives'}: {one.what}", flush=True)
        all_killed &= killed
    return all_killed


def _run_unchanged(tree: ast.Module, checks: Sequence[Check]) -> None:
    """Run all checks on the unchanged module; what fails is raised."""
    for _ in run_checks(load_mutant(tree), checks):
        pass


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("subjects", nargs="*", metavar="SUBJECT", help=f"all without one: {', '.join(SUBJECTS)}")
    parser.add_argument("--share", type=int, default=0, help="play about so many mutants of each, evenly spread")
    parser.add_argument("--by-hand", action="store_true", help="play those set by hand only")
    parser.add_argument("--without-checks", action="store_true", help="to see that survivors are told")
    parser.add_argument("--with", dest="words", action="append", default=[], help="play mutants with this text")
    options = parser.parse_args()
    if options.by_hand:
        return 0 if play_by_hand() else 1
    names = options.subjects or SUBJECTS
    if unknown := [name for name in names if name not in SUBJECTS]:
        parser.error(f"subject {unknown[0]!r} is unknown; {suggest_closest(unknown[0], SUBJECTS)}")
    if options.share < 0:
        parser.error(f"--share is {options.share}; allowed is 0, which plays all, and more")
    results = [play(SUBJECTS[name], options.share, options.words, options.without_checks) for name in names]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())

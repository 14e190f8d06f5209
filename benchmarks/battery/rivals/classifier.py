"""Residual classifier: random forest, extremely randomised trees and boosted trees, averaged; trained on the development split.

Trained on single effects, null cases and unknown effects of that split (their names are the classes `nothing_missing` and
`none_of_these`). On the development split itself it answers for what was left out of its training, five folds.
References      Breiman 2001, Machine Learning 45; Ke et al. 2017, NeurIPS 30 (histogram boosting)
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

_TREES = 600
_FOLDS = 5
_SEED = 6


def _forests() -> list[Any]:
    from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier, RandomForestClassifier

    return [
        RandomForestClassifier(_TREES, class_weight="balanced", min_samples_leaf=1, random_state=_SEED, n_jobs=2),
        ExtraTreesClassifier(_TREES, class_weight="balanced", min_samples_leaf=1, random_state=_SEED, n_jobs=2),
        HistGradientBoostingClassifier(max_iter=200, learning_rate=0.06, l2_regularization=1.0, random_state=_SEED),
    ]


class Classifier:
    """Probabilities of classes by features (cases, k)."""

    def __init__(self, x: np.ndarray, classes: Sequence[str]) -> None:
        self.classes = sorted(set(classes))
        index = np.array([self.classes.index(c) for c in classes])
        self._forests = [forest.fit(x, index) for forest in _forests()]

    def ranked(self, x: np.ndarray) -> list[list[tuple[str, float]]]:
        """Classes with probabilities, the most probable first, of each case."""
        p = np.mean([forest.predict_proba(x) for forest in self._forests], axis=0)
        return [sorted(zip(self.classes, row.tolist(), strict=True), key=lambda one: -one[1]) for row in p]


def left_out(x: np.ndarray, classes: Sequence[str]) -> list[list[tuple[str, float]]]:
    """Answers to the training cases, each by a classifier that was not shown it."""
    fold = np.random.default_rng(_SEED).permutation(len(classes)) % _FOLDS
    found: list[list[tuple[str, float]]] = [[] for _ in classes]
    for k in range(_FOLDS):
        inside = fold != k
        if not inside.any() or inside.all():
            continue
        trained = Classifier(x[inside], [c for c, ok in zip(classes, inside, strict=True) if ok])
        for i, answer in zip(np.flatnonzero(~inside), trained.ranked(x[~inside]), strict=True):
            found[i] = answer
    return found

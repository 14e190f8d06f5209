"""Classifier of residuals: mean of random forest, extremely randomised trees and boosted trees.

It is trained on single effects, null cases and unknown effects of the development split; the last two are the classes
`nothing_missing` and `none_of_these`. Its answers on the development split come from five-fold cross-validation.
References      Breiman 2001, Machine Learning 45; Ke et al. 2017, NeurIPS 30 (histogram boosting)
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

_TREES = 600  # of each forest; chosen by judgement: more take longer
_FOLDS = 5  # of the cross-validation; chosen: as is usual
_SEED = 6  # chosen: arbitrary, makes runs repeatable


def _make_forests() -> list[Any]:
    from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier, RandomForestClassifier

    return [
        RandomForestClassifier(_TREES, class_weight="balanced", min_samples_leaf=1, random_state=_SEED, n_jobs=2),
        ExtraTreesClassifier(_TREES, class_weight="balanced", min_samples_leaf=1, random_state=_SEED, n_jobs=2),
        HistGradientBoostingClassifier(max_iter=200, learning_rate=0.06, l2_regularization=1.0, random_state=_SEED),
    ]


class Classifier:
    """Classifier trained on features `x` (cases, k) and `classes` (cases,)."""

    def __init__(self, x: np.ndarray, classes: Sequence[str]) -> None:
        self.classes = sorted(set(classes))
        index = np.array([self.classes.index(c) for c in classes])
        self._forests = [forest.fit(x, index) for forest in _make_forests()]

    def rank_classes(self, x: np.ndarray) -> list[list[tuple[str, float]]]:
        """Rank the classes of each case of `x` (cases, k): pairs of class and probability, the most probable first."""
        p = np.mean([forest.predict_proba(x) for forest in self._forests], axis=0)
        return [sorted(zip(self.classes, row.tolist(), strict=True), key=lambda one: -one[1]) for row in p]


def cross_validate(x: np.ndarray, classes: Sequence[str]) -> list[list[tuple[str, float]]]:
    """Rank the classes of each training case by a classifier that was trained without it."""
    fold = np.random.default_rng(_SEED).permutation(len(classes)) % _FOLDS
    rankings: list[list[tuple[str, float]]] = [[] for _ in classes]
    for k in range(_FOLDS):
        inside = fold != k
        if not inside.any() or inside.all():
            continue
        trained = Classifier(x[inside], [c for c, ok in zip(classes, inside, strict=True) if ok])
        for i, answer in zip(np.flatnonzero(~inside), trained.rank_classes(x[~inside]), strict=True):
            rankings[i] = answer
    return rankings

"""Intervals: 95 % intervals and correlation of fitted parameters that hold where residuals last over many samples.

Equation        covariance = G/(G - 1) (J'J)^-1 [sum over G clusters of s s'] (J'J)^-1,  s = J_c' r_c
                interval: +-t(0.975, G - 1) sqrt(covariance), at least that of independent residuals
                a cluster is a contiguous stretch of five correlation times of the residual; with four runs or more also a run
Assumptions     clusters are independent of each other; the model is nearly linear over an interval
Not modelled    parameters at a bound: they are held there, and their interval is not-a-number
References      Liang and Zeger 1986, Biometrika 73; Cameron and Miller 2015, J. Hum. Resour. 50 (few clusters)
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import t

from plant_sim.friction.identification.least_squares import CONFIDENCE, Estimate

CORRELATED = 0.2  # of the autocorrelation: below it residuals count as uncorrelated; chosen
TIMES = 5  # correlation times in a cluster: ends of neighbours then hardly matter; chosen
CLUSTERS = (8, 60)  # least and most of them: fewer give no standard error, more bring nothing
AT_BOUND = 1e-3  # of a bound: a value nearer to it rests there; the search keeps off it by about 1e-8
AT_ZERO = 1e-9  # of the upper bound, where the lower one is 0
LEAST_RUNS = 4  # for which runs are clusters as well: a t quantile of 3.2


def compute_correlation_time(residuals: Sequence[np.ndarray]) -> int:
    """Samples after which the autocorrelation of `residuals`, one array for each record, has fallen below CORRELATED."""
    longest = 1
    for residual in residuals:
        centred = residual - residual.mean()
        power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
        correlation = np.fft.irfft(power)[: centred.size]
        low = np.flatnonzero(correlation < CORRELATED * correlation[0])
        longest = max(longest, int(low[0]) if low.size else centred.size)
    return longest


def split_clusters(residuals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Indices of the residuals of all records, in contiguous clusters of TIMES correlation times."""
    total = sum(one.size for one in residuals)
    length = TIMES * compute_correlation_time(residuals)
    count = int(np.clip(total // max(length, 1), *CLUSTERS))
    clusters, start = [], 0
    for one in residuals:
        share = max(round(count * one.size / total), 1)
        clusters += np.array_split(np.arange(start, start + one.size), share)
        start += one.size
    return clusters


def compute_intervals(
    estimate: Estimate, bounds: np.ndarray, residuals: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Intervals (m, 2) and correlation (m, m) of `estimate` within `bounds` (m, 2); `residuals` are those of each record."""
    low, high = bounds.T
    least = low + np.where(low != 0.0, AT_BOUND * np.abs(low), AT_ZERO * high)
    inside = (estimate.values > least) & (estimate.values < high - AT_BOUND * np.abs(high))
    inner = inside & (np.linalg.norm(estimate.jacobian, axis=0) > 0.0)
    half = np.full(estimate.values.size, np.nan)
    correlation = np.full((half.size, half.size), np.nan)
    np.fill_diagonal(correlation, 1.0)
    if inner.any():
        rows = estimate.jacobian[:, inner]
        size = np.linalg.norm(rows, axis=0)
        residual = np.concatenate(residuals)
        groups = [split_clusters(residuals)]
        if len(residuals) >= LEAST_RUNS:
            ends = np.cumsum([one.size for one in residuals])
            groups.append(np.split(np.arange(residual.size), ends[:-1]))
        inverse = np.linalg.pinv((rows / size).T @ (rows / size), rcond=1e-13, hermitian=True)
        freedom = max(residual.size - int(inner.sum()), 1)
        largest = float(residual @ residual) / freedom * inverse
        widest = t.ppf(0.5 + CONFIDENCE / 2.0, freedom) * np.sqrt(np.maximum(np.diag(largest), 0.0))
        for group in groups:
            count = len(group)
            scores = np.array([(rows[one] / size).T @ residual[one] for one in group])
            own = count / (count - 1) * inverse @ (scores.T @ scores) @ inverse
            half_own = t.ppf(0.5 + CONFIDENCE / 2.0, count - 1) * np.sqrt(np.maximum(np.diag(own), 0.0))
            if group is groups[0]:
                deviation = np.sqrt(np.maximum(np.diag(own), np.finfo(float).tiny))
                correlation[np.ix_(inner, inner)] = own / np.outer(deviation, deviation)
            widest = np.maximum(widest, half_own)
        half[inner] = widest / size
    return np.column_stack([estimate.values - half, estimate.values + half]), correlation

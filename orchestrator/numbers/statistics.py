"""Compute statistics of draws."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence


def clopper_pearson(count: int, n: int, level: float = 0.95) -> list[float]:
    """Compute the exact interval (%) of a binomial share.

    See Clopper & Pearson, Biometrika 26 (1934) 404.
    """
    from scipy.special import betaincinv  # the quantile of the beta distribution

    tail = (1.0 - level) / 2.0
    low = betaincinv(count, n - count + 1, tail) if count else 0.0
    high = betaincinv(count + 1, n - count, 1.0 - tail) if count < n else 1.0
    return [100.0 * float(low), 100.0 * float(high)]


def median_interval(
    values: Sequence[float], level: float = 0.95
) -> tuple[float, float, float]:
    """Compute the median of values, and its confidence interval.

    The interval is the narrowest one between two of the values, equally many from
    either end, that holds the median of the population with at least this probability,
    whatever the distribution: Thompson, Annals of Mathematical Statistics 7 (1936) 122.
    For fewer than six values (at 0.95) it extends from the smallest to the largest.
    """
    ordered, n = sorted(values), len(values)
    below, cut = 0.0, 0
    for k in range((n - 1) // 2):
        below += math.comb(n, k) / 2.0**n
        if below > (1.0 - level) / 2.0:
            break
        cut = k + 1
    first = max(cut - 1, 0)
    return statistics.median(ordered), ordered[first], ordered[n - 1 - first]

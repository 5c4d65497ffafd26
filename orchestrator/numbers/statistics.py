"""Statistics of draws."""

from __future__ import annotations


def clopper_pearson(count: int, n: int, level: float = 0.95) -> list[float]:
    """The exact interval (%) of a binomial share: Clopper & Pearson, Biometrika 26 (1934) 404."""
    from scipy.special import betaincinv  # the quantile of the beta distribution

    tail = (1.0 - level) / 2.0
    low = betaincinv(count, n - count + 1, tail) if count else 0.0
    high = betaincinv(count + 1, n - count, 1.0 - tail) if count < n else 1.0
    return [100.0 * float(low), 100.0 * float(high)]

"""Model a magnetic torquer rod: hysteresis of its core and current of its winding.

The current i is expressed as the dipole that it stands for, x = area_turns i (A m2). A
core with the remanence rho (the fraction of the dipole at the limit X that remains at
zero current) has

    m = (1 - 2 rho) x + 4 rho / N sum_k p_k,       p_k <- min(max(p_k, x - r_k), x + r_k)

with N plays p_k of half widths r_k = (k - 1/2) X / N: a Prandtl-Ishlinskii operator of
even density, which tends to Rayleigh's law as N grows. From the demagnetised core m is
X at X, and rho X is left at 0; the loop of a cycle of +-X has the area 8/3 rho X^2 (1 +
1/(2 N^2)).

Source: Rayleigh, Phil. Mag. 23 (1887) 225; Brokate & Sprekels, Hysteresis and Phase
Transitions (1996), ch. 2.
"""

from __future__ import annotations

from math import inf, log

from ..maths.moments import first_order, part

PLAYS = 8

Plays = tuple[float, float, float, float, float, float, float, float]
DEMAGNETISED: Plays = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

# Maximum number of pieces into which a monotonic current divides a time: one more than
# plays.
CUTS = PLAYS + 1
JOINED = 1e-12  # tolerance, relative to the limit, within which a play has joined


def warm(resistance: float, temperature: float, coefficient: float) -> float:
    """Compute the resistance (Ohm) of a winding at a temperature (K).

    `resistance` is that at 293.15 K (Ohm), `coefficient` in 1/K.
    """
    return resistance * (1.0 + coefficient * (temperature - 293.15))


def half_width(k: int, limit: float) -> float:
    """Return the half width r_k (A m2) of play k, from 0 on."""
    return (k + 0.5) * limit / PLAYS


def move_plays(plays: Plays, x: float, limit: float) -> Plays:
    """Update the plays after the current has changed monotonically to x (A m2)."""
    a, b, c, d, e, f, g, h = plays
    return (
        _move_play(a, x, half_width(0, limit)),
        _move_play(b, x, half_width(1, limit)),
        _move_play(c, x, half_width(2, limit)),
        _move_play(d, x, half_width(3, limit)),
        _move_play(e, x, half_width(4, limit)),
        _move_play(f, x, half_width(5, limit)),
        _move_play(g, x, half_width(6, limit)),
        _move_play(h, x, half_width(7, limit)),
    )


def _move_play(p: float, x: float, r: float) -> float:
    """Update one play of half width r: limit p to x +- r."""
    return min(max(p, x - r), x + r)


def dipole(x: float, plays: Plays, remanence: float) -> float:
    """Compute the dipole m (A m2) at the current x (A m2)."""
    a, b, c, d, e, f, g, h = plays
    return (1.0 - 2.0 * remanence) * x + 4.0 * remanence / PLAYS * (
        a + b + c + d + e + f + g + h
    )


def _next(plays: Plays, x: float, limit: float, up: bool) -> tuple[int, float]:
    """Count the plays that move with a current at x (A m2), rising or falling.

    The second result is the current at which the next play joins them (A m2).
    """
    along, level = 0, inf if up else -inf
    for k in range(PLAYS):
        r = half_width(k, limit)
        joins = plays[k] + r if up else plays[k] - r
        if (joins <= x + JOINED * limit) if up else (joins >= x - JOINED * limit):
            along += 1
        else:
            level = min(level, joins) if up else max(level, joins)
    return along, level


# Mean and slope of m (A m2) over a time, the means of m^2 and x^2 (A2 m4), and x at its
# end (A m2).
Over = tuple[float, float, float, float, float]


def over(
    plays: Plays,
    x: float,
    towards: float,
    lag: float,
    time: float,
    limit: float,
    remanence: float,
) -> tuple[Over, Plays]:
    """Integrate a rod over a time (s) in which its current tends to `towards` (A m2).

    The current starts at x (A m2) and has the time constant lag (s); 0: it takes its
    final value at once. The result is exact: the time is divided where a play joins.
    """
    plays = move_plays(plays, x, limit)
    if lag <= 0.0:
        plays = move_plays(plays, towards, limit)
        m = dipole(towards, plays, remanence)
        return (m, 0.0, m * m, towards * towards, towards), plays
    mean = slope = square = heat = begin = 0.0
    for cut in range(CUTS):
        up = towards > x
        along, level = _next(plays, x, limit, up)
        end = time
        if cut < PLAYS and ((level < towards) if up else (level > towards)):
            end = min(begin + lag * log((towards - x) / (towards - level)), time)
        steep = 1.0 - 2.0 * remanence + 4.0 * remanence / PLAYS * along
        rest = dipole(x, plays, remanence) - steep * x
        x_mean, x_slope, after, x_square = first_order(x, towards, (end - begin) / lag)
        if end < time:
            after = level
        length = (end - begin) / time
        a, b = part(begin / time, end / time, rest + steep * x_mean, steep * x_slope)
        mean, slope = mean + a, slope + b
        square += length * (
            rest * (rest + 2.0 * steep * x_mean) + steep * steep * x_square
        )
        heat += length * x_square
        x, begin = after, end
        plays = move_plays(plays, x, limit)
        if begin >= time:
            break
    return (mean, slope, square, heat, x), plays

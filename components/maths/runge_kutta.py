"""Integrate a state of seven numbers by one explicit Runge-Kutta step.

The orders are 4, 6 and 8. Each function integrates y' = f(e, y) from y at e, with y'
per second and e the fraction of an outer step; the step is `dt` seconds, or `de` of
that fraction. The products stand in a fixed order, so that a translation to C gives the
same bits. In `f(e + c de, y + sum a k)` c and a are the method's table.
"""

from __future__ import annotations

from collections.abc import Callable

State = tuple[float, float, float, float, float, float, float]
Slope = Callable[[float, State], State]  # f(e, y) = y', per second


def step4(f: Slope, e: float, y: State, de: float, dt: float) -> State:
    """Integrate one step by the classical method: 4 stages, order 4."""
    half = e + 0.5 * de
    k1 = f(e, y)
    k2 = f(half, _plus1(y, 0.5 * dt, k1))
    k3 = f(half, _plus1(y, 0.5 * dt, k2))
    k4 = f(e + de, _plus1(y, dt, k3))
    a = dt / 6.0
    return _plus4(y, a, k1, 2.0 * a, k2, 2.0 * a, k3, a, k4)


def step6(f: Slope, e: float, y: State, de: float, dt: float) -> State:
    """Integrate one step by Butcher's method: 7 stages, order 6.

    Source: Butcher, On Runge-Kutta processes of high order, J. Austral. Math. Soc. 4 (1964)
    179.
    """
    third, half = e + de / 3.0, e + 0.5 * de
    h = dt
    k1 = f(e, y)
    k2 = f(third, _plus1(y, h / 3.0, k1))
    k3 = f(e + de / 1.5, _plus1(y, h / 1.5, k2))
    k4 = f(third, _plus3(y, h / 12.0, k1, h / 3.0, k2, h / -12.0, k3))
    k5 = f(
        half, _plus4(y, h / -16.0, k1, h * 1.125, k2, h * -0.1875, k3, h * -0.375, k4)
    )
    k6 = f(half, _plus4(y, h * 1.125, k2, h * -0.375, k3, h * -0.75, k4, h * 0.5, k5))
    k7 = f(
        e + de,
        _plus5(
            y,
            h * 9.0 / 44.0,
            k1,
            h * -9.0 / 11.0,
            k2,
            h * 63.0 / 44.0,
            k3,
            h * 18.0 / 11.0,
            k4,
            h * -16.0 / 11.0,
            k6,
        ),
    )
    end, inner, middle = h * 11.0 / 120.0, h * 0.675, h * -4.0 / 15.0
    return _plus5(
        _plus1(y, end, k1), inner, k3, inner, k4, middle, k5, middle, k6, end, k7
    )


def step8(f: Slope, e: float, y: State, de: float, dt: float) -> State:
    """Integrate one step by the method of Dormand and Prince: 12 stages, order 8.

    It is the formula with which DOP853 advances. Source: Hairer, Norsett, Wanner,
    Solving Ordinary Differential Equations I (1993), sec. II.5; the table is that of
    their program dop853.
    """
    h = dt
    k1 = f(e, y)
    k2 = f(e + 0.05260015195876773 * de, _plus1(y, 0.05260015195876773 * h, k1))
    k3 = f(
        e + 0.0789002279381516 * de,
        _plus2(y, 0.0197250569845379 * h, k1, 0.0591751709536137 * h, k2),
    )
    k4 = f(
        e + 0.1183503419072274 * de,
        _plus2(y, 0.02958758547680685 * h, k1, 0.08876275643042054 * h, k3),
    )
    k5 = f(
        e + 0.2816496580927726 * de,
        _plus3(
            y,
            0.2413651341592667 * h,
            k1,
            -0.8845494793282861 * h,
            k3,
            0.924834003261792 * h,
            k4,
        ),
    )
    k6 = f(
        e + de / 3.0,
        _plus3(
            y, h / 27.0, k1, 0.17082860872947386 * h, k4, 0.12546768756682242 * h, k5
        ),
    )
    k7 = f(
        e + 0.25 * de,
        _plus4(
            y,
            0.037109375 * h,
            k1,
            0.17025221101954405 * h,
            k4,
            0.06021653898045596 * h,
            k5,
            -0.017578125 * h,
            k6,
        ),
    )
    k8 = f(
        e + 0.3076923076923077 * de,
        _plus5(
            y,
            0.03709200011850479 * h,
            k1,
            0.17038392571223998 * h,
            k4,
            0.10726203044637328 * h,
            k5,
            -0.015319437748624402 * h,
            k6,
            0.008273789163814023 * h,
            k7,
        ),
    )
    k9 = f(
        e + 0.6512820512820513 * de,
        _plus3(
            _plus3(
                y,
                0.6241109587160757 * h,
                k1,
                -3.3608926294469414 * h,
                k4,
                -0.868219346841726 * h,
                k5,
            ),
            27.59209969944671 * h,
            k6,
            20.154067550477894 * h,
            k7,
            -43.48988418106996 * h,
            k8,
        ),
    )
    k10 = f(
        e + 0.6 * de,
        _plus4(
            _plus3(
                y,
                0.47766253643826434 * h,
                k1,
                -2.4881146199716677 * h,
                k4,
                -0.590290826836843 * h,
                k5,
            ),
            21.230051448181193 * h,
            k6,
            15.279233632882423 * h,
            k7,
            -33.28821096898486 * h,
            k8,
            -0.020331201708508627 * h,
            k9,
        ),
    )
    k11 = f(
        e + 0.8571428571428571 * de,
        _plus5(
            _plus3(
                y,
                -0.9371424300859873 * h,
                k1,
                5.186372428844064 * h,
                k4,
                1.0914373489967295 * h,
                k5,
            ),
            -8.149787010746927 * h,
            k6,
            -18.52006565999696 * h,
            k7,
            22.739487099350505 * h,
            k8,
            2.4936055526796523 * h,
            k9,
            -3.0467644718982196 * h,
            k10,
        ),
    )
    k12 = f(
        e + de,
        _plus5(
            _plus4(
                y,
                2.273310147516538 * h,
                k1,
                -10.53449546673725 * h,
                k4,
                -2.0008720582248625 * h,
                k5,
                -17.9589318631188 * h,
                k6,
            ),
            27.94888452941996 * h,
            k7,
            -2.8589982771350235 * h,
            k8,
            -8.87285693353063 * h,
            k9,
            12.360567175794303 * h,
            k10,
            0.6433927460157636 * h,
            k11,
        ),
    )
    return _plus4(
        _plus4(
            y,
            0.054293734116568765 * h,
            k1,
            4.450312892752409 * h,
            k6,
            1.8915178993145003 * h,
            k7,
            -5.801203960010585 * h,
            k8,
        ),
        0.3111643669578199 * h,
        k9,
        -0.1521609496625161 * h,
        k10,
        0.20136540080403034 * h,
        k11,
        0.04471061572777259 * h,
        k12,
    )


# y + a p + b q + ... for one to five slopes. They are written out because most of a
# step's time is spent here.


def _plus1(y: State, a: float, p: State) -> State:
    """Return y + a p."""
    return (
        y[0] + a * p[0],
        y[1] + a * p[1],
        y[2] + a * p[2],
        y[3] + a * p[3],
        y[4] + a * p[4],
        y[5] + a * p[5],
        y[6] + a * p[6],
    )


def _plus2(y: State, a: float, p: State, b: float, q: State) -> State:
    """Return y + (a p + b q)."""
    return (
        y[0] + (a * p[0] + b * q[0]),
        y[1] + (a * p[1] + b * q[1]),
        y[2] + (a * p[2] + b * q[2]),
        y[3] + (a * p[3] + b * q[3]),
        y[4] + (a * p[4] + b * q[4]),
        y[5] + (a * p[5] + b * q[5]),
        y[6] + (a * p[6] + b * q[6]),
    )


def _plus3(
    y: State, a: float, p: State, b: float, q: State, c: float, r: State
) -> State:
    """Return y + (a p + b q + c r)."""
    return (
        y[0] + (a * p[0] + b * q[0] + c * r[0]),
        y[1] + (a * p[1] + b * q[1] + c * r[1]),
        y[2] + (a * p[2] + b * q[2] + c * r[2]),
        y[3] + (a * p[3] + b * q[3] + c * r[3]),
        y[4] + (a * p[4] + b * q[4] + c * r[4]),
        y[5] + (a * p[5] + b * q[5] + c * r[5]),
        y[6] + (a * p[6] + b * q[6] + c * r[6]),
    )


def _plus4(
    y: State,
    a: float,
    p: State,
    b: float,
    q: State,
    c: float,
    r: State,
    d: float,
    s: State,
) -> State:
    """Return y + (a p + b q + c r + d s)."""
    return (
        y[0] + (a * p[0] + b * q[0] + c * r[0] + d * s[0]),
        y[1] + (a * p[1] + b * q[1] + c * r[1] + d * s[1]),
        y[2] + (a * p[2] + b * q[2] + c * r[2] + d * s[2]),
        y[3] + (a * p[3] + b * q[3] + c * r[3] + d * s[3]),
        y[4] + (a * p[4] + b * q[4] + c * r[4] + d * s[4]),
        y[5] + (a * p[5] + b * q[5] + c * r[5] + d * s[5]),
        y[6] + (a * p[6] + b * q[6] + c * r[6] + d * s[6]),
    )


def _plus5(
    y: State,
    a: float,
    p: State,
    b: float,
    q: State,
    c: float,
    r: State,
    d: float,
    s: State,
    e: float,
    t: State,
) -> State:
    """Return y + (a p + b q + c r + d s + e t)."""
    return (
        y[0] + (a * p[0] + b * q[0] + c * r[0] + d * s[0] + e * t[0]),
        y[1] + (a * p[1] + b * q[1] + c * r[1] + d * s[1] + e * t[1]),
        y[2] + (a * p[2] + b * q[2] + c * r[2] + d * s[2] + e * t[2]),
        y[3] + (a * p[3] + b * q[3] + c * r[3] + d * s[3] + e * t[3]),
        y[4] + (a * p[4] + b * q[4] + c * r[4] + d * s[4] + e * t[4]),
        y[5] + (a * p[5] + b * q[5] + c * r[5] + d * s[5] + e * t[5]),
        y[6] + (a * p[6] + b * q[6] + c * r[6] + d * s[6] + e * t[6]),
    )

"""docs/papers/exchange: what the exchange of mean and slope is worth, measured."""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import Any

from desat.analyses import convergence
from desat.study.case import Options

from .page import Page

CASES = (("gyrostat/full", "slew, desaturation and gravity gradient, 600 s"),
         ("gyrostat/free", "slew without external torque, 600 s"),
         ("gyrostat/stress", "stress values, no external torque, 200 s"))  # fmt: skip


def cell(value: float | None) -> str:
    """An error as text."""
    return "" if value is None else f"{value:.1e}"


def main() -> None:
    """Write the page."""
    page = Page("exchange", "An exchange between components that conserves momentum")
    page.text(
        """A craft cut into FMUs behaves like the uncut one only if what one component gives is
        what another takes. Here wheels, torquers and thrusters hand over the mean of their torque
        or dipole over the step and its slope, that is impulse and first moment, and the master
        lets each component step with the values of those before it. The case is a rigid craft with
        three wheels with lag and friction, three lagging torquers, gravity gradient and a sampled
        PID (`ssp/gyrostat`); the truth is its monolithic solution (DOP853, rtol 1e-13)."""
    )
    for name, title in CASES:
        study: dict[str, Any] = convergence.study(name, Options(), jobs=os.cpu_count() or 1)
        page.heading(f"{title[0].upper()}{title[1:]}")
        page.table(
            ["master", "step s", "attitude rad", "wheel momentum N m s", "momentum residual N m s",
             "attitude, same delays", "wheel momentum, same delays"],
            [[r["algorithm"], f"{r['step']:g}",
              *(cell(r[k]) for k in list(asdict(convergence.Row("", 0, 0, 0, 0)))[2:7])]
             for r in study["rows"]],
        )  # fmt: skip
        page.text(
            f"Observed order of the conserving master: {study['order']:.2f} in attitude, "
            f"{study['order_wheel_momentum']:.2f} in the wheels' momentum."
        )
        page.figure(
            name.partition("/")[2],
            f"Largest attitude error, {title}",
            convergence.plot(study, "attitude_error", "rad"),
        )
    page.text(
        """Under `jacobi`, what other masters do, each link of the loop costs a step; against the
        ideal truth its error is these delays and nothing else: against a truth with the same delays
        it converges as the conserving master does. In the stress case the order falls to 2: there
        the wheels' friction is so strong that the extrapolation of the body's rate over the step
        is what counts."""
    )
    page.write()

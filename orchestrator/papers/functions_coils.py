"""The verbs of pages about momentum management by coils; part of `verbs.py`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ..runs.run import Options, prepare
from ..system.errors import DesatError
from .session import Change, Sources


class CoilVerbs:
    """Verbs that need a run of single coils and a `desat bound` of them."""

    _of: Sources

    def least_energy(self, scenario: str, change: Change | None = None) -> dict[str, Any]:
        """Of a run that unloads by coils: its `energy` and `peak` and the `least` energy with no
        larger one, as `desat bound` gives them."""
        from ..analyses import coil_bound

        run = self._of.run(scenario, change)
        return asdict(coil_bound.of_run(run.manifest, run.results))

    def energy_curve(self, scenario: str, peaks: Sequence[float]) -> list[tuple[float, float]]:
        """Of the same the least energy of each largest momentum of a wheel (N m s)."""
        from ..analyses import coil_bound

        run = self._of.run(scenario)
        return coil_bound.curve(run.manifest, run.results, peaks)

    def least_time(self, scenario: str, number: str, held: float) -> dict[str, float]:
        """Of a detumbling run whose `number` (min) says when it is slow, for `held` (s): when it is
        (`law`), when it could be (`found`) and what no law is below (`floor`), in min."""
        from ..analyses.papers import least_time

        run = self._of.run(scenario)
        if (slow := run.manifest["numbers"][number]["value"]) is None:
            if self._of.draft is None:
                raise DesatError(f"{scenario}: {number} is not reached")
            return dict.fromkeys(("law", "found", "floor"), math.nan)
        times = asdict(least_time.of_run(run.manifest, run.results, 60.0 * slow, held))
        return {name: value / 60.0 for name, value in times.items()}

    def periods(self, scenario: str, periods: Sequence[float]) -> list[dict[str, float]]:
        """What an open-loop law would do for desaturation periods (s), on the field of a run."""
        from ..analyses.papers import desaturation

        run = self._of.run(scenario)
        return desaturation.study(run.manifest, run.results, periods)

    def onboard(self, scenario: str) -> float:
        """Multiplications and divisions a second of a law of momentum management."""
        from ..analyses.papers import onboard

        system, _ = prepare(self._of.name_of(scenario), Options(blocks=True)).or_raise()
        return onboard.work(system)

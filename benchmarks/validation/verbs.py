"""Verbs of pages beyond those of all: what holds runs against the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from desat.analyses import coverage
from desat.runs.run import Options, prepare
from desat.system.model import AUTO

from ..pages.verbs import Verbs
from . import calibration, convergence
from .estimate import difference
from .reference import Gyrostat


class ValidationVerbs(Verbs):
    """Those of all pages, and these."""

    def convergence(self, scenario: str) -> dict[str, Any]:
        """A scenario at several steps against its monolithic reference: `rows`,
        `order`."""
        options = Options(stop=self._of.end_of(scenario, None))
        return convergence.study(
            self._of.name_of(scenario), options, jobs=self._of.jobs
        )

    def exchange(self, scenario: str, substeps: int | None = None) -> dict[str, Any]:
        """A scenario at its own step against its reference, with other substeps:
        errors, the run's own estimate, and the numbers that it is covered by."""
        options = Options(stop=self._of.end_of(scenario, None), substeps=substeps)
        name, step = self._of.name_of(scenario), float(self.setting(scenario, "step"))
        study = convergence.study(
            name, options, (step,), ("gauss_seidel",), self._of.jobs
        )
        bound = coverage.bound(prepare(name, options).or_raise()[0])
        return {**study["rows"][0], **(asdict(bound) if bound else {})}

    def chosen(self, scenario: str) -> dict[str, Any]:
        """A scenario whose run chooses its substeps, against its reference: the error
        with one (`once`), with those that it takes, its own estimate (rad), their
        number, and how many it has flown beforehand for each of the run's."""
        name, stop = self._of.name_of(scenario), self._of.end_of(scenario, None)
        system, _ = prepare(name, Options(stop=stop)).or_raise()
        ideal = Gyrostat(system).ideal()
        once, run = (
            convergence.fly(name, Options(stop=stop, substeps=n)) for n in (1, AUTO)
        )
        errors = [difference(f.q, f.h, ideal.q, ideal.h)[0] for f in (once, run)]
        choice = run.choice
        assert choice is not None
        share = choice.flown / (choice.substeps * system.steps)
        return {
            **choice.to_json(),
            "once": errors[0],
            "error": errors[1],
            "flown_share": share,
        }

    def hidden_work(self, scenario: str, substeps: int) -> dict[str, Any]:
        """The error of a run against one with 64 substeps, and the work that its steps
        hide; of a scenario, or of a craft of `calibration.JETS`."""
        values = calibration.JETS.get(scenario)
        name = self._of.name_of("pulses" if values else scenario)
        stop = self._of.end_of("pulses" if values else scenario, None)
        return calibration.held(scenario, name, (substeps,), values, stop)[0]._asdict()

    def told_apart(self, first: int, count: int) -> dict[str, Any]:
        """So many craft made at random, from this seed on: `rows`, and what they sum up
        to."""
        short = {} if self._of.draft is None else {"stop": self._of.draft}
        rows = calibration.at_random(range(first, first + count), **short)
        return {**calibration.summed(rows), "rows": [r._asdict() for r in rows]}

    def summed(self, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
        """The same sums of rows from elsewhere."""
        return calibration.summed(calibration.Row(**r) for r in rows)

    def convergence_plot(
        self, file: str, caption: str, study: dict[str, Any], key: str, unit: str
    ) -> str:
        """An error of such a study over the steps."""
        return self._figure(file, caption, convergence.plot(study, key, unit))

"""Run campaigns: thousands of cases of a system's dispersions, on one machine or many.

plan.py     the definition of a campaign; a case is a function of plan and number alone
case.py     one case as a row
store.py    the folder: Parquet files of full blocks of cases, journals of the others
cluster.py  the cases on a Dask cluster
coordinator.py  hands out cases and keeps rows
draws.py, pairs.py  draws and sweeps in memory, and pairs
spread.py   the spread of a number over runs
judged.py, report.py  the results

The package can be called: `desat.campaign(...)` is `desat.cases(...)`.
"""

import sys
from types import ModuleType
from typing import Any


class _Campaign(ModuleType):
    """The package as a function, whose name it has."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Run the missing cases of a campaign, as `desat.cases` does."""
        from .. import cases

        return cases(*arguments, **options)


sys.modules[__name__].__class__ = _Campaign

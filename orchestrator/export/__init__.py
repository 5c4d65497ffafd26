"""Export a loop as one FMU, a block as C, series as tables, a system as .ssp.

The package can be called: `desat.export(run, "parquet", "out")`.
"""

from __future__ import annotations

import sys
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..runs.run import Run


class _Export(ModuleType):
    """The package as a function, whose name it has."""

    def __call__(
        self,
        run: Run | str | PathLike[str],
        form: str = "csv",
        folder: str | PathLike[str] | None = None,
    ) -> list[Path]:
        """Write a run's series or plots for other programs, as `desat export run` does.

        Parameters
        ----------
        run
            A run, or the folder of one.
        form
            csv, parquet or mat, or svg, png or pdf of its plots.
        folder
            Where the files go; None: the run's folder.

        Returns
        -------
        list of Path
            The files.

        Raises
        ------
        DesatError
            If there is no such form, the folder has no run, or the run has none.
        """
        from .series import export, export_run

        if isinstance(run, (str, PathLike)):
            place = None if folder is None else Path(folder)
            return export(Path(run), form, place)[0]
        return export_run(run, form, folder)


sys.modules[__name__].__class__ = _Export

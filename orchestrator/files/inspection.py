"""Inspect an FMU for `desat check` without loading its binary.

Only its description is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from desat.components.contract.block import Variable
from desat.components.contract.units import conversion, unit_of

from ..system.errors import DesatError, plain
from ..system.interface import base_name, role_classes
from ..system.parameters import known_unit
from . import library
from .fmu import SIGNAL_KINDS, root_of, structure_faults

INDICES = re.compile(r"\[(\d+(?:,\d+)*)\]$")
SUFFIX = ".fmu"
DESCRIPTION = "modelDescription.xml"
CAUSALITIES = (
    "input",
    "output",
    "parameter",
    "calculatedParameter",
    "structuralParameter",
    "local",
    "independent",
    "dependent",
)
# Element of a description -> purpose of the FMU.
KINDS = {
    "CoSimulation": "co-simulation",
    "ModelExchange": "model exchange",
    "ScheduledExecution": "scheduled execution",
    "Implementation/CoSimulation_StandAlone": "co-simulation",
    "Implementation/CoSimulation_Tool": "co-simulation by a tool",
}
MOST_FAULTS = (
    100  # lines: a description of thousands of variables may violate a rule in each
)


@dataclass(frozen=True)
class InspectedVariable:
    """A variable, or an array of scalars with a common name: `q[1]`, `q[2]`, ..."""

    name: str
    causality: str
    type: str
    shape: tuple[int, ...]  # largest index of each dimension; () for a scalar
    unit: str
    description: str


@dataclass(frozen=True)
class RoleFit:
    """How an FMU fits one of our roles, by the names of its variables."""

    role: str
    outputs: tuple[str, ...]  # of the role, that it has
    lacking: tuple[str, ...]  # outputs of the role that it lacks
    misfits: tuple[str, ...]  # outputs and inputs of another type, size or unit
    open_inputs: tuple[str, ...]  # inputs that the role does not have

    @property
    def fit(self) -> str:
        """Return whether it can take the place of a block: fits, in part, or not.

        In part means that it has some of the outputs, as a law without thrusters does.
        """
        if self.misfits or not self.outputs:
            return "does not fit"
        return "fits in part" if self.lacking else "fits"

    def text(self) -> str:
        """Describe the fit in a line."""
        parts = [f"gives {', '.join(self.outputs)}"] if self.outputs else []
        for heading, names in (
            ("lacks", self.lacking),
            ("does not fit in", self.misfits),
            ("has inputs of its own", self.open_inputs),
        ):
            parts += [f"{heading} {', '.join(names)}"] if names else []
        return "; ".join([f"{self.role}: {self.fit}", *parts])


@dataclass(frozen=True)
class InspectedFmu:
    """Findings about an FMU without loading its binary."""

    path: str
    model: str
    fmi: str
    kinds: tuple[str, ...]
    platforms: tuple[str, ...]
    sha256: str
    ours: bool
    variables: tuple[InspectedVariable, ...]
    roles: tuple[RoleFit, ...]  # those of whose outputs it has any
    problems: tuple[str, ...]  # violations of the standard, a line each
    warnings: tuple[str, ...]  # reasons why it would not run here, a line each

    def of_causality(self) -> dict[str, list[InspectedVariable]]:
        """Group the variables by causality, in the order of `CAUSALITIES`."""
        variables: dict[str, list[InspectedVariable]] = {
            name: [] for name in CAUSALITIES
        }
        for variable in self.variables:
            variables.setdefault(variable.causality, []).append(variable)
        return {name: of for name, of in variables.items() if of}


def is_fmu(target: str) -> bool:
    """Return whether a target of `check` is an FMU, by name or extracted."""
    path = Path(target)
    return path.suffix.lower() == SUFFIX or (path / DESCRIPTION).is_file()


def inspect_fmu(path: Path) -> InspectedFmu:
    """Read the description of an FMU and check it against the standard.

    Raises
    ------
    DesatError
        If the file cannot be read, is no archive, or holds no model description of
        FMI 1.0, 2.0 or 3.0.
    """
    if not path.exists():
        raise DesatError(f"{path}: No such file or directory")
    fmu = library.load(path)
    root = root_of(fmu.folder, path.name)
    kinds = tuple(
        name for element, name in KINDS.items() if root.find(element) is not None
    )
    if root.get("fmiVersion") == "1.0" and not kinds:
        kinds = (KINDS["ModelExchange"],)  # FMI 1.0 has no element for it
    problems = [
        *(_reference_faults(root) or structure_faults(fmu.folder)),
        *_implementation_faults(fmu.folder, root),
    ]
    variables: tuple[InspectedVariable, ...] = ()
    try:
        variables = _variables(fmu.description)
    except Exception as error:  # fmpy raises many kinds
        problems = problems or [f"its variables cannot be read: {_line(error)}"]
    if len(problems) > MOST_FAULTS:
        problems = [*problems[:MOST_FAULTS], f"and {len(problems) - MOST_FAULTS} more"]
    return InspectedFmu(
        path=str(path),
        model=root.get("modelName", ""),
        fmi=root.get("fmiVersion", ""),
        kinds=kinds,
        platforms=tuple(fmu.platforms),
        sha256=fmu.sha256,
        ours=fmu.ours,
        variables=variables,
        roles=tuple(_role_fits(variables)),
        problems=tuple(plain(f"{path.name}: {text}") for text in problems),
        warnings=() if problems else tuple(map(plain, _obstacles(fmu))),
    )


def _role_fits(variables: Sequence[InspectedVariable]) -> Iterator[RoleFit]:
    """Yield how an FMU fits each role of whose outputs it has any, the best first."""
    known_variables = {(v.causality, v.name): v for v in variables}
    inputs = {name for causality, name in known_variables if causality == "input"}
    fit_value = []
    for role, declared in role_classes().items():
        of_role: dict[str, list[Variable]] = {
            "input": [],
            "output": [],
            "parameter": [],
        }
        for v in declared.variables:
            if v.name != "fault":
                of_role[v.causality].append(v)
        outputs = [
            v for v in of_role["output"] if ("output", v.name) in known_variables
        ]
        if not outputs:
            continue
        misfits = [
            f"{v.name} ({reason})"
            for v in (*outputs, *of_role["input"])
            if (variable := known_variables.get((v.causality, v.name)))
            and (reason := _misfit(variable, v))
        ]
        input_names = {v.name for v in of_role["input"]}
        fit_value.append(
            RoleFit(
                role,
                tuple(v.name for v in outputs),
                tuple(v.name for v in of_role["output"] if v not in outputs),
                tuple(misfits),
                tuple(sorted(inputs - input_names)),
            )
        )
    yield from sorted(
        fit_value,
        key=lambda f: (f.fit != "fits", len(f.lacking) - len(f.outputs), f.role),
    )


def _misfit(variable: InspectedVariable, declared: Variable) -> str:
    """Return how a variable differs from that of a role; empty if it does not."""
    kind = SIGNAL_KINDS.get(variable.type, variable.type)
    if kind != declared.type:
        return f"{variable.type}, {declared.type} is needed"
    if tuple(variable.shape) != tuple(declared.shape):
        sizes = [
            " x ".join(map(str, s)) or "1" for s in (variable.shape, declared.shape)
        ]
        return f"{sizes[0]} elements, {sizes[1]} are needed"
    unit = known_unit(variable.unit) if variable.unit else None
    fit = unit is None or conversion(unit, unit_of(declared.unit)) is not None
    return "" if fit else f"unit {variable.unit}, {declared.unit} is needed"


def _line(error: Exception) -> str:
    """Return the first line of an error's message."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _reference_faults(root: Any) -> list[str]:
    """Find references of ModelStructure and derivatives to missing variables.

    FMI 2.0 counts variables from 1; FMI 3.0 names them by their value references.
    """
    if root.get("fmiVersion") == "1.0":
        return []
    third = root.get("fmiVersion").startswith("3.")
    variables = root.findall("ModelVariables/*")
    if third:
        references = {v.get("valueReference") for v in variables}
        key, allowed = "valueReference", "the value reference of a variable"
    else:
        references = {str(i) for i in range(1, len(variables) + 1)}
        key, allowed = "index", f"1 to {len(variables)}"
    faults = []
    for element in root.iterfind("ModelStructure//*"):
        for attribute in (key, "dependencies"):
            for text in (element.get(attribute) or "").split():
                if text not in references:
                    faults.append(
                        f"ModelStructure: {element.tag}: {attribute} {text}: allowed is {allowed}"
                    )
    for variable in variables:
        derived = variable if third else next(iter(variable), variable)
        text = derived.get("derivative")
        if text is not None and text not in references:
            name = variable.get("name")
            faults.append(f"{name}: derivative {text}: allowed is {allowed}")
    return faults


def _implementation_faults(folder: Path, root: Any) -> list[str]:
    """Find faults of an extracted FMU's binaries, by their names alone."""
    elements = [root] if root.get("fmiVersion") == "1.0" else list(root)
    names = {e.get("modelIdentifier") for e in elements if e.get("modelIdentifier")}
    sources = folder / "sources"
    has_sources = sources.is_dir() and any(sources.iterdir())
    binaries = sorted(p for p in (folder / "binaries").glob("*") if p.is_dir())
    files = {p.name: {q.stem for q in p.iterdir() if q.is_file()} for p in binaries}
    lacking = [
        f"binaries/{platform} has no library {name}, which modelIdentifier names"
        for platform, stems in files.items()
        for name in sorted(names - stems)
    ]
    if not any(files.values()) and not has_sources:
        return ["neither a library in binaries/ nor sources/"]
    return lacking


def _variables(description: Any) -> tuple[InspectedVariable, ...]:
    """Return the variables of a description.

    Scalars with a common name are one array.
    """
    variables: dict[tuple[str, str], InspectedVariable] = {}
    for v in description.modelVariables:
        causality = v.causality or "local"
        key = (base_name(v.name), causality)
        before = variables.get(key)
        unit = v.unit or getattr(v.declaredType, "unit", None) or ""
        variables[key] = InspectedVariable(
            name=key[0],
            causality=causality,
            type=v.type,
            shape=_larger(before.shape if before else (), _shape_of(v)),
            unit=before.unit if before else unit,
            description=before.description if before else v.description or "",
        )
    return tuple(variables.values())


def _shape_of(variable: Any) -> tuple[int, ...]:
    """Return the shape of an FMI 3.0 array, or the indices that end a scalar's name."""
    if variable.shape:
        return tuple(variable.shape)
    indices = INDICES.search(variable.name)
    return tuple(int(x) for x in indices[1].split(",")) if indices else ()


def _larger(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    """Return the larger index of each dimension."""
    if len(one) != len(other):
        return max(one, other, key=len)
    return tuple(map(max, one, other))


def _obstacles(fmu: library.FmuFile) -> list[str]:
    """Return why an FMU that satisfies the standard would not run here, a line each."""
    try:
        obstacle = library.find_obstacle(fmu)
    except DesatError as error:
        return [str(error)]
    return [obstacle] if obstacle else []

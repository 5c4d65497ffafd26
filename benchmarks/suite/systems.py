"""The systems of the suite: each about one thing, with what is expected of it.

The numbers follow from suite.c by hand. A copy of the variable n is n; a sum over the
steps of a constant c is c times the stop time.
"""

from __future__ import annotations

from collections.abc import Iterator

from .files import (
    NAMESPACES,
    Archive,
    Component,
    System,
    Variable,
    description,
    element,
)

BIG = 256 << 20  # bytes of zeros in the archive that is a bomb
FAULTS = ("discard", "error", "fatal", "not_a_number", "crash", "exit", "endless")
NESTED = 6  # entities of ten: a million words


def _pair(
    name: str,
    about: str,
    source: Variable,
    target: Variable,
    result: Variable,
    value: float = 0.0,
    *,
    version: str = "2.0",
    wire: str = "",
    refused: bool = False,
) -> System:
    """Connect an output of `a` with an input of `b` that has a result."""
    return System(
        name,
        about,
        (
            Component("a", (source,), version=version),
            Component("b", (target, result), version=version),
        ),
        (f"a.{source.name}|b.{target.name}{wire}",),
        {f"b.{result.name}": value} if value else {},
        refused or not value,
    )


def types() -> Iterator[System]:
    """One of each type: an output of it feeds an input of it."""
    values = {"Real": 5, "Integer": 5, "Boolean": 1, "Enumeration": 5, "String": 5}
    wide = 4_000_000_000
    values_3 = {
        "Float64": 5,
        "Float32": 5,
        "Int8": -100,
        "Int16": -30_000,
        "Int32": -2_000_000_000,
        "Int64": -wide,
        "UInt8": 200,
        "UInt16": 60_000,
        "UInt32": wide,
        "UInt64": wide,
        "Boolean": 1,
        "Enumeration": 5,
        "String": 5,
        "Binary": 5,
    }
    for version, types_ in (("2.0", values), ("3.0", values_3)):
        for type_, value in types_.items():
            reference = 16 + (7 if "Int" in type_ and version == "3.0" else 5)
            refused = type_ == "Binary" or abs(value) == wide
            ending = ", or refused" if refused else ""
            result = Variable("y", 17, type_)
            number = "Real" if version == "2.0" else "Float64"
            if type_ in ("String", "Binary"):
                result = Variable("length", 65, number)
            yield _pair(
                f"type_{type_}_{version[0]}",
                f"{type_} of FMI {version} is passed on{ending}.",
                Variable("y", reference, type_),
                Variable("u", 1, type_),
                result,
                value,
                version=version,
                refused=refused,
            )
    rows = (Variable("c", 6, "Clock"), Variable("y", 21, "Float64"))
    yield System(
        "type_Clock_3",
        "A Clock that nobody needs is in the description; a refusal will do.",
        (Component("a", rows, version="3.0"),),
        numbers={"a.y": 5},
        refused=True,
    )


def names() -> Iterator[System]:
    """Names that FMI 2.0 allows for any variable."""
    all_names = {
        "brackets": "y[2].z[1,3]",
        "dots": "y.z.der(w)",
        "quotes": "'y \"z\" <&>'",
        "not_ascii": "größe_μ_y速度",
        "blanks": "y and z",
        "long": "y" * 1000,
    }
    for key, name in all_names.items():
        yield _pair(
            f"name_{key}",
            f"Names with {key.replace('_', ' ')} are connected and read.",
            Variable(name, 21),
            Variable(name.replace("y", "u"), 1),
            Variable(name, 17),
            5,
        )
    rows = (Variable("Y", 20), Variable("y", 21))
    yield System(
        "name_case",
        "Two names differ by case alone.",
        (
            Component("a", rows),
            Component(
                "b",
                (
                    Variable("U", 0),
                    Variable("u", 1),
                    Variable("Y", 16),
                    Variable("y", 17),
                ),
            ),
        ),
        ("a.Y|b.U", "a.y|b.u"),
        {"b.Y": 4, "b.y": 5},
    )


def units() -> Iterator[System]:
    """Units of both ends of a connection."""
    linear = '|<ssc:LinearTransformation factor="2" offset="1"/>'
    cases = {
        "same": ("m", "m", 5, "", "Both ends have the same unit."),
        "factor": ("km", "m", 5000, "", "km feeds m: a factor."),
        "offset": ("degC", "K", 278.15, "", "degC feeds K: an offset."),
        "dimension": ("m", "s", 0, "", "m feeds s: to be refused."),
        "suppressed": (
            "km",
            "m",
            5,
            '|suppressUnitConversion="true"',
            "The number itself is passed on.",
        ),
        "linear": ("", "", 11, linear, "A linear transformation without units."),
    }
    for key, (source, target, value, wire, about) in cases.items():
        yield _pair(
            f"unit_{key}",
            about,
            Variable("y", 21, unit=source),
            Variable("u", 1, unit=target),
            Variable("y", 17, unit=target),
            value,
            wire=wire,
        )


def arrays() -> Iterator[System]:
    """Arrays of FMI 3.0, and elements by their names in FMI 2.0."""
    size = '<Dimension valueReference="72"/>'
    three = '<Dimension start="3"/>'
    fixed = (
        Variable("u", 70, "Float64", inner=three, start="1 2 3"),
        Variable("y", 71, "Float64", inner=three),
    )
    sized = (
        Variable("n", 72, "UInt64", start="3"),
        Variable("u", 70, "Float64", inner=size, start="1 2 3"),
        Variable("y", 71, "Float64", inner=size),
    )
    twice = {f"a.y[{n}]": 2 * n for n in (1, 2, 3)}
    for key, rows in (("fixed", fixed), ("structural", sized)):
        about = f"An array of three, its size {key}."
        component = Component("a", rows, version="3.0")
        yield System(f"array_{key}", about, (component,), numbers=twice)
    yield System(
        "array_connection",
        "One connection passes on a whole array.",
        tuple(Component(name, fixed, version="3.0") for name in "ab"),
        ("a.y|b.u",),
        {f"b.y[{n}]": 4 * n for n in (1, 2, 3)},
    )
    crossed = tuple(
        Variable(f"{x}[{n}]", r + n) for x, r in (("u", 0), ("y", 16)) for n in (1, 2)
    )
    yield System(
        "array_elements",
        "Connections of elements by their names, crossed.",
        (
            Component("a", (Variable("y[1]", 20), Variable("y[2]", 21))),
            Component("b", crossed),
        ),
        ("a.y[1]|b.u[2]", "a.y[2]|b.u[1]"),
        {"b.y[1]": 5, "b.y[2]": 4},
    )


def loops() -> Iterator[System]:
    """Order, feedback and the values before the first step."""
    source = Component("a", (Variable("y", 37),))  # 11
    total = Component("b", (Variable("u", 1), Variable("x", 49)))
    yield System(
        "chain_in_order",
        "The sum of 11 from the first step on.",
        (source, total),
        ("a.y|b.u",),
        {"b.x": 110},
    )
    yield System(
        "chain_reversed",
        "The same with the target declared first.",
        (total, source),
        ("a.y|b.u",),
        {"b.x": 110},
    )
    through = Component("c", (Variable("u", 1), Variable("y", 33)))
    yield System(
        "chain_through",
        "The first step has what came through a component declared later: 23.",
        (total, through, source),
        ("a.y|c.u", "c.y|b.u"),
        {"b.x": 230},
    )
    state = (Variable("u", 7), Variable("x", 55))
    yield System(
        "feedback",
        "Two sums, each of the other, both start with 1: doubled at each step.",
        tuple(Component(name, state) for name in "ab"),
        ("a.x|b.u", "b.x|a.u"),
        {"a.x": 1024, "b.x": 1024},
    )
    yield System(
        "feedback_through",
        "x + 2 x + 1 at each step from 1 on, y = 2 x + 1 at once: (3^11 - 1) / 2.",
        (Component("a", state), through),
        ("a.x|c.u", "c.y|a.u"),
        {"a.x": 88573},
    )
    yield System(
        "feedback_start",
        "The first step of the same: the loop is consistent before it.",
        (through, Component("a", state)),
        ("a.x|c.u", "c.y|a.u"),
        {"a.x": 4},
        stop=1.0,
    )
    yield System(
        "loop_algebraic",
        "y = 2 (2 y + 1) + 1 at once: its solution, or a refusal.",
        tuple(Component(name, through.variables) for name in "ab"),
        ("a.y|b.u", "b.y|a.u"),
        {"a.y": -1},
        refused=True,
    )


def parameter_set(**numbers: float) -> str:
    """Return a parameter set of Reals; `__` in a name is a dot."""
    rows = "".join(
        element(
            "ssv:Parameter", element("ssv:Real", value=x), name=name.replace("__", ".")
        )
        for name, x in numbers.items()
    )
    inner = element("ssv:Parameters", rows)
    return f'<ssv:ParameterSet {NAMESPACES} version="1.0" name="p">{inner}</ssv:ParameterSet>'


def values(mapping: str = "", **numbers: float) -> str:
    """Return a parameter set inline, as a binding."""
    inner = element("ssd:ParameterValues", parameter_set(**numbers)) + mapping
    return element("ssd:ParameterBindings", element("ssd:ParameterBinding", inner))


def parameters() -> Iterator[System]:
    """Parameter sets, and systems in systems."""
    rows = (Variable("u", 1), Variable("p", 8), Variable("y", 17), Variable("q", 24))
    from_file = element(
        "ssd:ParameterBindings",
        element("ssd:ParameterBinding", source="resources/p.ssv"),
    )
    entry = element("ssm:MappingEntry", source="speed", target="p")
    mapping = element(
        "ssd:ParameterMapping", element("ssm:ParameterMapping", entry, version="1.0")
    )
    mapping = mapping.replace(
        "<ssm:ParameterMapping", f"<ssm:ParameterMapping {NAMESPACES}"
    )
    yield System(
        "parameter_inline",
        "A set inside the description.",
        (Component("a", rows, inside=values(p=7.0)),),
        numbers={"a.q": 7},
    )
    yield System(
        "parameter_file",
        "A set in a file.",
        (Component("a", rows, inside=from_file),),
        numbers={"a.q": 7},
        files={"resources/p.ssv": parameter_set(p=7.0)},
    )
    yield System(
        "parameter_mapping",
        "A mapping names the parameter.",
        (Component("a", rows, inside=values(mapping, speed=7.0)),),
        numbers={"a.q": 7},
    )
    yield System(
        "parameter_over_start",
        "A value for an input that nobody feeds.",
        (Component("a", rows, inside=values(u=7.0)),),
        numbers={"a.y": 7},
    )
    yield System(
        "parameter_outer",
        "A value of the system over that of its component.",
        (Component("a", rows, inside=values(p=7.0)),),
        inside=values(a__p=8.0),
        numbers={"a.q": 8},
    )
    ends = "".join(
        element("ssd:Connector", "<ssc:Real/>", name=name, kind=kind)
        for name, kind in (("in", "input"), ("out", "output"))
    )
    wires = '<ssd:Connection startConnector="in" endElement="b" endConnector="u"/>'
    wires += '<ssd:Connection startElement="b" startConnector="y" endConnector="out"/>'
    inner = (
        element("ssd:Connectors", ends)
        + element("ssd:Elements", "{b}")
        + element("ssd:Connections", wires)
    )
    yield System(
        "nested",
        "A system within the system, with connectors of its own.",
        (
            Component("a", (Variable("y", 21),)),
            Component("b", (Variable("u", 1), Variable("y", 33))),
            Component("c", (Variable("u", 1), Variable("y", 17))),
        ),
        ("a.y|inner.in", "inner.out|c.u"),
        {"c.y": 11},
        layout="{a}" + element("ssd:System", inner, name="inner") + "{c}",
    )


def faults() -> Iterator[System]:
    """FMUs that fail in the step from 3 s on: the host says so, and lives."""
    time = (Variable("t", 64),)
    for number, fault in enumerate(FAULTS, 1):
        about = f"The fourth step: {fault.replace('_', ' ')}."
        yield System(
            f"fault_{fault}", about, (Component("a", time, number),), refused=True
        )
    longer = Component("a", (Variable("t", 64, "Float64"),), 8, "3.0")
    yield System(
        "fault_longer",
        "The fourth step ends 1 s late, by lastSuccessfulTime.",
        (longer,),
        refused=True,
    )
    yield System(
        "fault_logs",
        "A thousand messages a step, and no fault.",
        (Component("a", time, 9),),
        numbers={"a.t": 10},
    )


def attacks() -> Iterator[System]:
    """Files that are wrong or hostile: a message, and nothing outside the folder."""
    rows = (Variable("y", 21),)
    text = description(Component("a", rows))

    def outside(entries: Archive) -> None:
        entries |= {"../" * n + "outside.txt": b"outside" for n in (1, 2, 3)}

    def zeros(entries: Archive) -> None:
        entries["resources/zeros.bin"] = bytes(BIG)

    def no_binary(entries: Archive) -> None:
        for name in [name for name in entries if name.startswith("binaries/")]:
            entries[name.replace("binaries/", "binaries/other-")] = entries.pop(name)

    def described(name: str, about: str, old: str, new: str, more: str = "") -> System:
        variables = "<ModelVariables>"
        changed = text.replace(old, new).replace(variables, variables + more)
        assert changed != text

        def spoil(entries: Archive) -> None:
            entries["modelDescription.xml"] = changed.encode("latin-1")

        return System(
            f"attack_{name}", about, (Component("a", rows, spoil=spoil),), refused=True
        )

    one = (Component("a", rows),)
    safe = {"a.y": 5.0}  # where only the entry is left out
    yield System(
        "attack_parent_ssp",
        "Entries ../outside.txt in the .ssp.",
        one,
        numbers=safe,
        refused=True,
        spoil=outside,
    )
    yield System(
        "attack_parent_fmu",
        "The same in the .fmu.",
        (Component("a", rows, spoil=outside),),
        numbers=safe,
        refused=True,
    )
    yield System(
        "attack_bomb",
        "256 MiB of zeros in a small .ssp.",
        one,
        refused=True,
        spoil=zeros,
    )
    yield System("attack_truncated", "Half of an .ssp.", one, refused=True, share=0.5)
    yield System(
        "attack_no_binary",
        "No binary for any platform.",
        (Component("a", rows, spoil=no_binary),),
        refused=True,
    )
    yield described(
        "guid", "The GUID is not that of the library.", "{suite-0", "{other"
    )
    yield described(
        "no_identifier", "No modelIdentifier.", 'modelIdentifier="suite"', ""
    )
    yield described(
        "path_identifier",
        "A path as modelIdentifier.",
        'er="suite"',
        'er="../linux64/suite"',
    )
    yield described(
        "not_utf_8", "Bytes that are not UTF-8.", 'name="y"', 'name="größe"'
    )
    root = "<fmiModelDescription"
    external = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    yield described("external", "An external entity.", root, external + root, "&e;")
    laughs = "".join(
        f'<!ENTITY e{n} "{10 * f"&e{n - 1};"}">' for n in range(1, NESTED + 1)
    )
    laughs = f'<!DOCTYPE x [<!ENTITY e0 "ha">{laughs}]>'
    yield described(
        "laughs",
        "Entities of entities.",
        root,
        f'{laughs}{root} description="&e{NESTED};"',
    )
    twins = (Variable("y", 21, "Float64"), Variable("z", 21, "Float64"))
    yield System(
        "attack_twins",
        "Two variables of FMI 3.0 with one value reference.",
        (Component("a", twins, version="3.0"),),
        refused=True,
    )


GROUPS = {
    "types": types,
    "names": names,
    "units": units,
    "arrays": arrays,
    "loops": loops,
    "parameters": parameters,
    "faults": faults,
    "attacks": attacks,
}


def systems() -> dict[str, tuple[str, System]]:
    """Return all systems by name, each with its group."""
    return {s.name: (group, s) for group, make in GROUPS.items() for s in make()}

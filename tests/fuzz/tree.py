"""Command lines generated from the command tree: each command with each of its options.

An option that is added is in a line at once, with a value of its type; EXAMPLES has
values that reach further than those.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Any

from typer.main import get_command

from desat.cli import app_for

EXAMPLES = {
    "--set": "manager.gain=1e-3",
    "--source": "manager=manager_cross_product",
    "--stop": "3",
    "--step": "1",
    "--substeps": "1",
    "--accuracy": "1e-7",
    "--output-class": "manager.m_cmd_body=interval",
    "--design": "now",
    "--record": "manager.*",
    "--trust": "trusted.txt",
    "--time-limit": "9",
    "--call-limit": "9",
    "--case-limit": "9",
    "--laws": "all",
    "--law": "manager_cross_product",
    "--by": "peak",
    "--for": "largest_momentum",
    "--between": "1e-4,1e-2",
    "--sampling": "random",
    "--keep": "every:1",
    "--curve": "speed",
    "--cluster": "local:1",
    "--format": "csv",
    "--outputs": "spacecraft.*",
    "--inputs": "manager.h_target_body",
    "--parameters": "manager.gain",
    "--without": "manager",
    "--slider": "manager.gain=1e-4:1e-2",
    "--platforms": "linux64",
    "--compiler": "false -O0",
    "--slew": "60/300",
    "--rods": "0.1",
    "--inclinations": "10",
    "--altitudes": "400",
    "--dipoles": "0.1",
    "--altitude": "400km",
    "--inclination": "51.6deg",
    "--sso": "500km",
    "--ltan": "10:30",
    "--tle": "iss.tle",
    "--orbit": "500x39860km",
    "--sun": "1.52AU",
    "--epoch": "2027-01-01T00:00:00Z",
    "--mass": "16kg",
    "--size": "12U",
    "--box": "0.2,0.2,0.4",
    "--inertia": "0.2,0.2,0.1",
    "--wheels": "4 pyramid 30mNms",
    "--thrusters": "4 1N",
    "--dump": "thrusters 70:10",
    "--panel": "13m2 1.35m",
    "--isp": "220s",
    "--propellant": "5kg",
    "--pointing": "inertial",
    "--secular": "80uNm",
    "--torque": "torque.csv body",
    "--residual-dipole": "0.05",
}
"""A right value of each option that takes more than a number."""
ARGUMENTS = {
    "build": "own.py",
    "compare": "TARGET other",
    "sweep": "TARGET manager.gain=1e-3,2e-3",
    "tables": "nowhere",
    "tune": "TARGET manager.gain",
    "campaign status": "nowhere",
    "campaign report": "nowhere",
    "campaign case": "nowhere 0",
    "export run": "nowhere",
    "export c": "magnetometer",
    "help page": "sizing",
    "help keys": "",
    "help measures": "",
    "help blocks": "magnetometer",
    "list": "",
    "report": "nowhere",
    "resume": "nowhere",
    "new craft": "made",
    "new law": "made_law",
    "new block": "magnetometer made_block",
}
"""What each command is given; TARGET by default."""
ALWAYS = {"new craft": "--force", "new law": "--force", "new block": "--force"}
FLIGHT = ("--blocks", "--stop", "--step", "--substeps", "--jobs")
"""What makes a flight short, where a command has it."""
FEW = {"tune": "-n 1 --unseen 1", "campaign run": "-n 1"}
"""What makes flights few."""
STARTS = {
    "--ltan": "--sso 500km",
    "--dump": "--altitude 400km --thrusters '4 1N'",
    "--isp": "--altitude 400km --thrusters '4 1N'",
    "--propellant": "--altitude 400km --thrusters '4 1N'",
}
"""What an option of `new craft` needs beside it."""
ORBITS = ("--altitude", "--sso", "--tle", "--orbit", "--sun")
NOT_FLOWN = {"--open", "--fresh", "--cluster", "--platforms", "--out", "--html"}
"""What is in no line of a craft that is there: it opens a browser, takes long, or
writes."""
TOGETHER = 4
"""So many options stand in one line."""


def commands_in(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Yield the name of each command in the tree, and the command."""
    below = getattr(command, "commands", None)
    if below is None:
        yield " ".join(path), command
        return
    for name, inner in below.items():
        yield from commands_in(inner, (*path, name))


def every_command() -> dict[str, Any]:
    """Return all commands of desat by name."""
    return dict(commands_in(get_command(app_for([]))))


def options_in(command: Any) -> list[Any]:
    """Return the options of a command."""
    options = [p for p in command.params if p.param_type_name == "option"]
    return [p for p in options if "--help" not in p.opts]


def words_of(option: Any, name: str, place: str) -> list[str]:
    """Return an option, by one of its names, with a value that it takes."""
    if option.is_flag:
        return [name]
    annotation = option.type_descriptor.annotation
    if name in ("--out", "--html"):
        value = f"made_{place.replace(' ', '_')}{'.html' if name == '--html' else ''}"
    elif isinstance(annotation, type) and issubclass(annotation, Enum):
        value = str(next(iter(annotation)).value)
    elif annotation in (int, float):
        value = EXAMPLES.get(option.opts[0], "1")
    else:
        value = EXAMPLES.get(option.opts[0], "x")
    return [name, value]


def lines_of(
    place: str, command: Any, target: str, with_flights: bool
) -> Iterator[str]:
    """Yield command lines in which each option of a command stands once."""
    words = ARGUMENTS.get(place, "TARGET").replace("TARGET", target)
    begin = [*place.split(), *shlex.split(words)]
    options = options_in(command)
    required_words = [
        w for o in options if o.required for w in words_of(o, o.opts[0], place)
    ]
    always = [*shlex.split(ALWAYS.get(place, "")), *required_words]
    if with_flights:
        short = [o for o in options if o.opts[0] in FLIGHT]
        always += [w for o in short for w in words_of(o, o.opts[0], place)]
        always += FEW.get(place, "").split()
    yield shlex.join([*begin, *always])
    names = [(o, name) for o in options for name in (*o.opts, *o.secondary_opts)]
    if with_flights:
        names = [(o, name) for o, name in names if o.opts[0] not in NOT_FLOWN]
    together = 1 if place == "new craft" else TOGETHER
    for i in range(0, len(names), together):
        some = [
            w for o, name in names[i : i + together] for w in words_of(o, name, place)
        ]
        start = _start_of(names[i][1]) if place == "new craft" else []
        yield shlex.join([*begin, *always, *start, *some])


def _start_of(name: str) -> list[str]:
    """Return what makes a craft of one option of `new craft`."""
    orbit = "" if name in ORBITS else "--altitude 400km"
    return shlex.split(STARTS.get(name, orbit))


def generate_lines(
    target: str, with_flights: bool = False, only: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return command lines of all commands, or of some, with all of their options.

    Parameters
    ----------
    target
        The scenario or folder of the commands that take one.
    flown
        Whether the target is there: flights are then kept short, and what opens a browser,
        writes or takes long is left out.
    only
        Names of commands; by default all.
    """
    all_commands = every_command()
    return tuple(
        line
        for place in only or all_commands
        for line in lines_of(place, all_commands[place], target, with_flights)
    )

"""Define `desat new craft FOLDER`, `desat new law NAME`, `desat new block ROLE`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from ...report.table import Column, Table
from .. import options as o
from ..console import Commands, app, example, out, print_json, print_table, warn

news = Commands(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Begin something of your own: a craft, a law, a block.",
)
app.add_typer(news, name="new")


@news.command(
    epilog=example("desat new craft my12u --size 12U --altitude 400km --rods 0.2")
)
def craft(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where it goes.")],
    altitude: Annotated[
        str | None, typer.Option(help="Of a circular orbit: 400km.")
    ] = None,
    inclination: Annotated[str | None, typer.Option(help="51.6deg.")] = None,
    sso: Annotated[
        str | None,
        typer.Option(help="A Sun-synchronous orbit of this altitude: 500km."),
    ] = None,
    ltan: Annotated[
        str | None, typer.Option(help="Its local time of the ascending node: 10:30.")
    ] = None,
    tle: Annotated[
        Path | None, typer.Option(help="A file with a two-line element set.")
    ] = None,
    orbit: Annotated[
        str | None,
        typer.Option(
            help="geo, gto, molniya, or heights of perigee and apogee: 500x39860km."
        ),
    ] = None,
    sun: Annotated[
        str | None, typer.Option(help="Deep space, a circle about the Sun: 1.52AU.")
    ] = None,
    epoch: Annotated[
        str | None, typer.Option(help="UTC of t = 0: 2027-01-01T00:00:00Z.")
    ] = None,
    mass: Annotated[
        str | None, typer.Option(help='16kg; with its spread (90 %): "16kg +-10%".')
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="A CubeSat of so many units: 12U.")
    ] = None,
    box: Annotated[
        str | None, typer.Option(help="Sides along x, y, z: 0.5,0.5,0.8 (m).")
    ] = None,
    inertia: Annotated[
        str | None, typer.Option(help="Principal moments: 0.2,0.2,0.1 (kg m2).")
    ] = None,
    wheels: Annotated[
        str | None,
        typer.Option(
            help='Three to eight: "4 pyramid 30mNms", "6 pyramid 50Nms", "3 axes 0.2Nms", or a '
            'csv with an axis (x, y, z) a row: "wheels.csv 30mNms". A capacity that is not known '
            'for sure: "4 pyramid 11Nms +-50%".'
        ),
    ] = None,
    rods: Annotated[
        str | None,
        typer.Option(
            help="Of each axis: 0.2 (A m2); none; or as made, of turns or dipole, size, wire and "
            'current: "coil 300 80x80mm 0.2mm 100mA", "rod 0.2Am2 60x8mm 0.2mm 100mA".'
        ),
    ] = None,
    thrusters: Annotated[
        str | None,
        typer.Option(
            help='Pairs about each axis: "4 1N"; nozzles: "6 1N", "8 10N", "12 22N", or a csv of '
            "x, y, z (m), u, v, w of the force, thrust (N): layout.csv. --dump says when they "
            "fire."
        ),
    ] = None,
    dump: Annotated[
        str | None,
        typer.Option(
            help='Between shares (%) of a wheel: "thrusters 70:10", "coils 70:10", "both 70:10" '
            "(rods all the time, thrusters what they leave), or momenta: "
            '"thrusters 1.8Nms:0"; "thrusters 70:10 aligned": each waits for its cheapest '
            'attitude; by the calendar: "thrusters every 7d". Only at contacts, or never in an '
            'observation: "thrusters 70:10 within FILE.csv each 1d", "outside FILE.csv", of '
            "begin and end (s, or as the heading says)."
        ),
    ] = None,
    panel: Annotated[
        str | None,
        typer.Option(help='A wing on -y, its area and arm: "13m2 1.35m"; see --wings.'),
    ] = None,
    wings: Annotated[
        list[str] | None,
        typer.Option(
            "--wings",
            "--wing",
            help='A pair, turned to the Sun: "2 x 13m2 3.2m", its area and arm; or one: "13m2 '
            '3.2m +y". May follow: axis, fixed SIDE, mass, reflected shares (mirrored/scattered), '
            'as "2 x 13m2 3.2m y fixed +z 3kg/m2 0.2/0.03".',
        ),
    ] = None,
    dish: Annotated[
        str | None, typer.Option(help='Diameter, side and arm: "1.2m +x 1m".')
    ] = None,
    cp: Annotated[
        str | None,
        typer.Option(
            help="Centre of pressure from the centre of mass: 2cm,0cm,1cm; one number: in an "
            'unknown direction. With its spread (90 %): "2cm,0cm,1cm +-1cm".'
        ),
    ] = None,
    isp: Annotated[str | None, typer.Option(help="Specific impulse: 220s.")] = None,
    propellant: Annotated[str | None, typer.Option(help="In the tank: 5kg.")] = None,
    pointing: Annotated[
        str | None,
        typer.Option(
            help="nadir (default), inertial, sun (+z to it; default in deep space), yaw (nadir, +x "
            "towards the Sun)."
        ),
    ] = None,
    secular: Annotated[
        str | None,
        typer.Option(
            help="A constant torque, about y or x,y,z of body: 80uNm. Given torques add up; it "
            "replaces the class's drag, light and dipole, not wings or --residual-dipole."
        ),
    ] = None,
    torque: Annotated[
        list[str] | None,
        typer.Option(
            help='A csv of t (s) and torque about x, y, z (N m), as --secular: "FILE body", or '
            "lvlh, eci; it repeats from its end on. A heading may name columns and units, as "
            "t [ms], x [mN m]. Several add up."
        ),
    ] = None,
    residual_dipole: Annotated[
        str | None,
        typer.Option(help="0.05 (A m2), in an unknown direction; or x,y,z of body."),
    ] = None,
    sample: Annotated[
        str | None,
        typer.Option(
            help="Sample time of sensors, controller and wheels, which is the step, too: 0.2s "
            "(default: what is stable with full wheels)."
        ),
    ] = None,
    bias: Annotated[
        str | None,
        typer.Option(
            help="What each wheel keeps against the others, away from standstill: 20mNms, or a "
            "speed: 1000rpm."
        ),
    ] = None,
    arm: Annotated[
        str | None, typer.Option(help="Lever arm of the thrusters: 1.2m.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Into a folder that exists.")
    ] = False,
    as_json: o.Json = False,
) -> None:
    """A craft of your own: a folder with craft.toml and the scenarios nominal, worst
    and, with rods, detumbling and rollout, which run at once. What you do not say is
    typical of its class, and marked.
    """
    from ...begin.facts import CraftFacts
    from ...files.paths import shown
    from ...runs.new_craft import write_craft

    facts = CraftFacts(
        altitude,
        inclination,
        sso,
        ltan,
        tle,
        epoch,
        mass,
        size,
        box,
        inertia,
        wheels,
        rods,
        thrusters,
        pointing,
        residual_dipole,
        orbit,
        dump,
        panel,
        sun,
        secular,
        torque,
        propellant,
        isp,
        sample,
        wings,
        dish,
        cp,
        bias,
        arm,
    )
    command = shlex.join(["desat", *sys.argv[1:]])
    written, warnings = write_craft(folder, facts, command, force)
    warn(warnings)
    if as_json:
        assumptions = [x._asdict() for x in written.assumptions]
        print_json(
            {"files": [str(x) for x in written.files], "assumptions": assumptions}
        )
        return
    names = ", ".join(x.name for x in written.files)
    out.print(f"{shown(folder)}: {names}", highlight=False, markup=False)
    columns = [
        Column(title, kind="text") for title in ("quantity", "value", "unit", "from")
    ]
    print_table(Table("", columns, written.assumptions), is_folded=True)
    out.print(
        f"desat run {shown(folder)}    # nominal; desat size {shown(folder)} what it "
        "needs",
        highlight=False,
        markup=False,
    )


@news.command(epilog=example("desat new law my_law"))
def law(
    file: Annotated[Path, typer.Argument(metavar="NAME", help="Of the file: my_law.")],
    force: Annotated[
        bool, typer.Option("--force", help="Over files that exist.")
    ] = False,
    as_json: o.Json = False,
) -> None:
    """A law of your own: a manager's block in twenty lines, which flies as it is in any
    craft with coils and wheels, and a test of it.
    `desat run CRAFT --source manager=NAME.py` builds it.
    """
    from ...begin import block as new_block

    _print(
        new_block.write_law(file, force), "manager", "a craft of yours or ours", as_json
    )


@news.command(epilog=example("desat new block rate_gyro my_gyro"))
def block(
    base: Annotated[
        str,
        typer.Argument(
            metavar="ROLE|BLOCK", help="magnetometer, or a block of ours: rate_gyro."
        ),
    ],
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[NAME]", help="Of the file (default: my_ROLE)."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Over files that exist.")
    ] = False,
    as_json: o.Json = False,
) -> None:
    """A block of your own: a file that derives from a block of ours and flies as it is,
    with the place where yours goes, and a test of it. Of the role manager it is a law
    (`new law`).
    """
    from desat.fmus.registry import block_class

    from ...begin import block as new_block

    files = new_block.write(base, file, force)
    _print(files, block_class(str(files[0])).role, "a craft that has one", as_json)


def _print(paths_made: list[Path], role: str, folder: str, as_json: bool) -> None:
    """Print the files of a new block, and the command that flies it."""
    from ...files.paths import shown

    if as_json:
        print_json({"files": [str(x) for x in paths_made]})
        return
    out.print(", ".join(shown(x) for x in paths_made), highlight=False, markup=False)
    out.print(
        f"desat run CRAFT --source {role}={shown(paths_made[0])}    # {folder}",
        highlight=False,
        markup=False,
    )

"""`python -m benchmarks.questions`: answer ten public questions, into docs/questions.md.

Each answer has the numbers and the picture of runs and sizings that are made now.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np

import desat
from desat.analyses import residual
from desat.figures.canvas import Figure
from desat.figures.plots import series_figure
from desat.numbers.text import number, spell_unit

PAGE = Path(__file__).parents[1] / "docs" / "questions.md"
CRAFTS = """\
desat new craft q6u --size 6U --altitude 500km --inclination 51.6deg --rods 0.2 --residual-dipole 0.045
desat new craft q4w --size 6U --altitude 500km --inclination 51.6deg --rods 0.2 \\
    --wheels "4 pyramid 30mNms" --residual-dipole 0.045
desat new craft q3w --size 6U --altitude 500km --inclination 51.6deg --rods 0.2 \\
    --wheels "3 axes 30mNms" --residual-dipole 0.045
desat new craft q3u --size 3U --sso 550km --rods 0.2
desat new craft qsun --sun 1.01AU --mass 6200kg --box 6,6,8 --panel "160m2 1.0m" --cp 0,0,0 \\
    --wheels "4 pyramid 68Nms" --thrusters "4 4N" --dump "thrusters 70:10" --isp 220s --propellant 130kg
desat new craft qflap --sun 1.01AU --mass 6200kg --box 6,6,8 --panel "160m2 0.1m" --cp 0,0,0 \\
    --wheels "4 pyramid 68Nms" --thrusters "4 4N" --dump "thrusters 70:10" --isp 220s --propellant 130kg
desat new craft qcruise --sun 0.72AU --mass 1035kg --box 3,3,4 --panel "12.6m2 0.3m" \\
    --wheels "3 axes 27Nms" --thrusters "4 0.9N" --dump "thrusters 70:10" --isp 220s --propellant 130kg
desat new craft qcoil --size 3U --altitude 500km --inclination 97.4deg --rods "coil 300 80x80mm 0.2mm 100mA"
"""
HEAD = """\
# Ten public questions

Ten questions that people asked in public, each with the commands that answer it, its answer and one
picture. Where a question names no craft, one was assumed. Made by `python -m benchmarks.questions` on
{date}, desat {version}.

```text
{crafts}```
"""
SIX = "6orbits"


class Answer(NamedTuple):
    """Question with its address, what is typed, what it comes to, and its picture."""

    question: str
    address: str
    commands: str
    text: str
    figure: Figure


def value(run: Any, name: str) -> str:
    """Return a number of a run with its unit."""
    found = run.manifest.numbers[name]
    if found.unit == "N.m.s":
        return f"{number(1e3 * found.value)} mN m s"
    return f"{number(found.value)} {spell_unit(found.unit)}".rstrip()


def overlaid(plot: str, runs: dict[str, Any]) -> Figure:
    """Draw a plot of a craft over runs, by their labels."""
    first = next(iter(runs.values()))
    figure = series_figure(
        first.manifest.content.plots[plot],
        [(label, run.results, run.manifest.parameters) for label, run in runs.items()],
    )
    assert figure is not None
    return figure


def plot_of(sizing: Any) -> Figure:
    """Draw the first figure of a sizing."""
    figure = sizing.plot()
    assert isinstance(figure, Figure)
    return figure


def is_it_desaturated() -> Answer:
    """Hold a dipole along the momentum beside the cross product."""
    subprocess.run(["desat", "new", "law", "p_direct"], check=True, capture_output=True)
    file = Path("p_direct.py")
    text = file.read_text(encoding="utf-8")
    cross = "return scale(self.gain / size, cross(h, self.b_body))"
    direct = "return scale(self.gain / size**0.5, h)"
    assert cross in text
    file.write_text(
        text.replace(cross, direct).replace("import cross, dot", "import dot")
    )
    start = {"wheels.h_start_wheel": [0.005] * 4}
    runs = {
        "cross product": desat.run("q6u", start, stop="1orbits"),
        "m = K h": desat.run(
            "q6u", start, stop="1orbits", sources={"manager": "p_direct.py"}
        ),
        "no dumping": desat.run("q6u", {**start, "manager.gain": 0.0}, stop="1orbits"),
    }
    ends = ", ".join(f"{k} {value(r, 'final_momentum')}" for k, r in runs.items())
    return Answer(
        "Does m = -K (h_ref - h) desaturate a wheel?",
        "https://space.stackexchange.com/questions/18309/will-this-magnetorquer-configuration-effectively-desaturate-a-reaction-wheel",
        f"desat new law p_direct    # then: {direct}\n"
        "desat run q6u --set wheels.h_start_wheel=0.005,0.005,0.005,0.005 --stop 1orbits --source "
        "manager=p_direct.py",
        "No: a dipole along h gives the torque h x B, which is across h and takes nothing out of "
        "it. From the same "
        f"start an orbit leaves, of the wheels' momentum: {ends}.",
        overlaid("momentum", runs),
    )


def what_slows_a_wheel() -> Answer:
    """Fly with the coils and without them."""
    coils = desat.run("q6u", stop=SIX)
    none = desat.run("q6u", {"manager.gain": 0.0}, stop=SIX)
    return Answer(
        "How does an external torque slow a wheel?",
        "https://space.stackexchange.com/questions/43867/how-does-desaturation-of-the-reaction-wheels-work",
        "desat run q6u --stop 6orbits\ndesat run q6u --stop 6orbits --set manager.gain=0\ndesat "
        "show q6u --diagram",
        "The attitude loop makes the wheels absorb the torque of the coils. After six orbits the "
        "wheels hold "
        f"{value(coils, 'final_momentum')} in place of {value(none, 'final_momentum')}, the fastest "
        f"turns at "
        f"{value(coils, 'largest_speed')} in place of {value(none, 'largest_speed')}, and pointing "
        f"stays at "
        f"{value(coils, 'pointing')} rms.",
        overlaid("speed", {"coils": coils, "no dumping": none}),
    )


def what_is_a_fourth_wheel_for() -> Answer:
    """Fail a wheel of four in a pyramid, and of three along the axes."""
    sets = {"wheels.failed": 1, "wheels.failed_from": 17042.0}
    four, three = (desat.run(name, sets, stop=SIX) for name in ("q4w", "q3w"))
    return Answer(
        "Is the fourth wheel a backup for one of the others only?",
        "https://rl.huuu.biz/r/interestingasfuck/comments/r5oa25/selfbalancing_cube_by_centrifugal_force/hmpfx9a/?context=3",
        "desat run q4w --stop 6orbits --set wheels.failed=1 --set wheels.failed_from=17042\n"
        "desat run q3w --stop 6orbits --set wheels.failed=1 --set wheels.failed_from=17042",
        f"For any, in a pyramid: pointing is {value(four, 'pointing')} rms over the failure. With "
        f"three wheels along the "
        f"axes the attitude is lost ({value(three, 'pointing')} rms), which is said beforehand. The "
        f"price of the fourth "
        "is a null space, which `null_gain` empties.",
        overlaid(
            "pointing", {"four in a pyramid": four, "three along the axes": three}
        ),
    )


def is_a_bias_kept() -> Answer:
    """Empty the wheels to a bias."""
    bias = desat.run("q6u", {"manager.h_target_body": [0.0, -0.004, 0.0]}, stop=SIX)
    none = desat.run("q6u", stop=SIX)
    return Answer(
        "Can the wheels be emptied to a bias?",
        "https://github.com/lasp/xmera/issues/312",
        "desat run q6u --stop 6orbits --set manager.h_target_body=0,-0.004,0",
        f"Yes: the total less its target is {value(bias, 'left_rms')} rms "
        f"({value(none, 'left_rms')} without a bias), "
        f"the duty {value(bias, 'coil_duty')} in place of {value(none, 'coil_duty')}, and wheels pass zero "
        f"{value(bias, 'crossings')} in place of {value(none, 'crossings')} times.",
        overlaid("momentum", {"bias": bias, "none": none}),
    )


def why_does_b_dot_diverge() -> Answer:
    """Brake a tumble with gains that are usual, low, and high with an old field."""
    spin = {"spacecraft.omega_start_body": [0.3, -0.25, 0.2]}
    target = "q3u/detumbling.toml"
    runs = {
        "usual gain": desat.run(target, spin, stop=SIX),
        "low gain": desat.run(target, {**spin, "manager.plain_gain": 1e4}, stop=SIX),
        "high gain, field 7 s old": desat.run(
            target, {**spin, "manager.plain_gain": 1e7, "manager.delay": 7.0}, stop=SIX
        ),
    }
    return Answer(
        "Why does B-dot diverge?",
        "https://github.com/lipofefeyt/openobsw/issues/70",
        "desat run q3u/detumbling.toml --stop 6orbits --set spacecraft.omega_start_body=0.3,-0.25,0.2\n"
        "# with --set manager.plain_gain=1e4; with --set manager.plain_gain=1e7 --set manager.delay=7",
        "A low gain is slow, it does not diverge; a field that is 7 s old with a high gain does not "
        "brake. In part: "
        "their inertia and dipole are not given.",
        overlaid("rate", runs),
    )


def what_does_a_flap_save() -> Answer:
    """Size a craft with the centre of pressure near and far."""
    far: Any = desat.size("qsun")
    near: Any = desat.size("qflap")
    return Answer(
        "What does a momentum flap save?",
        "https://space.stackexchange.com/questions/57514/is-there-any-more-information-available-on-jwsts-aft-momentum-flap",
        "desat size qsun\ndesat size qflap",
        f"With 1.0 m between the centres of pressure and of mass there are "
        f"{number(far.steady.a_week)} dumps a week and "
        f"{number(far.a_year)} kg a year, with 0.1 m {number(near.steady.a_week)} and "
        f"{number(near.a_year)}. In part: no "
        "torque over many attitudes. The picture is of 1.0 m.",
        plot_of(far),
    )


def what_is_desaturation() -> Answer:
    """Size a cruise, and a slew in it."""
    cruise: Any = desat.size("qcruise")
    slew: Any = desat.size("qcruise", slew_angle=np.pi / 2.0, slew_time=600.0)
    return Answer(
        "What is wheel desaturation, and why is it done?",
        "https://utzoo.superglobalmegacorp.com/usenet/b130/sci/space/12449.txt",
        "desat size qcruise\ndesat size qcruise --slew 90/600",
        f"Sunlight puts {number(cruise.a_day)} N m s a day into the wheels: after "
        f"{number(cruise.steady.first / 86400.0)} d "
        f"comes the first dump, then {number(cruise.steady.a_week)} a week. A slew of 90 deg in 600 "
        f"s needs "
        f"{number(slew.slew_momentum)} N m s of a wheel of {number(slew.capacity)}: what is in it "
        f"already is in the way.",
        plot_of(cruise),
    )


def does_the_attitude_follow() -> Answer:
    """Set a target of the momentum within what wheels hold and beyond."""
    sets = {
        "no target": [0.0, 0.0, 0.0],
        "4 mN m s": [0.0, -0.004, 0.0],
        "200 mN m s": [0.0, -0.2, 0.0],
    }
    runs = {
        label: desat.run("q6u", {"manager.h_target_body": target}, stop=SIX)
        for label, target in sets.items()
    }
    errors = ", ".join(f"{k}: {value(r, 'pointing')}" for k, r in runs.items())
    return Answer(
        "Why does the attitude not follow the target momentum?",
        "https://github.com/OpenSatKit/OpenSatKit/issues/41",
        "desat run q6u --stop 6orbits --set manager.h_target_body=0,-0.2,0",
        f"It must not: the pointing error (rms) is, by target, {errors}. A target beyond the wheels "
        f"is warned of; "
        "flown, it loses the attitude. In part: their software is another.",
        overlaid("pointing", runs),
    )


def how_is_a_co_simulation_verified() -> Answer:
    """Hold what is conserved against a loop with a step of delay."""
    usual = desat.run("q6u", stop=SIX)
    late = desat.run("q6u", stop=SIX, algorithm="jacobi")
    ((_, figure),) = residual.figures(late.manifest, late.results)
    return Answer(
        "How do I verify a co-simulation?",
        "https://github.com/modelon-community/PyFMI/issues/232",
        "desat run q6u --stop 6orbits\ndesat run q6u --stop 6orbits --algorithm jacobi",
        f"By what is conserved: the residual of the momentum is {value(usual, 'momentum_residual')} "
        f"here, and "
        f"{value(late, 'momentum_residual')} with a step of delay in the loop, where pointing is "
        f"{value(late, 'pointing')} in place of {value(usual, 'pointing')}; "
        f"[why](understand/exchange.md). In part: "
        "shown of our FMUs. The picture is of the delay.",
        figure,
    )


def are_coils_real() -> Answer:
    """Size a craft whose coil is given by its windings."""
    coil: Any = desat.size("qcoil")
    return Answer(
        "Are real coils modelled?",
        "https://github.com/ericstoneking/42/issues/156",
        "desat new craft qcoil --rods 'coil 300 80x80mm 0.2mm 100mA' ...    # as above\ndesat size qcoil",
        f"300 turns of 80 x 80 mm at 100 mA are {number(coil.rod)} A m2; the least rod of this craft is "
        f"{number(coil.least)} A m2. In part: no core material, no round coil.",
        plot_of(coil),
    )


QUESTIONS: tuple[Callable[[], Answer], ...] = (
    is_it_desaturated,
    what_slows_a_wheel,
    what_is_a_fourth_wheel_for,
    is_a_bias_kept,
    why_does_b_dot_diverge,
    what_does_a_flap_save,
    what_is_desaturation,
    does_the_attitude_follow,
    how_is_a_co_simulation_verified,
    are_coils_real,
)


def sections(answers: Iterable[Answer]) -> list[str]:
    """Return the text of each answer, with its picture written beside the page."""
    texts = []
    for k, answer in enumerate(answers, 1):
        picture = PAGE.with_name(f"question-{k}.svg")
        picture.write_text(answer.figure.svg(), encoding="utf-8")
        texts.append(
            f"## {k}. {answer.question}\n\n{fill(answer.text, 115)}\n([asked here]({answer.address}))\n\n"
            f"```text\n{answer.commands}\n```\n\n![{answer.question}]({picture.name})\n"
        )
    return texts


def main() -> int:
    """Write the page."""
    head = HEAD.format(
        date=datetime.now(UTC).date(), version=version("desat"), crafts=CRAFTS
    )
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        subprocess.run(CRAFTS, shell=True, check=True, capture_output=True)
        texts = sections(ask() for ask in QUESTIONS)
    PAGE.write_text("\n".join([head, *texts]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

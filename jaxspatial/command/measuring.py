"""The trade-off on the built-in scene or on the wrenches of a file, as tables, picture and JSON."""

import argparse
import importlib
import pathlib
import sys
import warnings
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.command import algorithms, trade
from jaxspatial.command.algorithms import ALGORITHMS, arm
from jaxspatial.command.files import OutputError, WrenchFileError, free, staged, writable
from jaxspatial.command.result import Result
from jaxspatial.command.wrench_file import Parts, WrenchFile
from jaxspatial.measure import timing
from jaxspatial.measure.operation import OPERATIONS, Wrenches, rotating_body
from jaxspatial.mechanism import Mechanism

_OFFSET = (0.3, -0.2, 0.5)
_NEEDED = "jaxspatial shows tables, progress and pictures: from a clone, pip install '.[plot]'"
# Of what is no terminal: room for the whole table.
_WIDTH = 144


class Plan(NamedTuple):
    """All that is known before anything is measured."""

    about: str
    wrenches: Wrenches
    offset: np.ndarray
    largest: int
    operations: list[str]
    dtypes: list[str]
    picture: pathlib.Path | None
    robot: Mechanism | None
    algorithms: list[str]  # of the robot
    has_applications: bool


def run(given: argparse.Namespace):
    """Measures, shows and writes; returns the exit status, 1 where a promise does not hold."""
    check_installed(given)
    plan, console = _plan(given), console_on(stderr=given.json)
    result = _measured(plan, console)
    if plan.picture:
        from jaxspatial.command import picture

        with staged(plan.picture, given.overwrite) as file:
            picture.draw(result, file, plan.picture.suffix[1:].lower())
    if given.json:
        print(result.to_json())
    _show(console, result, plan, given)
    return 1 if result.broken else 0


def console_on(stderr: bool = False):
    """Where tables and progress go; None without rich."""
    try:
        from rich.console import Console
    except ImportError:
        return None
    return Console(width=None if sys.stdout.isatty() else _WIDTH, stderr=stderr)


def check_installed(given, *more: str):
    """Says what is missing before any work is done; more: packages that a job needs besides."""
    needed = {"rich": not given.json, "matplotlib": not given.json or given.picture is not None}
    needed |= dict.fromkeys(more, True)
    for name in (name for name, is_needed in needed.items() if is_needed):
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise WrenchFileError(f"{_NEEDED} ({error})") from error


# -- what to do: all that can be refused is refused here ---------------------------------------------------------------


def _plan(given):
    picture, offset = picture_of(given), np.array(_OFFSET if given.offset is None else given.offset)
    parts, asked = WrenchFile(given.file).all_parts() if given.file else None, given.operation
    wrenches, about = _wrenches(given.file, parts, given.largest)
    dtypes: list[str] = list(dict.fromkeys(given.dtype or trade.DTYPES))
    _check_sizes(wrenches, offset, dtypes, given.file or "--offset")
    robot, operations = _robot(given), _operations(given.file, parts, asked)
    whole = [name for name in ALGORITHMS if robot and (not asked or name in asked)]
    about += f"; {given.robot.name if given.robot else 'an arm of seven joints'}" if whole else ""
    is_all = not (given.file or asked or given.robot) and algorithms.LOSSY in dtypes
    return Plan(about, wrenches, offset, given.largest, operations, dtypes, picture, robot, whole, is_all)


def _robot(given):
    """That of the file, or the embedded one where it is asked for or nothing is; None for none."""
    if given.robot is None:
        return arm() if set(given.operation or (() if given.file else ALGORITHMS)) & set(ALGORITHMS) else None
    read = Mechanism.from_urdf if given.robot.suffix.lower() == ".urdf" else Mechanism.from_mjcf
    try:
        with warnings.catch_warnings(action="ignore"):
            robot = read(given.robot)
    except (ValueError, ImportError) as error:
        raise WrenchFileError(f"--robot: {given.robot}: {error}") from error
    if not robot.nv:
        raise WrenchFileError(f"--robot: {given.robot}: expected joints that move, got none")
    return robot


def picture_of(given: argparse.Namespace) -> pathlib.Path | None:
    """Where the picture goes, if there is any; one that was given no name takes a free one."""
    picture, beside = given.picture, given.file or pathlib.Path("jaxspatial.")
    if picture is None and not given.json:
        picture = beside.with_name(f"{beside.stem.rstrip('.')}_trade.png")
        picture = picture if given.overwrite else free(picture)
    return None if picture is None else writable(_as_picture(picture), given.overwrite)


def _as_picture(path):
    from jaxspatial.command import picture

    if path.is_dir():
        raise OutputError(f"{path}: a folder is in the way")
    path = path if path.suffix else path.with_name(f"{path.name}.png")
    if path.suffix[1:].lower() not in picture.ENDINGS:
        raise WrenchFileError(f"--picture: expected a name ending in {', '.join(picture.ENDINGS)}, got {path}")
    return path


def _wrenches(path, parts: Parts | None, largest):
    if parts is None:
        return rotating_body(largest), f"{largest:,} wrenches on a rotating body"
    wide: dict[str, Any] = {name: x.astype(np.float64) for name, x in parts.items()}
    f, w, v = wide["f"], wide.get("w"), wide.get("v")
    about = f"{len(parts['f']):,} wrenches of {path.name}" + (
        "" if "w" in parts else ", which gives no motion: no power"
    )
    return Wrenches(wide.get("tau", np.zeros_like(f)), f, w, v), about


def _operations(path, parts: Parts | None, asked):
    """Those asked for, as far as the numbers for them are there: neither motions nor accelerations are invented."""
    names = [name for name in dict.fromkeys(asked or OPERATIONS) if name in OPERATIONS]
    if parts is None:
        return names
    known = {*parts, "tau", "p"}
    lacking = {name: [x for x in OPERATIONS[name].arguments if x not in known] for name in names}
    for name in names if asked else ():
        if lacking[name]:
            raise WrenchFileError(f"--operation {name}: expected {', '.join(lacking[name])} in {path}")
    return [name for name in names if not lacking[name]]


def _check_sizes(wrenches, offset, dtypes, source):
    for dtype in dtypes:
        if dtype in trade.STREAMED and not trade.fits(wrenches, offset, dtype):
            others = "" if dtype == "float64" else "; --dtype float64 measures only float64"
            raise WrenchFileError(f"{source}: torques, forces or their power are too large for {dtype}{others}")


# -- doing it ---------------------------------------------------------------------------------------------------------


def _measured(plan: Plan, console):
    """All measurements; where there is a console, with the power before, and a progress bar."""
    has_power = plan.operations and plan.wrenches.w is not None
    moving = plan.wrenches if has_power else None
    fitting = [dtype for dtype in trade.STREAMED if moving and trade.fits(moving, plan.offset, dtype)]
    powers = {dtype: trade.power(plan.wrenches, plan.offset, dtype) for dtype in fitting}
    if console:
        console.print(f"{plan.about}\noffset p_PQ = {plan.offset.tolist()} m\n{timing.machine()}\n", soft_wrap=True)
    lines = trade.cases(plan.operations, plan.dtypes)
    pairs = trade.curved(plan.operations, plan.dtypes)
    whole = algorithms.cases(plan.algorithms, plan.dtypes)

    def work(advance):
        return (
            trade.measure(plan.wrenches, plan.offset, lines, plan.largest, advance),
            trade.curves(pairs, advance),
            algorithms.measure(plan.robot, whole, advance=advance) if plan.robot else [],
            algorithms.losses(advance) if plan.has_applications else [],
        )

    if console:
        from jaxspatial.command import report

        steps = trade.steps(lines) + len(pairs) + algorithms.steps(whole)
        steps += plan.has_applications * algorithms.application_steps()
        report.print_power(console, powers)
        measured = report.with_progress(console, work, steps)
    else:
        measured = work(lambda: None)
    return Result(plan.about, timing.machine(), plan.offset, trade.sizes(plan.largest), powers, *measured)


def _show(console, result: Result, plan: Plan, given):
    """Tables, what was written, and what is broken."""
    if console and not given.json:
        from jaxspatial.command import report

        report.print_trade(console, result, given.full)
    written = [f"picture: {plan.picture}"] if plan.picture else []
    broken = [f"does not hold here: {what}" for what in result.broken]
    for text in (*written, *broken):
        style = "bold red" if text in broken else None
        # Names of files and columns may have brackets, which are no marks of style.
        console.print(text, style=style, markup=False) if console else print(text, file=sys.stderr)

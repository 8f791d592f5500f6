"""`python -m jaxspatial`: the trade on the built-in scene or on the user's wrenches, as tables, picture and JSON."""

import argparse
import contextlib
import importlib
import pathlib
import sys
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from jaxspatial.command import files, moving
from jaxspatial.command.result import Result
from jaxspatial.command.wrench_file import WrenchFile, WrenchFileError
from jaxspatial.measure import algorithms, applications, conditions, power, timing, trade
from jaxspatial.measure.algorithms import ALGORITHMS
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.measure.scene import Wrenches, arm, rotating_body
from jaxspatial.measure.timing import Advance
from jaxspatial.mechanism import Mechanism

if TYPE_CHECKING:
    from rich.console import Console

_OFFSET = (0.3, -0.2, 0.5)
_NEEDED = "python -m jaxspatial shows tables, progress and pictures: from a clone, pip install '.[plot]'"
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
    outputs: dict[str, pathlib.Path]  # what is written -> path
    file: WrenchFile | None
    shifted: dict[str, np.ndarray]  # the parts of the file about Q
    robot: Mechanism | None
    algorithms: list[str]  # of the robot
    is_everything: bool  # nothing was asked for by name: applications too


def run(options: argparse.Namespace):
    """Measures, shows and writes; returns the exit status, 1 where a promise does not hold."""
    _check_installed(options)
    plan, console = _plan(options), console_on(stderr=options.json)
    result = _measured(plan, console, options)
    _write(plan, result, options.overwrite)
    if options.json:
        print(result.to_json())
    _show(console, result, plan.outputs, options)
    return 1 if result.broken else 0


def console_on(stderr: bool = False):
    """Where tables and progress go; None without rich."""
    try:
        from rich.console import Console
    except ImportError:
        return None
    return Console(width=None if sys.stdout.isatty() else _WIDTH, stderr=stderr)


def _check_installed(options: argparse.Namespace):
    """Says what is missing before any work is done."""
    needed = {"rich": not options.json, "matplotlib": not options.json or options.picture is not None}
    for name in (name for name, is_needed in needed.items() if is_needed):
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise WrenchFileError(f"{_NEEDED} ({error})") from error


# -- what to do: all that can be refused is refused here ---------------------------------------------------------------


def _plan(options: argparse.Namespace):
    outputs, offset = _outputs(options), np.array(_OFFSET if options.offset is None else options.offset)
    file = WrenchFile(options.file) if options.file else None
    wrenches, about = _wrenches(file, options.largest)
    dtypes: list[str] = list(dict.fromkeys(options.dtype or trade.DTYPES))
    _check_sizes(wrenches, offset, dtypes, file.path if file else "--offset")
    asked, robot = options.operation, _robot(options)
    operations = _operations(file, asked)
    whole = [name for name in ALGORITHMS if robot and (not asked or name in asked)]
    about += f"; {options.robot.name if options.robot else 'an arm of seven joints'}" if whole else ""
    shifted = moving.moved(file.parts, offset) if file else {}
    if file:
        file.check_finite(shifted)
    is_all = not (file or asked or options.robot) and applications.DTYPE in dtypes
    subjects = operations, dtypes, outputs, file, shifted
    return Plan(about, wrenches, offset, options.largest, *subjects, robot, whole, is_all)


def _robot(options: argparse.Namespace):
    """That of the file, or the embedded one where it is asked for or nothing is; None for none."""
    if options.robot is None:
        return arm() if set(options.operation or (() if options.file else ALGORITHMS)) & set(ALGORITHMS) else None
    read = Mechanism.from_urdf if options.robot.suffix.lower() == ".urdf" else Mechanism.from_mjcf
    try:
        with warnings.catch_warnings(action="ignore"):
            robot = read(options.robot)
    except (ValueError, ImportError) as error:
        raise WrenchFileError(f"--robot: {options.robot}: {error}") from error
    if not robot.nv:
        raise WrenchFileError(f"--robot: {options.robot}: expected joints that move, got none")
    return robot


def _outputs(options: argparse.Namespace):
    """What is written, and where; a picture that was given no name takes one that is free."""
    picture, beside = options.picture, options.file or pathlib.Path("jaxspatial.")
    if picture is None and not options.json:
        picture = beside.with_name(f"{beside.stem.rstrip('.')}_trade.png")
        picture = picture if options.overwrite else files.free(picture)
    found = {"picture": _as_picture(picture)} if picture else {}
    found |= {"shifted wrenches": files.shifted_path(options.file)} if options.file else {}
    return {what: files.checked(path, options.overwrite) for what, path in found.items()}


def _as_picture(path: pathlib.Path):
    from jaxspatial.command import picture

    if path.is_dir():
        raise files.OutputError(f"{path}: a folder is in the way")
    path = path if path.suffix else path.with_name(f"{path.name}.png")
    if path.suffix[1:].lower() not in picture.ENDINGS:
        raise WrenchFileError(f"--picture: expected a name ending in {', '.join(picture.ENDINGS)}, got {path}")
    return path


def _wrenches(file: WrenchFile | None, largest: int):
    if file is None:
        return rotating_body(largest), f"{largest:,} wrenches on a rotating body"
    parts = {name: x.astype(np.float64) for name, x in file.parts.items()}
    about = f"{len(file):,} wrenches of {file.path.name}" + ("" if file.moves else ", which gives no motion: no power")
    return Wrenches(parts["tau"], parts["f"], parts.get("w"), parts.get("v")), about


def _operations(file: WrenchFile | None, asked: list[str] | None):
    """Those asked for, as far as the numbers for them are there: neither motions nor accelerations are invented."""
    names = [name for name in dict.fromkeys(asked or OPERATIONS) if name in OPERATIONS]
    if file is None:
        return names
    lacking = {name: [x for x in OPERATIONS[name].arguments if x not in (*file.parts, "p")] for name in names}
    for name in names if asked else ():
        if lacking[name]:
            raise WrenchFileError(f"--operation {name}: expected {', '.join(lacking[name])} in {file.path}")
    return [name for name in names if not lacking[name]]


def _check_sizes(wrenches: Wrenches, offset: np.ndarray, dtypes: list[str], source: object):
    for dtype in dtypes:
        if dtype in trade.STREAMED and not power.fits(wrenches, offset, dtype):
            others = "" if dtype == "float64" else "; --dtype float64 measures only float64"
            raise WrenchFileError(f"{source}: torques, forces or their power are too large for {dtype}{others}")


# -- doing it ---------------------------------------------------------------------------------------------------------


def _measured(plan: Plan, console: "Console | None", options: argparse.Namespace):
    """All measurements; where there is a console, with the power before, and a progress bar."""
    moving_at = plan.wrenches if plan.operations and plan.wrenches.w is not None else None
    fitting = [dtype for dtype in trade.STREAMED if moving_at and power.fits(moving_at, plan.offset, dtype)]
    powers = {dtype: power.compare(plan.wrenches, plan.offset, dtype) for dtype in fitting}
    if console:
        console.print(f"{plan.about}\noffset p_PQ = {plan.offset.tolist()} m\n{timing.machine()}\n")
    lines, pairs = trade.cases(plan.operations, plan.dtypes), conditions.subjects(plan.operations, plan.dtypes)
    whole = algorithms.cases(plan.algorithms, plan.dtypes)

    def work(advance: Advance):
        yield trade.measure(plan.wrenches, plan.offset, lines, plan.largest, advance)
        yield conditions.measure(pairs, advance)
        yield algorithms.measure(plan.robot, whole, advance=advance) if plan.robot else []
        yield applications.measure(advance) if plan.is_everything else []

    steps = trade.steps(lines) + len(pairs) + algorithms.steps(whole) + plan.is_everything * applications.steps()
    measured = _reported(console, powers, lambda advance: list(work(advance)), steps)
    return Result(plan.about, timing.machine(), plan.offset, trade.sizes(plan.largest), powers, *measured)


def _reported(
    console: "Console | None", powers: dict[str, power.Power], work: Callable[[Advance], list[Any]], total: int
):
    """The work, after the power and with a progress bar where there is a console."""
    if console is None:
        return work(lambda: None)
    from jaxspatial.command import report

    report.print_power(console, powers)
    return report.with_progress(console, work, total)


def _write(plan: Plan, result: Result, overwrite: bool):
    """All files or none."""
    with contextlib.ExitStack() as stack:
        for what, path in plan.outputs.items():
            file = stack.enter_context(files.staged(path, overwrite))
            if what == "picture":
                _draw(result, file, path)
            elif plan.file:
                plan.file.write(file, plan.shifted)


def _draw(result: Result, file: BinaryIO, path: pathlib.Path):
    from jaxspatial.command import picture

    picture.draw(result, file, path.suffix[1:].lower())


def _show(console: "Console | None", result: Result, outputs: dict[str, pathlib.Path], options: argparse.Namespace):
    """Tables, what was written, and what is broken."""
    if console and not options.json:
        from jaxspatial.command import report

        report.print_trade(console, result, options.full)
    written = [f"{what}: {path}" for what, path in outputs.items()]
    broken = [f"does not hold here: {what}" for what in result.broken]
    for text in (*written, *broken):
        console.print(text, style="bold red" if text in broken else None) if console else print(text, file=sys.stderr)

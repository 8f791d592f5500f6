"""The trade-off on the built-in scene or on the wrenches of a file, as tables, picture and JSON."""

import argparse
import contextlib
import importlib
import pathlib
import sys
import warnings
from typing import NamedTuple

import numpy as np

from jaxspatial.measure import algorithms, options, timing, trade
from jaxspatial.measure.algorithms import ALGORITHMS, arm
from jaxspatial.measure.operation import OPERATIONS, Wrenches, rotating_body
from jaxspatial.measure.options import OutputError, WrenchFileError
from jaxspatial.measure.result import Result
from jaxspatial.measure.wrench_file import WrenchFile, moved, staged
from jaxspatial.mechanism import Mechanism

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
    has_applications: bool
    is_first_look: bool  # nothing was asked for


def run(given: argparse.Namespace):
    """Measures, shows and writes; returns the exit status, 1 where a promise does not hold."""
    _check_installed(given)
    plan, console = _plan(given), console_on(stderr=given.json)
    result = _measured(plan, console)
    _write(plan, result, given.overwrite)
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


def _check_installed(given):
    """Says what is missing before any work is done."""
    needed = {"rich": not given.json, "matplotlib": not given.json or given.picture is not None}
    for name in (name for name, is_needed in needed.items() if is_needed):
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise WrenchFileError(f"{_NEEDED} ({error})") from error


# -- what to do: all that can be refused is refused here ---------------------------------------------------------------


def _plan(given):
    if options.is_first_look(given):
        return _first_look(_outputs(given))
    outputs, offset = _outputs(given), np.array(_OFFSET if given.offset is None else given.offset)
    file, asked = WrenchFile(given.file) if given.file else None, given.operation
    wrenches, about = _wrenches(file, given.largest)
    dtypes: list[str] = list(dict.fromkeys(given.dtype or trade.DTYPES))
    _check_sizes(wrenches, offset, dtypes, file.path if file else "--offset")
    robot, operations = _robot(given), _operations(file, asked)
    whole = [name for name in ALGORITHMS if robot and (not asked or name in asked)]
    about += f"; {given.robot.name if given.robot else 'an arm of seven joints'}" if whole else ""
    shifted = moved(file.parts, offset) if file else {}
    if file:
        file.check_finite(shifted)
    is_all = not (file or asked or given.robot) and algorithms.LOSSY in dtypes
    measured = operations, dtypes, outputs, file, shifted
    return Plan(about, wrenches, offset, given.largest, *measured, robot, whole, is_all, is_first_look=False)


def _first_look(outputs):
    """One operation and one algorithm in one dtype, and the applications: what shows the trade in half a minute."""
    n, about = trade.IN_CACHE, "wrenches on a rotating body, an arm of seven joints, and five applications, in float32"
    measured = ["shift_force"], [algorithms.LOSSY], outputs, None, {}
    offset, whole = np.array(_OFFSET), ["inverse_dynamics"]
    return Plan(about, rotating_body(n), offset, n, *measured, arm(), whole, has_applications=True, is_first_look=True)


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


def _outputs(given):
    """What is written, and where; a picture that was given no name takes one that is free."""
    picture, beside = given.picture, given.file or pathlib.Path("jaxspatial.")
    if picture is None and not given.json:
        picture = beside.with_name(f"{beside.stem.rstrip('.')}_trade.png")
        picture = picture if given.overwrite else options.free(picture)
    outputs = {"picture": _as_picture(picture)} if picture else {}
    outputs |= {"shifted wrenches": options.shifted_path(given.file)} if given.file else {}
    return {what: options.writable(path, given.overwrite) for what, path in outputs.items()}


def _as_picture(path):
    from jaxspatial.measure import picture

    if path.is_dir():
        raise OutputError(f"{path}: a folder is in the way")
    path = path if path.suffix else path.with_name(f"{path.name}.png")
    if path.suffix[1:].lower() not in picture.ENDINGS:
        raise WrenchFileError(f"--picture: expected a name ending in {', '.join(picture.ENDINGS)}, got {path}")
    return path


def _wrenches(file: WrenchFile | None, largest):
    if file is None:
        return rotating_body(largest), f"{largest:,} wrenches on a rotating body"
    parts = {name: x.astype(np.float64) for name, x in file.parts.items()}
    about = f"{len(file):,} wrenches of {file.path.name}" + ("" if file.moves else ", which gives no motion: no power")
    return Wrenches(parts["tau"], parts["f"], parts.get("w"), parts.get("v")), about


def _operations(file: WrenchFile | None, asked):
    """Those asked for, as far as the numbers for them are there: neither motions nor accelerations are invented."""
    names = [name for name in dict.fromkeys(asked or OPERATIONS) if name in OPERATIONS]
    if file is None:
        return names
    lacking = {name: [x for x in OPERATIONS[name].arguments if x not in (*file.parts, "p")] for name in names}
    for name in names if asked else ():
        if lacking[name]:
            raise WrenchFileError(f"--operation {name}: expected {', '.join(lacking[name])} in {file.path}")
    return [name for name in names if not lacking[name]]


def _check_sizes(wrenches, offset, dtypes, source):
    for dtype in dtypes:
        if dtype in trade.STREAMED and not trade.fits(wrenches, offset, dtype):
            others = "" if dtype == "float64" else "; --dtype float64 measures only float64"
            raise WrenchFileError(f"{source}: torques, forces or their power are too large for {dtype}{others}")


# -- doing it ---------------------------------------------------------------------------------------------------------


def _measured(plan: Plan, console):
    """All measurements; where there is a console, with the power before, and a progress bar."""
    has_power = plan.operations and plan.wrenches.w is not None and not plan.is_first_look
    moving = plan.wrenches if has_power else None
    fitting = [dtype for dtype in trade.STREAMED if moving and trade.fits(moving, plan.offset, dtype)]
    powers = {dtype: trade.power(plan.wrenches, plan.offset, dtype) for dtype in fitting}
    if console:
        offset = "" if plan.is_first_look else f"offset p_PQ = {plan.offset.tolist()} m\n"
        console.print(f"{plan.about}\n{offset}{timing.machine()}\n", soft_wrap=True)
    lines = trade.cases(plan.operations, plan.dtypes)
    pairs = [] if plan.is_first_look else trade.curved(plan.operations, plan.dtypes)
    whole = algorithms.cases(plan.algorithms, plan.dtypes)

    def work(advance):
        return (
            trade.measure(plan.wrenches, plan.offset, lines, plan.largest, advance),
            trade.curves(pairs, advance),
            algorithms.measure(plan.robot, whole, advance=advance) if plan.robot else [],
            algorithms.losses(advance) if plan.has_applications else [],
        )

    if console:
        from jaxspatial.measure import report

        steps = trade.steps(lines) + len(pairs) + algorithms.steps(whole)
        steps += plan.has_applications * algorithms.application_steps()
        report.print_power(console, powers)
        measured = report.with_progress(console, work, steps)
    else:
        measured = work(lambda: None)
    return Result(plan.about, timing.machine(), plan.offset, trade.sizes(plan.largest), powers, *measured)


def _write(plan: Plan, result, overwrite):
    """All files or none."""
    with contextlib.ExitStack() as stack:
        for what, path in plan.outputs.items():
            file = stack.enter_context(staged(path, overwrite))
            if what == "picture":
                _draw(plan, result, file, path)
            elif plan.file:
                plan.file.write(file, plan.shifted)


def _draw(plan: Plan, result, file, path):
    from jaxspatial.measure import picture

    draw = picture.draw_first_look if plan.is_first_look else picture.draw
    draw(result, file, path.suffix[1:].lower())


def _show(console, result: Result, plan: Plan, given):
    """Tables, what was written, and what is broken."""
    if console and not given.json:
        from jaxspatial.measure import report

        if plan.is_first_look:
            report.print_first_look(console, result)
        else:
            report.print_trade(console, result, given.full)
    written = [f"{what}: {path}" for what, path in plan.outputs.items()]
    written += [left for left in (plan.file.left_behind() if plan.file else "",) if left]
    broken = [f"does not hold here: {what}" for what in result.broken]
    for text in (*written, *broken):
        style = "bold red" if text in broken else None
        # Names of files and columns may have brackets, which are no marks of style.
        console.print(text, style=style, markup=False) if console else print(text, file=sys.stderr)

"""The command line: the trade on the built-in scene or on the user's own wrenches; whether the promises hold here."""

import argparse
import importlib
import os
import pathlib
import sys

import jax
import numpy as np

from jaxspatial.measure import conditions, power, timing, trade
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.measure.result import Result, as_json
from jaxspatial.measure.scene import Wrenches, rotating_body
from jaxspatial.measure.self_check import self_check
from jaxspatial.measure.wrench_file import WrenchFile, WrenchFileError
from jaxspatial.spatial import SpatialForce, SpatialVelocity, shift

_OFFSET = (0.3, -0.2, 0.5)
_NEEDED = "python -m jaxspatial shows tables, progress and pictures: pip install 'jaxspatial[plot]'"


def main(arguments=None):
    """Runs the command; returns its exit status: 0, 1 where power or a promise does not hold, 2 for bad input."""
    options = _parser().parse_args(arguments)
    if options.self_check:
        return _print_self_check(options)
    if missing := _missing(options):
        print(f"error: {_NEEDED} ({missing})", file=sys.stderr)
        return 2
    try:
        return _run(options)
    except WrenchFileError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _missing(options):
    """What cannot be imported of what will be needed, before any work is done."""
    needed = {"rich": not options.json, "matplotlib": not options.json or options.picture is not None}
    for name in (name for name, is_needed in needed.items() if is_needed):
        try:
            importlib.import_module(name)
        except ImportError as error:
            return error
    return None


def _print_self_check(options):
    found, console = self_check(), None if options.json else _console()
    if console:
        from jaxspatial.measure import report

        report.print_self_check(console, found)
    else:
        print(as_json(found.to_dict()) if options.json else found)
    return 0 if found.holds else 1


def _console(stderr=False):
    """Where tables and progress go; None without rich."""
    try:
        from rich.console import Console
    except ImportError:
        return None
    return Console(width=None if sys.stdout.isatty() else 144, stderr=stderr)


def _parser():
    parser = argparse.ArgumentParser(
        prog="python -m jaxspatial",
        description="The speed and accuracy trade, measured here. Exit status 1 where a promise does not hold.",
    )
    parser.add_argument(
        "file",
        nargs="?",
        type=pathlib.Path,
        help=".npz with arrays tau, f and, if known, w, v of shape (n, 3), or .csv with columns tau_x, tau_y, tau_z, "
        "f_x, ...; the shifted wrenches are written beside it. Without: a million wrenches on a rotating body",
    )
    parser.add_argument(
        "--offset", nargs=3, type=_finite, default=None, metavar=("X", "Y", "Z"), help="from P to Q, metres (p_PQ_E)"
    )
    parser.add_argument("--largest", type=_count, default=trade.LARGEST, help="number of wrenches to stream")
    parser.add_argument("--picture", type=pathlib.Path, default=None, help="where to write the picture")
    for name, choices in (("operation", OPERATIONS), ("dtype", trade.DTYPES)):
        what = f"only this {name}, may be repeated: {', '.join(choices)}"
        parser.add_argument(f"--{name}", action="append", choices=tuple(choices), metavar=name.upper(), help=what)
    parser.add_argument(
        "--json",
        action="store_true",
        help="everything measured as one JSON object on standard output, progress on standard error; a picture only "
        "with --picture. Keys: about, machine, versions, offset, sizes, power, rows, conditions, broken, holds, "
        "explained in jaxspatial/measure/result.py",
    )
    parser.add_argument(
        "--self-check",
        action="store_true",
        help="only ask whether the promises of the library hold on this backend and with these flags, in seconds",
    )
    return parser


def _finite(text):
    value = _number(text, float)
    if value is None or not np.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number of metres, got {text}")
    return value


def _count(text):
    value = _number(text, int)
    if value is None or value < trade.SMALLEST:
        raise argparse.ArgumentTypeError(f"expected at least {trade.SMALLEST} wrenches, got {text}")
    return value


def _number(text, kind):
    try:
        return kind(text)
    except ValueError:
        return None


def _run(options):
    if options.file is not None and options.offset is None:
        raise WrenchFileError("--offset: expected X Y Z, the position of the new point from the old, with a file")
    offset = np.array(_OFFSET if options.offset is None else options.offset)
    file = WrenchFile(options.file) if options.file else None
    wrenches, about = _wrenches(file, options)
    target = options.picture or (None if options.json else _beside(file))
    _check_writable((target or _beside(file)).parent)
    console = _console(stderr=options.json)
    result = _measured(options, console, wrenches, offset, about)
    if options.json:
        print(result.to_json())
    _show(console, result, [*_draw(result, target), *_write_shifted(file, offset)], tables=not options.json)
    return 1 if result.broken else 0


def _measured(options, console, wrenches, offset, about):
    """All measurements; where there is a console, with the power before, and a progress bar."""
    powers = {dtype: power.compare(wrenches, offset, dtype) for dtype in trade.STREAMED}
    operations = list(dict.fromkeys(options.operation or OPERATIONS))
    dtypes = list(dict.fromkeys(options.dtype or trade.DTYPES))
    lines, pairs = trade.cases(operations, dtypes), conditions.subjects(operations, dtypes)

    def work(advance):
        rows = trade.measure(wrenches, offset, lines, options.largest, advance)
        return rows, conditions.measure(pairs, advance)

    if console:
        _announce(console, f"{about}\noffset p_PQ = {offset.tolist()} m\n{timing.machine()}\n", powers)
    measured = _with_progress(console, work, trade.steps(lines) + len(pairs))
    return Result(about, timing.machine(), offset, trade.sizes(options.largest), powers, *measured)


def _announce(console, about, powers):
    from jaxspatial.measure import report

    console.print(about)
    report.print_power(console, powers)


def _with_progress(console, work, total):
    if console is None:
        return work(lambda: None)
    from jaxspatial.measure import report

    return report.with_progress(console, work, total)


def _draw(result, target):
    if target is None:
        return []
    from jaxspatial.measure import picture

    picture.draw(result, target)
    return [f"picture: {target}"]


def _write_shifted(file, offset):
    return [f"shifted wrenches: {file.write_shifted(shifted(file.parts, offset))}"] if file else []


def _show(console, result, written, tables):
    """Tables, what was written, and what is broken."""
    if tables:
        from jaxspatial.measure import report

        report.print_trade(console, result)
    broken = [f"does not hold here: {what}" for what in result.broken]
    for text in (*written, *broken):
        console.print(text, style="bold red" if text in broken else None) if console else print(text, file=sys.stderr)


def _wrenches(file, options):
    if file is None:
        return rotating_body(options.largest), f"{options.largest:,} wrenches on a rotating body"
    parts = {name: x.astype(np.float64) for name, x in file.parts.items()}
    moving = "w" in parts
    turning = np.broadcast_to(np.array([0.0, 0.0, 1.0]), parts["tau"].shape)
    motion = (parts["w"], parts["v"]) if moving else (turning, np.zeros_like(turning))
    about = f"{len(parts['tau']):,} wrenches of {file.path.name}" + ("" if moving else ", turning at 1 rad/s about z")
    return Wrenches(parts["tau"], parts["f"], *motion), about


def _beside(file):
    return file.path.with_name(f"{file.path.stem}_trade.png") if file else pathlib.Path("jaxspatial_trade.png")


def _check_writable(folder):
    if not os.access(folder, os.W_OK):
        raise WrenchFileError(f"{folder}: expected a folder to write to")


def shifted(parts, offset):
    """The wrenches, and the velocities where they are known, about Q: in the dtype they came in."""
    with jax.enable_x64(True):
        p = offset.astype(parts["tau"].dtype)
        F = shift(SpatialForce(parts["tau"], parts["f"]), p)
        result = {"tau": F.tau, "f": F.f}
        if "w" in parts:
            V = shift(SpatialVelocity(parts["w"], parts["v"]), p)
            result |= {"w": V.w, "v": V.v}
        return {name: np.asarray(x) for name, x in result.items()}

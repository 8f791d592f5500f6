"""The command line: the trade on the built-in scene or on the user's own wrenches."""

import argparse
import os
import pathlib
import sys

import jax
import numpy as np

from jaxspatial.measure import power, timing, trade
from jaxspatial.measure.scene import Wrenches, rotating_body
from jaxspatial.measure.wrench_file import WrenchFile, WrenchFileError
from jaxspatial.spatial import SpatialForce, SpatialVelocity, shift

_OFFSET = (0.3, -0.2, 0.5)
_NEEDED = "python -m jaxspatial shows tables, progress and pictures: pip install 'jaxspatial[plot]'"


def main(arguments=None):
    """Runs the command; returns its exit status: 0, 1 where power or an error bound does not hold, 2 for bad input."""
    options = _parser().parse_args(arguments)
    try:
        import matplotlib  # noqa: F401
        import rich  # noqa: F401
    except ImportError as error:
        print(f"error: {_NEEDED} ({error})", file=sys.stderr)
        return 2
    try:
        return _run(options)
    except WrenchFileError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _parser():
    parser = argparse.ArgumentParser(
        prog="python -m jaxspatial", description="The speed and accuracy trade, measured here."
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
    parser.add_argument("--largest", type=_count, default=trade.SIZES[-1], help="largest number of wrenches to time")
    parser.add_argument("--picture", type=pathlib.Path, default=None, help="where to write the picture")
    return parser


def _finite(text):
    value = _number(text, float)
    if value is None or not np.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number of metres, got {text}")
    return value


def _count(text):
    value = _number(text, int)
    if value is None or value < trade.SIZES[0]:
        raise argparse.ArgumentTypeError(f"expected at least {trade.SIZES[0]} wrenches, got {text}")
    return value


def _number(text, kind):
    try:
        return kind(text)
    except ValueError:
        return None


def _run(options):
    from rich.console import Console

    from jaxspatial.measure import picture, report

    if options.file is not None and options.offset is None:
        raise WrenchFileError("--offset: expected X Y Z, the position of the new point from the old, with a file")
    console = Console(width=None if sys.stdout.isatty() else 150)
    offset = np.array(_OFFSET if options.offset is None else options.offset)
    file = WrenchFile(options.file) if options.file else None
    wrenches, about = _wrenches(file, options)
    target = options.picture or _beside(file)
    _check_writable(target.parent)
    sizes = [n for n in trade.SIZES if n <= options.largest]
    console.print(f"{about}\noffset p_PQ = {offset.tolist()} m\n{timing.machine()}\n")
    powers = {dtype: power.compare(wrenches, offset, dtype) for dtype in trade.DTYPES}
    report.print_power(console, powers)
    rows = report.with_progress(console, lambda advance: trade.measure(wrenches, offset, sizes, advance=advance), sizes)
    report.print_trade(console, rows, sizes)
    picture.draw(rows, target, f"{about}\n{timing.machine()}")
    if file:
        console.print(f"shifted wrenches: {file.write_shifted(shifted(file.parts, offset))}")
    console.print(f"picture: {target}")
    return _status(console, powers, rows)


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


def _status(console, powers, rows):
    unequal = [dtype for dtype, p in powers.items() if not p.difference <= power.BOUND]
    broken = [row.case for row in rows if not row.u_of_magnitude <= row.bound]
    for what in (*unequal, *broken):
        console.print(f"[bold red]does not hold here: {what}")
    return 1 if unequal or broken else 0

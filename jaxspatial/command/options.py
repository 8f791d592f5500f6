"""What the command accepts: the options of its jobs."""

import argparse
import functools
import math
import pathlib
import re
from collections.abc import Callable, Sequence
from importlib import metadata
from typing import NoReturn, TypeVar

from jaxspatial.command import files
from jaxspatial.command.algorithms import ALGORITHMS
from jaxspatial.command.trade import DTYPES, LARGEST
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.numerics.precision import Precision

PARTS = {"tau": "torque", "f": "force", "w": "angular velocity", "v": "velocity"}
# The least number of wrenches to stream.
SMALLEST = 1_000
# What the formats of wrenches end in.
ENDINGS = ".npz", ".csv", ".tsv"


# -- the options -------------------------------------------------------------------------------------------------------

N = TypeVar("N", int, float)
_PROG = "jaxspatial"
_XYZ, _WXYZ = ("X", "Y", "Z"), ("W", "X", "Y", "Z")
_SUBCOMMANDS = """\
without any of these: a first look, in a minute

subcommands, each with its own --help:
  trade        what is done without a subcommand: measure
  shift FILE   wrenches of a file about another point, in other axes
  self-check   as --self-check
  demo         a quadruped that is pushed, in a browser

as in
  jaxspatial mine.csv --offset 0.3 0 -0.1
"""
_FILES = """\
The first line of a .csv has the names of columns; numbers have a decimal point:
  tau_x,tau_y,tau_z,f_x,f_y,f_z
  0.5,0,-1.25,10,0,3
Without torques, forces act at the point themselves. In a .npz, p_x is a column of an array p (n, 3).
"""
_SHIFTING = """\
as in
  shift mine.csv --offset 0.3 0 -0.1      the same for all rows
  shift mine.csv --offset p_x p_y p_z     columns of the file: each row has its own

columns: f_x f_y f_z and, if known, tau_x ... v_z, or named: --columns tau=Mx,My,Mz f=Fx,Fy,Fz
(or f=force for force_x, force_y, force_z). In a .npz they are arrays tau, f (n, 3), and a name may be that of an array
(n,), or of a column of one: p_x of p (n, 3), q_w of q (n, 4), a_0 of a (n, k).
"""
# By option, what it takes: numbers, or names of columns.
_EXAMPLES = {
    "offset": ("0.3 0 -0.1", "p_x p_y p_z"),
    "rotation": ("1 0 0 0", "q_w q_x q_y q_z"),
    "pose": ("1 0 0 0 0.3 0 -0.1", "q_w q_x q_y q_z p_x p_y p_z"),
}


def example(name: str, has_columns: bool = True):
    """How an option of a motion is given, with numbers and, where rows may have their own, with columns."""
    numbers, columns = _EXAMPLES[name]
    return f"as in --{name} {numbers}" + (f", or with columns of the file, --{name} {columns}" if has_columns else "")


class _Parser(argparse.ArgumentParser):
    """Takes -1e-3 for the number that it is, not for an option; has examples for what is given wrongly."""

    def __init__(self, has_columns: bool, **names):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **names)
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self._has_columns = has_columns

    def error(self, message: str) -> NoReturn:
        """Exits, as that of any parser."""
        named = re.match(r"argument --(\w+): expected", message)
        hint = f"; {example(named[1], self._has_columns)}" if named and named[1] in _EXAMPLES else ""
        super().error(message + hint)


def measuring():
    """The parser of the main job."""
    parser = _Parser(
        has_columns=False,
        prog=_PROG,
        description="The trade-off of speed and accuracy, measured here. Exit status 1 where a promise does not hold,\n"
        "2 where something cannot be done, 130 after an interrupt.",
        epilog=f"{_SUBCOMMANDS}\n{_FILES}",
    )
    versions = ", ".join(f"{package} {metadata.version(package)}" for package in (_PROG, "jax", "jaxlib"))
    parser.add_argument("--version", action="version", version=versions, help="of this library and of JAX")
    parser.add_argument(
        "file",
        nargs="?",
        type=pathlib.Path,
        help=".npz with arrays f and, if known, tau, w, v of shape (n, 3), or .csv with columns tau_x, tau_y, tau_z, "
        "f_x, ... What needs a motion is only measured where the file has "
        "it. Without: a million wrenches on a rotating body",
    )
    parser.add_argument(
        "--offset",
        nargs=3,
        type=functools.partial(_finite, what="number of metres"),
        metavar=_XYZ,
        help="from P to Q, metres (p_PQ_E)",
    )
    parser.add_argument(
        "--robot",
        type=pathlib.Path,
        help=".urdf or MJCF file of the robot whose inverse and forward dynamics are measured. Without: an arm of "
        "seven joints; none where a FILE of wrenches is given",
    )
    parser.add_argument("--largest", type=_count, default=LARGEST, help="number of wrenches to stream")
    parser.add_argument("--picture", type=pathlib.Path, help="where to write the picture")
    for name, choices in (("operation", (*OPERATIONS, *ALGORITHMS)), ("dtype", DTYPES)):
        what = f"only this {name}, may be repeated: {', '.join(choices)}"
        parser.add_argument(f"--{name}", action="append", choices=choices, metavar=name.upper(), help=what)
    parser.add_argument(
        "--full", action="store_true", help="everything: all operations, dtypes and numbers, minutes instead of seconds"
    )
    _add_overwrite(parser)
    parser.add_argument(
        "--json",
        action="store_true",
        help="everything measured as one JSON object on standard output, progress on standard error; a picture only "
        "with --picture. Keys: about, machine, versions, offset, sizes, power, rows, conditions, algorithms, "
        "applications, broken, holds, explained in jaxspatial/command/result.py",
    )
    what = "only ask whether the promises of the library hold on this backend and with these flags, in seconds"
    parser.add_argument("--self-check", action="store_true", help=what)
    return parser


def shifting():
    """The parser of `shift`."""
    parser = _Parser(
        has_columns=True,
        prog=f"{_PROG} shift",
        description="Wrenches, and velocities where they are known, about another point and in other axes.\n"
        "X, W, PX ... are numbers, or names of columns of the file: then each row has its own.",
        epilog=f"{_SHIFTING}\n{_FILES}",
    )
    parser.add_argument("file", type=pathlib.Path, help=".npz, .csv or .tsv; separated by commas, semicolons or tabs")
    motions = (
        ("offset", _XYZ, "from P to Q, metres, in the axes of the file (p_PQ_E)"),
        ("rotation", _WXYZ, "unit quaternion of R_AE, from the axes E of the file to other axes A; after the offset"),
        ("pose", (*_WXYZ, "PX", "PY", "PZ"), "X_AB, as quaternion and position of frame B in A: from B's origin and "
         "axes, as in the file, to A's"),
    )  # fmt: skip
    for name, entries, what in motions:
        parser.add_argument(f"--{name}", nargs=len(entries), type=_entry, metavar=entries, help=what)
    parser.add_argument("--columns", nargs="+", action=_Columns, metavar="PART=NAMES", help="what the file calls them")
    parser.add_argument("--output", type=pathlib.Path, help="where to write; without: FILE_shifted, beside it")
    _add_overwrite(parser)
    parser.add_argument("--precision", choices=tuple(map(str, Precision)), help="of the arithmetic")
    return parser


def checking():
    """The parser of `self-check`."""
    description = "Whether the promises of the library hold here."
    parser = _Parser(has_columns=False, prog=f"{_PROG} self-check", description=description)
    parser.add_argument("--json", action="store_true", help="as one JSON object: holds, surroundings, findings")
    return parser


def showing():
    """The parser of `demo`."""
    description = "A quadruped that is pushed, in a browser: a slider, a box to let it play, and the forces as arrows."
    parser = _Parser(has_columns=False, prog=f"{_PROG} demo", description=description)
    parser.add_argument("--record", type=pathlib.Path, metavar="FILE", help="write a page that needs no server, .html")
    parser.add_argument("--port", type=_port, default=8080, help="the first to try")
    _add_overwrite(parser)
    return parser


def _add_overwrite(parser):
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist already")


class _Columns(argparse.Action):
    """part=names, for each part at most once: a dictionary of tuples."""

    def __call__(self, parser, namespace, values, option_string=None):
        columns = dict(getattr(namespace, self.dest) or {})
        for text in values or ():
            part, _, names = text.partition("=")
            columns[part] = tuple(name.strip() for name in names.split(","))
            if part not in PARTS or len(columns[part]) not in (1, 3) or not all(columns[part]):
                expected = f"{', '.join(PARTS)} with one name or three, as f=Fx,Fy,Fz"
                parser.error(f"--columns: expected {expected}, got {text}")
        setattr(namespace, self.dest, columns)


def _entry(text: str):
    """A number, or the name of a column."""
    is_name = number_of(text, float) is None and not decimal_point(text)
    return text if is_name else _finite(text, "number")


def _finite(text: str, what: str):
    value = number_of(text, float)
    if value is None or not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite {what}, got {text}{decimal_point(text)}")
    return value


def _count(text: str):
    value = number_of(text, int)
    if value is None or value < SMALLEST:
        raise argparse.ArgumentTypeError(f"expected at least {SMALLEST} wrenches, got {text}")
    return value


def _port(text: str):
    value = number_of(text, int)
    if value is None or not 0 <= value < 2**16:
        raise argparse.ArgumentTypeError(f"expected a number from 0 to 65535, got {text}")
    return value


def number_of(text: str, kind: Callable[[str], N]):
    """The number that a text is; None for any other text."""
    try:
        return kind(text)
    except ValueError:
        return None


def decimal_point(text: str):
    """A hint for a number with a decimal comma; nothing for anything else."""
    is_number = re.fullmatch(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*", text)
    return f"; numbers have a decimal point, as {text.strip().replace(',', '.')}" if is_number else ""


# -- what can be refused before any work is done -----------------------------------------------------------------------


def to_measure(arguments: Sequence[str]):
    """The options of the main job, with files that are there."""
    options = measuring().parse_args(arguments)
    if options.file is not None:
        files.existing(options.file, ENDINGS)
        if options.offset is None:
            what = "the position of the new point from the old, with a file"
            raise files.WrenchFileError(f"--offset: expected X Y Z, {what}, {example('offset', has_columns=False)}")
    if options.robot is not None:
        files.existing(options.robot)
    return options


def is_first_look(given: argparse.Namespace):
    """Whether nothing is asked for: neither a part nor everything."""
    asked = given.file, given.operation, given.dtype, given.robot, given.full, given.json
    return not any(asked) and given.largest == LARGEST


def to_shift(arguments: Sequence[str]):
    """The options of `shift`, with a file that is there, one motion, and a place for the result."""
    options = shifting().parse_args(arguments)
    files.existing(options.file, ENDINGS)
    if options.offset is options.rotation is options.pose is None:
        wanted = "--offset X Y Z, --rotation W X Y Z or --pose W X Y Z PX PY PZ"
        raise files.WrenchFileError(f"expected {wanted}, {example('offset')}")
    if options.pose is not None and not (options.offset is options.rotation is None):
        raise files.WrenchFileError(
            "--pose: is a rotation and a position; expected no --offset or --rotation beside it"
        )
    # By default beside the file.
    options.output = options.output or options.file.with_stem(f"{options.file.stem}_shifted")
    if options.output.suffix.lower() != options.file.suffix.lower():
        raise files.WrenchFileError(f"--output: expected a name ending in {options.file.suffix}, as {options.file} has")
    files.writable(options.output, options.overwrite)
    return options

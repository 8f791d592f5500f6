"""Which cases the laws are tested on: all of them with `-m ""`, and by default those that tell the most.

All operations in all dtypes, precisions and surroundings take hours to compile, and most of that is the same formula
with other numbers. So each choice below lists all its cases, says which of them run by default, and why.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import pytest

from jaxspatial.numerics.precision import Precision
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow
from tests.helpers.operations import (
    DISTINCT,
    DISTINCT_BOUNDED,
    DISTINCT_SUMS,
    DTYPES,
    NAIVE,
    OPERATIONS,
    OTHER_REPRESENTATIVES,
    REPRESENTATIVES,
)
from tests.laws.batches import ALL, FIRST, ONE
from tests.laws.surroundings import OF_ITEMS, OF_OPERATIONS

MANY = (*REPRESENTATIVES, *OTHER_REPRESENTATIVES)
DIFFERENTIABLE = [name for name in DISTINCT if OPERATIONS[name].differentiable]
DIFFERENTIABLE_BY_FORMULA = [name for name in DIFFERENTIABLE if name in NAIVE]


class Choice(NamedTuple):
    """The cases of a test, which of them run by default, and why these are enough."""

    cases: Sequence[Any]
    by_default: Callable[[Any], bool]
    why: str

    @property
    def parametrize(self):
        """Decorates a test whose arguments are the fields of a case."""
        cases = [case if self.by_default(case) else slow(*case) for case in self.cases]
        return pytest.mark.parametrize(self.cases[0]._fields, cases)


class Case(NamedTuple):
    """An operation in a dtype and a precision; None: the default one, "reproducible"."""

    name: str
    dtype: str
    precision: Precision | str | None


# -- error bounds, see `test_error_bounds` ----------------------------------------------------------------------------

BOUNDS_OP_BY_OP = Choice(
    list(itertools.starmap(Case, itertools.product(DISTINCT_BOUNDED, ["float32", "float64"], Precision))),
    by_default=lambda case: (
        case.dtype == "float32"
        and (case.precision != "faithful" or not OPERATIONS[case.name].is_long)
        or case.dtype == "float64"
        and case.precision == "compensated"
    ),
    why="Op by op nothing is compiled, and all precisions are cheap but for long sums in faithful. In float64 errors "
    "are summed beside in compensated, and what the bound has in u^2 shows where nearly all cancels; in faithful sums "
    "are rounded once as a whole, which shows in float32, too: there, terms rounded one by one break the bound.",
)

# These two are compiled in every dtype and precision, and in the surroundings of `bound_surroundings`.
_BOUND_REPRESENTATIVES = ("shift_force", "dot_force_velocity")
BOUNDS_COMPILED = Choice(
    list(itertools.starmap(Case, itertools.product(DISTINCT_SUMS, DTYPES, Precision))),
    by_default=lambda case: (
        case.name == _BOUND_REPRESENTATIVES[0]
        or case.name == _BOUND_REPRESENTATIVES[1]
        and case.dtype == "float32"
        or case.name in (*REPRESENTATIVES, "central_axis", "kinetic_energy")
        and case.dtype == "float32"
        and case.precision == "compensated"
    ),
    why="Products of many factors compile for seconds, those of act_acceleration for minutes. So one operation of each "
    "kind is compiled in float32 and compensated, as bits of reproducible are compared elsewhere; one of them in all "
    "dtypes and precisions, since error-free transforms in float64 and in 16 bits are made the same way for all, and "
    "another in all precisions.",
)
BOUNDS_SURROUNDED = Choice(
    list(itertools.starmap(Case, itertools.product(_BOUND_REPRESENTATIVES, ["float32", "float64"], Precision))),
    by_default=lambda case: False,
    why="By default the first operation is in all surroundings in float32, see `bound_surroundings`.",
)


def bound_surroundings(name, dtype, precision):
    """In which of `surroundings.OF_ITEMS` a compiled operation is tried: the first representative in all."""
    if name not in _BOUND_REPRESENTATIVES or dtype not in ("float32", "float64") or precision == "fast":
        return ("jit vmap", "single items")
    if (name, dtype) == (_BOUND_REPRESENTATIVES[0], "float32"):
        return tuple(OF_ITEMS)
    return ("jit vmap", "single items", "inside a larger fusion")


# -- bounds of derivatives, see `test_derivatives` --------------------------------------------------------------------


class DerivativeCase(NamedTuple):
    """Derivatives of an operation, compiled (`jax.jit`) or op by op (`interpreted`)."""

    name: str
    dtype: str
    precision: str
    run: Callable


_WITH_EXACT_DERIVATIVES = (
    "shift_force",
    "shift_velocity",
    "shift_acceleration",
    "dot_force_velocity",
    "cross_velocity",
    "cross_force",
    "rotate",
    "wrench_from_point_forces",
)
DERIVATIVES = Choice(
    [
        *(
            DerivativeCase(name, dtype, precision, jax.jit)
            for name, dtype in [
                *itertools.product(_WITH_EXACT_DERIVATIVES, ["float32", "float64"]),
                ("shift_velocity", "bfloat16"),
            ]
            for precision in ("compensated", "faithful")
        ),
        *(DerivativeCase(name, "float32", "compensated", interpreted) for name in _WITH_EXACT_DERIVATIVES),
    ],
    by_default=lambda case: (
        case.run is interpreted
        or case.name == "shift_velocity"
        and case[1:3]
        in [("float32", "compensated"), ("float32", "faithful"), ("float64", "compensated"), ("bfloat16", "faithful")]
    ),
    why="One operation is compiled in each dtype and precision; all run op by op in one dtype and precision, as "
    "formulas are the same in each.",
)

# -- derivatives next to the exact ones, see `test_linearisations` ----------------------------------------------------

LINEARISATIONS = Choice(
    [
        *(Case(name, dtype, None) for dtype in ("float32", "float64") for name in DIFFERENTIABLE),
        *(Case(name, "bfloat16", None) for name in DIFFERENTIABLE_BY_FORMULA),
        *(Case(name, dtype, "fast") for dtype in ("float32", "float64") for name in DISTINCT_SUMS),
        *(Case(name, "float32", precision) for precision in ("compensated", "faithful") for name in DISTINCT_SUMS),
    ],
    by_default=lambda case: (
        case.precision in (None, "compensated")
        and case.name in REPRESENTATIVES
        or case[1:] == ("float32", None)
        and case.name in (*DIFFERENTIABLE_BY_FORMULA, *OTHER_REPRESENTATIVES, "from_axis_angle", "project_out", "log")
        or case.precision == "fast"
        and case.name == "shift_force"
    ),
    why="A derivative is made of the same operations in every dtype and precision: formulas run in float32, and "
    "representatives in the other dtypes and in compensated too. Three more have arguments that are often known.",
)


class Shared(NamedTuple):
    """An operation with one argument that all items of a batch share; the batch is one by `vmap` or by broadcasting."""

    name: str
    how: str


SHARED_ARGUMENTS = Choice(
    [
        Shared(name, how)
        for name in DIFFERENTIABLE
        if " " in OPERATIONS[name].arguments
        for how in ("vmap", "broadcasting")
    ],
    by_default=lambda case: (
        case.how == "vmap" and case.name in DIFFERENTIABLE_BY_FORMULA and not OPERATIONS[case.name].is_long
    ),
    why="Short formulas under vmap have all the ways in which a cotangent is summed over the batch.",
)


class Compiled(NamedTuple):
    """An operation in a dtype, compiled."""

    name: str
    dtype: str


COMPILED_DERIVATIVES = Choice(
    [
        *(Compiled(name, "float32") for name in (*REPRESENTATIVES, "newton_euler")),
        *(Compiled(name, "float32") for name in DIFFERENTIABLE_BY_FORMULA if name not in REPRESENTATIVES),
        *(Compiled(name, "float64") for name in DIFFERENTIABLE_BY_FORMULA),
        Compiled("combine", "float32"),
    ],
    by_default=lambda case: case.dtype == "float32" and case.name in (*REPRESENTATIVES, "newton_euler"),
    why="Representatives have all kinds of products and sums that a compiler could contract.",
)

# -- dtypes and precisions of what has no formula, see `test_precisions` ----------------------------------------------

# Op by op, sums over many items are many programs of many shapes: `inertia.test_mesh` and `test_sums` test them.
_OF_MANY_SHAPES = ("triangle_mesh", "sum_of_inertias")
PRECISIONS = Choice(
    [
        Case(name, dtype, precision)
        for dtype in DTYPES
        for precision in ("fast", "reproducible", "compensated", "faithful")
        for name in OPERATIONS
        if name not in NAIVE and (name in DISTINCT or (dtype, precision) == ("float32", "reproducible"))
    ],
    by_default=lambda case: (
        case.name not in _OF_MANY_SHAPES
        and (
            case[1:] == ("float32", "reproducible")
            or case.name in OTHER_REPRESENTATIVES
            and case[1:]
            in [
                ("float32", "compensated"),
                ("float16", "faithful"),
                ("float64", "reproducible"),
                ("bfloat16", "reproducible"),
            ]
        )
    ),
    why="Nothing in a formula depends on dtype and precision but the numbers it runs in: all operations run in one of "
    "each, representatives in four more, so that each dtype and each precision but fast is met.",
)


class Surrounded(NamedTuple):
    """Representatives in one of `surroundings.OF_OPERATIONS`."""

    surrounding: str
    precision: str


SURROUNDED = Choice(
    [Surrounded(*x[::-1]) for x in itertools.product(("compensated", "faithful", "fast"), OF_OPERATIONS)],
    by_default=lambda case: case.precision == "compensated",
    why="Compensated sums are the shortest that need every error-free transform.",
)

# -- programs of many operations, see `test_transformations` ----------------------------------------------------------


class Program(NamedTuple):
    """Operations that are compiled together: one program of many compiles in the time of a few."""

    surrounding: str  # of `surroundings.OF_OPERATIONS`
    dtype: str
    x64: bool
    items: Any  # of the batch
    operations: Sequence[str]
    why: str
    is_slow: bool = False


# These take long to compile, and are made of other operations of the table or of the same kind as a representative.
_LONG = (
    "triangle_mesh",
    "sum_of_inertias",
    "interpolate",
    "interpolate_motion",
    "exp_of_motion",
    "log_of_motion",
    "left_jacobian",
    "left_jacobian_of_motion",
    "left_jacobian_inverse_of_motion",
    "from_roll_pitch_yaw",
    "to_roll_pitch_yaw",
    "between",
    "is_physically_valid",
    "validity_slack",
    "nearest_valid",
    "equivalent_ellipsoid",
    "to_log_cholesky",
    "act_inverse_articulated",
    "project_out_two",
)
_SHORT = [name for name in DISTINCT if name not in (*_LONG, *MANY)]
_FEW = (*REPRESENTATIVES[:3], *OTHER_REPRESENTATIVES[:3])
_FEWEST = (*REPRESENTATIVES[:3], "from_one_vector")
_OFTEN_KNOWN = (*MANY, "from_axis_angle", "project_out")
PROGRAMS = [
    Program("vmap", "float32", False, FIRST, _SHORT, "Each formula is compiled once."),
    Program("vmap", "float32", False, FIRST, _LONG, "As above; what takes long.", is_slow=True),
    Program("nested", "float32", False, ALL, _FEW, "Loops, branches and rematerialization differ most from a formula."),
    Program(
        "nested", "float32", False, ALL, [name for name in DISTINCT if name not in _FEW], "As above; the others.", True
    ),
    Program("known", "float32", True, FIRST, _OFTEN_KNOWN, "Known numbers fold, and must fold to the same bits."),
    Program("known", "float32", False, ALL, tuple(OPERATIONS), "As above; all operations, 64-bit types off.", True),
    Program("known", "float64", True, ALL, DISTINCT, "As above; in float64.", is_slow=True),
    *(
        Program("vmap", dtype, True, ALL, DISTINCT, "Each formula is compiled in each dtype.", is_slow=True)
        for dtype in ("float64", "float16", "bfloat16")
    ),
    Program("eager", "float32", False, ALL, _FEW, "Each primitive is a program of its own."),
    Program("jit", "float64", True, ONE, _FEWEST, "Without a batch the compiler rewrites scalars."),
    Program("vmap", "float64", True, ALL, (*_FEWEST, "combine"), "No wider dtype takes float64 up."),
    Program("known", "float64", True, ALL, _FEWEST, "Constants in float64 fold too."),
    *(
        Program("vmap", dtype, True, ALL, _FEWEST, "16 bits are computed in float32 and rounded once.")
        for dtype in ("float16", "bfloat16")
    ),
    *(
        Program(surrounding, "float32", False, ALL, REPRESENTATIVES[:3], "A few operations in all surroundings.")
        for surrounding in OF_OPERATIONS
    ),
    *(
        Program(surrounding, dtype, True, ALL, MANY, "Many operations in all surroundings.", is_slow=True)
        for surrounding in OF_OPERATIONS
        for dtype in ("float32", "float64")
    ),
]

"""The precisions a caller can name, and what each promises."""

import contextlib
import enum
from typing import Any

import jax


class Precision(enum.StrEnum):
    """How sums of products are evaluated; the plain string is accepted wherever a precision is.

    `FAST`: the compiler may make one fused multiply-add of `a * b + c`, so that results depend on the program
    around them.
    `REPRODUCIBLE` (the default): every product is rounded on its own. Results are bitwise those of the same formula in
    NumPy, whatever the batch size, whether compiled or not, and whatever computed the arguments; `cross(a, a) == 0`,
    `cross(a, b) == -cross(b, a)`; inputs scaled by powers of two give outputs scaled by powers of two. bfloat16 is
    evaluated in float32, and rounded once.
    `COMPENSATED`: as if computed in twice the precision and rounded once.
    `FAITHFUL`: within one unit in the last place of the exact result, however much cancels.

    Each operation states its bounds in terms of u, the unit roundoff of the inputs' dtype, mag, the sum of the absolute
    values of the terms of a component, and r, the exact component. The last two hold for derivatives of every order.

    Example:
        >>> near = js.SpatialForce(f=np.float32([1e4, 1.0, 1e4])), js.SpatialVelocity(v=np.float32([1e4, 0.1, -1e4]))
        >>> print([round(float(js.dot(*near, precision=p)), 4) for p in js.Precision])
        [0.0, 0.0, 0.1, 0.1]
    """

    FAST = "fast"
    REPRODUCIBLE = "reproducible"
    COMPENSATED = "compensated"
    FAITHFUL = "faithful"

    @property
    def of_one_limb(self) -> "Precision":
        """Itself; "reproducible" for those that compute with more than the working precision."""
        return Precision.REPRODUCIBLE if self.sees_whole_sums else self

    @property
    def sees_whole_sums(self):
        """True for those that evaluate a sum of products as a whole, and not operation by operation."""
        return self in (Precision.COMPENSATED, Precision.FAITHFUL)

    @property
    def is_within_an_ulp(self):
        """True for those within one unit in the last place, whatever cancels, or overflows on the way."""
        return self is Precision.FAITHFUL


DEFAULT = Precision.REPRODUCIBLE
# The one that others are held against; in whole algorithms "faithful" carries the same numbers, under the same promise.
OF_REFERENCES = Precision.COMPENSATED
OF_ALGORITHMS = Precision.FAST, Precision.REPRODUCIBLE, OF_REFERENCES

# Part of the key under which jit caches its traces: a function traced under one default is traced again under another.
_default: Any = jax.make_user_context(default_value=DEFAULT)


def default_precision(precision: Precision | str) -> contextlib.AbstractContextManager[None]:
    """A context manager: operations inside, called without `precision=`, run in this one. An explicit one wins.

        with js.default_precision("fast"):
            simulate(state)

    What counts is where a function is called: it is traced once for every default it is called under. Defaults nest,
    and each thread has its own.

    Args:
        precision: name of a precision, or a `Precision`.

    Returns:
        The context manager.

    Raises:
        ValueError: the name is that of no precision.

    Error: none, nothing is computed.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> with js.default_precision("compensated"):
        ...     print(js.shift(F, [2.0, 0.0, 0.0]).tau)
        [ 0.  0. -1.]
    """
    return _default(resolve(precision))


def resolve(precision: Precision | str | None) -> Precision:
    """The named precision, or the default for None."""
    if precision is None:
        return _default.value
    try:
        return Precision(precision)
    except ValueError:
        names = ", ".join(repr(str(p)) for p in Precision)
        raise ValueError(f"precision: expected one of {names} or None, got {precision!r}") from None

"""What is done to all kinds of spatial vectors alike: sums, multiples, comparisons, and operations as methods."""

import operator
from collections.abc import Callable
from typing import Any, Self, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.errorfree.barrier import barrier
from jaxspatial.arithmetic.errorfree.reproducible import product, quotient
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Three, folding
from jaxspatial.arithmetic.numbers.components import Components, as_array, is_zero
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.stacking import Summed
from jaxspatial.arithmetic.numbers.trees import from_double_word, to_double_word
from jaxspatial.arithmetic.quantity import Quantity, matched, moved_to_last
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.rotation.matrices import expanded
from jaxspatial.spatial import operations
from jaxspatial.spatial.parts import Parts

_Kind = TypeVar("_Kind", bound=Quantity)


class SpatialVector(Parts):
    """Base of the four kinds. A subclass is a `tree` of two fields, rotational first."""

    # -- arithmetic ---------------------------------------------------------------------------------------------------

    def __add__(self, other: Any) -> Self:
        """Component by component, for two about the same point in the same frame: error <= u |x_i + y_i|."""
        return self._combined(operator.add, other)

    def __sub__(self, other: Any) -> Self:
        """Component by component, for two about the same point in the same frame: error <= u |x_i - y_i|."""
        return self._combined(operator.sub, other)

    def __radd__(self, other: Any) -> Self:
        """0 + x is x, for Python's `sum`; nothing else adds to a spatial vector."""
        if isinstance(other, int) and other == 0:
            return self
        return self.__rsub__(other)

    def __rsub__(self, other: Any) -> Any:
        raise TypeError(f"+ or -: expected two of one kind, got {type(other).__name__} and {type(self).__name__}")

    def __neg__(self) -> Self:
        """Component by component, exactly."""
        return self.with_vectors(-part for part in self.vectors)

    def __mul__(self, scalar: Any) -> Self:
        """Times a number, or one number per vector of the batch: error <= u |x_i s| per component.

        The number does not add axes to the batch: three times one vector is `jax.vmap(operator.mul, (None, 0))(x, s)`.
        """
        return self._scaled(product, scalar)

    __rmul__ = __mul__

    def __truediv__(self, scalar: Any) -> Self:
        """Divided by a number, or by one number per vector of the batch: error <= u |x_i / s| per component."""
        return self._scaled(quotient, scalar)

    def _combined(self, operation: Any, other: Any) -> Any:
        if not isinstance(other, SpatialVector):
            return NotImplemented
        return combined(operation, self, other)

    def _scaled(self, operation: Any, scalar: Any) -> Any:
        if isinstance(scalar, SpatialVector):
            return NotImplemented
        x, s = check.narrowed(self), self._scalar(scalar)
        batch = check.common_batch_shape(**{type(self).__name__: x.batch_shape, "scalar": s.shape})
        parts = check.broadcast_batch(batch, *x.vectors)
        factor = s if folding.is_known(s) else check.broadcast_batch(batch, expanded(s))[0]
        return self.with_vectors(_scaled_part(operation, part, factor) for part in parts)

    def _scalar(self, scalar: Any) -> Any:
        """A number, or one per vector of the batch: NumPy's for Python's."""
        kind = type(self).__name__
        dtype = check.narrowed(self).dtype
        if isinstance(scalar, (int, float)):
            return dtype.type(scalar)
        s = check.as_float_array(scalar, f"{kind} * or / scalar", dtype)
        check.require_same_dtype(**{kind: self, "scalar": s})
        if len(s.shape) > len(self.batch_shape) and not all(map(check.goes_with_any_batch, self.vectors)):
            raise ValueError(
                f"{kind} * or / scalar: expected a number, or one per vector of the batch of shape {self.batch_shape}, "
                f"got shape {s.shape}; each of them times all: jax.vmap(operator.mul, in_axes=(None, 0))(x, s)"
            )
        return s

    def sum(self, axis: int = 0, *, precision: PrecisionName = None) -> Self:
        """The sum of all vectors along an axis of the batch, about the same point in the same frame.

        Summed by halving, always in the same order.

        Args:
            axis: of the batch; negative ones count from its end.
            precision: name of a precision; None takes the default.

        Returns:
            The sum, over the other axes of the batch; of no vectors zero.

        Raises:
            ValueError: the batch does not have the axis.

        Error: per component of n vectors, L = ceil(log2 n), mag the sum of the absolute values: at most L u mag in
            "fast" and "reproducible", u |r| + 2 L^2 u^2 mag in "compensated", 1 ulp of r in "faithful" while |r| >= n^2
            u^2 mag (a sum in three times the precision), while nothing over- or underflows; plus a few finfo.tiny where
            subnormals are flushed.
        Source: Higham 2002, 4.2: pairwise summation.
        """
        place = check.batch_axis(axis, self.batch_shape, f"{type(self).__name__}.sum")
        return self.with_vectors(_summed(precision, *moved_to_last(self.vectors, place, self.batch_shape)))

    # -- operations ---------------------------------------------------------------------------------------------------

    def shift(self, p_PQ_E: Vector3, w: Vector3 | None = None, *, precision: PrecisionName = None) -> Self:
        """To another point of the body, see `jaxspatial.shift`."""
        return operations.shift(self, p_PQ_E, w, precision=precision)

    def dot(self, other: "SpatialVector", *, precision: PrecisionName = None) -> jax.Array:
        """The pairing of force and velocity, see `jaxspatial.dot`."""
        return operations.dot(self, other, precision=precision)

    def __rmatmul__(self, R_AE: Any) -> Self:
        """R @ X: see `jaxspatial.rotate`."""
        return operations.rotate(R_AE, self)

    # -- comparison: arrays of answers over the batch; NaN never compares as near -------------------------------------

    def get_maximum_absolute_differences(self, other: Self) -> tuple[jax.Array, jax.Array]:
        """The largest absolute difference of each part, NaN where either has one.

        Args:
            other: the same kind, about the same point, in the same frame.

        Returns:
            (rotational (*batch,), translational (*batch,)), over the common batch.

        Raises:
            TypeError: other is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: that of one rounded difference.
        """
        a, b = matched(self, other, "comparison")
        differences = (folding.quietly(operator.sub, x, y) for x, y in zip(a.vectors, b.vectors, strict=True))
        rotational, translational = (from_double_word(abs(as_array(d, a.batch_shape))) for d in differences)
        return _largest(rotational), _largest(translational)

    def is_nearly_equal_within_absolute_tolerance(
        self, other: Self, rotational_tolerance: ArrayLike, translational_tolerance: ArrayLike
    ) -> jax.Array:
        """True where the largest absolute difference of each part is at most its tolerance.

        Args:
            other: the same kind, about the same point, in the same frame.
            rotational_tolerance: (*batch,), in the units of the rotational part.
            translational_tolerance: (*batch,), in the units of the translational part.

        Returns:
            A mask (*batch,), over the common batch; False where there is a NaN.

        Raises:
            TypeError: other is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `get_maximum_absolute_differences`.
        """
        rotational, translational = self.get_maximum_absolute_differences(other)
        return (rotational <= _plain(rotational_tolerance)) & (translational <= _plain(translational_tolerance))

    def is_approx(self, other: Self, tolerance: ArrayLike | None = None) -> jax.Array:
        """True where all six absolute differences are at most the tolerance.

        Args:
            other: the same kind, about the same point, in the same frame.
            tolerance: (*batch,); None takes the eps of the dtype.

        Returns:
            A mask (*batch,), over the common batch; False where there is a NaN.

        Raises:
            TypeError: other is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `get_maximum_absolute_differences`.
        """
        a, b = matched(self, other, "comparison")
        tolerance = check.eps(a.dtype) if tolerance is None else tolerance
        return a.is_nearly_equal_within_absolute_tolerance(b, tolerance, tolerance)


@formula(of_sums=True)
def _summed(rotational: Three, translational: Three) -> list[Summed]:
    return [vectors.summed(rotational), vectors.summed(translational)]


def _scaled_part(operation: Callable[..., Any], part: Any, s: Any) -> Any:
    """operation(part, s) for s (*batch, 1) or a number; double words and Components know it as an operator."""
    factor: Any = s
    x: Any = to_double_word(part) if isinstance(s, DoubleWord) and not isinstance(part, Components) else part
    if isinstance(x, check.StandIn):
        return x * factor if operation is product else x / factor
    return operation(barrier(x), barrier(jnp.broadcast_to(factor, x.shape)))


def combined(operation: Callable[..., Any], x: _Kind, y: _Kind) -> _Kind:
    """x + y or x - y, of one kind, part by part."""
    a, b = matched(x, y, operation.__name__)
    return a.with_vectors(_skipping_zero(operation, *parts) for parts in zip(a.vectors, b.vectors, strict=True))


def _skipping_zero(operation: Callable[..., Any], x: Any, y: Any) -> Any:
    """x + y or x - y: of known zeros nothing is left."""
    if is_zero(y):
        return x
    if is_zero(x):
        return y if operation is operator.add else -y
    return folding.quietly(operation, barrier(x), barrier(y))


def _largest(x: Any) -> Any:
    # Written out: a reduction over an axis of length 3 is a library call on XLA CPU. Both maxima keep NaN.
    maximum: Any = np.maximum if isinstance(x, np.ndarray) else jnp.maximum
    return maximum(maximum(x[..., 0], x[..., 1]), x[..., 2])


def _plain(number: ArrayLike) -> ArrayLike:
    """A Python number for any that is one (np.float64 is): it takes the dtype of what it is compared with."""
    return float(number) if isinstance(number, float) else number

"""What all spatial vectors share: two 3-vectors, rotational on top of translational, about one point, in one frame.

Which point, which body and which frame is said by names (monogram notation: `F_Bp_E` acts on body B at point Bp,
expressed in frame E), never stored: vectors of different frames can be stacked, scanned and batched.
"""

import dataclasses
import operator
import typing
from typing import Any, Self

import chex
import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, folding, vectors
from jaxspatial.arithmetic.components import Components, as_array
from jaxspatial.arithmetic.double_word import DoubleWord, from_double_word, to_double_word
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.quantity import Quantity, matched, moved_to_last
from jaxspatial.arithmetic.reproducible import product, quotient
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.arithmetic.types import BatchShape, DTypeLike, PrecisionName, Six, Vector3
from jaxspatial.spatial import operations


class SpatialVector(Quantity):
    """Base of the four kinds. A subclass is a frozen dataclass with two fields, see `spatial_vector`."""

    if typing.TYPE_CHECKING:

        def __init__(self, rotational: Vector3, translational: Vector3): ...

    # The names of the two fields, set by `spatial_vector`.
    _names: typing.ClassVar[tuple[str, ...]] = ()

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    def __post_init__(self):
        """Checks what a caller passes. JAX rebuilds vectors without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(leaf) for leaf in self._parts):
            return
        names = [f"{type(self).__name__}: {name}" for name in self._names]
        given = zip(names, self._parts, strict=True)
        arrays = check.alike(**{name: _owned(check.as_vectors(x, name, held=True)) for name, x in given})
        batch_shapes = {name: a.shape[:-1] for name, a in arrays.items() if not check.goes_with_any_batch(a)}
        if len(set(batch_shapes.values())) > 1:
            came = ", ".join(f"{name}: {shape}" for name, shape in batch_shapes.items())
            raise ValueError(f"{type(self).__name__}: expected equal batch shapes, got {came}; see jnp.broadcast_to")
        for name, array in zip(self._names, arrays.values(), strict=True):
            object.__setattr__(self, name, array)

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def from_array(cls, x6: Six) -> Self:
        """From six coefficients, rotational on top.

        Args:
            x6: (*batch, 6).

        Returns:
            The vector (*batch,).

        Raises:
            TypeError: x6 is not of floating point.
            ValueError: the shape does not fit.

        Error: none, it is exact.
        """
        array = check.as_vectors(x6, f"{cls.__name__}.from_array: x6", size=6, held=True)
        return cls(array[..., :3], array[..., 3:])

    @classmethod
    def zero(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """Six zeros, known while tracing: what is added to them, or made of them, leaves no operation behind.

        Args:
            batch_shape: shape of the batch.
            dtype: of the numbers; None takes JAX's default.

        Returns:
            The vector (*batch_shape,).

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, it is exact.
        """
        return cls._filled(0, batch_shape, dtype)

    @classmethod
    def nan(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """Six NaNs, for what is yet to be set.

        Args:
            batch_shape: shape of the batch.
            dtype: of the numbers; None takes JAX's default.

        Returns:
            The vector (*batch_shape,).

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, nothing is computed.
        """
        return cls._filled(np.nan, batch_shape, dtype)

    @classmethod
    def _filled(cls, value: float, batch_shape: BatchShape, dtype: DTypeLike | None) -> Self:
        dtype = check.as_dtype(dtype)
        batch_shape = (batch_shape,) if isinstance(batch_shape, int) else batch_shape
        return cls(*(np.full((*batch_shape, 3), value, dtype) for _ in range(2)))

    def _like(self, rotational: Any, translational: Any) -> Self:
        return _rebuild(type(self), (rotational, translational))

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def _parts(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in self._names)

    @property
    def _vectors(self) -> tuple[Any, ...]:
        return self._parts

    def _with_vectors(self, vectors: Any) -> Self:
        return self._like(*vectors)

    @property
    def rotational(self) -> Any:
        """(*batch, 3) the rotational part."""
        return self._parts[0]

    @property
    def translational(self) -> Any:
        """(*batch, 3) the translational part."""
        return self._parts[1]

    def to_array(self) -> jax.Array:
        """The coefficients (*batch, 6), rotational on top; as NumPy where JAX would narrow them. Exact."""
        return joined(*self._parts)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return check.batch_shape(*self._parts)

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(self.rotational.dtype)

    @property
    def size(self) -> int:
        """6, whatever the batch."""
        return 6

    def __getitem__(self, i: int) -> Any:
        """The i-th of the six components of one vector, rotational first."""
        if self.batch_shape:
            # Not an IndexError: Python would take it for the end when iterating.
            raise TypeError(
                f"{type(self).__name__}[i] is the i-th component of a single vector, this is a batch of shape "
                f"{self.batch_shape}; component i of all: x.to_array()[..., i], vector i of the batch: x.at_batch(i)"
            )
        i = operator.index(i)
        if not -6 <= i < 6:
            raise IndexError(f"{type(self).__name__}: expected a component index from -6 to 5, got {i}")
        return self._parts[i % 6 // 3][i % 3]

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
        return self._like(*(-part for part in self._parts))

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
        a, b = matched(self, other, operation.__name__)
        return self._like(*(skipping_zero(operation, x, y) for x, y in zip(a._parts, b._parts, strict=True)))

    def _scaled(self, operation: Any, scalar: Any) -> Any:
        if isinstance(scalar, SpatialVector):
            return NotImplemented
        x, s = check.narrowed(self), self._scalar(scalar)
        batch = check.common_batch_shape(**{type(self).__name__: x.batch_shape, "scalar": s.shape})
        parts = check.broadcast_batch(batch, *x._parts)
        s = s if isinstance(s, np.generic) else check.broadcast_batch(batch, s.reshape((*s.shape, 1)))[0]
        return self._like(*(_scaled_part(operation, part, s) for part in parts))

    def _scalar(self, scalar: Any) -> Any:
        """A number, or one per vector of the batch: NumPy's for Python's."""
        kind = type(self).__name__
        dtype = check.narrowed(self).dtype
        if isinstance(scalar, (int, float)):
            return dtype.type(scalar)
        s = check.as_float_array(scalar, f"{kind} * or / scalar", dtype)
        check.require_same_dtype(**{kind: self, "scalar": s})
        if len(s.shape) > len(self.batch_shape) and not all(map(check.goes_with_any_batch, self._parts)):
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
        return self._like(*_summed(precision, *moved_to_last(self._parts, place, self.batch_shape)))

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
        differences = (folding.quietly(operator.sub, x, y) for x, y in zip(a._parts, b._parts, strict=True))
        return tuple(_largest(from_double_word(abs(as_array(d, a.batch_shape)))) for d in differences)

    def is_nearly_equal_within_absolute_tolerance(
        self, other: Self, rotational_tolerance: chex.Numeric, translational_tolerance: chex.Numeric
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

    def is_approx(self, other: Self, tolerance: chex.Numeric | None = None) -> jax.Array:
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
        tolerance = jnp.finfo(a.dtype).eps if tolerance is None else tolerance
        return a.is_nearly_equal_within_absolute_tolerance(b, tolerance, tolerance)

    def __repr__(self) -> str:
        parts = ", ".join(f"{name}={_shown(part)}" for name, part in zip(self._names, self._parts, strict=True))
        return f"{type(self).__name__}({parts})"


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def spatial_vector(cls):
    """Class decorator: a frozen dataclass of two 3-vectors, rotational first, known to JAX as a pytree."""
    cls = tree(cls)
    cls._names = tuple(field.name for field in dataclasses.fields(cls))
    return cls


@formula(of_sums=True)
def _summed(rotational, translational):
    return [vectors.summed(rotational), vectors.summed(translational)]


def shifted(law, X_P_E, precision, **given):
    """A formula over the parts of X and the named vectors that shift it; the result of the kind of X."""
    kind = type(X_P_E).__name__
    given = {name: check.as_vectors(x, f"shift: {name}", X_P_E.dtype) for name, x in given.items()}
    check.require_same_dtype(**{kind: X_P_E, **given})
    batch_shapes = {name: x.shape[:-1] for name, x in given.items()}
    check.common_batch_shape(**{kind: X_P_E.batch_shape, **batch_shapes})
    return X_P_E._like(*law(precision, *X_P_E._parts, *given.values()))


def require_no_w(X_P_E, w, operation="shift"):
    """Only a SpatialAcceleration needs the angular velocity; anywhere else it is a mistake."""
    if w is not None:
        raise TypeError(f"{operation}: w is for a SpatialAcceleration, not for a {type(X_P_E).__name__}")


def require_w(A_P_E, w, operation="shift"):
    """The angular velocity of the body, without which an acceleration does not move."""
    if w is None:
        raise TypeError(
            f"{operation}: expected w, the angular velocity of the body, (*batch, 3), for a SpatialAcceleration"
        )
    w = check.as_vectors(w, f"{operation}: w", A_P_E.dtype)
    check.require_same_dtype(SpatialAcceleration=A_P_E, w=w)
    check.common_batch_shape(SpatialAcceleration=A_P_E.batch_shape, w=w.shape[:-1])
    return w


def joined(*parts):
    """(*batch, 6) of the two parts; as NumPy where JAX would narrow them."""
    parts = tuple(as_array(part, check.batch_shape(*parts)) for part in parts)
    if all(map(check.is_only_held, parts)):
        return np.concatenate(parts, axis=-1)
    parts = to_double_word(parts) if any(map(_is_double, parts)) else parts
    return jax.tree.map(lambda top, bottom: jnp.concatenate((top, bottom), axis=-1), *parts)


def require_kind(x, kind, name):
    if not isinstance(x, kind):
        raise TypeError(f"{name}: expected a {kind.__name__}, got {type(x).__name__}")


def _rebuild(cls, parts):
    return rebuilt(cls, cls._names, parts)


def _owned(array):
    """A NumPy array as a read-only copy: the caller may write to his own."""
    if isinstance(array, np.ndarray):
        array = array.copy()
        array.setflags(write=False)
    return array


def _is_double(x):
    return isinstance(x, DoubleWord)


def _scaled_part(operation, part, s):
    """operation(part, s) for s (*batch, 1) or a number; double words and Components know it as an operator."""
    part = to_double_word(part) if _is_double(s) and not isinstance(part, Components) else part
    if isinstance(part, check.StandIn):
        return part * s if operation is product else part / s
    return operation(part, jnp.broadcast_to(s, part.shape))


def skipping_zero(operation, x, y):
    """x + y or x - y: of known zeros nothing is left."""
    if isinstance(y, np.ndarray) and not y.any():
        return x
    if isinstance(x, np.ndarray) and not x.any():
        return y if operation is operator.add else -y
    return folding.quietly(operation, x, y)


def _largest(x):
    # Written out: a reduction over an axis of length 3 is a library call on XLA CPU. Both maxima keep NaN.
    maximum = np.maximum if isinstance(x, np.ndarray) else jnp.maximum
    return maximum(maximum(x[..., 0], x[..., 1]), x[..., 2])


def _plain(number):
    """A Python number for any that is one (np.float64 is): it takes the dtype of what it is compared with."""
    return float(number) if isinstance(number, float) else number


def _shown(part):
    """The numbers of one vector, the shape of a batch or of something not computed yet."""
    if isinstance(part, check.StandIn):
        return repr(part)
    if isinstance(part, (np.ndarray, jax.Array)) and not isinstance(part, jax.core.Tracer) and part.ndim == 1:
        return "[" + ", ".join(str(x) for x in np.asarray(part)) + "]"
    if hasattr(part, "shape") and hasattr(part, "dtype"):
        return f"{np.dtype(part.dtype).name}[{','.join(map(str, part.shape))}]"
    return repr(part)

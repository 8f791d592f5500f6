"""Arrays by their components, some of which are numbers known while tracing: planar forces, rotations about an axis.

What is known of an array is lost as soon as its components are stacked. Here they stay unstacked, and what is known is
part of the type: it survives jit, scan, vmap and derivatives, where a NumPy array becomes data.
"""

import functools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Self

import jax
import jax.export
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.errorfree.barrier import barrier
from jaxspatial.numerics.numbers.double_word import DoubleWord, to_double_word
from jaxspatial.numerics.numbers.layout import stack
from jaxspatial.numerics.numbers.rounded import Arithmetic, Rounded, is_known, quietly, uniform
from jaxspatial.numerics.precision import Precision
from jaxspatial.numerics.types import ArrayLike, DTypeLike

_INTEGERS: tuple[type, ...] = int, np.integer


class _Structure(NamedTuple):
    """What is static: for every component the known number, None for data; the dtype's name, where no data has one."""

    known: tuple[float | None, ...]
    dtype: str | None


class Components(Arithmetic, floats.StandIn):
    """An array (*batch, n) by its n components, each data or a number known while tracing.

        f = js.Components(fx, fy, 0.0)                        # a force in the plane
        F = js.SpatialForce(js.Components(0.0, 0.0, tz), f)
        js.shift(F, js.Components(px, py, 0.0)).tau           # Components(0.0, 0.0, tz'): 2 products, not 6

    Each component is data: an array (*batch,) or a DoubleWord, with batches that broadcast; or known: a Python number
    or NumPy scalar. dtype: that of the data; of known numbers alone it may be named.

    Known numbers fold: a known 0, 1 or -1 leaves no operation behind, and a known 0 is an exact zero, also next to an
    infinity or a NaN (-0 is 0). Components take the place of an array wherever the library takes one. What gets any
    returns Components. What is known of these is decided by the structure of the arguments, not by where it is called:
    NumPy arrays beside them are known in those components that are 0, 1 or -1 throughout, eagerly too. Beside double
    words the data of results are double words. Where all Components among the arguments are known zeros, as in
    `SpatialForce(f=f)`, results are arrays, but for those that are zero, which are such Components again.

    A pytree whose leaves are the data, (*batch,) each. `jax.vmap` with in_axes=0 maps over the first axis of the batch,
    with -1 over the last one of the batch, not over components. Known numbers are static. Another number is another
    type, for which jit compiles again, and which a scan carry or the other branch of a cond does not take; without data
    there is no batch, and it goes with any. In gradients and tangents known numbers stand as they are: descend by
    `jax.tree.map(lambda x, g: x - rate * g, x, gradient)`, which leaves them alone.

    Operators: + - * / with arrays (*batch, n) or (*batch, 1), numbers and Components, each result rounded once.
    Raises TypeError for dtypes that differ or integers, ValueError for batches that do not broadcast.

    Example:
        >>> f = js.Components(1.0, jnp.array(2.0), 0.0)
        >>> js.SpatialForce(f=f).shift(js.Components(2.0, 0.0, 0.0)).tau
        Components(0.0, 0.0, Array(-4.0))
    """

    structure: _Structure
    data: tuple

    def __init__(self, *components, dtype: DTypeLike | None = None):
        """Checks what a caller passes. JAX rebuilds Components without it, with whatever leaves it needs."""
        if not components:
            raise ValueError("Components: expected at least one component, got none")
        parts = [_checked(c, f"Components: component {i}", dtype) for i, c in enumerate(components)]
        # The dtype of what has one, or the one named; JAX's default for Python floats alone.
        typed = {f"component {i}": c for i, c in enumerate(parts) if isinstance(c, floats.ARRAYS)}
        if dtype is not None:
            typed["dtype"] = np.empty((), jax.dtypes.canonicalize_dtype(dtype))
        check.require_same_dtype(**typed)
        dtype = next(iter(typed.values())).dtype if typed else jax.dtypes.canonicalize_dtype(float)
        batches = {f"component {i}": c.shape for i, c in enumerate(parts) if not isinstance(c, (float, np.generic))}
        batch = floats.common_batch_shape(**batches) if batches else ()
        self._fill([_over(c, batch, dtype) for c in parts])

    def _fill(self, components: Sequence) -> None:
        known = tuple(_plain(c) if is_known(c) else None for c in components)
        self.data = tuple(c for c, number in zip(components, known, strict=True) if number is None)
        self.structure = _Structure(known, None if self.data else np.dtype(components[0].dtype).name)

    @classmethod
    def from_array(cls, x: ArrayLike, known: Sequence[float | None]) -> Self:
        """The components of x (*batch, n), but for those of which the number is known: `known` has it, or None.

            js.Components.from_array(p, (None, None, 0.0))      # what a plane leaves of p

        Args:
            x: array (*batch, n). What it has where a number is known is not looked at.
            known: n entries, a number or None for data.

        Returns:
            The Components, of the dtype of x.

        Raises:
            TypeError: x is not floating point.
            ValueError: it has not as many components as `known` entries.

        Error: none, it is exact.

        Example:
            >>> js.Components.from_array(jnp.array([1.0, 2.0, 3.0]), (None, None, 0.0))
            Components(Array(1.0), Array(2.0), 0.0)
        """
        x = floats.as_vectors(x, "Components.from_array: x", size=len(known))
        return cls(*(x[..., i] if number is None else number for i, number in enumerate(known)), dtype=x.dtype)

    @classmethod
    def of(cls, components: Sequence) -> Self:
        """Of components of one dtype, not checked.

        Args:
            components: NumPy scalars, which are known, and data (*batch,) over one batch.

        Returns:
            Components of these.

        Error: none, it is exact.

        Example:
            >>> js.Components.of([np.float32(0.0), jnp.array(2.0)])
            Components(0.0, Array(2.0))
        """
        x = object.__new__(cls)
        x._fill(components)
        return x

    @classmethod
    def of_array(cls, x: jax.Array | np.ndarray) -> Self:
        """Of an array: in one of NumPy, components that are 0, 1 or -1 throughout are known.

        Args:
            x: (*batch, n) array.

        Returns:
            Its n components, (*batch,) each.

        Error: none, it is exact.

        Example:
            >>> js.Components.of_array(np.float32([0.0, 1.0, 0.5]))
            Components(0.0, 1.0, Array(0.5))
        """
        columns: list[Any] = [x[..., i] for i in range(x.shape[-1])]
        if not isinstance(x, np.ndarray):
            return cls.of(columns)
        numbers = map(uniform, columns)
        units = [None if c is None or c not in (0, 1, -1) else x.dtype.type(c) for c in numbers]
        return cls.of([jnp.asarray(c) if unit is None else unit for c, unit in zip(columns, units, strict=True)])

    # -- as an array ---------------------------------------------------------------------------------------------------

    @property
    def components(self) -> tuple:
        """The n components: arrays or double words (*batch,), and NumPy scalars, which are known."""
        # A NumPy array that JAX put there would be known.
        data = iter([jnp.asarray(x) if isinstance(x, (np.ndarray, np.generic)) else x for x in self.data])
        dtype = self.dtype
        return tuple(next(data) if c is None else dtype.type(c) for c in self.structure.known)

    @property
    def shape(self) -> tuple[int, ...]:
        return (*(self.data[0].shape if self.data else ()), len(self.structure.known))

    @property
    def dtype(self) -> np.dtype:
        return np.dtype(self.data[0].dtype if self.data else self.structure.dtype)

    def to_array(self, batch_shape: tuple[int, ...] = ()) -> Any:
        """All components as one array.

        Args:
            batch_shape: what the batch is broadcast to, if it is wider than that of the data.

        Returns:
            (*batch, n), an array, or a DoubleWord where any component is one; NumPy's where all are known.

        Raises:
            ValueError: the batch shapes do not broadcast.

        Error: none, it is exact.

        Example:
            >>> print(js.Components(1.0, jnp.array(2.0), 0.0).to_array())
            [1. 2. 0.]
        """
        batch = floats.broadcast_shapes(self.shape[:-1], batch_shape)
        parts = self.components
        parts = to_double_word(parts) if any(isinstance(c, DoubleWord) for c in parts) else parts
        return jax.tree.map(lambda *limbs: stack(limbs, batch), *parts, is_leaf=is_known)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.to_array(), dtype)

    def _over_batch(self, batch_shape: tuple[int, ...]) -> "Components":
        """The data over another batch; what is known goes with any."""
        return _rebuild(self.structure, (_over(c, batch_shape, self.dtype) for c in self.data))

    def astype(self, dtype: DTypeLike) -> "Components":
        """Data and known numbers in another dtype.

        Args:
            dtype: one of floating point.

        Returns:
            The Components in it.

        Error: each number is rounded once, a double word as `DoubleWord.astype` does it.

        Example:
            >>> print(js.Components(1.0, jnp.array(2.0)).astype("float16").dtype)
            float16
        """
        return self.of([c.astype(dtype) for c in self.components])

    def reshape(self, *shape: int | Sequence[int]) -> Any:
        """With another batch shape; with other components as an array.

        Args:
            shape: the new one, components included, as one tuple or number by number. -1 as in NumPy.

        Returns:
            The Components, or, where their number changes, an array or a DoubleWord.

        Raises:
            TypeError: the sizes do not fit.

        Error: none, it is exact.

        Example:
            >>> x = js.Components(jnp.ones((2, 3)), 0.0)
            >>> print(x.reshape((6, 2)).shape)
            (6, 2)
        """
        new: Any = shape[0] if len(shape) == 1 and isinstance(shape[0], (tuple, list)) else shape
        if new[-1] != self.shape[-1]:
            return self.to_array().reshape(new)
        return _rebuild(self.structure, (c.reshape(tuple(new[:-1])) for c in self.data))

    def __getitem__(self, index) -> Any:
        """As of the array: x[..., i] is component i, (*batch,), as a NumPy array where it is known; x[..., 1:] and x[3]
        of a batch are Components. What needs components as an axis, x[..., None], comes as an array."""
        batch, which = _split_index(index, self.ndim, bool(self.data))
        if which is None:
            return self.to_array()[index]
        parts = [c if is_known(c) else c[batch] for c in self.components]
        if not isinstance(which, int):
            return self.of([parts[i] for i in np.arange(len(parts))[which]])
        shape = next((c.shape for c in parts if not is_known(c)), ())
        return floats.numpy_for(shape).broadcast_to(parts[which], shape) if is_known(parts[which]) else parts[which]

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator:
        # Without it Python would count up __getitem__ until an IndexError, which JAX never raises.
        return (self[i] for i in range(len(self)))

    # -- operators: component by component, what is known folds, and each result is rounded once -----------------------

    def __neg__(self) -> Self:
        return self.of([-c for c in self.components])

    def __abs__(self) -> Self:
        return self.of([abs(c) for c in self.components])

    def _operated(self, operation: Callable, other, is_reflected: bool = False) -> Any:
        other = self._beside(other)
        if other is NotImplemented:
            return NotImplemented
        a, b = (other, self) if is_reflected else (self, other)
        batch = floats.common_batch_shape(left=a.shape[:-1], right=b.shape[:-1])
        return _by_component(operation, *floats.broadcast_batch(batch, a, b))

    def _beside(self, other):
        """What stands beside this one in an operation, with as many components; NotImplemented."""
        n = self.shape[-1]
        if isinstance(other, (int, float)) and not isinstance(other, bool):
            return self.of([_over(float(other), (), self.dtype)] * n)
        if not isinstance(other, (np.generic, np.ndarray, jax.Array, floats.StandIn)):
            return NotImplemented
        array = floats.as_float_array(other, "Components: other")
        check.require_same_dtype(Components=self, other=array)
        if isinstance(other, np.generic):
            return self.of([array[()]] * n)
        array = array if array.ndim else array.reshape((1,))
        if array.shape[-1] not in (1, n):
            raise ValueError(f"Components: other: expected shape (*batch, {n}) or (*batch, 1), got {array.shape}")
        parts = (array if isinstance(array, Components) else self.of_array(array)).components
        return self.of(parts * n if len(parts) == 1 else parts)

    def __repr__(self) -> str:
        data = map(_shown, self.data)
        return f"Components({', '.join(next(data) if c is None else str(c) for c in self.structure.known)})"


def _rebuild(structure: _Structure, data: Iterable) -> Components:
    x = object.__new__(Components)
    x.structure, x.data = structure, tuple(data)
    return x


def _flattened_with_keys(x: Components) -> tuple[tuple, _Structure]:
    places = (i for i, c in enumerate(x.structure.known) if c is None)
    return tuple((jax.tree_util.SequenceKey(i), leaf) for i, leaf in zip(places, x.data, strict=True)), x.structure


def _restored(text: bytes | bytearray) -> _Structure:
    known, dtype = json.loads(text)
    return _Structure(tuple(None if c is None else _plain(float(c)) for c in known), dtype)


def _stored(structure: _Structure) -> bytes:
    known, dtype = structure
    return json.dumps(([None if c is None else repr(c) for c in known], dtype)).encode()


jax.tree_util.register_pytree_with_keys(Components, _flattened_with_keys, _rebuild, lambda x: (x.data, x.structure))
jax.export.register_pytree_node_serialization(
    Components, serialized_name="jaxspatial.Components", serialize_auxdata=_stored, deserialize_auxdata=_restored
)


def as_components(x) -> Components:
    """Any array (*batch, n) as Components: `of_array` for NumPy arrays, all data for others."""
    return x if isinstance(x, Components) else Components.of_array(x)


of = Components.of


def _checked(c, name: str, dtype) -> Any:
    """A component as it came: a Python number as a float, a NumPy scalar, an array or a DoubleWord."""
    if isinstance(c, Components):
        raise TypeError(f"{name}: expected an array (*batch,), a DoubleWord or a float, got Components")
    if type(c) in (float, int):
        return float(c)
    array = floats.as_float_array(c, name, dtype)
    return array[()] if isinstance(c, np.generic) else array


# -- Components where arrays are meant, and arrays beside Components ---------------------------------------------------


def from_components(x: object) -> Any:
    """Every Components of a tree as one array. All else stays as it is.

    What is known goes with any batch, and comes without one where all of it is known.

    Args:
        x: a pytree of anything, or one Components (*batch, n).

    Returns:
        The same tree, with an array (*batch, n), or a DoubleWord, in place of each Components.

    Error: none, it is exact.

    Example:
        >>> F = js.SpatialForce(f=[1.0, 2.0, 0.0])
        >>> js.from_components(F)
        SpatialForce(tau=[0.0, 0.0, 0.0], f=[1.0, 2.0, 0.0])
    """
    return jax.tree.map(
        functools.partial(as_array, batch_shape=()), x, is_leaf=lambda leaf: isinstance(leaf, Components)
    )


def as_array(x, batch_shape: tuple[int, ...]) -> Any:
    """Components as one array over a batch, of which known numbers have none; anything else as it is."""
    return x.to_array(batch_shape) if isinstance(x, Components) else x


def zero(size: int, dtype: DTypeLike) -> Components:
    """Components of known zeros, also of a dtype that JAX has switched off."""
    return of([np.dtype(dtype).type(0)] * size)


def is_zero(x) -> bool:
    """True for what is known to be zero throughout: Components without data, or a NumPy array."""
    if isinstance(x, Components):
        return not x.data and not any(x.structure.known)
    return isinstance(x, floats.NUMPY) and not x.any()


def all_are_zero(arrays: Sequence) -> bool:
    """Whether all Components among the arrays are zeros."""
    return all(is_zero(a) for a in arrays if isinstance(a, Components))


def has_pairs(x) -> bool:
    """True for a DoubleWord, and for Components of which one is."""
    return isinstance(x, DoubleWord) or (isinstance(x, Components) and any(isinstance(c, DoubleWord) for c in x.data))


@functools.partial(jax.jit, static_argnums=0, inline=True)
def _by_component(operation: Callable, a, b):
    numbers = ([Rounded(Precision.REPRODUCIBLE, c, barrier(c)) for c in x.components] for x in (a, b))
    return a.of([x.value for x in map(operation, *numbers)])


# -- single components: known numbers and data, brought to one dtype and one batch -------------------------------------


def _over(c, batch: tuple[int, ...], dtype):
    """The component over a batch; a number in its dtype."""
    if isinstance(c, (float, np.generic)):
        return quietly(lambda t, number: t.type(number), np.dtype(dtype), c)
    # Copies of NumPy's arrays: the caller may write to his own.
    limbs = jax.tree.map(lambda limb: jnp.array(limb) if isinstance(limb, np.ndarray) else limb, c)
    return jax.tree.map(lambda limb: limb if limb.shape == batch else jnp.broadcast_to(limb, batch), limbs)


def _plain(number: float) -> float:
    """As a Python float that equals itself: 0 for -0, one NaN for all."""
    number = float(number)
    return math.nan if math.isnan(number) else number + 0.0


def _shown(leaf) -> str:
    """A number, the shape of more or of something not computed yet."""
    if floats.is_computed(leaf) and leaf.ndim == 0:
        return f"Array({np.asarray(leaf)})"
    return check.in_short(leaf)


# -- an index: that of the batch, and that of the components -----------------------------------------------------------


def _split_index(index, ndim: int, has_batch: bool) -> tuple[tuple, Any]:
    """An index as that of the batch and that of the components, the latter None where they do not stay unstacked.

    What is known goes with any batch: without data, of an index [..., i, j] the last is taken.
    """
    index = index if isinstance(index, tuple) else (index,)
    if not has_batch and len(index) > 2 and index[0] is Ellipsis and index[-1] is not None:
        index = index[-1:]
    indices = [i for i in index if i is not Ellipsis]
    are_masks = [isinstance(i, bool) or (isinstance(i, floats.ARRAYS) and i.dtype == np.bool_) for i in indices]
    if len(indices) > ndim or any(i is None for i in indices) or any(are_masks):
        return (), None
    before = next((k for k, i in enumerate(index) if i is Ellipsis), len(index))
    batch: list
    last: Any
    *batch, last = *index[:before], *[slice(None)] * (ndim - len(indices)), *index[before + 1 :]
    # An int, a slice or a list; not traced ones, nor lists beside arrays.
    if isinstance(last, _INTEGERS):
        return tuple(batch), int(last)
    is_alone = all(isinstance(i, (int, slice)) for i in batch)
    is_list = is_alone and isinstance(last, (list, floats.NUMPY)) and np.ndim(last) == 1
    return tuple(batch), last if isinstance(last, slice) else np.asarray(last) if is_list else None

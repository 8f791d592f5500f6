"""Arrays of floating point: what a caller passes as arrays, as JAX computes with it; dtypes, and shapes of batches."""

import functools
import operator
import warnings
from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import DTypeLike

# Of what the stubs leave in part unknown. `isinstance` of the type leaves nothing unknown behind.
NUMPY: type[Any] = np.ndarray
config: Any = jax.config
finfo: Any = jnp.finfo

_Tree = TypeVar("_Tree")
_Shape = tuple[int, ...]
_Array = jax.Array | np.ndarray
_FLOATS = "float16, bfloat16, float32 or float64"
_NARROWED = (
    "float64 NumPy numbers become float32 in this operation: JAX's 64-bit types are off. To compute in float64: "
    'jax.config.update("jax_enable_x64", True), or a block `with jax.enable_x64(True):`. To compute in float32: give '
    ".astype(np.float32). Said once; to find out where: warnings.simplefilter('error', jaxspatial.NarrowingWarning)"
)


class NarrowingWarning(UserWarning):
    """An operation computes in float32 with float64 NumPy numbers, because JAX's 64-bit types are off. Said once.

    Numbers that nothing is computed with keep their digits: inside a vector, in `to_array`, in converters.

        jax.config.update("jax_enable_x64", True)                       # compute in float64
        F.astype(np.float32)                                            # say that float32 is meant
        warnings.simplefilter("ignore", jaxspatial.NarrowingWarning)    # silence
        warnings.simplefilter("error", jaxspatial.NarrowingWarning)     # find out where

    Example:
        >>> import warnings
        >>> with jax.enable_x64(False), warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", js.NarrowingWarning)
        ...     print(js.Rotation.exp(np.float64([0.0, 0.0, 0.5])).dtype)
        float32
    """


# What Python's `warnings` keeps in a module that warns: with it nothing is said twice.
_said: dict[Any, Any] = {}


class StandIn:
    """Base of what stands for an array of floating point without being one: it passes every check as it is."""

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    shape: Any
    dtype: Any

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def _over_batch(self, batch_shape: _Shape):
        """Broadcast to another batch shape."""
        shape = (*batch_shape, self.shape[-1])
        return jax.tree.map(functools.partial(jnp.broadcast_to, shape=shape), self)


# What has a shape and a dtype: arrays, traced ones too, their shapes alone, and what stands for them.
ARRAYS: tuple[type[Any], ...] = jax.Array, np.ndarray, np.generic, jax.ShapeDtypeStruct, StandIn


# -- numbers of a caller as arrays ------------------------------------------------------------------------------------


def as_float_array(x, name: str, dtype: DTypeLike | None = None, *, keep_dtype: bool = False) -> jax.Array:
    """x as an array of floating point. Python numbers, lists of them, and NumPy's integers get the dtype `dtype`.

    NumPy stays NumPy (known while tracing): with `keep_dtype` in its own dtype, else in the one JAX computes in, see
    `narrowed`. JAX's arrays of integers are refused: where they come from, a dtype was meant.
    """
    # To all who compute, what stands for an array and those of NumPy are arrays, which no stub says.
    if isinstance(x, StandIn):
        return x  # pyright: ignore[reportReturnType]
    array: Any = x if isinstance(x, jax.Array) else _as_array(x, name, dtype)
    if not _is_floating(array.dtype):
        advice = ""
        # Of a key of `jax.random` the dtype is none of NumPy's.
        if any(jnp.issubdtype(array.dtype, kind) for kind in (bool, jnp.integer, jnp.floating)):
            meant = np.dtype(jax.dtypes.canonicalize_dtype(float) if dtype is None else dtype).name
            advice = f"; convert with .astype({meant!r})" if isinstance(x, ARRAYS) else "; write 1.0 for 1"
        raise TypeError(f"{name}: expected floating point ({_FLOATS}), got {array.dtype}{advice}")
    if isinstance(array, NUMPY):
        if not array.dtype.isnative:  # Files may have the bytes of a number in the other order, which JAX refuses.
            array = array.astype(array.dtype.newbyteorder("="))
        if keep_dtype:
            return array
        # NumPy's scalar of float64 is a Python float too: nobody asked for its digits.
        return _in_jax_dtype(array) if isinstance(x, np.float64) else narrowed(array)
    # A weakly typed array would make a second trace for what is otherwise the same call.
    return jax.lax.convert_element_type(array, array.dtype) if array.weak_type else array


def _as_array(x, name: str, dtype: DTypeLike | None):
    if isinstance(x, ARRAYS) and not isinstance(x, float):
        array = np.asarray(x) if isinstance(x, np.generic) else x
        # Integers say no more than those of a list.
        is_integer = isinstance(array, NUMPY) and array.dtype.kind in "iu"
        return array.astype(jax.dtypes.canonicalize_dtype(float) if dtype is None else dtype) if is_integer else array
    leaves, problem = jax.tree.leaves(x), None
    try:
        if any(isinstance(leaf, jax.Array) for leaf in leaves):
            return jnp.asarray(x)
        array = np.asarray(x)
    except (TypeError, ValueError) as error:
        array, problem = None, error
    if array is None or array.dtype.kind not in "fiub":
        text = repr(x)
        came = f"{type(x).__name__} {text if len(text) <= 60 else text[:57] + '...'}"
        raise TypeError(f"{name}: expected an array of floating point ({_FLOATS}), got {came}") from problem
    # Python numbers have no dtype, nor have lists of them or of NumPy scalars, or of NumPy arrays of integers.
    if array.dtype.kind in "iu":
        has_dtype = any(isinstance(leaf, (bool, np.bool_)) for leaf in leaves)
    else:
        is_plain = isinstance(x, (int, float, list, tuple)) and not isinstance(x, np.generic)
        has_dtype = not is_plain or array.dtype.kind != "f" or any(np.ndim(leaf) for leaf in leaves)
    return array if has_dtype else array.astype(jax.dtypes.canonicalize_dtype(float) if dtype is None else dtype)


def as_vectors(
    x,
    name: str,
    dtype: DTypeLike | None = None,
    size: int = 3,
    many: Sequence[str] = (),
    *,
    keep_dtype: bool = False,
    otherwise: str = "",
) -> jax.Array:
    """x as an array of shape (*batch, size), or (*batch, n, size) with n named in `many`; see `as_float_array`.

    otherwise: the end of the message about another shape: what takes arrays of that one."""
    array = as_float_array(x, name, dtype, keep_dtype=True)
    if array.shape[-1:] != (size,) or array.ndim <= len(many):
        shape = ", ".join(("*batch", *many, str(size)))
        raise ValueError(f"{name}: expected shape ({shape}), got {array.shape}{otherwise}")
    return array if keep_dtype or isinstance(array, jax.Array) else narrowed(array)


def as_matrices(m, name: str, n: int = 3) -> jax.Array:
    """Matrices (*batch, n, n) by their entries (*batch, n n)."""
    array = as_vectors(m, name, size=n, many=[str(n)], keep_dtype=True)
    if array.shape[-2] != n:
        raise ValueError(f"{name}: expected shape (*batch, {n}, {n}), got {array.shape}")
    return array.reshape((*array.shape[:-2], n * n))


def owned(array):
    """A NumPy array as a read-only copy: the caller may write to the original."""
    if not isinstance(array, NUMPY):
        return array
    copy = np.array(array)
    copy.setflags(write=False)
    return copy


# -- dtypes -----------------------------------------------------------------------------------------------------------


def as_dtype(x: DTypeLike | None) -> np.dtype:
    """The dtype of this name, NumPy's own: None and Python's `float` are JAX's default."""
    if x is None or x is float:
        return np.dtype(jax.dtypes.canonicalize_dtype(float))
    try:
        dtype = np.dtype(x)
    except TypeError:
        raise TypeError(f"dtype: expected {_FLOATS}, got {x!r}") from None
    if not _is_floating(dtype):
        raise TypeError(f"dtype: expected {_FLOATS}, got {dtype}")
    return dtype


def floating_dtype(*arguments) -> np.dtype | None:
    """The dtype of the first array of floating point: Python numbers, np.float64 among them, take it on beside the
    array, and messages advise to convert integers to it."""
    arrays = (x for x in arguments if isinstance(x, ARRAYS) and not isinstance(x, float))
    return next((np.dtype(x.dtype) for x in arrays if _is_floating(x.dtype)), None)


@functools.cache
def _is_floating(dtype: DTypeLike) -> bool:
    return jnp.issubdtype(dtype, jnp.floating) and 2 <= np.dtype(dtype).itemsize <= 8


def eps(dtype: DTypeLike) -> float:
    """The distance from 1 to the next number."""
    return float(finfo(dtype).eps)


def narrowed(tree: _Tree) -> _Tree:
    """The tree with NumPy's float64 as JAX computes with it: as float32, with a warning, while 64-bit types are off."""
    if config.jax_enable_x64:
        return tree
    return jax.tree.map(_narrowed, tree, is_leaf=goes_with_any_batch)


def narrowed_each(arrays: Sequence) -> Sequence:
    """`narrowed`, of a sequence of arrays."""
    if config.jax_enable_x64:
        return arrays
    return [x if isinstance(x, jax.Array) else _narrowed(x) for x in arrays]


def _narrowed(x):
    if goes_with_any_batch(x):
        return x.astype(jax.dtypes.canonicalize_dtype(x.dtype))
    if not isinstance(x, NUMPY) or x.dtype != np.float64:
        return x
    warnings.warn_explicit(_NARROWED, NarrowingWarning, "jaxspatial", 0, "jaxspatial", _said)
    return _in_jax_dtype(x)


def _in_jax_dtype(array):
    with np.errstate(all="ignore"):
        return array.astype(jax.dtypes.canonicalize_dtype(array.dtype), copy=False)


# -- shapes -----------------------------------------------------------------------------------------------------------


def is_sized(shape: Sequence[int]) -> bool:
    """Whether all sizes are numbers, and none a symbol of `jax.export`, which stands for any."""
    return all(isinstance(n, (int, np.integer)) for n in shape)


def numpy_for(shape: Sequence[int]):
    """NumPy, to make a known array of this shape; `jax.numpy` where sizes are symbols, which NumPy cannot have."""
    return np if is_sized(shape) else jnp


def broadcast_shapes(*shapes: _Shape) -> _Shape:
    """The shape that all broadcast to. Sizes may be symbols of `jax.export`."""
    try:
        return np.broadcast_shapes(*shapes)
    except TypeError:
        return jnp.broadcast_shapes(*shapes)


def common_batch_shape(**batch_shapes: _Shape) -> _Shape:
    """The shape that all batch shapes broadcast to."""
    first, *others = batch_shapes.values()
    if others.count(first) == len(others):
        return first
    try:
        return broadcast_shapes(first, *others)
    except ValueError:
        came = ", ".join(f"{name}: {shape}" for name, shape in batch_shapes.items())
        raise ValueError(
            f"{' and '.join(batch_shapes)}: expected batch shapes that broadcast, got {came}; "
            "one item against many is jax.vmap(..., in_axes=(0, None))"
        ) from None


def broadcast_batch(batch_shape: _Shape, *arrays) -> tuple:
    """Each array (*batch, n) over the common batch; NumPy stays NumPy."""
    result = []
    for a in arrays:
        if a.shape[:-1] == batch_shape:
            result.append(a)
        elif isinstance(a, StandIn):
            result.append(a._over_batch(batch_shape))
        else:
            library = numpy_for(batch_shape) if isinstance(a, NUMPY) else jnp
            result.append(library.broadcast_to(a, (*batch_shape, a.shape[-1])))
    return tuple(result)


def batch_axis(axis: int, batch_shape: _Shape, operation: str) -> int:
    """An axis of the batch, counted from the front."""
    if not -len(batch_shape) <= axis < len(batch_shape):
        raise ValueError(f"{operation}: axis: expected one of a batch of shape {batch_shape}, got {axis}")
    return operator.index(axis) % len(batch_shape)


def batch_shape(*parts) -> _Shape:
    """The batch shape of arrays that have one in common, but for those that go with any."""
    for x in parts:
        if not isinstance(x, StandIn) or not goes_with_any_batch(x):
            return x.shape[:-1]
    return parts[0].shape[:-1]


def goes_with_any_batch(x: object) -> bool:
    """True for what consists of known numbers alone, see `Components`."""
    return isinstance(x, StandIn) and not jax.tree.leaves(x)


def matrices(entries, n: int) -> jax.Array:
    """Entries (*batch, n n) as matrices (*batch, n, n)."""
    return entries.reshape((*entries.shape[:-1], n, n))


def expanded(x) -> jax.Array:
    """(*batch,) as (*batch, 1)."""
    return x.reshape((*x.shape, 1))


# -- what is known ----------------------------------------------------------------------------------------------------


def is_computed(x) -> bool:
    """True for an array whose numbers are there to be looked at."""
    if not isinstance(x, jax.Array):
        return isinstance(x, NUMPY)
    is_number = not jnp.issubdtype(x.dtype, jax.dtypes.extended)
    return is_number and not isinstance(x, Tracer) and not x.is_deleted()


def is_nothing(x: _Array):
    """Whether all numbers are known to be zero."""
    return isinstance(x, np.ndarray) and not x.any()


def is_infinite(limits: _Array) -> bool:
    """Whether all limits are known to be none."""
    return isinstance(limits, np.ndarray | np.generic) and bool(np.isinf(limits).all())


def one_array(numbers: Sequence, dtype: np.dtype) -> _Array:
    """(k,) NumPy where all of them are known."""
    is_known = all(isinstance(x, np.ndarray | np.generic | float) for x in numbers)
    return (np if is_known else jnp).stack([(np if is_known else jnp).asarray(x, dtype) for x in numbers])

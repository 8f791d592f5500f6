"""What comes in from the caller, checked once: messages name the argument, what was expected and what came."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_FLOATS = "float16, bfloat16, float32 or float64"


class Number:
    """Base of what stands for an array of floating point without being one: it passes every check as it is."""

    def over_batch(self, batch_shape):
        """Broadcast to another batch shape."""
        shape = (*batch_shape, self.shape[-1])
        return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), self)


def as_float_array(x, name, dtype=None) -> Any:
    """x as an array of floating point; `dtype` is taken on by numbers that have none (Python floats, lists of them).

    NumPy stays NumPy (known while tracing), in JAX's canonical dtype. Integers are refused: whether 1 means 1.0f or
    1.0 is the caller's to say.
    """
    if isinstance(x, Number):
        return x
    array = _as_array(x, name, dtype)
    if not _is_floating(array.dtype):
        advice = "; convert with .astype(float)" if np.dtype(array.dtype).kind in "iub" else ""
        raise TypeError(f"{name}: expected floating point ({_FLOATS}), got {array.dtype}{advice}")
    if isinstance(array, np.ndarray):
        return array.astype(jax.dtypes.canonicalize_dtype(array.dtype), copy=False)
    # A weakly typed array would make a second trace for what is otherwise the same call.
    return jax.lax.convert_element_type(array, array.dtype) if getattr(array, "weak_type", False) else array


@functools.cache
def _is_floating(dtype):
    return jnp.issubdtype(dtype, jnp.floating)


def _as_array(x, name, dtype):
    if isinstance(x, (np.ndarray, np.generic, jax.Array, jax.ShapeDtypeStruct)) and not isinstance(x, float):
        return np.asarray(x) if isinstance(x, np.generic) else x
    try:
        if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(x)):
            return jnp.asarray(x)
        array = np.asarray(x)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected an array of floating point ({_FLOATS}), got {_shown(x)}") from error
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{name}: expected an array of floating point ({_FLOATS}), got {_shown(x)}")
    has_no_dtype = array.dtype.kind == "f" and dtype is not None and not hasattr(x, "__array__")
    return array.astype(dtype) if has_no_dtype else array


def _shown(x):
    text = repr(x)
    return f"{type(x).__name__} {text if len(text) <= 60 else text[:57] + '...'}"


def as_vectors(x, name, dtype=None, size=3, many=()) -> Any:
    """x as an array of shape (*batch, size), or (*batch, n, size) with n named in `many`."""
    array = as_float_array(x, name, dtype)
    if array.shape[-1:] != (size,) or array.ndim <= len(many):
        shape = ", ".join(("*batch", *many, str(size)))
        raise ValueError(f"{name}: expected shape ({shape}), got {array.shape}")
    return array


def require_same_dtype(**arrays):
    """All dtypes equal: mixed ones would be promoted silently, or not at all, depending on a global flag."""
    if len({a.dtype for a in arrays.values()}) > 1:
        dtypes = {name: np.dtype(a.dtype).name for name, a in arrays.items()}
        came = ", ".join(f"{name}: {dtype}" for name, dtype in dtypes.items())
        raise TypeError(f"{' and '.join(dtypes)}: expected one dtype, got {came}; convert with .astype")


def common_batch_shape(**batch_shapes):
    """The shape that all batch shapes broadcast to."""
    first, *others = batch_shapes.values()
    if all(shape == first for shape in others):
        return first
    try:
        return np.broadcast_shapes(first, *others)
    except ValueError:
        came = ", ".join(f"{name}: {shape}" for name, shape in batch_shapes.items())
        raise ValueError(
            f"{' and '.join(batch_shapes)}: expected batch shapes that broadcast, got {came}; "
            "one item against many is jax.vmap(..., in_axes=(0, None))"
        ) from None


def broadcast_batch(batch_shape, *arrays):
    """Each array (*batch, n) over the common batch; NumPy stays NumPy."""
    return tuple(a if a.shape[:-1] == batch_shape else _broadcast(a, batch_shape) for a in arrays)


def _broadcast(array, batch_shape):
    if isinstance(array, Number):
        return array.over_batch(batch_shape)
    return (np if isinstance(array, np.ndarray) else jnp).broadcast_to(array, (*batch_shape, array.shape[-1]))


def goes_with_any_batch(x):
    """True for what consists of known numbers alone, see `Components`."""
    return isinstance(x, Number) and not jax.tree.leaves(x)


def batch_shape(*parts):
    """The batch shape of arrays that have one in common, but for those that go with any."""
    with_batch = [x for x in parts if not goes_with_any_batch(x)]
    return jnp.shape((with_batch or parts)[0])[:-1]


def is_tree_mark(leaf):
    """True for what stands for a leaf in a tree that describes trees: an axis, None, a sharding, a partition spec."""
    axis = isinstance(leaf, int) and not isinstance(leaf, bool)
    return leaf is None or axis or isinstance(leaf, (jax.sharding.PartitionSpec, jax.sharding.Sharding))

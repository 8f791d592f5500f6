"""Checks of arguments, once at the public edge: messages name the argument, what was expected and what it got."""

import difflib
import functools
import operator
import warnings
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import DTypeLike

# Of what the stubs leave in part unknown. `isinstance` of the type leaves nothing unknown behind.
NUMPY: type[Any] = np.ndarray
config: Any = jax.config
finfo: Any = jnp.finfo
_dtype_of = operator.attrgetter("dtype")

_Tree = TypeVar("_Tree")
_Item = TypeVar("_Item")
_Shape = tuple[int, ...]
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


def in_short(x) -> str:
    """float32[4,3] of an array, the text of anything else."""
    if isinstance(x, ARRAYS) and not isinstance(x, StandIn):
        return f"{x.dtype}[{','.join(map(str, x.shape))}]"
    return repr(x)


def shown(x, n: int) -> str:
    """The numbers of one item, n in a row (0 of a scalar); the shape of a batch or of something not computed yet."""
    if not is_computed(x) or x.ndim != min(n, 1):
        return in_short(x)
    if not n:
        return str(x)
    numbers = list(map(str, np.asarray(x)))
    return f"[{'; '.join(', '.join(numbers[i : i + n]) for i in range(0, len(numbers), n))}]"


def as_tuple(items, kind: type[_Item], what: str, words: str) -> tuple[_Item, ...]:
    """A sequence of items of one kind as a tuple. words: for these, in the message."""
    found = tuple(items) if isinstance(items, Iterable) and not isinstance(items, str) else None
    if found is None or not all(isinstance(item, kind) for item in found):
        raise TypeError(f"{what}: expected a sequence of {words}, got {items!r}")
    return found


def did_you_mean(name: object, names: Iterable[str], nearness: float = 0.6) -> str:
    """The end of a message about an unknown name: the nearest of the known ones, where one is near."""
    by_small = {known.lower(): known for known in names}
    near = difflib.get_close_matches(name.lower(), by_small, 1, nearness) if isinstance(name, str) else []
    return f"; did you mean {by_small[near[0]]!r}?" if near else ""


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


def floating_dtype(*arguments) -> np.dtype | None:
    """The dtype of the first array of floating point: Python numbers, np.float64 among them, take it on beside the
    array, and messages advise to convert integers to it."""
    arrays = (x for x in arguments if isinstance(x, ARRAYS) and not isinstance(x, float))
    return next((np.dtype(x.dtype) for x in arrays if _is_floating(x.dtype)), None)


@functools.cache
def _is_floating(dtype: DTypeLike) -> bool:
    return jnp.issubdtype(dtype, jnp.floating) and 2 <= np.dtype(dtype).itemsize <= 8


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


def eps(dtype: DTypeLike) -> float:
    """The distance from 1 to the next number."""
    return float(finfo(dtype).eps)


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


def matrices(entries, n: int) -> jax.Array:
    """Entries (*batch, n n) as matrices (*batch, n, n)."""
    return entries.reshape((*entries.shape[:-1], n, n))


def expanded(x) -> jax.Array:
    """(*batch,) as (*batch, 1)."""
    return x.reshape((*x.shape, 1))


def owned(array):
    """A NumPy array as a read-only copy: the caller may write to the original."""
    if not isinstance(array, NUMPY):
        return array
    copy = np.array(array)
    copy.setflags(write=False)
    return copy


def refuse(operation: str, expected: str, x: object) -> NoReturn:
    raise TypeError(f"{operation}: expected {expected}, got {type(x).__name__}")


def require_kind(x: object, kind: type, name: str, place: str = "") -> None:
    if not isinstance(x, kind):
        # What `to_matrix` gives of an object, `from_matrix` takes.
        maker = getattr(kind, "_as_array", "").replace("to_", "from_")
        way_out = f"; of an array make one with {kind.__name__}.{maker}" if maker and isinstance(x, ARRAYS) else ""
        raise TypeError(f"{name}: expected a {kind.__name__}{place}, got {type(x).__name__}{way_out}")


def require_same_dtype(**arrays) -> None:
    """All dtypes equal, as JAX computes with them: mixed ones would be promoted silently, or not at all, depending on a
    global flag."""
    if len(set(map(_dtype_of, arrays.values()))) == 1:
        return
    dtypes: dict[str, str] = {}
    for name, x in arrays.items():
        is_numpy = all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(x))
        dtypes[name] = np.dtype(jax.dtypes.canonicalize_dtype(x.dtype) if is_numpy else x.dtype).name
    if len(set(dtypes.values())) > 1:
        came = ", ".join(f"{name}: {dtype}" for name, dtype in dtypes.items())
        raise TypeError(f"{' and '.join(dtypes)}: expected one dtype, got {came}; convert with .astype")


def same_dtype(**arrays) -> dict:
    """The arrays, or trees of them, in one dtype: as they are, or as JAX computes with them; see `narrowed`."""
    if len(set(map(_dtype_of, arrays.values()))) == 1:
        return arrays
    require_same_dtype(**arrays)
    return {name: narrowed(a) for name, a in arrays.items()}


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


def as_count(x: object, name: str, least: int) -> int:
    """x as an int; refused unless it is an integer from `least` on, known while tracing."""
    try:
        n = operator.index(cast(Any, x))
    except TypeError:
        n = None
    if isinstance(x, bool) or n is None or n < least:
        raise ValueError(f"{name}: expected an integer >= {least}, got {in_short(x)}")
    return n


def above_zero(x: object, name: str) -> float:
    """x as a float; refused unless it is a number above zero, known while tracing."""
    try:
        number = None if isinstance(x, str) else float(cast(Any, x))
    except (TypeError, ValueError):
        number = None
    if number is None or not number > 0:
        raise ValueError(f"{name}: expected a number above 0, known while tracing, got {in_short(x)}")
    return number


def as_batch_shape(x: object) -> _Shape:
    """A batch shape, given as a number or as numbers, among them symbols of `jax.export`."""
    sizes: tuple[Any, ...] = tuple(x) if isinstance(x, Iterable) and not isinstance(x, str) else (x,)
    for n in sizes:
        if not jax.export.is_symbolic_dim(n) and (not isinstance(n, (int, np.integer)) or isinstance(n, bool) or n < 0):
            raise ValueError(f"batch_shape: expected integers >= 0, one or a tuple of them, got {in_short(x)}")
    return cast(_Shape, sizes)


def require_key(key: object, name: str) -> None:
    """One key of `jax.random`, of the new kind or of the old one, uint32[2]."""
    is_typed = isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
    is_raw = isinstance(key, (jax.Array, np.ndarray)) and key.dtype == np.uint32 and key.ndim == 1
    if not is_raw and not (is_typed and cast(Any, key).ndim == 0):
        raise TypeError(f"{name}: expected a single key, as jax.random.key(0), got {in_short(key)}")


def is_computed(x) -> bool:
    """True for an array whose numbers are there to be looked at."""
    if not isinstance(x, jax.Array):
        return isinstance(x, NUMPY)
    is_number = not jnp.issubdtype(x.dtype, jax.dtypes.extended)
    return is_number and not isinstance(x, Tracer) and not x.is_deleted()


def goes_with_any_batch(x: object) -> bool:
    """True for what consists of known numbers alone, see `Components`."""
    return isinstance(x, StandIn) and not jax.tree.leaves(x)


def batch_shape(*parts) -> _Shape:
    """The batch shape of arrays that have one in common, but for those that go with any."""
    for x in parts:
        if not isinstance(x, StandIn) or not goes_with_any_batch(x):
            return x.shape[:-1]
    return parts[0].shape[:-1]


def is_tree_mark(leaf: object) -> bool:
    """True for what stands for a leaf in a tree that describes trees: an axis, None, a sharding, a partition spec."""
    axis = isinstance(leaf, int) and not isinstance(leaf, bool)
    return leaf is None or axis or isinstance(leaf, (jax.sharding.PartitionSpec, jax.sharding.Sharding))

"""Checks of arguments, once at the public edge: messages name the argument, what was expected and what it got."""

import difflib
import operator
from collections.abc import Iterable
from typing import Any, NoReturn, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics.floats import ARRAYS, StandIn, is_computed, narrowed

_dtype_of = operator.attrgetter("dtype")

_Item = TypeVar("_Item")


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


def did_you_mean(name: object, names: Iterable[str], nearness: float = 0.6) -> str:
    """The end of a message about an unknown name: the nearest of the known ones, where one is near."""
    by_small = {known.lower(): known for known in names}
    near = difflib.get_close_matches(name.lower(), by_small, 1, nearness) if isinstance(name, str) else []
    return f"; did you mean {by_small[near[0]]!r}?" if near else ""


def refuse(operation: str, expected: str, x: object) -> NoReturn:
    raise TypeError(f"{operation}: expected {expected}, got {type(x).__name__}")


def require_kind(x: object, kind: type, name: str, place: str = "") -> None:
    if not isinstance(x, kind):
        # What `to_matrix` gives of an object, `from_matrix` takes.
        maker = getattr(kind, "_as_array", "").replace("to_", "from_")
        way_out = f"; of an array make one with {kind.__name__}.{maker}" if maker and isinstance(x, ARRAYS) else ""
        raise TypeError(f"{name}: expected a {kind.__name__}{place}, got {type(x).__name__}{way_out}")


def as_tuple(items, kind: type[_Item], what: str, words: str) -> tuple[_Item, ...]:
    """A sequence of items of one kind as a tuple. words: for these, in the message."""
    found = tuple(items) if isinstance(items, Iterable) and not isinstance(items, str) else None
    if found is None or not all(isinstance(item, kind) for item in found):
        raise TypeError(f"{what}: expected a sequence of {words}, got {items!r}")
    return found


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


def as_batch_shape(x: object) -> tuple[int, ...]:
    """A batch shape, given as a number or as numbers, among them symbols of `jax.export`."""
    sizes: tuple[Any, ...] = tuple(x) if isinstance(x, Iterable) and not isinstance(x, str) else (x,)
    for n in sizes:
        if not jax.export.is_symbolic_dim(n) and (not isinstance(n, (int, np.integer)) or isinstance(n, bool) or n < 0):
            raise ValueError(f"batch_shape: expected integers >= 0, one or a tuple of them, got {in_short(x)}")
    return cast(tuple[int, ...], sizes)


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


def require_key(key: object, name: str) -> None:
    """One key of `jax.random`, of the new kind or of the old one, uint32[2]."""
    is_typed = isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
    is_raw = isinstance(key, (jax.Array, np.ndarray)) and key.dtype == np.uint32 and key.ndim == 1
    if not is_raw and not (is_typed and cast(Any, key).ndim == 0):
        raise TypeError(f"{name}: expected a single key, as jax.random.key(0), got {in_short(key)}")


def is_tree_mark(leaf: object) -> bool:
    """True for what stands for a leaf in a tree that describes trees: an axis, None, a sharding, a partition spec."""
    axis = isinstance(leaf, int) and not isinstance(leaf, bool)
    return leaf is None or axis or isinstance(leaf, (jax.sharding.PartitionSpec, jax.sharding.Sharding))

"""What inertias are made of, as arrays; and what operations ask of their arguments."""

from typing import Any, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.types import DTypeLike, Matrix3, Scalar, Six, Vector, Vector3


def checked(operation: str, mass: Scalar, com: Vector3, six: Six | Matrix3, name: str = "central") -> list[Any]:
    """The three as arrays of one dtype over their common batch, the last by six entries."""
    dtype = next((x.dtype for x in (mass, com, six) if _is_floating(x)), None)
    given = {
        f"{operation}: mass": check.as_float_array(mass, f"{operation}: mass", dtype, held=True),
        f"{operation}: com": check.as_vectors(com, f"{operation}: com", dtype, held=True),
        f"{operation}: {name}": as_entries(six, f"{operation}: {name}", 6, dtype),
    }
    arrays = check.alike(**given)
    items = dict(zip(arrays, ((), (3,), (6,)), strict=True))
    shapes = {key: x.shape[: len(x.shape) - len(items[key])] for key, x in arrays.items()}
    batch = check.common_batch_shape(**shapes)
    return [x if shapes[key] == batch else _broadcast(x, (*batch, *items[key])) for key, x in arrays.items()]


def _is_floating(x: Any) -> TypeGuard[jax.Array]:
    return isinstance(x, check.ARRAYS) and jnp.issubdtype(x.dtype, jnp.floating) and not isinstance(x, float)


def as_entries(x: Vector | Matrix3, name: str, n: int, dtype: DTypeLike | None = None) -> Any:
    """An array (*batch, n), or of matrices (*batch, 3, 3) their n entries: 6 of symmetric ones, or all 9."""
    array = check.as_float_array(x, name, dtype, held=True)
    if array.shape[-1:] == (n,):
        return array
    if array.shape[-2:] != (3, 3):
        raise ValueError(f"{name}: expected shape (*batch, 3, 3) or (*batch, {n}), got {array.shape}")
    return symmetric.from_matrix(array) if n == 6 else array.reshape((*array.shape[:-2], 9))


def _broadcast(array: Any, shape: tuple[int, ...]) -> Any:
    if isinstance(array, DoubleWord):
        return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), array)
    if isinstance(array, check.StandIn):
        return array.over_batch(shape[:-1])
    return (np if isinstance(array, np.ndarray) else jnp).broadcast_to(array, shape)

"""What a caller passes to an algorithm, checked: a mechanism, and arrays of its coordinates and rates."""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.mechanism import Mechanism


def checked_mechanism(operation: str, mechanism: object) -> Mechanism:
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"{operation}: expected a Mechanism first, got {type(mechanism).__name__}")
    return mechanism


def checked(operation: str, mechanism: object, **arrays: Any) -> tuple[Any, ...]:
    """The arrays of coordinates, (*batch, nq) for q and (*batch, nv) for all others, with a dtype in common."""
    mechanism = checked_mechanism(operation, mechanism)
    sizes = {name: mechanism.nq if name.startswith("q") else mechanism.nv for name in arrays}
    # Lists of numbers take the dtype of an array beside them.
    dtype = next((x.dtype for x in arrays.values() if isinstance(x, check.ARRAYS)), None)
    given = {name: check.as_vectors(x, f"{operation}: {name}", dtype, sizes[name]) for name, x in arrays.items()}
    data = [x for x in jax.tree.leaves(mechanism) if not isinstance(x, np.ndarray)]
    check.require_same_dtype(**given, **({"mechanism": data[0]} if data else {}))
    check.common_batch_shape(**{name: x.shape[:-1] for name, x in given.items()})
    return tuple(given.values())

"""The types of public arguments."""

import sys
import typing
from collections.abc import Sequence
from typing import Any

import jax.typing
from jax.typing import DTypeLike as DTypeLike

from jaxspatial.numerics.floats import StandIn
from jaxspatial.numerics.precision import Precision


def named(name: str, union) -> Any:
    """A union under its name, which `help` shows in place of the members. Python 3.11 writes it ~name."""
    kind: Any = typing
    return kind.TypeAliasType(name, union) if sys.version_info >= (3, 12) else kind.TypeVar(name, bound=union)


# An array of JAX or NumPy, a number, a sequence of numbers, or what stands for an array (`DoubleWord`, `Components`).
# Docstrings say its shape, (*batch, ...), and what it holds. Results are `jax.Array`.
ArrayLike = jax.typing.ArrayLike | StandIn | Sequence[Any]
BatchShape = int | Sequence[int]
PrecisionName = Precision | str | None  # None takes the default
Key = jax.typing.ArrayLike  # of jax.random
if not typing.TYPE_CHECKING:
    ArrayLike, DTypeLike, Key = (named(*x) for x in (("ArrayLike", ArrayLike), ("DTypeLike", DTypeLike), ("Key", Key)))

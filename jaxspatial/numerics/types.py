"""The types of public arguments."""

from collections.abc import Sequence
from typing import Any

import jax.typing
from jax.typing import DTypeLike as DTypeLike

from jaxspatial.numerics.check import StandIn
from jaxspatial.numerics.precision import Precision

# An array of JAX or NumPy, a number, a sequence of numbers, or what stands for an array (`DoubleWord`, `Components`).
# Docstrings say its shape, (*batch, ...), and what it holds. Results are `jax.Array`.
ArrayLike = jax.typing.ArrayLike | StandIn | Sequence[Any]
BatchShape = int | Sequence[int]
PrecisionName = Precision | str | None  # None takes the default
Key = jax.typing.ArrayLike  # of jax.random

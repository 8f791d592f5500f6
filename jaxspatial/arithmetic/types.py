"""The types of public signatures: what an array holds, which no stub can check, is said by the name of an alias.

An argument is an array of JAX or NumPy, a sequence of numbers, or what stands for an array (`DoubleWord`,
`Components`). Results are `jax.Array`. All are (*batch, ...), with batch shapes that broadcast.
"""

from collections.abc import Sequence
from typing import Any

import chex
import jax.typing
from jax.typing import DTypeLike as DTypeLike

from jaxspatial.arithmetic.check import StandIn
from jaxspatial.arithmetic.precision import Precision

Vector = chex.Array | StandIn | Sequence[Any]  # (*batch, n)
Vector3 = Vector  # (*batch, 3): Cartesian components
Six = Vector  # (*batch, 6): rotational components first
Quaternion = Vector  # (*batch, 4): real part first
Matrix = chex.Array | Sequence[Any]  # (*batch, m, n)
Matrix3 = Matrix  # (*batch, 3, 3)
Scalar = chex.Numeric | StandIn | Sequence[Any]  # (*batch,)
Amount = Scalar | None  # (*batch,): of mass, kg, or density, kg/m3, exactly one is given

Coordinates = Vector  # (*batch, nq): the configuration of a mechanism
Rates = Vector  # (*batch, nv): generalized velocities, and their derivatives
Forces = Vector  # (*batch, nv): generalized forces

BatchShape = int | Sequence[int]
PrecisionName = Precision | str | None  # None takes the default
Key = jax.typing.ArrayLike  # of jax.random

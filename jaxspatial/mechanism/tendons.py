"""Tendons: linear forms of coordinates with a spring, damping and limits."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import jax
import numpy as np

from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import exported_tree_of
from jaxspatial.numerics.types import ArrayLike


@exported_tree_of("name", "joints")
class Tendon:
    """A tendon over joints of one coordinate: its length L is a linear form of these.

        L = coefficients . q + offset        tau = coefficients (-stiffness (L - rest) - damping dL/dt + N)

        js.Tendon("finger", ["knuckle", "tip"], [1.0, -1.0], stiffness=0.5, upper=0.1)

    `passive_forces` and the steps apply the spring and damping, and N, the force of a limit, where `Compliance` gives
    limits of tendons a stiffness. `convex_step` holds the limits as stiffly as its time step allows. Equal limits hold
    the length from both sides: the coordinates are coupled. `convex_step` then halves what L is off in each step.
    `forward_dynamics`, `constrained_forward_dynamics` and `close_loops` know nothing of limits.

    Args:
        name: for messages; static.
        joints: names of joints of one coordinate; static. Those of mimics count with the joint that they follow.
        coefficients: (k,) one for each joint, m/rad or 1.
        offset: L where the coordinates are zero, m.
        stiffness: N/m.
        rest: (2,) the shortest and the longest length at which the spring is at rest, or one number for both, m.
        damping: N s/m. The steps take it explicitly: they are stable for dt damping below the inertia along L.
        lower, upper: limits of L, m; two equal numbers to hold L there.

    Raises:
        TypeError: names are no text, or numbers are none of floating point.
        ValueError: there is no name, the numbers of names and of coefficients differ, or of numbers known while
            tracing one is NaN, damping below zero, or a lower limit above the upper.

    Example:
        >>> band = js.Tendon("band", ["shoulder", "elbow"], [0.25, -0.5], stiffness=8.0)
        >>> print(js.passive_forces(arm.replace(tendons=[band]), jnp.array([1.0, 0.25]), jnp.zeros(2)))
        [-0.25  0.5 ]
    """

    name: str
    joints: tuple[str, ...]
    coefficients: jax.Array
    offset: jax.Array = 0.0  # type: ignore[assignment]  # a number becomes an array
    stiffness: jax.Array = 0.0  # type: ignore[assignment]
    rest: jax.Array = 0.0  # type: ignore[assignment]
    damping: jax.Array = 0.0  # type: ignore[assignment]
    lower: jax.Array = -np.inf  # type: ignore[assignment]
    upper: jax.Array = np.inf  # type: ignore[assignment]

    if TYPE_CHECKING:

        def __init__(
            self,
            name: str,
            joints: Iterable[str],
            coefficients: ArrayLike,
            offset: ArrayLike = 0.0,
            stiffness: ArrayLike = 0.0,
            rest: ArrayLike = 0.0,
            damping: ArrayLike = 0.0,
            lower: ArrayLike = -np.inf,
            upper: ArrayLike = np.inf,
        ): ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", check.as_tuple(self.joints, str, "Tendon: joints", "names"))
        if not self.joints:
            raise ValueError(f"Tendon {self.name!r}: joints: expected at least one name, got none")
        for field, size in leaf_shapes(self).items():
            x = getattr(self, field)
            if check.is_tree_mark(x):
                continue
            array = floats.owned(floats.as_float_array(x, f"Tendon: {field}", np.float64, keep_dtype=True))
            array = np.repeat(array, 2) if field == "rest" and array.ndim == 0 else array
            if array.shape != size:
                raise ValueError(f"Tendon {self.name!r}: {field}: expected shape {size}, got {array.shape}")
            least = " of at least 0" if field == "damping" else ""
            if isinstance(array, np.ndarray) and not (array >= (0 if least else -np.inf)).all():
                raise ValueError(f"Tendon {self.name!r}: {field}: expected numbers{least}, got {array.tolist()}")
            object.__setattr__(self, field, array)
        if isinstance(self.lower, np.ndarray) and isinstance(self.upper, np.ndarray) and self.lower > self.upper:
            expected = f"expected at most upper, {self.upper.tolist()}"
            raise ValueError(f"Tendon {self.name!r}: lower: {expected}, got {self.lower.tolist()}")

    def __repr__(self) -> str:
        return f"Tendon({self.name!r}, {list(self.joints)}, {check.in_short(self.coefficients)})"


def leaf_shapes(tendon: Tendon) -> dict[str, tuple[int, ...]]:
    """The shapes of the numbers of a tendon, in their order."""
    names = "coefficients", "offset", "stiffness", "rest", "damping", "lower", "upper"
    return {name: () for name in names} | {"coefficients": (len(tendon.joints),), "rest": (2,)}


def checked_tendons(tendons, topology: Topology, what: str) -> tuple[Tendon, ...]:
    """A sequence of tendons over joints of one coordinate, as a tuple."""
    found = check.as_tuple(tendons, Tendon, what, "Tendons")
    for tendon in found:
        for name in tendon.joints:
            kind = topology.kind(topology.index(topology.joint_names, name, f"{what}: Tendon {tendon.name!r}: joints"))
            if kind.nq != 1 or kind.nv != 1:
                expected = "expected joints of one coordinate"
                raise ValueError(f"{what}: Tendon {tendon.name!r}: joints: {expected}, got {name!r}, a {kind.name!r}")
    return found

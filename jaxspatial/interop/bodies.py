"""Wrenches on the bodies of a mechanism as rows of a simulator's array, and back: used by MuJoCo and Newton alike.

Both take [f; tau] on each of their bodies, about its centre of mass, in world axes. Positions of centres of mass are
those of the simulator's own model, which may keep apart bodies that are merged here. They are converted to the dtype
that is computed with, and without a warning: nobody chose theirs.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.external_forces import applied_wrenches
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.interop import orders
from jaxspatial.mechanism import AppliedForces, Mechanism
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.numerics.quantity import stack
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation.rotation import rotated
from jaxspatial.spatial import SpatialForce, shift


def to_rows(
    mechanism: Mechanism,
    q: ArrayLike,
    forces: ExternalForces,
    row: Callable[[str], int],
    centers: np.ndarray | jax.Array,
    precision: PrecisionName,
) -> jax.Array:
    """Makes (*batch, n, 6) [f; tau] about the centres of mass of the n bodies of a simulator, in world axes.

    Args:
        mechanism: whose bodies the forces act on.
        q: (*batch, nq) coordinates.
        forces: a dict or AppliedForces, as `external_forces`.
        row: of the simulator's body with this name; raises KeyError where there is none.
        centers: (n, 3) or (*batch, n, 3) positions of centres of mass from the origins of bodies, in their axes.
        precision: name of a precision; None takes the default.

    Example:
        >>> com = np.float32([[0, 0, -0.5], [0, 0, -0.5]])
        >>> push = js.SpatialForce(f=[1.0, 0.0, 0.0])  # at the elbow, 0.5 m above the centre of mass
        >>> number = ("upper", "lower").index
        >>> print(js.interop.bodies.to_rows(arm, arm.neutral(), {"lower": push}, number, com, None)[1])
        [1.  0.  0.  0.  0.5 0. ]
    """
    wrenches = applied_wrenches(mechanism, q, forces, precision=precision)
    names = [name for name in wrenches if name != WORLD]
    rows, n = [row(name) for name in names], centers.shape[-2]
    if not names:
        return jnp.zeros((*np.shape(q)[:-1], n, 6), mechanism.dtype)
    X_WB = forward_kinematics(mechanism, q, names, precision=precision)
    p_BoBcm_B = centers.astype(X_WB.dtype)[..., np.array(rows, np.int32), :]
    p_BoBcm_W = rotated(X_WB.rotation, p_BoBcm_B, precision=precision)
    F_Bo_W = stack([wrenches[name] for name in names], axis=-1)
    six = orders.to_linear_first(shift(F_Bo_W, p_BoBcm_W, precision=precision))
    # The rows of bodies without a wrench are copies of a row of zeros behind the others.
    source = np.full(n, len(names), np.int32)
    source[rows] = np.arange(len(names))
    return jnp.concatenate([six, jnp.zeros_like(six[..., :1, :])], -2)[..., source, :]


def from_rows(names: Sequence[str], rows: jax.Array, centers: np.ndarray | jax.Array) -> AppliedForces:
    """Reads (*batch, n, 6) [f; tau] about the centres of mass of n bodies with these names, in world axes.

    centers: as of `to_rows`.

    Example:
        >>> com = np.float32([[0, 0, -0.5], [0, 0, -0.5]])
        >>> forces = js.interop.bodies.from_rows(["upper", "lower"], jnp.eye(2, 6), com)
        >>> print(forces.frames, forces.wrenches.f[1])
        ('upper', 'lower') [0. 1. 0.]
    """
    return AppliedForces(names, orders.from_linear_first(SpatialForce, rows), centers.astype(rows.dtype))

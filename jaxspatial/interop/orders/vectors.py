"""Orders of six-vectors and of matrices between them."""

from typing import TypeVar

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Matrix, Six
from jaxspatial.spatial.parts import joined
from jaxspatial.spatial.vector import SpatialVector

K = TypeVar("K", bound=SpatialVector)


def from_rotational_first(kind: type[K], x6: Six) -> K:
    """Makes a spatial vector of six numbers with the rotational part first.

    The order of Drake, Featherstone's books, `mj_objectVelocity`, Brax's `matrix()`, and ours.

    Args:
        kind: one of the four spatial vectors.
        x6: (*batch, 6) [w; v], [tau; f] and the like.

    Returns:
        The spatial vector (*batch,).

    Raises:
        ValueError: the shape does not fit.
    """
    return kind.from_array(x6)


def to_rotational_first(x: SpatialVector) -> jax.Array:
    """Stacks a spatial vector with the rotational part first: [w; v], [tau; f] and the like.

    Args:
        x: any of the four kinds (*batch,).

    Returns:
        The components (*batch, 6).
    """
    return x.to_array()


def from_linear_first(kind: type[K], x6: Six) -> K:
    """Makes a spatial vector of six numbers with the linear part first.

    The order of Pinocchio, jaxlie, jaxsim, frax, spatialmath, ROS, and of what users hand to MuJoCo.

    Args:
        kind: one of the four spatial vectors.
        x6: (*batch, 6) [v; w], [f; tau] and the like.

    Returns:
        The spatial vector (*batch,).

    Raises:
        ValueError: the shape does not fit.
    """
    six = check.as_vectors(x6, "from_linear_first: x6", size=6, held=True)
    return kind(six[..., 3:], six[..., :3])


def to_linear_first(x: SpatialVector) -> jax.Array:
    """Stacks a spatial vector with the linear part first: [v; w], [f; tau] and the like.

    Args:
        x: any of the four kinds (*batch,).

    Returns:
        The components (*batch, 6).
    """
    return joined(x.translational, x.rotational)


def matrix_from_linear_first(m: Matrix) -> jax.Array:
    """Exchanges the blocks of a matrix between spatial vectors with the linear part first.

    Args:
        m: (*batch, 6, 6) in the order [v; w] or [f; tau]: inertia, adjoint.

    Returns:
        The matrix (*batch, 6, 6) with rotational parts first, as ours.

    Raises:
        ValueError: the shape does not fit.
    """
    matrix = check.as_vectors(m, "matrix_from_linear_first: m", size=6, many=["6"], held=True)
    exchanged = np.array([3, 4, 5, 0, 1, 2])
    return matrix[..., exchanged[:, None], exchanged]


def matrix_to_linear_first(m: Matrix) -> jax.Array:
    """Exchanges the blocks of a matrix between spatial vectors with the rotational part first.

    Args:
        m: (*batch, 6, 6), rotational parts first, as ours.

    Returns:
        The matrix (*batch, 6, 6) in the order [v; w] or [f; tau].

    Raises:
        ValueError: the shape does not fit.
    """
    return matrix_from_linear_first(m)

"""Orders of components, on arrays: what other libraries, file formats and papers put where.

Ours: six-vectors and 6 x 6 matrices have the rotational part first, quaternions are wxyz, and symmetric 3 x 3 matrices
are their lower triangle by rows, [xx, xy, yy, xz, yz, zz], as Pinocchio's Symmetric3. Functions that move numbers are
exact and keep NumPy arrays NumPy; poses alone are computed, since we hold a matrix where others hold a quaternion. A
shape that does not fit raises ValueError.
"""

from typing import Any, TypeVar

import jax
import numpy as np

from jaxspatial.numerics import check
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform
from jaxspatial.spatial.vectors import SpatialVector, concatenated

K = TypeVar("K", bound=SpatialVector)

# -- six-vectors and matrices between them -----------------------------------------------------------------------------


def from_linear_first(kind: type[K], x6: ArrayLike) -> K:
    """Makes a spatial vector of six numbers with the linear part first.

    The order of Pinocchio, jaxlie, jaxsim, frax, spatialmath, ROS, and of what users hand to MuJoCo.

    Args:
        kind: one of the four spatial vectors.
        x6: (*batch, 6) [v; w], [f; tau] and the like.

    Returns:
        The spatial vector (*batch,).
    """
    six = check.as_vectors(x6, "from_linear_first: x6", size=6, held=True)
    return kind(six[..., 3:], six[..., :3])


def to_linear_first(x: SpatialVector) -> jax.Array:
    """Stacks a spatial vector of any kind as (*batch, 6) with the linear part first: [v; w], [f; tau] and the like."""
    return concatenated(x.translational, x.rotational)


def matrix_from_linear_first(m: ArrayLike) -> jax.Array:
    """Exchanges the blocks of a matrix between spatial vectors: an inertia, an adjoint.

    Args:
        m: (*batch, 6, 6) in the order [v; w] or [f; tau].

    Returns:
        The matrix (*batch, 6, 6) with rotational parts first.
    """
    matrix = check.as_vectors(m, "matrix_from_linear_first: m", size=6, many=["6"], held=True)
    exchanged = np.array([3, 4, 5, 0, 1, 2])
    return matrix[..., exchanged[:, None], exchanged]


def matrix_to_linear_first(m: ArrayLike) -> jax.Array:
    """Exchanges the blocks of a matrix (*batch, 6, 6) between spatial vectors, back to the order [v; w] or [f; tau]."""
    return matrix_from_linear_first(m)


# -- symmetric matrices ------------------------------------------------------------------------------------------------


def symmetric_from_diagonal_first(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, yy, zz, xy, xz, yz] as [xx, xy, yy, xz, yz, zz].

    Moments come first in MuJoCo's `fullinertia` and `cinert` and in the six arguments of Drake's RotationalInertia.
    """
    return _reordered(x6, "symmetric_from_diagonal_first: x6", 0, 3, 1, 4, 5, 2)


def symmetric_to_diagonal_first(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, xy, yy, xz, yz, zz] as [xx, yy, zz, xy, xz, yz], moments first."""
    return _reordered(x6, "symmetric_to_diagonal_first: x6", 0, 2, 5, 1, 3, 4)


def symmetric_from_upper_triangle(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, xy, xz, yy, yz, zz], the upper triangle by rows (URDF, SDF), as the lower triangle."""
    return _reordered(x6, "symmetric_from_upper_triangle: x6", 0, 1, 3, 2, 4, 5)


def symmetric_to_upper_triangle(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, xy, yy, xz, yz, zz] as [xx, xy, xz, yy, yz, zz], the upper triangle by rows."""
    return _reordered(x6, "symmetric_to_upper_triangle: x6", 0, 1, 3, 2, 4, 5)


# -- quaternions and poses ---------------------------------------------------------------------------------------------


def quaternion_from_xyzw(q: ArrayLike) -> jax.Array:
    """Moves the real part of quaternions (*batch, 4) to the front: from the order of Pinocchio, SciPy and ROS."""
    return _reordered(q, "quaternion_from_xyzw: q", 3, 0, 1, 2)


def quaternion_to_xyzw(q: ArrayLike) -> jax.Array:
    """Moves the real part of quaternions (*batch, 4) to the end: from ours, of Drake, MuJoCo, Brax and jaxlie too."""
    return _reordered(q, "quaternion_to_xyzw: q", 1, 2, 3, 0)


def pose_from_xyz_xyzw(x7: ArrayLike, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes X_AB (*batch,) of (*batch, 7) [p_AB; xyzw], m: Pinocchio's XYZQUAT and free flyer, ROS.

    Error: as of `Rotation.from_quaternion`.
    """
    pose = check.as_vectors(x7, "pose_from_xyz_xyzw: x7", size=7, held=True)
    return _pose(pose[..., :3], quaternion_from_xyzw(pose[..., 3:]), precision)


def pose_to_xyz_xyzw(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks X_AB (*batch,) as (*batch, 7) [p_AB; xyzw], m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return concatenated(X_AB.translation, quaternion_to_xyzw(X_AB.rotation.to_quaternion(precision=precision)))


def pose_from_xyz_wxyz(x7: ArrayLike, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes X_AB (*batch,) of (*batch, 7) [p_AB; wxyz], m: a free joint in MuJoCo's qpos.

    Error: as of `Rotation.from_quaternion`.
    """
    pose = check.as_vectors(x7, "pose_from_xyz_wxyz: x7", size=7, held=True)
    return _pose(pose[..., :3], pose[..., 3:], precision)


def pose_to_xyz_wxyz(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks X_AB (*batch,) as (*batch, 7) [p_AB; wxyz], m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return concatenated(X_AB.translation, X_AB.rotation.to_quaternion(precision=precision))


def pose_from_wxyz_xyz(x7: ArrayLike, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes X_AB (*batch,) of (*batch, 7) [wxyz; p_AB], m: jaxlie, jaxsim, Drake's floating joint, the free joint here.

    Error: as of `Rotation.from_quaternion`.
    """
    pose = check.as_vectors(x7, "pose_from_wxyz_xyz: x7", size=7, held=True)
    return _pose(pose[..., 4:], pose[..., :4], precision)


def pose_to_wxyz_xyz(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks X_AB (*batch,) as (*batch, 7) [wxyz; p_AB], m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return concatenated(X_AB.rotation.to_quaternion(precision=precision), X_AB.translation)


def _pose(xyz: jax.Array, wxyz: jax.Array, precision: PrecisionName) -> RigidTransform:
    return RigidTransform(Rotation.from_quaternion(wxyz, precision=precision), xyz)


def _reordered(x: ArrayLike, name: str, *order: int) -> jax.Array:
    return check.as_vectors(x, name, size=len(order), held=True)[..., np.array(order)]


# -- one item, for libraries that hold one -----------------------------------------------------------------------------


def single(x: Any, name: str) -> Any:
    """Copies one item to the host, for a constructor that takes nothing else.

    Args:
        x: (n,) an array, or a double word.
        name: of the item, for the message.

    Returns:
        (n,) float64; of a double word the nearest.

    Raises:
        ValueError: x is a batch.
    """
    words = [np.asarray(word, np.float64) for word in jax.tree.leaves(x)]
    if words[0].ndim != 1:
        raise ValueError(
            f"{name}: expected one item, got a batch of shape {words[0].shape[:-1]}; "
            "item i is jax.tree.map(lambda leaf: leaf[i], x)"
        )
    return np.sum(words, axis=0)

"""Orders of components, on arrays: what other libraries, file formats and papers put where.

Ours: six-vectors and 6 x 6 matrices have the rotational part first, quaternions are wxyz, and symmetric 3 x 3 matrices
are their lower triangle by rows, [xx, xy, yy, xz, yz, zz], as Pinocchio's Symmetric3. Functions that move numbers are
exact and keep NumPy arrays NumPy; poses alone are computed, since we hold a matrix where others hold a quaternion. A
shape that does not fit raises ValueError.
"""

from typing import TypeVar

import jax
import numpy as np

from jaxspatial.numerics import floats
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform
from jaxspatial.spatial.vectors import SpatialVector, side_by_side

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

    Example:
        >>> js.interop.orders.from_linear_first(js.SpatialForce, np.float32([1, 2, 3, 4, 5, 6]))  # [f; tau]
        SpatialForce(tau=[4.0, 5.0, 6.0], f=[1.0, 2.0, 3.0])
    """
    six = floats.as_vectors(x6, "from_linear_first: x6", size=6, keep_dtype=True)
    return kind(six[..., 3:], six[..., :3])


def to_linear_first(x: SpatialVector) -> jax.Array:
    """Stacks a spatial vector of any kind as (*batch, 6) with the linear part first: [v; w], [f; tau] and the like.

    Example:
        >>> print(js.interop.orders.to_linear_first(F))
        [1. 2. 0. 0. 0. 3.]
    """
    return side_by_side(x.translational, x.rotational)


def matrix_from_linear_first(m: ArrayLike) -> jax.Array:
    """Exchanges the blocks of a matrix between spatial vectors: an inertia, an adjoint.

    Args:
        m: (*batch, 6, 6) in the order [v; w] or [f; tau].

    Returns:
        The matrix (*batch, 6, 6) with rotational parts first.

    Example:
        >>> m = np.arange(36.0).reshape(6, 6)
        >>> print(js.interop.orders.matrix_from_linear_first(m)[0])
        [21. 22. 23. 18. 19. 20.]
    """
    matrix = floats.as_vectors(m, "matrix_from_linear_first: m", size=6, many=["6"], keep_dtype=True)
    exchanged = np.array([3, 4, 5, 0, 1, 2])
    return matrix[..., exchanged[:, None], exchanged]


def matrix_to_linear_first(m: ArrayLike) -> jax.Array:
    """Exchanges the blocks of a matrix (*batch, 6, 6) between spatial vectors, back to the order [v; w] or [f; tau].

    Example:
        >>> m = np.arange(36.0).reshape(6, 6)
        >>> print(js.interop.orders.matrix_to_linear_first(m)[0])
        [21. 22. 23. 18. 19. 20.]
    """
    return matrix_from_linear_first(m)


# -- symmetric matrices ------------------------------------------------------------------------------------------------


def symmetric_from_diagonal_first(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, yy, zz, xy, xz, yz] as [xx, xy, yy, xz, yz, zz].

    Moments come first in MuJoCo's `fullinertia` and `cinert` and in the six arguments of Drake's RotationalInertia.

    Example:
        >>> print(js.interop.orders.symmetric_from_diagonal_first(np.float32([1, 2, 3, 4, 5, 6])))
        [1. 4. 2. 5. 6. 3.]
    """
    return _reordered(x6, "symmetric_from_diagonal_first: x6", 0, 3, 1, 4, 5, 2)


def symmetric_to_diagonal_first(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, xy, yy, xz, yz, zz] as [xx, yy, zz, xy, xz, yz], moments first.

    Example:
        >>> print(js.interop.orders.symmetric_to_diagonal_first(np.float32([1, 2, 3, 4, 5, 6])))
        [1. 3. 6. 2. 4. 5.]
    """
    return _reordered(x6, "symmetric_to_diagonal_first: x6", 0, 2, 5, 1, 3, 4)


def symmetric_from_upper_triangle(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, xy, xz, yy, yz, zz], the upper triangle by rows (URDF, SDF), as the lower triangle.

    Example:
        >>> print(js.interop.orders.symmetric_from_upper_triangle(np.float32([1, 2, 3, 4, 5, 6])))
        [1. 2. 4. 3. 5. 6.]
    """
    return _reordered(x6, "symmetric_from_upper_triangle: x6", 0, 1, 3, 2, 4, 5)


def symmetric_to_upper_triangle(x6: ArrayLike) -> jax.Array:
    """Reorders (*batch, 6) [xx, xy, yy, xz, yz, zz] as [xx, xy, xz, yy, yz, zz], the upper triangle by rows.

    Example:
        >>> print(js.interop.orders.symmetric_to_upper_triangle(np.float32([1, 2, 3, 4, 5, 6])))
        [1. 2. 4. 3. 5. 6.]
    """
    return _reordered(x6, "symmetric_to_upper_triangle: x6", 0, 1, 3, 2, 4, 5)


# -- quaternions and poses ---------------------------------------------------------------------------------------------


def quaternion_from_xyzw(q: ArrayLike) -> jax.Array:
    """Moves the real part of quaternions (*batch, 4) to the front: from the order of Pinocchio, SciPy and ROS.

    Example:
        >>> print(js.interop.orders.quaternion_from_xyzw(np.float32([0, 0, 0, 1])))
        [1. 0. 0. 0.]
    """
    return _reordered(q, "quaternion_from_xyzw: q", 3, 0, 1, 2)


def quaternion_to_xyzw(q: ArrayLike) -> jax.Array:
    """Moves the real part of quaternions (*batch, 4) to the end: from ours, of Drake, MuJoCo, Brax and jaxlie too.

    Example:
        >>> print(js.interop.orders.quaternion_to_xyzw(np.float32([1, 0, 0, 0])))
        [0. 0. 0. 1.]
    """
    return _reordered(q, "quaternion_to_xyzw: q", 1, 2, 3, 0)


def pose_from_xyz_xyzw(x7: ArrayLike, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes X_AB (*batch,) of (*batch, 7) [p_AB; xyzw], m: Pinocchio's XYZQUAT and free flyer, ROS.

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> X_AB = js.interop.orders.pose_from_xyz_xyzw(np.float32([1, 2, 3, 0, 0, 0, 1]))
        >>> print(X_AB.translation)
        [1. 2. 3.]
    """
    pose = floats.as_vectors(x7, "pose_from_xyz_xyzw: x7", size=7, keep_dtype=True)
    return _pose(pose[..., :3], quaternion_from_xyzw(pose[..., 3:]), precision)


def pose_to_xyz_xyzw(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks X_AB (*batch,) as (*batch, 7) [p_AB; xyzw], m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.orders.pose_to_xyz_xyzw(below))
        [ 0.  0. -1.  0.  0.  0.  1.]
    """
    return side_by_side(X_AB.translation, quaternion_to_xyzw(X_AB.rotation.to_quaternion(precision=precision)))


def pose_from_xyz_wxyz(x7: ArrayLike, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes X_AB (*batch,) of (*batch, 7) [p_AB; wxyz], m: a free joint in MuJoCo's qpos.

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> X_AB = js.interop.orders.pose_from_xyz_wxyz(np.float32([1, 2, 3, 1, 0, 0, 0]))
        >>> print(X_AB.translation)
        [1. 2. 3.]
    """
    pose = floats.as_vectors(x7, "pose_from_xyz_wxyz: x7", size=7, keep_dtype=True)
    return _pose(pose[..., :3], pose[..., 3:], precision)


def pose_to_xyz_wxyz(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks X_AB (*batch,) as (*batch, 7) [p_AB; wxyz], m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.orders.pose_to_xyz_wxyz(below))
        [ 0.  0. -1.  1.  0.  0.  0.]
    """
    return side_by_side(X_AB.translation, X_AB.rotation.to_quaternion(precision=precision))


def pose_from_wxyz_xyz(x7: ArrayLike, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes X_AB (*batch,) of (*batch, 7) [wxyz; p_AB], m: jaxlie, jaxsim, Drake's floating joint, the free joint here.

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> X_AB = js.interop.orders.pose_from_wxyz_xyz(np.float32([1, 0, 0, 0, 1, 2, 3]))
        >>> print(X_AB.translation)
        [1. 2. 3.]
    """
    pose = floats.as_vectors(x7, "pose_from_wxyz_xyz: x7", size=7, keep_dtype=True)
    return _pose(pose[..., 4:], pose[..., :4], precision)


def pose_to_wxyz_xyz(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks X_AB (*batch,) as (*batch, 7) [wxyz; p_AB], m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.orders.pose_to_wxyz_xyz(below))
        [ 1.  0.  0.  0.  0.  0. -1.]
    """
    return side_by_side(X_AB.rotation.to_quaternion(precision=precision), X_AB.translation)


def _pose(xyz: jax.Array, wxyz: jax.Array, precision: PrecisionName) -> RigidTransform:
    return RigidTransform(Rotation.from_quaternion(wxyz, precision=precision), xyz)


def _reordered(x: ArrayLike, name: str, *order: int) -> jax.Array:
    return floats.as_vectors(x, name, size=len(order), keep_dtype=True)[..., np.array(order)]


# -- one item, for libraries that hold one -----------------------------------------------------------------------------


def single(x, name: str):
    """Copies one item to the host, for a constructor that takes nothing else.

    Args:
        x: (n,) an array, or a double word.
        name: of the item, for the message.

    Returns:
        (n,) float64; of a double word the nearest.

    Raises:
        ValueError: x is a batch.

    Example:
        >>> js.interop.orders.single(jnp.array([1.0, 2.0]), "x")
        array([1., 2.])
    """
    words = [np.asarray(word, np.float64) for word in jax.tree.leaves(x)]
    if words[0].ndim != 1:
        raise ValueError(
            f"{name}: expected one item, got a batch of shape {words[0].shape[:-1]}; "
            "item i is jax.tree.map(lambda leaf: leaf[i], x)"
        )
    return np.sum(words, axis=0)

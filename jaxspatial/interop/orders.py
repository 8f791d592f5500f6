"""Orders of components, on arrays: what other libraries, file formats and papers put where.

Ours: six-vectors and 6 x 6 matrices have the rotational part on top, quaternions are wxyz, symmetric 3 x 3 matrices are
their lower triangle by rows, [xx, xy, yy, xz, yz, zz] (Pinocchio's Symmetric3 is that too). Everything below only moves
numbers, exactly; poses alone are computed, since we hold a matrix where others hold a quaternion.
"""

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform
from jaxspatial.spatial.vector import joined

# -- spatial vectors --------------------------------------------------------------------------------------------------


def from_rotational_first(kind, x6):
    """A spatial vector of that kind from (*batch, 6) [w; v], [tau; f], ...: the order of Drake, Featherstone's books,
    `mj_objectVelocity`, Brax's `matrix()`, and ours."""
    return kind.from_array(x6)


def to_rotational_first(x):
    """(*batch, 6) [w; v], [tau; f], ... of any of the four kinds."""
    return x.to_array()


def from_linear_first(kind, x6):
    """A spatial vector of that kind from (*batch, 6) [v; w], [f; tau], ...: the order of Pinocchio, jaxlie, jaxsim,
    frax, spatialmath, ROS, and of what users hand to MuJoCo."""
    x6 = check.as_vectors(x6, "from_linear_first: x6", size=6, held=True)
    return kind(x6[..., 3:], x6[..., :3])


def to_linear_first(x):
    """(*batch, 6) [v; w], [f; tau], ... of any of the four kinds."""
    return joined(x.translational, x.rotational)


def matrix_from_linear_first(m):
    """(*batch, 6, 6) between spatial vectors, in the order [v; w] or [f; tau], as ours: inertia, adjoint."""
    m = check.as_vectors(m, "matrix_from_linear_first: m", size=6, many=["6"], held=True)
    exchanged = np.array([3, 4, 5, 0, 1, 2])
    return m[..., exchanged[:, None], exchanged]


def matrix_to_linear_first(m):
    """(*batch, 6, 6) of ours, rotational on top, in the order [v; w] or [f; tau]: the same exchange of blocks."""
    return matrix_from_linear_first(m)


# -- quaternions and poses --------------------------------------------------------------------------------------------


def quaternion_from_xyzw(q):
    """(*batch, 4) real part last (Pinocchio, SciPy, ROS) as wxyz (ours, Drake, MuJoCo, Brax, jaxlie)."""
    return check.as_vectors(q, "quaternion_from_xyzw: q", size=4, held=True)[..., np.array([3, 0, 1, 2])]


def quaternion_to_xyzw(q):
    """(*batch, 4) wxyz as xyzw."""
    return check.as_vectors(q, "quaternion_to_xyzw: q", size=4, held=True)[..., np.array([1, 2, 3, 0])]


def pose_from_xyz_xyzw(x7, *, precision=None):
    """X_AB from (*batch, 7) [p_AB; xyzw]: Pinocchio's XYZQUAT, ROS. Errors as of `Rotation.from_quaternion`."""
    x7 = check.as_vectors(x7, "pose_from_xyz_xyzw: x7", size=7, held=True)
    return _pose(x7[..., :3], quaternion_from_xyzw(x7[..., 3:]), precision)


def pose_to_xyz_xyzw(X_AB, *, precision=None):
    """(*batch, 7) [p_AB; xyzw], the real part not negative. Errors as of `Rotation.to_quaternion`."""
    return joined(X_AB.translation, quaternion_to_xyzw(X_AB.rotation.to_quaternion(precision=precision)))


def pose_from_xyz_wxyz(x7, *, precision=None):
    """X_AB from (*batch, 7) [p_AB; wxyz]: MuJoCo's free joint. Errors as of `Rotation.from_quaternion`."""
    x7 = check.as_vectors(x7, "pose_from_xyz_wxyz: x7", size=7, held=True)
    return _pose(x7[..., :3], x7[..., 3:], precision)


def pose_to_xyz_wxyz(X_AB, *, precision=None):
    """(*batch, 7) [p_AB; wxyz], the real part not negative. Errors as of `Rotation.to_quaternion`."""
    return joined(X_AB.translation, X_AB.rotation.to_quaternion(precision=precision))


def pose_from_wxyz_xyz(x7, *, precision=None):
    """X_AB from (*batch, 7) [wxyz; p_AB]: jaxlie, jaxsim, Drake's floating joint, and the free joint here. Errors as of
    `Rotation.from_quaternion`."""
    x7 = check.as_vectors(x7, "pose_from_wxyz_xyz: x7", size=7, held=True)
    return _pose(x7[..., 4:], x7[..., :4], precision)


def pose_to_wxyz_xyz(X_AB, *, precision=None):
    """(*batch, 7) [wxyz; p_AB], the real part not negative. Errors as of `Rotation.to_quaternion`."""
    return joined(X_AB.rotation.to_quaternion(precision=precision), X_AB.translation)


def _pose(xyz, wxyz, precision):
    return RigidTransform(Rotation.from_quaternion(wxyz, precision=precision), xyz)


# -- inertia ----------------------------------------------------------------------------------------------------------


def symmetric_from_diagonal_first(x6):
    """(*batch, 6) [xx, yy, zz, xy, xz, yz], moments first (MuJoCo's `fullinertia` and `cinert`, the six arguments of
    Drake's RotationalInertia), as [xx, xy, yy, xz, yz, zz]."""
    return check.as_vectors(x6, "symmetric_from_diagonal_first: x6", size=6, held=True)[
        ..., np.array([0, 3, 1, 4, 5, 2])
    ]


def symmetric_to_diagonal_first(x6):
    """(*batch, 6) [xx, xy, yy, xz, yz, zz] as [xx, yy, zz, xy, xz, yz]."""
    return check.as_vectors(x6, "symmetric_to_diagonal_first: x6", size=6, held=True)[..., np.array([0, 2, 5, 1, 3, 4])]


def symmetric_from_upper_triangle(x6):
    """(*batch, 6) [xx, xy, xz, yy, yz, zz], the upper triangle by rows (URDF, SDF), as [xx, xy, yy, xz, yz, zz]."""
    return check.as_vectors(x6, "symmetric_from_upper_triangle: x6", size=6, held=True)[
        ..., np.array([0, 1, 3, 2, 4, 5])
    ]


def symmetric_to_upper_triangle(x6):
    """(*batch, 6) [xx, xy, yy, xz, yz, zz] as [xx, xy, xz, yy, yz, zz]: the same exchange."""
    return symmetric_from_upper_triangle(x6)


# -- one item, for libraries that hold one -----------------------------------------------------------------------------


def single(x, name):
    """The array (n,) of one item as float64 on the host, for a constructor that takes nothing else; of a double word
    the nearest float64."""
    words = [np.asarray(word, np.float64) for word in jax.tree.leaves(x)]
    if words[0].ndim != 1:
        raise ValueError(
            f"{name}: expected one item, got a batch of shape {words[0].shape[:-1]}; "
            "item i is jax.tree.map(lambda leaf: leaf[i], x)"
        )
    return np.sum(words, axis=0)

"""Pinocchio: Force [f; tau] and Motion [v; w], linear part first; accelerations are Featherstone's; SE3 as X_AB.

Its Force is a force as well as a momentum, its Motion a velocity as well as an acceleration: the name of the function
here says which one is meant. Objects are single and float64. What is read is NumPy in float64, copied, known while
tracing; what is made takes one item, and a batch raises ValueError. Its ten dynamic parameters are those of
`SpatialInertia.from_dynamic_parameters`. Read: Pinocchio's spatial headers, pin 4.1.
"""

from typing import Any

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.numerics import eigen
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity
from jaxspatial.spatial.vectors import SpatialVector


def _library() -> Any:
    """Imported where an object of it is made. Its names come from compiled code that has no stubs."""
    import pinocchio

    return pinocchio


# -- spatial vectors ---------------------------------------------------------------------------------------------------


def from_force(F) -> SpatialForce:
    """Reads a pinocchio.Force that is a force, such as `data.f[i]`: about the origin of its frame, in its axes.

    Example:
        >>> import pinocchio
        >>> js.interop.pinocchio.from_force(pinocchio.Force(np.array([1.0, 2, 0]), np.array([0.0, 0, 3])))  # [f; tau]
        SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
    """
    return SpatialForce(F.angular, F.linear)


def from_momentum(L) -> SpatialMomentum:
    """Reads a pinocchio.Force that is a momentum, such as `data.h[i]`, or `data.hg` about the centre of mass.

    Example:
        >>> import pinocchio
        >>> motion = pinocchio.Motion(np.array([2.0, 0, 0]), np.array([0.0, 0, 1]))
        >>> js.interop.pinocchio.from_momentum(pinocchio.Inertia.Identity() * motion)
        SpatialMomentum(h=[0.0, 0.0, 1.0], l=[2.0, 0.0, 0.0])
    """
    return SpatialMomentum(L.angular, L.linear)


def to_force(F: SpatialForce | SpatialMomentum):
    """Makes a pinocchio.Force, [f; tau] or [l; h], of a single force or momentum.

    Example:
        >>> print(js.interop.pinocchio.to_force(F).vector)  # [f; tau]
        [1. 2. 0. 0. 0. 3.]
    """
    return _library().Force(_six(F, "pinocchio.to_force"))


def from_motion(V) -> SpatialVelocity:
    """Reads a pinocchio.Motion that is a velocity, such as `data.v[i]`.

    Example:
        >>> import pinocchio
        >>> js.interop.pinocchio.from_motion(pinocchio.Motion(np.array([0.5, 0, 0]), np.array([0.0, 0, 1])))  # [v; w]
        SpatialVelocity(w=[0.0, 0.0, 1.0], v=[0.5, 0.0, 0.0])
    """
    return SpatialVelocity(V.angular, V.linear)


def to_motion(V: SpatialVelocity):
    """Makes a pinocchio.Motion, [v; w], of a single velocity.

    Example:
        >>> print(js.interop.pinocchio.to_motion(V).vector)  # [v; w]
        [0.5 0.  0.  0.  0.  1. ]
    """
    return _library().Motion(_six(V, "pinocchio.to_motion"))


def from_spatial_acceleration(A, V, *, precision: PrecisionName = None) -> SpatialAcceleration:
    """Reads a pinocchio.Motion that is Featherstone's acceleration, such as `data.a[i]`: a = A.linear + w x v.

    Args:
        A: the acceleration; `data.a` is without gravity, `data.a_gf` less gravity.
        V: the velocity, a Motion about the same point in the same axes.
        precision: name of a precision; None takes the default.

    Returns:
        The classical acceleration.

    Error: as of `SpatialAcceleration.from_featherstone`.

    Example:
        >>> import pinocchio
        >>> A, V = pinocchio.Motion.Zero(), pinocchio.Motion(np.array([0.5, 0, 0]), np.array([0.0, 0, 1]))
        >>> with jax.enable_x64(True):
        ...     print(js.interop.pinocchio.from_spatial_acceleration(A, V).a)  # w x v, of a circle
        [0.  0.5 0. ]
    """
    six = np.concatenate((A.angular, A.linear))
    return SpatialAcceleration.from_featherstone(six, from_motion(V), precision=precision)


def to_spatial_acceleration(A: SpatialAcceleration, V: SpatialVelocity, *, precision: PrecisionName = None):
    """Makes a pinocchio.Motion that is Featherstone's acceleration, [a - w x v; alpha], such as `data.a[i]`.

    Args:
        A: a single classical acceleration.
        V: a single velocity about the same point in the same axes.
        precision: name of a precision; None takes the default.

    Error: as of `SpatialAcceleration.to_featherstone`.

    Example:
        >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 2.0], a=[0.0, 0.5, 0.0])
        >>> print(js.interop.pinocchio.to_spatial_acceleration(A, V).vector)
        [0. 0. 0. 0. 0. 2.]
    """
    spatial = SpatialAcceleration.from_array(A.to_featherstone(V, precision=precision))
    return _library().Motion(_six(spatial, "pinocchio.to_spatial_acceleration"))


def from_classical_acceleration(A) -> SpatialAcceleration:
    """Reads a pinocchio.Motion that is the classical acceleration, of `getFrameClassicalAcceleration`.

    Example:
        >>> import pinocchio
        >>> motion = pinocchio.Motion(np.array([0, 0.5, 0]), np.array([0, 0, 2.0]))  # [a; alpha]
        >>> js.interop.pinocchio.from_classical_acceleration(motion)
        SpatialAcceleration(alpha=[0.0, 0.0, 2.0], a=[0.0, 0.5, 0.0])
    """
    return SpatialAcceleration(A.angular, A.linear)


def to_classical_acceleration(A: SpatialAcceleration):
    """Makes a pinocchio.Motion, [a; alpha], of a single acceleration, as `getFrameClassicalAcceleration` returns it.

    Example:
        >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 2.0], a=[0.0, 0.5, 0.0])
        >>> print(js.interop.pinocchio.to_classical_acceleration(A).vector)
        [0.  0.5 0.  0.  0.  2. ]
    """
    return _library().Motion(_six(A, "pinocchio.to_classical_acceleration"))


def _six(x: SpatialVector, name: str):
    return orders.single(orders.to_linear_first(x), name)


# -- poses and inertias ------------------------------------------------------------------------------------------------


def from_se3(X_AB) -> RigidTransform:
    """Reads a pinocchio.SE3, such as `data.oMi[i]`, m: a copy, while SE3 hands out its own memory.

    Example:
        >>> import pinocchio
        >>> js.interop.pinocchio.from_se3(pinocchio.SE3(np.eye(3), np.array([1.0, 2.0, 3.0]))).translation
        array([1., 2., 3.])
    """
    return RigidTransform(Rotation.from_matrix(np.array(X_AB.rotation)), np.array(X_AB.translation))


def to_se3(X_AB: RigidTransform):
    """Makes a pinocchio.SE3, m, the rotation taken as it is (`SE3.normalize` repairs it).

    Example:
        >>> print(js.interop.pinocchio.to_se3(below).translation)
        [ 0.  0. -1.]
    """
    R = orders.single(X_AB.rotation.entries, "pinocchio.to_se3").reshape(3, 3)
    return _library().SE3(R, orders.single(X_AB.translation, "pinocchio.to_se3"))


def from_inertia(Y) -> SpatialInertia:
    """Reads a pinocchio.Inertia, which holds mass, lever (com) and the central inertia.

    Example:
        >>> import pinocchio
        >>> M = js.interop.pinocchio.from_inertia(pinocchio.Inertia.FromBox(12.0, 1.0, 2.0, 3.0))
        >>> print(M.mass, M.central)
        12.0 [13.  0. 10.  0.  0.  5.]
    """
    return SpatialInertia(Y.mass, np.array(Y.lever), np.array(Y.inertia))


def to_inertia(M: SpatialInertia):
    """Makes a pinocchio.Inertia of the numbers as they are.

    Pinocchio's constructor would refuse one that rounding has made a little indefinite, like that of a rod.

    Example:
        >>> theirs = js.interop.pinocchio.to_inertia(rod)
        >>> print(theirs.mass, theirs.lever)
        2.0 [ 0.   0.  -0.5]
    """
    mass, com, six = (orders.single(x, "pinocchio.to_inertia") for x in M._vectors)
    Y = _library().Inertia.Zero()
    Y.mass, Y.lever, Y.inertia = mass[0], com, eigen.matrix_of_six(six)
    return Y


def from_pseudo_inertia(J, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads a pinocchio.PseudoInertia.

    Error: as of `SpatialInertia.from_pseudo_inertia`.

    Example:
        >>> import pinocchio
        >>> J = pinocchio.PseudoInertia.FromInertia(pinocchio.Inertia.FromBox(12.0, 1.0, 2.0, 3.0))
        >>> with jax.enable_x64(True):
        ...     print(js.interop.pinocchio.from_pseudo_inertia(J).mass)
        12.0
    """
    return SpatialInertia.from_pseudo_inertia(np.array(J.toMatrix()), precision=precision)


def to_pseudo_inertia(M: SpatialInertia, *, precision: PrecisionName = None):
    """Makes a pinocchio.PseudoInertia.

    Error: as of `SpatialInertia.to_pseudo_inertia`.

    Example:
        >>> print(js.interop.pinocchio.to_pseudo_inertia(rod).toMatrix()[2:])
        [[ 0.      0.      0.6667 -1.    ]
         [ 0.      0.     -1.      2.    ]]
    """
    J = M.to_pseudo_inertia(precision=precision)
    entries = orders.single(J.reshape((*J.shape[:-2], 16)), "pinocchio.to_pseudo_inertia")
    return _library().PseudoInertia.FromMatrix(entries.reshape(4, 4))


def from_log_cholesky(theta, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads pinocchio.LogCholeskyParameters.

    Error: as of `SpatialInertia.from_log_cholesky`.

    Example:
        >>> import pinocchio
        >>> theta = pinocchio.LogCholeskyParameters(np.zeros(10))
        >>> with jax.enable_x64(True):
        ...     print(js.interop.pinocchio.from_log_cholesky(theta).mass)
        1.0
    """
    return SpatialInertia.from_log_cholesky(np.array(theta.parameters), precision=precision)


def to_log_cholesky(M: SpatialInertia, *, precision: PrecisionName = None):
    """Makes pinocchio.LogCholeskyParameters, which Pinocchio has no way to make of an inertia.

    Error: as of `SpatialInertia.to_log_cholesky`.

    Example:
        >>> theta = js.interop.pinocchio.to_log_cholesky(js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=12.0))
        >>> print(theta.toDynamicParameters()[[0, 4, 6, 9]])  # the mass, the moments
        [12. 13. 10.  5.]
    """
    theta10 = orders.single(M.to_log_cholesky(precision=precision), "pinocchio.to_log_cholesky")
    return _library().LogCholeskyParameters(theta10)

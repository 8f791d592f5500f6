"""Joint torques as a linear function of inertial parameters; also exports the regressors of a single body."""

import jax

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.composite_bodies import generalized_force, in_world_axes
from jaxspatial.dynamics.kinematics import BodyMotion, angular_acceleration_tensor, motion_step, world_motion
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.algorithm import GEOMETRY, algorithm
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.linear import Symmetric, Vector, Wrench, cross
from jaxspatial.numerics.numbers import constant
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName


@promises(bound=ALGORITHM)
def joint_torque_regressor(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, vdot: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """The matrix Y of joint torques as a linear function of inertial parameters pi.

        tau = Y pi + armature vdot        (`inverse_dynamics` without external forces)

    Of linear velocities along axes that turn vdot + w x v is the rate here, see `Joint`.
    pi = `mechanism.inertias.to_dynamic_parameters().ravel()` has ten parameters for each of the n bodies, in the order
    of `mechanism.body_names`, about the origin of the body's joint frame, in its axes.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        vdot: (*batch, nv) generalized accelerations: rad/s^2, m/s^2.
        precision: name of a precision; None takes the default.

    Returns:
        Y (*batch, nv, 10 n), zero wherever a joint does not carry a body.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Atkeson, An, Hollerbach 1986, Estimation of inertial parameters of manipulator loads and links; Khalil,
        Dombre 2002, 12.2.

    Example:
        >>> Y = js.regressors.joint_torque_regressor(arm, q, v, jnp.zeros(2))
        >>> pi = arm.inertias.to_dynamic_parameters().ravel()
        >>> print(Y.shape, Y @ pi)  # as `inverse_dynamics`
        (2, 20) [17.2569  2.7004]
    """
    return _regressor(precision, mechanism, q, v, vdot)


@algorithm(*GEOMETRY, "gravity")
def _regressor(state: MechanismState, v: Array, vdot: Array):
    links, placed = state.links(v, vdot), matrices.poses_from_root(state)
    motions = recursion.outward(state, motion_step, world_motion(state), links)
    subspaces = ((link.joint.subspace, X) for link, X in zip(links, placed, strict=True))
    rows = [(len(S), in_world_axes(X, stacking.stacked_trees(S))) for S, X in subspaces]
    columns = [
        (10, stacking.stacked_trees([in_world_axes(X, wrench) for wrench in _of_parameters(motion)]))
        for X, motion in zip(placed, motions, strict=True)
    ]
    (Y,) = matrices.matrices(state, lambda row, column: (generalized_force(row, column),), rows, columns)
    return state.in_callers_axes(state.rounded(matrices.by_velocity(state, Y, 0)))


def _of_parameters(motion: BodyMotion) -> list[Wrench]:
    """The wrench about Jo for each unit parameter: the mass, the first moments m c, and the entries of the inertia J.

    f = m a + E (m c)        tau = (m c) x a + J alpha + w x J w        E = [alpha]x + [w]x [w]x
    """
    zero, one = (constant(motion.w[0], x) for x in (0, 1))
    no_vector = Vector(zero, zero, zero)
    units = [Symmetric(*(one if i == k else zero for i in range(6))) for k in range(6)]
    E = angular_acceleration_tensor(motion.w, motion.alpha).T
    of_arms = [Wrench(cross(unit[:3], motion.a), column) for unit, column in zip(units, E, strict=False)]
    of_inertia = [Wrench(J @ motion.alpha + cross(motion.w, J @ motion.w), no_vector) for J in units]
    return [Wrench(no_vector, motion.a), *of_arms, *of_inertia]

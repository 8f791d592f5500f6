"""Joint torques as a linear function of the inertial parameters of all bodies."""

from typing import Any

import jax

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.numbers import Rows, Wrench, constant, noinline
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics import along, pairs, recursion
from jaxspatial.dynamics.algorithm import GEOMETRY, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.links import BodyMotion, angular_acceleration_tensor, motion_step, world_motion
from jaxspatial.dynamics.mass_matrix import generalized_force, in_root_axes
from jaxspatial.dynamics.state import MechanismState, Pose
from jaxspatial.mechanism import Mechanism


def joint_torque_regressor(
    mechanism: Mechanism, q: Coordinates, v: Rates, vdot: Rates, *, precision: PrecisionName = None
) -> jax.Array:
    """The matrix Y of joint torques as a linear function of inertial parameters.

    `inverse_dynamics`, without external forces, is Y pi + armature vdot: pi has ten parameters for each of the n
    bodies, in the order of `mechanism.body_names`, about the origin of its joint's frame, in its axes:
    `mechanism.inertias.to_dynamic_parameters().ravel()`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        vdot: (*batch, nv) time derivatives of the rates: rad/s^2, m/s^2.
        precision: name of a precision; None takes the default.

    Returns:
        Y (*batch, nv, 10 n), zero wherever a joint does not carry a body.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Atkeson, An, Hollerbach 1986, Estimation of inertial parameters of manipulator loads and links; Khalil,
        Dombre 2002, 12.2.
    """
    return _regressor(precision, mechanism, q, v, vdot)


@algorithm(*GEOMETRY, "gravity", entries=lambda t: 10 * t.nv * len(t))
def _regressor(state: MechanismState, v: Array, vdot: Array):
    links, placed = state.links(v, vdot), pairs.from_root(state)
    motions = recursion.outward(state, motion_step, world_motion(state), links)
    both = zip(links, placed, strict=True)
    rows = [
        (len(S), noinline(in_root_axes)(X, along.abreast(S))) for S, X in ((link.joint.subspace, X) for link, X in both)
    ]
    columns = [(10, _in_root_axes(*x)) for x in zip(placed, motions, strict=True)]
    (Y,) = pairs.matrices(state, lambda row, column: (generalized_force(row, column),), rows, columns)
    return state.in_given_axes(state.rounded(pairs.by_rates(state, Y, 0)))


def _in_root_axes(X: Pose, motion: BodyMotion) -> Any:
    """The wrenches of all parameters of a body, side by side."""
    return along.abreast([noinline(in_root_axes)(X, wrench) for wrench in noinline(_of_parameters)(motion)])


def _of_parameters(motion: BodyMotion) -> list[Wrench]:
    """The wrench of a unit of mass, of each first moment, of each entry of the inertia, about the origin of J.

    f = m a + E (m c)        tau = (m c) x a + J alpha + w x J w        E = [alpha]x + [w]x [w]x
    """
    zero, one = (constant(motion.w[0], x) for x in (0, 1))
    no_vector = (zero,) * 3
    units = [tuple(one if i == k else zero for i in range(6)) for k in range(6)]
    E = vectors.transpose(angular_acceleration_tensor(motion.w, motion.alpha))
    of_arms = [(vectors.cross(unit[:3], motion.a), column) for unit, column in zip(units, E, strict=False)]
    of_inertia = [(_torque(symmetric.rows(unit), motion), no_vector) for unit in units]
    return [(no_vector, motion.a), *of_arms, *of_inertia]


def _torque(J: Rows, motion: BodyMotion):
    spin = vectors.cross(motion.w, vectors.matrix_times(J, motion.w))
    return vectors.plus(vectors.matrix_times(J, motion.alpha), spin)

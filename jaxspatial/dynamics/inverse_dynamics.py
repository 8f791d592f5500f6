"""Inverse dynamics: the forces at the joints for given accelerations."""

import jax

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.numbers import noinline
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.algorithm import DYNAMICS, FRAMES, algorithm, checked, of_rates
from jaxspatial.dynamics.links import Motion, across, angular_acceleration_tensor, body_motion, minus_gravity, to_parent
from jaxspatial.dynamics.loads import ExternalForces, checked_forces, loads
from jaxspatial.mechanism import Mechanism
from jaxspatial.spatial import algebra


def inverse_dynamics(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    vdot: Rates,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The generalized forces for given accelerations.

        tau = M(q) vdot + C(q, v) v + g(q) - J^T F

    Armature is part of M. Damping, friction and springs are not: see `passive_forces`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, unit quaternions.
        v: (*batch, nv) rates: rad/s, m/s.
        vdot: (*batch, nv) time derivatives of the rates: rad/s^2, m/s^2.
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        precision: name of a precision; None takes the default.

    Returns:
        tau (*batch, nv), over the common batch: N m, N.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators; Featherstone 2008, table
        5.1.
    """
    q, v, vdot = checked("inverse_dynamics", mechanism, q=q, v=v, vdot=vdot)
    frames, forces = checked_forces("inverse_dynamics", mechanism, external_forces, q)
    return _inverse_dynamics(precision, mechanism, q, v, vdot, forces, frames=frames)


def bias_forces(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """C(q, v) v + g(q) - J^T F: `inverse_dynamics` for vdot = 0, without the terms in vdot.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, unit quaternions.
        v: (*batch, nv) rates: rad/s, m/s.
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv), over the common batch: N m, N.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: as of `inverse_dynamics`.
    """
    q, v = checked("bias_forces", mechanism, q=q, v=v)
    frames, forces = checked_forces("bias_forces", mechanism, external_forces, q)
    return _inverse_dynamics(precision, mechanism, q, v, None, forces, frames=frames)


def gravity_forces(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """g(q): `inverse_dynamics` at rest.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, unit quaternions.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv): N m, N.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: as of `inverse_dynamics`.
    """
    (q,) = checked("gravity_forces", mechanism, q=q)
    return _inverse_dynamics(precision, mechanism, q, None, None, (), frames=())


@algorithm(*DYNAMICS, *FRAMES, result=of_rates)
def _inverse_dynamics(state, v, vdot, forces, *, frames):
    return state.by_rate(forces_of(state, v, vdot, loads(state, frames, forces), minus_gravity(state)))


def forces_of(state, v, vdot, body_loads, gravity):
    """The generalized forces of every bundle, under loads; gravity: the upward acceleration of the world."""
    own = list(zip(state.links(v, vdot), body_loads, strict=True))
    world = Motion(state.no_vector, state.no_vector, gravity)
    wrenches = recursion.outward(state, _net_wrench, world, own)
    nothing = state.no_vector, state.no_vector
    return recursion.inward(state, _joint_forces, nothing, list(zip(state.links(v, vdot), wrenches, strict=True)))


def _net_wrench(own, parent):
    """(the wrench that accelerates a body, less its load; its motion)."""
    link, load = own
    motion = body_motion(link, parent)
    return tuple(vectors.minus(x, y) for x, y in zip(wrench_of(link.inertia, motion), load[:2], strict=True)), motion


def _joint_forces(own, children):
    """(tau, the wrench transformed to the parent) of a body, from its own net wrench and the sum of its children's."""
    link, wrench = own
    tau, f = (vectors.plus(x, y) for x, y in zip(wrench, children, strict=True))
    at_joint = [algebra.power((tau, f), S) for S in link.joint.subspace]
    at_rotor = vectors.products(link.armature, link.vdot)
    return vectors.plus(tuple(at_joint), at_rotor), to_parent(across(link.placement, link.joint), tau, f)


def wrench_of(inertia, motion):
    """The Newton-Euler equations: the net wrench about the origin of a body with this motion.

    f = m (a + E c)    tau = I alpha + w x I w + c x f
    """
    f = noinline(_force)(inertia, motion.a, angular_acceleration_tensor(motion.w, motion.alpha))
    h = noinline(vectors.matrix_times)(symmetric.rows(inertia.central), motion.w)
    return algebra.newton_euler_torque(inertia.com, inertia.central, motion.alpha, motion.w, h, f), f


def _force(inertia, a, E):
    return vectors.times(inertia.mass, vectors.plus(a, vectors.matrix_times(E, inertia.com)))

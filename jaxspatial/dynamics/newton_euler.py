"""The recursive Newton-Euler algorithm: motions outward, the wrenches that cause them inward.

[Luh, Walker, Paul 1980; Featherstone 2008, table 5.1]
"""

from jaxspatial.dynamics.external_forces import Load
from jaxspatial.dynamics.kinematics import BodyMotion, angular_acceleration_tensor, body_motion
from jaxspatial.engine import recursion
from jaxspatial.engine.recursion import R, Step
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.numerics.linear import Inertia, Vector, Wrench
from jaxspatial.numerics.numbers import Numbers
from jaxspatial.spatial import algebra


def forces_of(
    state: MechanismState, v: Array | None, vdot: Array | None, body_loads: list[Load], gravity: Vector
) -> list[Numbers]:
    """The generalized forces of every bundle under external loads. gravity: the upward acceleration of the world."""
    return _inward(state, v, vdot, body_loads, gravity, _joint_forces)


def wrenches_through_joints(
    state: MechanismState, v: Array | None, vdot: Array | None, body_loads: list[Load], gravity: Vector
) -> list[Wrench]:
    """The wrench on the body of every bundle through its joint, about Jo in the axes of J; arguments of `forces_of`."""
    return _inward(state, v, vdot, body_loads, gravity, _wrench_through_joint)


def _inward(
    state: MechanismState,
    v: Array | None,
    vdot: Array | None,
    body_loads: list[Load],
    gravity: Vector,
    step: Step[tuple[Link, Wrench], Wrench, R],
) -> list[R]:
    """Net wrenches outward, then the inward step from (a body, its net wrench) and the sum of its children's."""
    links = state.links(v, vdot)
    world = BodyMotion(state.zero_vector, state.zero_vector, gravity)
    wrenches = recursion.outward(state, _net_wrench, world, list(zip(links, body_loads, strict=True)))
    nothing = Wrench(state.zero_vector, state.zero_vector)
    return recursion.inward(state, step, nothing, list(zip(links, wrenches, strict=True)))


def _net_wrench(body: tuple[Link, Load], parent: BodyMotion) -> tuple[Wrench, BodyMotion]:
    """(the net wrench on a body less its load, the motion of the body)."""
    link, (tau, f, _) = body
    motion = body_motion(link, parent)
    return wrench_of(link.inertia, motion) - Wrench(tau, f), motion


def _joint_forces(body: tuple[Link, Wrench], of_children: Wrench) -> tuple[Numbers, Wrench]:
    """(tau, the wrench across the joint, about the parent's origin), from the net wrench and the sum of children's."""
    link, _ = body
    wrench, about_parent = _wrench_through_joint(body, of_children)
    at_joint = [algebra.power(wrench, s) for s in link.joint.subspace]
    return tuple(x + y for x, y in zip(at_joint, link.rotor_forces, strict=True)), about_parent


def _wrench_through_joint(body: tuple[Link, Wrench], of_children: Wrench) -> tuple[Wrench, Wrench]:
    """(the wrench across the joint about the body's origin, the same about the parent's origin)."""
    link, wrench = body
    wrench = wrench + of_children
    return wrench, algebra.acted_wrench(link.X_PB, wrench)


def wrench_of(inertia: Inertia, motion: BodyMotion) -> Wrench:
    """The net wrench about the origin of a body with this motion, by the Newton-Euler equations.

    f = m (a + E c)    tau = I alpha + w x I w + c x f        E = [alpha]x + [w]x [w]x
    """
    E = angular_acceleration_tensor(motion.w, motion.alpha)
    f = inertia.mass * (motion.a + E @ inertia.com)
    h = inertia.central @ motion.w
    return Wrench(algebra.euler_torque(inertia, motion.alpha, motion.w, h, f), f)

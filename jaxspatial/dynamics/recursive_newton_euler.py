"""Newton and Euler's recursion: out for motions, in for the wrenches that make bodies move so.

[Luh, Walker, Paul 1980; Featherstone 2008, table 5.1]
"""

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.numbers import Numbers, Rows, Three, Wrench, noinline
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.along import Maybe
from jaxspatial.dynamics.links import BodyMotion, across, angular_acceleration_tensor, body_motion, to_parent
from jaxspatial.dynamics.state import Inertia, Link, Load, MechanismState
from jaxspatial.spatial import algebra


def forces_of(state: MechanismState, v: Maybe, vdot: Maybe, body_loads: list[Load], gravity: Three) -> list[Numbers]:
    """The generalized forces of every bundle, under loads; gravity: the upward acceleration of the world."""
    own = list(zip(state.links(v, vdot), body_loads, strict=True))
    world = BodyMotion(state.no_vector, state.no_vector, gravity)
    wrenches = recursion.outward(state, _net_wrench, world, own)
    nothing = state.no_vector, state.no_vector
    return recursion.inward(state, _joint_forces, nothing, list(zip(state.links(v, vdot), wrenches, strict=True)))


def _net_wrench(own: tuple[Link, Load], parent: BodyMotion):
    """(the wrench that accelerates a body, less its load; its motion)."""
    link, load = own
    motion = body_motion(link, parent)
    return tuple(vectors.minus(x, y) for x, y in zip(wrench_of(link.inertia, motion), load[:2], strict=True)), motion


def _joint_forces(own: tuple[Link, Wrench], children: Wrench):
    """(tau, the wrench transformed to the parent) of a body, from its own net wrench and the sum of its children's."""
    link, wrench = own
    tau, f = (vectors.plus(x, y) for x, y in zip(wrench, children, strict=True))
    at_joint = [algebra.power((tau, f), S) for S in link.joint.subspace]
    at_rotor = vectors.componentwise_product(link.armature, link.vdot)
    return vectors.plus(tuple(at_joint), at_rotor), to_parent(across(link.placement, link.joint), tau, f)


def wrench_of(inertia: Inertia, motion: BodyMotion) -> Wrench:
    """The Newton-Euler equations: the net wrench about the origin of a body with this motion.

    f = m (a + E c)    tau = I alpha + w x I w + c x f
    """
    f = noinline(_force)(inertia, motion.a, angular_acceleration_tensor(motion.w, motion.alpha))
    h = noinline(vectors.matrix_times)(symmetric.rows(inertia.central), motion.w)
    return algebra.newton_euler_torque(inertia.com, inertia.central, motion.alpha, motion.w, h, f), f


def _force(inertia: Inertia, a: Three, E: Rows):
    return vectors.times(inertia.mass, vectors.plus(a, vectors.matrix_times(E, inertia.com)))

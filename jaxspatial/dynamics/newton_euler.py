"""The recursive Newton-Euler algorithm: motions outward, the wrenches that cause them inward.

[Luh, Walker, Paul 1980; Featherstone 2008, table 5.1]
"""

import operator
from collections.abc import Callable
from typing import Any

import jax

from jaxspatial.dynamics.kinematics import BodyMotion, body_motion, poses, tensor
from jaxspatial.engine import recursion, stacking
from jaxspatial.engine.algorithm import Wrenches, WrenchesOnFrames
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.numerics.linear import Inertia, Matrix, Pose, Symmetric, Vector, Wrench, cross
from jaxspatial.numerics.numbers import Numbers, is_number, noinline
from jaxspatial.numerics.sums.pairwise import of_neighbours
from jaxspatial.spatial import algebra

# The external wrench (tau, f) on a body about J, and further numbers that add up with it, see `loads`.
Load = tuple[Vector, Vector, Any]
OfLoad = Callable[[Vector, Vector, Vector, bool], Any]


def forces_of(
    state: MechanismState, v: Array | None, vdot: Array | None, body_loads: list[Load], gravity: Vector
) -> list[Numbers]:
    """The generalized forces of every bundle under external loads. gravity: the upward acceleration of the world."""
    links = list(zip(state.links(v, vdot), body_loads, strict=True))
    world = BodyMotion(state.zero_vector, state.zero_vector, gravity)
    wrenches = recursion.outward(state, _net_wrench, world, links)
    nothing = Wrench(state.zero_vector, state.zero_vector)
    return recursion.inward(state, _joint_forces, nothing, list(zip(state.links(v, vdot), wrenches, strict=True)))


def _net_wrench(body: tuple[Link, Load], parent: BodyMotion) -> tuple[Wrench, BodyMotion]:
    """(the net wrench on a body less its load, the motion of the body)."""
    link, (tau, f, _) = body
    motion = body_motion(link, parent)
    return wrench_of(link.inertia, motion) - Wrench(tau, f), motion


def _joint_forces(body: tuple[Link, Wrench], of_children: Wrench) -> tuple[Numbers, Wrench]:
    """(tau, the wrench across the joint, about the parent's origin), from the net wrench and the sum of children's."""
    link, wrench = body
    wrench = wrench + of_children
    at_joint = [algebra.power(wrench, s) for s in link.joint.subspace]
    of_rotors = [i * x for i, x in zip(link.armature, link.vdot, strict=True)]
    tau = tuple(x + y for x, y in zip(at_joint, of_rotors, strict=True))
    return tau, algebra.acted_wrench(link.X_PB, wrench)


def wrench_of(inertia: Inertia, motion: BodyMotion) -> Wrench:
    """The net wrench about the origin of a body with this motion, by the Newton-Euler equations.

    f = m (a + E c)    tau = I alpha + w x I w + c x f        E = [alpha]x + [w]x [w]x
    """
    f = _force(inertia, motion.a, tensor(motion.w, motion.alpha))
    h = _times(inertia.central, motion.w)
    return Wrench(algebra.euler_torque(inertia, motion.alpha, motion.w, h, f), f)


# Several components of a result need these: calls of their own are computed once, where fused code repeats them.
@noinline
def _force(inertia: Inertia, a: Vector, E: Matrix) -> Vector:
    return inertia.mass * (a + E @ inertia.com)


_times = noinline(Symmetric.__matmul__)


# -- external forces --------------------------------------------------------------------------------------------------


def loads(state: MechanismState, forces: Wrenches, of_load: OfLoad | None = None) -> list[Load]:
    """The external Load of every bundle, about J in its axes; known zeros for bodies without one.

    of_load: a function of (tau, f, the position of the point, whether the wrench keeps its direction in the world) that
        returns the further numbers of a Load.
    """
    of_load = of_load or (lambda tau, f, p_JQ, in_world: ())
    nothing = (state.zero_vector, state.zero_vector, of_load(*(state.zero_vector,) * 3, True))
    on_bodies: dict[int, list[Load]] = {}
    placed = poses(state) if any(group.in_world for group in forces) else []
    for group in forces:
        bodies, X_JQ, F = wrenches_on_bodies(state, group, placed)
        load = F.tau, F.f, of_load(F.tau, F.f, X_JQ.p, group.in_world)
        for i, body in enumerate(bodies):
            on_bodies.setdefault(body, []).append(_row(load, i) if len(bodies) > 1 else load)
    summed = {body: of_neighbours(_added, items) for body, items in on_bodies.items()}
    return [_of_bundle(state, bundle, summed, nothing) for bundle in state.bundles]


def wrenches_on_bodies(
    state: MechanismState, group: WrenchesOnFrames, placed: list[Pose]
) -> tuple[list[int], Pose, Wrench]:
    """(the bodies, X_JQ of the frames at their points, the wrenches about Jo in the axes of J), as numbers (n, B).

    placed: X_WJ of every bundle, for wrenches in world axes.
    """
    bodies = [state.topology.frames[frame][1] for frame in group.frames]
    X_JQ = state.frame_placements(group.frames)
    if group.points is not None:
        X_JQ = _moved(X_JQ, _parts(state, group.points))
    F = Wrench(_parts(state, group.tau), _parts(state, group.f))
    if not group.in_world:
        return bodies, X_JQ, _acted(X_JQ, F)
    carriers = [state.of_body(body, placed, state.world) for body in bodies]
    X_WJ = carriers[0] if len(carriers) == 1 else stacking.concatenated_trees(carriers, state.n)
    return bodies, X_JQ, _about_joint(X_WJ, X_JQ, F)


def _parts(state: MechanismState, parts: Array | None) -> Vector:
    """The numbers (n, B) of n vectors."""
    if parts is None:
        return state.zero_vector
    return Vector(*state.numbers(parts.reshape((-1, 3, *parts.shape[1:]))))


@noinline
def _moved(X_JF: Pose, p_FQ: Vector) -> Pose:
    """X_JQ of a frame with the axes of F at Q."""
    return Pose(X_JF.R, X_JF.p + X_JF.R @ p_FQ)


@noinline
def _about_joint(X_WJ: Pose, X_JQ: Pose, F: Wrench) -> Wrench:
    """A wrench about Q in world axes, as one about Jo in the axes of J."""
    f = X_WJ.R.T @ F.f
    return Wrench(X_WJ.R.T @ F.tau + cross(X_JQ.p, f), f)


_acted = noinline(algebra.acted_wrench)


def _row(load: Load, i: int) -> Load:
    """Row i of numbers (n, B); a number that is the same for all has one row."""
    return stacking.mapped(lambda word: word[min(i, word.shape[0] - 1)][None], load)


def _added(a: Load, b: Load) -> Load:
    return jax.tree.map(operator.add, a, b, is_leaf=is_number)


def _of_bundle(state: MechanismState, bundle: Bundle, on_bodies: dict[int, Load], nothing: Load) -> Load:
    bodies = bundle.bodies.ravel().tolist()
    if not any(i in on_bodies for i in bodies):
        return nothing
    rows = stacking.concatenated_trees([on_bodies.get(i, nothing) for i in bodies], state.n)
    return stacking.mapped(lambda word: word.reshape((bundle.length, bundle.width, -1)), rows)

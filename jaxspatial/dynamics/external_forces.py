"""External forces: from the points and axes in which they are given to the bodies that they act on."""

import functools
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import jax

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.kinematics import poses
from jaxspatial.engine import stacking
from jaxspatial.engine.algorithm import FRAMES, GEOMETRY, ExternalForces, Wrenches, WrenchesOnFrames, algorithm, checked
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.numerics.linear import Pose, Vector, Wrench, cross
from jaxspatial.numerics.numbers import is_number
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.sums.pairwise import of_neighbours
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce, algebra

T = TypeVar("T")
# The external wrench (tau, f) on a body about J, and further numbers that add up with it, see `loads`.
Load = tuple[Vector, Vector, Any]
OfLoad = Callable[[Vector, Vector, Vector, bool], Any]


@promises(bound=ALGORITHM)
def applied_wrenches(
    mechanism: Mechanism, q: ArrayLike, external_forces: ExternalForces, *, precision: PrecisionName = None
) -> dict[str, SpatialForce]:
    """The external wrench on each body, about its origin: F_Bo_W.

    All functions that take external forces take this dict in place of them. It is what simulators ask for, see
    `interop.mujoco.to_xfrc_applied`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        precision: name of a precision; None takes the default.

    Returns:
        By name of a body on which forces act, in the order of `mechanism.body_names`: the sum of all of them, a
        SpatialForce (*batch,) about the body's origin, in world axes. Forces on frames of the world are under "world".

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.5 (wrenches).

    Example:
        >>> push = js.AppliedForces(["hand"] * 2, js.SpatialForce(f=jnp.array([[5.0, 0.0, 0.0], [1.0, 0.0, 0.0]])))
        >>> js.applied_wrenches(arm, jnp.zeros(2), push)["lower"]
        SpatialForce(tau=[0.0, -6.0, -0.0], f=[6.0, 0.0, 0.0])
    """
    q, forces = checked("applied_wrenches", mechanism, q=q, external_forces=external_forces)
    sums = _applied_wrenches(precision, mechanism, q, forces)
    carriers = {body for group in forces for body in mechanism.topology.bodies_of(group.frames)}
    names = [WORLD if body < 0 else mechanism.body_names[body] for body in sorted(carriers)]
    return {name: SpatialForce(*F) for name, F in zip(names, sums, strict=True)}


@algorithm(*GEOMETRY, *FRAMES)
def _applied_wrenches(state: MechanismState, external_forces: Wrenches) -> list[Wrench]:
    """The sum on each body that carries forces, in the order of bodies."""
    placed = poses(state)
    on_bodies: list[tuple[list[int], Wrench]] = []
    for group in external_forces:
        bodies, F = state.topology.bodies_of(group.frames), _wrenches_of(state, group)
        X_WJ, X_JQ = state.of_bodies(bodies, placed, state.world), _placed(state, group)
        X_JB = state.of_bodies(bodies, list(map(state.child_placement, state.bundles)), state.world)
        R_WJ, p_BQ_J = X_WJ.R, X_JQ.p - X_JB.p
        if not group.in_world:
            F = Wrench(R_WJ @ (X_JQ.R @ F.tau), R_WJ @ (X_JQ.R @ F.f))
        on_bodies.append((bodies, Wrench(F.tau + cross(R_WJ @ p_BQ_J, F.f), F.f)))
    sums = _sums(on_bodies)
    return [sums[body] for body in sorted(sums)]


# -- about joints -----------------------------------------------------------------------------------------------------


def loads(state: MechanismState, forces: Wrenches, of_load: OfLoad | None = None) -> list[Load]:
    """The external Load of every bundle, about J in its axes; known zeros for bodies without one.

    of_load: a function of (tau, f, the position of the point, whether the wrench keeps its direction in the world) that
        returns the further numbers of a Load.
    """
    of_load = of_load or (lambda tau, f, p_JQ, in_world: ())
    zero = state.zero_vector
    nothing = zero, zero, of_load(zero, zero, zero, True)
    on_bodies: list[tuple[list[int], Load]] = []
    placed = poses(state) if any(group.in_world for group in forces) else []
    for group in forces:
        bodies, (X_JQ, F) = state.topology.bodies_of(group.frames), _about_joints(state, group, placed)
        on_bodies.append((bodies, (F.tau, F.f, of_load(F.tau, F.f, X_JQ.p, group.in_world))))
    sums = _sums(on_bodies)
    return [_of_bundle(state, bundle, sums, nothing) for bundle in state.bundles]


def _about_joints(state: MechanismState, group: WrenchesOnFrames, placed: list[Pose]) -> tuple[Pose, Wrench]:
    """(X_JQ of the points, the wrenches about Jo in the axes of J), for each frame of a group."""
    X_JQ, F = _placed(state, group), _wrenches_of(state, group)
    if not group.in_world:
        return X_JQ, algebra.acted_wrench(X_JQ, F)
    R_WJ = state.of_bodies(state.topology.bodies_of(group.frames), placed, state.world).R
    f = R_WJ.T @ F.f
    return X_JQ, Wrench(R_WJ.T @ F.tau + cross(X_JQ.p, f), f)


def loads_on_frames(state: MechanismState, forces: Wrenches, placed: list[Pose]) -> list[tuple[int, Wrench]]:
    """[(frame, its external wrench about Jo of the body that carries it, in the axes of J)], one for each wrench."""
    found = list[tuple[int, Wrench]]()
    for group in forces:
        _, F = _about_joints(state, group, placed)
        found += [(frame, _row(F, i) if len(group.frames) > 1 else F) for i, frame in enumerate(group.frames)]
    return found


def _placed(state: MechanismState, group: WrenchesOnFrames) -> Pose:
    """X_JQ of the frames, moved to their points."""
    X_JF = state.frame_placements(group.frames)
    return X_JF if group.points is None else Pose(X_JF.R, X_JF.p + X_JF.R @ state.vectors(group.points))


def _wrenches_of(state: MechanismState, group: WrenchesOnFrames) -> Wrench:
    return Wrench(state.vectors(group.tau), state.vectors(group.f))


def _sums(on_bodies: list[tuple[list[int], T]]) -> dict[int, T]:
    """The sum on each body of trees of numbers (n, B), a row for each of n bodies, which may come several times."""
    by_body: dict[int, list[T]] = {}
    for bodies, tree in on_bodies:
        for i, body in enumerate(bodies):
            by_body.setdefault(body, []).append(_row(tree, i) if len(bodies) > 1 else tree)
    added = functools.partial(jax.tree.map, operator.add, is_leaf=is_number)
    return {body: of_neighbours(added, trees) for body, trees in by_body.items()}


def _row(tree: T, i: int) -> T:
    """Row i of numbers (n, B); a number that is the same for all has one row."""
    return stacking.mapped(lambda word: word[min(i, word.shape[0] - 1)][None], tree)


def _of_bundle(state: MechanismState, bundle: Bundle, on_bodies: dict[int, Load], nothing: Load) -> Load:
    bodies = bundle.bodies.ravel().tolist()
    if not any(i in on_bodies for i in bodies):
        return nothing
    rows = stacking.concatenated_trees([on_bodies.get(i, nothing) for i in bodies], state.n)
    return stacking.mapped(lambda word: word.reshape((bundle.length, bundle.width, -1)), rows)

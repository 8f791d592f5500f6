"""External forces on frames, transformed to the bodies that carry these."""

import operator
from collections.abc import Callable
from typing import Any

import jax

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Three, Wrench, is_number, noinline
from jaxspatial.dynamics import along
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.arguments import Wrenches
from jaxspatial.dynamics.kinematics import poses, world
from jaxspatial.dynamics.state import Load, MechanismState, Pose
from jaxspatial.mechanism.topology import Bundle

OfLoad = Callable[[Three, Three, Three], Any]


def loads(state: MechanismState, forces: Wrenches, of_load: OfLoad | None = None) -> list[Load]:
    """(tau, f) of every bundle, about J in its axes: known zeros where there are none.

    of_load: of (tau, f) and the place of the frame, further numbers that add up, a tuple.
    """
    of_load = of_load or (lambda tau, f, p_JF: ())
    nothing = (state.no_vector, state.no_vector, of_load(*(state.no_vector,) * 3))
    on_bodies: dict[int, Load] = {}
    placed = poses(state) if forces else []
    for frame, F in forces.items():
        body = state.topology.frames[frame][1]
        load = _of_frame(state, placed, frame, body, F, of_load)
        on_bodies[body] = (
            jax.tree.map(operator.add, on_bodies[body], load, is_leaf=is_number) if body in on_bodies else load
        )
    return [_of_bundle(state, bundle, on_bodies, nothing) for bundle in state.bundles]


def _of_frame(
    state: MechanismState,
    placed: list[Pose],
    frame: int,
    body: int,
    F: tuple[Array | None, Array | None],
    of_load: OfLoad,
) -> Load:
    X_WJ, X_JF = state.of_body(body, placed, world(state)), state.frame_placement(frame)
    tau, f = noinline(_about_joint)(X_WJ, X_JF, *(_part(state, part) for part in F))
    return tau, f, of_load(tau, f, X_JF.p)


def _part(state: MechanismState, part: Array | None) -> Any:
    if part is None:
        return state.no_vector
    return tuple(along.mapped(lambda w: w[None], x) for x in state.numbers(part))


def _about_joint(X_WJ: Pose, X_JF: Pose, tau: Three, f: Three) -> Wrench:
    """Of a wrench about Fo in world axes: about Jo in those of J."""
    R_JW = vectors.transpose(X_WJ.rows)
    f = vectors.matrix_times(R_JW, f)
    return vectors.plus(vectors.matrix_times(R_JW, tau), vectors.cross(X_JF.p, f)), f


def _of_bundle(state: MechanismState, bundle: Bundle, on_bodies: dict[int, Load], nothing: Load) -> Load:
    bodies = bundle.bodies.ravel().tolist()
    if not any(i in on_bodies for i in bodies):
        return nothing
    rows = along.concatenated_trees([on_bodies.get(i, nothing) for i in bodies], state.n)
    return along.mapped_tree(lambda word: word.reshape((bundle.length, bundle.width, -1)), rows)

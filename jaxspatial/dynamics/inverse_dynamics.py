"""Inverse dynamics: the generalized forces for given accelerations."""

from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.derivatives import jacobians
from jaxspatial.dynamics.external_forces import loads, loads_on_frames
from jaxspatial.dynamics.kinematics import forward_kinematics, motion_step, poses, world_motion
from jaxspatial.dynamics.newton_euler import forces_of, wrench_of, wrenches_through_joints
from jaxspatial.engine import recursion
from jaxspatial.engine.algorithm import (
    BODIES,
    DYNAMICS,
    FRAMES,
    NO_ARRAY,
    Algorithm,
    ExternalForces,
    Wrenches,
    algorithm,
    checked_mechanism,
    velocity_shape,
)
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import AppliedForces, LoopClosure, Mechanism
from jaxspatial.mechanism.loops import checked_loops
from jaxspatial.numerics import check
from jaxspatial.numerics.linear import Wrench
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce, algebra


@promises(bound=ALGORITHM)
def inverse_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    vdot: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The generalized forces for given accelerations.

        tau = M(q) vdot + C(q, v) v + g(q) - J^T F

    Armature is part of M, and of C where axes turn, see `Joint`. Damping, friction and springs are not included: see
    `passive_forces`. Whole Jacobians (`jax.jacfwd`, `jax.jacrev`: at least nv tangents or cotangents at one state) are
    computed in closed form, as by `inverse_dynamics_derivatives`: with its error, and not bitwise as single derivatives
    are.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        vdot: (*batch, nv) generalized accelerations: rad/s^2, m/s^2.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        precision: name of a precision; None takes the default.

    Returns:
        tau (*batch, nv), over the common batch: N m, N.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators; Featherstone 2008, table
        5.1.

    Example:
        >>> print(js.inverse_dynamics(arm, q, v, vdot=jnp.array([1.0, 0.0])))
        [22.5504  4.3471]
    """
    return inverse_dynamics_of(precision, mechanism, q, v, vdot, external_forces, operation="inverse_dynamics")


@promises(bound=ALGORITHM)
def bias_forces(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The bias forces C(q, v) v + g(q) - J^T F: `inverse_dynamics` without the terms in vdot.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv), over the common batch: N m, N.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: as of `inverse_dynamics`.

    Example:
        >>> print(js.bias_forces(arm, q, v) - js.gravity_forces(arm, q))  # centrifugal and Coriolis forces
        [ 0.2483 -0.1987]
    """
    return inverse_dynamics_of(precision, mechanism, q, v, NO_ARRAY, external_forces, operation="bias_forces")


@promises(bound=ALGORITHM)
def gravity_forces(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The generalized forces g(q) that hold a mechanism at rest against gravity.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv): N m, N.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: as of `inverse_dynamics`.

    Example:
        >>> print(js.gravity_forces(arm, q))
        [17.0086  2.8991]
    """
    return inverse_dynamics_of(precision, mechanism, q, NO_ARRAY, NO_ARRAY, None, operation="gravity_forces")


@promises(bound=ALGORITHM)
def joint_reactions(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    vdot: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    joints: str | Sequence[str] | None = None,
    loops: Iterable[LoopClosure] = (),
    loop_wrenches: SpatialForce | None = None,
    precision: PrecisionName = None,
) -> SpatialForce:
    """The wrench through every joint: what its parent exerts on each body.

        F_i = (net wrench of body i) - (external forces on body i) + sum of F over its children

    It holds the body against gravity, external forces, its own motion and all that hangs on it. Its part along the
    joint is the force of the joint: S . F + armature vdot = `inverse_dynamics`, in "reproducible" bit by bit where the
    joint is at the origin of its body; where axes turn the rate is that of `Joint`. The bearing takes the rest.

    Fixed joints have reactions, too, which are computed where `joints` names them: js.joint_reactions(mech, q, v, vdot,
    joints="wrist"), also those to the world, and of mechanisms that have no others. All that is welded behind the joint
    has the inertia `mechanism.weld_inertias`.

    Closed loops push and pull on the tree, with wrenches that q, v and vdot do not tell. Give those of
    `constrained_forward_dynamics`, or of `convex_step`, with its vdot:

        vdot, wrenches = js.constrained_forward_dynamics(mech, q, v, tau, mech.loops)
        js.joint_reactions(mech, q, v, vdot, loops=mech.loops, loop_wrenches=wrenches)

    Where closures are redundant these wrenches are one choice of many, and so are the reactions.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        vdot: (*batch, nv) generalized accelerations: rad/s^2, m/s^2.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        joints: the name of a joint, or several, in the order of the results: of `mechanism.joint_names`, or of fixed
            ones, `mechanism.weld_names`. The name of a body stands for the joint that holds it. None takes
            `mechanism.joint_names`.
        loops: LoopClosures whose wrenches act beside the joints; none at all leave the tree.
        loop_wrenches: SpatialForce (*batch, number of closures), of each closure on the body of its frame B, about the
            origin of B, in world axes: N m, N.
        precision: name of a precision; None takes the default.

    Returns:
        F_Bo_B (*batch, n), in the order of `mechanism.body_names`, or of `joints`; (*batch,) of the one joint that is
        named: the wrench on each body by its parent, about the origin of the body, in its axes; N m, N. Others have the
        same wrench on the child about other points: Drake's `reaction_forces` about the origin of the joint's frame on
        the child, in the axes of that frame; Pinocchio's `data.f` about the joint, in its axes; MuJoCo's `cfrc_int`
        about `subtree_com` of the root, in world axes.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, loops are no
            LoopClosures, or forces are neither a dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators; Featherstone 2008, table
        5.1.

    Example:
        >>> through = js.joint_reactions(arm, jnp.zeros(2), 0 * v, 0 * v)
        >>> print(through.f)  # the shoulder carries both rods, the elbow one
        [[ 0.    0.   39.24]
         [-0.    0.   19.62]]
    """
    mechanism = checked_mechanism("joint_reactions", mechanism)
    forces = _with_loops(precision, mechanism, q, external_forces, loops, loop_wrenches)
    if joints is None:
        return SpatialForce(*_joint_reactions(precision, mechanism, q, v, vdot, forces))
    wanted = [_place(mechanism, name) for name in ([joints] if isinstance(joints, str) else joints)]
    if not wanted:
        raise ValueError("joint_reactions: joints: expected at least one name, got none")
    found = dict[tuple[bool, int], tuple[jax.Array, jax.Array]]()
    for of_welds in sorted({is_weld for is_weld, _ in wanted}):
        places = sorted({k for is_weld, k in wanted if is_weld == of_welds})
        if of_welds:
            t = mechanism.topology
            behind = tuple((k, t.welds[k][1], *t.behind(k)) for k in places)
            tau, f = _weld_reactions(
                precision, mechanism, q, v, vdot, forces, welds=behind, operation="joint_reactions"
            )
        else:
            tau, f = (x[..., np.array(places), :] for x in _joint_reactions(precision, mechanism, q, v, vdot, forces))
        found |= {(of_welds, k): (tau[..., i, :], f[..., i, :]) for i, k in enumerate(places)}
    of_each = [found[place] for place in wanted]
    if isinstance(joints, str):
        return SpatialForce(*of_each[0])
    return SpatialForce(*(jnp.stack(parts, -2) for parts in zip(*of_each, strict=True)))


def _place(mechanism: Mechanism, name: str) -> tuple[bool, int]:
    """(whether a joint is a fixed one, its number), by its name or that of the body that it holds."""
    t, welds = mechanism.topology, mechanism.weld_names
    if name in mechanism.joint_names:
        return False, mechanism.joint_names.index(name)
    if name in welds:
        return True, welds.index(name)
    welded = [t.frames[frame][0] for _, frame in t.welds]
    places = {x: (False, i) for i, x in enumerate(mechanism.body_names)} | {x: (True, k) for k, x in enumerate(welded)}
    if name not in places:  # This raises, and lists the names there are.
        t.index((*mechanism.joint_names, *welds, *places), name, "joint_reactions: joints")
    return places[name]


def _with_loops(
    precision: PrecisionName,
    mechanism: Mechanism,
    q: ArrayLike,
    forces: ExternalForces,
    loops: Iterable[LoopClosure],
    wrenches: SpatialForce | None,
) -> ExternalForces:
    """The external forces, and the wrenches of closures on both of their frames."""
    closures = checked_loops(loops, mechanism.topology, "joint_reactions: loops")
    if wrenches is None or not closures:
        if closures or wrenches is not None:
            expected = "loops and their wrenches, of `constrained_forward_dynamics` or `convex_step`"
            raise ValueError(f"joint_reactions: expected {expected}, got {'no wrenches' if closures else 'no loops'}")
        return forces
    if not isinstance(wrenches, SpatialForce):
        check.refuse("joint_reactions: loop_wrenches", "a SpatialForce", wrenches)
    if wrenches.batch_shape[-1:] != (len(closures),):
        expected = f"shape (*batch, {len(closures)})"
        raise ValueError(f"joint_reactions: loop_wrenches: expected {expected}, got {wrenches.batch_shape}")
    of_A, of_B = ([getattr(loop, name) for loop in closures] for name in ("frame_a", "frame_b"))
    X_WA, X_WB = (forward_kinematics(mechanism, q, frames, precision=precision) for frames in (of_A, of_B))
    # On A the opposite acts at the origin of B.
    on_A = AppliedForces(of_A, -wrenches, X_WA.inverse() @ X_WB.translation)
    sources: Any = forces if isinstance(forces, list | tuple) else [forces]
    return [*sources, AppliedForces(of_B, wrenches), on_A]


class InverseDynamics(Algorithm):
    """The program of `inverse_dynamics_of`; nv or more (co)tangents at one state use closed-form Jacobians."""

    def jacobians(self, moving: tuple[bool, ...], n_columns: int):
        # Whether q, v and vdot are among the arguments that move.
        leaves = jax.tree.unflatten(self.tree, range(self.tree.num_leaves))[1][:3]
        wanted = tuple(i is not None and self.known[i] is None and moving[self.place(i)] for i in leaves)
        # The closed form knows no derivatives of S by coordinates.
        if n_columns < self.topology.nv or sum(wanted) < sum(moving) or self.topology.has_subspaces_of_q:
            return None
        return self.program_of(jacobians, wanted=wanted)


@algorithm(*DYNAMICS, *FRAMES, program_class=InverseDynamics, result_shape=velocity_shape)
def inverse_dynamics_of(state: MechanismState, v: Array | None, vdot: Array | None, external_forces: Wrenches):
    return state.by_velocity(forces_of(state, v, vdot, loads(state, external_forces), state.minus_gravity))


@algorithm(*BODIES, "gravity", *FRAMES)
def _joint_reactions(state: MechanismState, v: Array, vdot: Array, external_forces: Wrenches):
    body_loads = loads(state, external_forces)
    through = wrenches_through_joints(state, v, vdot, body_loads, state.minus_gravity)
    placed = zip(map(state.child_placement, state.bundles), through, strict=True)
    about_bodies = [algebra.inverse_acted_wrench(X_JB, F) for X_JB, F in placed]
    return tuple(state.by_body([F[k] for F in about_bodies], 3) for k in (0, 1))


# (the number of a fixed joint, the frame that it holds, the frames behind it, the joints that hang on these)
Weld = tuple[int, int, tuple[int, ...], tuple[int, ...]]


@algorithm(*BODIES, "gravity", "weld_inertias", *FRAMES)
def _weld_reactions(
    state: MechanismState, v: Array, vdot: Array, external_forces: Wrenches, *, welds: tuple[Weld, ...]
) -> tuple[jax.Array, jax.Array]:
    """(tau, f) (n, 3, B) through fixed joints: what is welded behind one, and the joints that hang on it."""
    placed = poses(state) if any(group.in_world for group in external_forces) else []
    links, at_frames = state.links(v, vdot), loads_on_frames(state, external_forces, placed)
    motions = recursion.outward(state, motion_step, world_motion(state), links)
    through = wrenches_through_joints(state, v, vdot, loads(state, external_forces), state.minus_gravity)
    about_parents = [algebra.acted_wrench(link.X_PB, F) for link, F in zip(links, through, strict=True)]
    found = list[Wrench]()
    for k, frame, frames, joints in welds:
        X_JC = state.frame_placements((frame,))
        motion = state.of_bodies(state.topology.bodies_of([frame]), motions, world_motion(state))
        # Of what is welded behind the joint, in the axes of the frame that it holds.
        welded = state.inertia_at("weld_inertias", np.array([k]))
        F = wrench_of(algebra.acted_inertia(X_JC, welded), motion)
        for i in joints:
            F = F + state.of_bodies([i], about_parents, F)
        for _, load in (x for x in at_frames if x[0] in frames):
            F = F - load
        found.append(algebra.inverse_acted_wrench(X_JC, F))
    tau, f = (jnp.concatenate([state.by_row(F[part], 1) for F in found]) for part in (0, 1))
    return tau, f

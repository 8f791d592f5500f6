"""Inverse dynamics: the generalized forces for given accelerations."""

from typing import Any

import jax

from jaxspatial.dynamics.derivatives import jacobians
from jaxspatial.dynamics.docstrings import documented
from jaxspatial.dynamics.external_forces import loads
from jaxspatial.dynamics.newton_euler import forces_of, wrenches_through_joints
from jaxspatial.engine.algorithm import (
    BODIES,
    DYNAMICS,
    FRAMES,
    Algorithm,
    ExternalForces,
    Wrenches,
    algorithm,
    velocity_shape,
)
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.numbers import noinline
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce, algebra


@documented
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

    Armature is part of M. Damping, friction and springs are not included: see `passive_forces`. Whole Jacobians
    (`jax.jacfwd`, `jax.jacrev`: at least nv tangents or cotangents at one state) are computed in closed form, as by
    `inverse_dynamics_derivatives`: with its error, and not bitwise as single derivatives are.

    Returns:
        tau (*batch, nv), over the common batch: N m, N.

    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators; Featherstone 2008, table
        5.1.
    """
    return inverse_dynamics_of(precision, mechanism, q, v, vdot, external_forces, operation="inverse_dynamics")


@documented
def bias_forces(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The bias forces C(q, v) v + g(q) - J^T F: `inverse_dynamics` without the terms in vdot.

    Returns:
        (*batch, nv), over the common batch: N m, N.

    Source: as of `inverse_dynamics`.
    """
    return inverse_dynamics_of(precision, mechanism, q, v, None, external_forces, operation="bias_forces")


@documented
def gravity_forces(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The generalized forces g(q) that hold a mechanism at rest against gravity.

    Returns:
        (*batch, nv): N m, N.

    Source: as of `inverse_dynamics`.
    """
    return inverse_dynamics_of(precision, mechanism, q, None, None, None, operation="gravity_forces")


@documented
def joint_reactions(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    vdot: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> SpatialForce:
    """The wrench through every joint: what its parent exerts on each body.

        F_i = (net wrench of body i) - (external forces on body i) + sum of F over its children

    It holds the body against gravity, external forces, its own motion and all that hangs on it. Its part along the
    joint is the force of the joint: S . F + armature vdot = `inverse_dynamics`, in "reproducible" bit by bit where the
    joint is at the origin of its body. The bearing takes the rest. The wrench through a weld is that of `newton_euler`
    for what is behind it.

    Returns:
        F_Bo_B (*batch, n), in the order of `mechanism.body_names`: the wrench on each body by its parent, about the
        origin of the body, in its axes; N m, N. Others have the same wrench on the child about other points: Drake's
        `reaction_forces` about the origin of the joint's frame on the child, in the axes of that frame; Pinocchio's
        `data.f` about the joint, in its axes; MuJoCo's `cfrc_int` about `subtree_com` of the root, in world axes.

    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators; Featherstone 2008, table
        5.1.
    """
    return SpatialForce(*_joint_reactions(precision, mechanism, q, v, vdot, external_forces))


class InverseDynamics(Algorithm):
    """The program of `inverse_dynamics_of`; nv or more (co)tangents at one state use closed-form Jacobians."""

    def jacobians(self, moving: tuple[bool, ...], n_columns: int) -> Any:
        wanted = self._moves_with(moving)
        if n_columns < self.topology.nv or sum(wanted) < sum(moving):
            return None
        return self.program_of(jacobians, wanted=wanted)

    def _moves_with(self, moving: tuple[bool, ...]) -> tuple[bool, ...]:
        """Whether q, v and vdot are among the arguments that move."""
        leaves = jax.tree.unflatten(self.tree, range(self.tree.num_leaves))[1][:3]
        return tuple(i is not None and self.known[i] is None and moving[self.place(i)] for i in leaves)


@algorithm(*DYNAMICS, *FRAMES, program_class=InverseDynamics, result_shape=velocity_shape)
def inverse_dynamics_of(state: MechanismState, v: Array | None, vdot: Array | None, external_forces: Wrenches):
    return state.by_velocity(forces_of(state, v, vdot, loads(state, external_forces), state.minus_gravity))


@algorithm(*BODIES, "gravity", *FRAMES, entries=lambda t: 6 * len(t))
def _joint_reactions(state: MechanismState, v: Array, vdot: Array, external_forces: Wrenches):
    body_loads = loads(state, external_forces)
    through = wrenches_through_joints(state, v, vdot, body_loads, state.minus_gravity)
    placed = zip(map(state.child_placement, state.bundles), through, strict=True)
    about_bodies = [_about_body(X_JB, F) for X_JB, F in placed]
    return tuple(state.by_body([F[k] for F in about_bodies], 3) for k in (0, 1))


_about_body = noinline(algebra.inverse_acted_wrench)

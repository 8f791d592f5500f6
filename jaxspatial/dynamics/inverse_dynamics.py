"""Inverse dynamics: the forces at the joints for given accelerations."""

import jax

from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics.algorithm import DYNAMICS, FRAMES, Algorithm, algorithm, of_rates
from jaxspatial.dynamics.along import Maybe
from jaxspatial.dynamics.arguments import ExternalForces, Wrenches
from jaxspatial.dynamics.derivatives import jacobians
from jaxspatial.dynamics.links import minus_gravity
from jaxspatial.dynamics.loads import loads
from jaxspatial.dynamics.recursive_newton_euler import forces_of
from jaxspatial.dynamics.state import MechanismState
from jaxspatial.mechanism import Mechanism


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

    Armature is part of M. Damping, friction and springs are not: see `passive_forces`. Of as many tangents or
    cotangents at one state as there are rates (`jax.jacfwd`, `jax.jacrev`) derivatives come from those in closed form,
    see `inverse_dynamics_derivatives`: with its errors, and other bits than single ones.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
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
    return _inverse_dynamics(precision, mechanism, q, v, vdot, external_forces)


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
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
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
    return _inverse_dynamics(precision, mechanism, q, v, None, external_forces, operation="bias_forces")


def gravity_forces(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """g(q): `inverse_dynamics` at rest.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
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
    return _inverse_dynamics(precision, mechanism, q, None, None, None, operation="gravity_forces")


class InverseDynamics(Algorithm):
    """The program of `_inverse_dynamics`. As many tangents or cotangents at one state as there are rates come from the
    Jacobians in closed form."""

    def jacobians(self, moving: tuple[bool, ...], n_columns: int):
        wanted = self._moves_with(moving)
        if n_columns < self.topology.nv or sum(wanted) < sum(moving):
            return None
        return self.sibling(jacobians, wanted=wanted)

    def _moves_with(self, moving: tuple[bool, ...]):
        """Whether q, v and vdot do."""
        leaves = jax.tree.unflatten(self.tree, range(self.tree.num_leaves))[1][:3]
        return tuple(i is not None and self.known[i] is None and moving[self.place(i)] for i in leaves)


@algorithm(*DYNAMICS, *FRAMES, kind=InverseDynamics, result=of_rates)
def _inverse_dynamics(state: MechanismState, v: Maybe, vdot: Maybe, external_forces: Wrenches):
    return state.by_rate(forces_of(state, v, vdot, loads(state, external_forces), minus_gravity(state)))

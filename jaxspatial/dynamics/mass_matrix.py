"""The mass matrix, by composite rigid bodies, and its factors."""

from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.numbers import Motion, Number, Three, Wrench, is_constant, noinline, shape_of, where
from jaxspatial.arithmetic.tree import tree
from jaxspatial.arithmetic.types import Coordinates, Forces, PrecisionName
from jaxspatial.dynamics import along, pairs, recursion
from jaxspatial.dynamics.algorithm import BODIES, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.links import across
from jaxspatial.dynamics.state import Inertia, Link, MechanismState, Pose
from jaxspatial.inertia.articulated import congruent
from jaxspatial.inertia.composition import joined
from jaxspatial.mechanism import Mechanism
from jaxspatial.spatial import algebra

# The two parts of a motion or wrench, and where its point is.
Placed = tuple[Three, Three, Three]


def mass_matrix(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """The mass matrix M(q): v^T M v / 2 is the kinetic energy. Armature is on its diagonal.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv, nv), symmetric to the last bit; kg m^2, kg m, kg.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Walker, Orin 1982, Efficient dynamic computer simulation of robotic mechanisms; Featherstone 2008, table
        6.2.
    """
    return _mass_matrix(precision, mechanism, q)


@algorithm(*BODIES, "armature", entries=lambda t: t.nv**2, result=lambda t: (t.nv, t.nv))
def _mass_matrix(state: MechanismState):
    return state.rounded(matrix_of(state))


def matrix_of(state: MechanismState):
    """M as numbers (nv, nv, B)."""
    links, placed = state.links(), pairs.from_root(state)
    both = zip(links, composites(state), placed, strict=True)
    sides = [noinline(_in_root_axes)(along.abreast(link.joint.subspace), c, X) for link, c, X in both]
    rows, columns = ([(b.kind.nv, x[side]) for b, x in zip(state.bundles, sides, strict=True)] for side in (0, 1))
    (upper,) = pairs.matrices(state, lambda row, column: (generalized_force(row, column),), rows, columns)
    return with_armature(state, links, symmetric_of(upper))


def _in_root_axes(motion: Motion, composite: Inertia, X: Pose) -> tuple[Placed, Placed]:
    """(the motions S, the wrenches I S of the composite body), in world axes, with their points from the root."""
    return in_root_axes(X, motion), in_root_axes(X, algebra.inertia_times(*composite, *motion))


def in_root_axes(X: Pose, vector: Motion | Wrench) -> Placed:
    """The two parts of a motion or wrench in the axes of the world, and where its point is."""
    x, y = (vectors.matrix_times(X.rows, part) for part in vector)
    return x, y, X.p


def generalized_force(row: Placed, column: Placed):
    """The generalised force of a wrench (tau, f) at a place, along a motion (w, v) at another: S . F."""
    (w, v, p), (tau, f, p2) = row, column
    return algebra.power((vectors.plus(tau, vectors.cross(vectors.minus(p2, p), f)), f), (w, v))


def symmetric_of(upper: Number):
    """A symmetric matrix of its upper triangle."""
    n = shape_of(upper)[0]
    is_upper = jnp.asarray(np.triu(np.ones((n, n), bool))[:, :, None])
    return where(is_upper, upper, along.mapped(lambda w: jnp.swapaxes(w, 0, 1), upper))


def with_armature(state: MechanismState, links: list[Link], M: Number):
    """A matrix over all rates, with the inertia of rotors on its diagonal, over v."""
    whole = pairs.by_rates(state, pairs.by_rates(state, M, 0), 1)
    if all(is_constant(x) and x.value == 0 for link in links for x in link.armature):
        return whole
    rotors = state.own_rates([link.armature for link in links])
    on_diagonal = jnp.asarray(np.eye(shape_of(whole)[0], dtype=bool)[:, :, None])
    return where(on_diagonal, whole + along.mapped(lambda w: w[:, None], rotors), whole)


# -- composite bodies -------------------------------------------------------------------------------------------------


def composites(state: MechanismState) -> list[Inertia]:
    """The composite inertia of the subtree of every body, about J in its axes."""
    return recursion.inward(state, _composite, state.no_inertia, state.links(), joined=combine)


def _composite(link: Link, children: Inertia):
    """(the composite inertia of a body and its children, the same about the parent's origin, in its axes)."""
    inertia = combine(link.inertia, children)
    return inertia, inertia_to_parent(across(link.placement, link.joint), inertia)


def combine(a: Inertia, b: Inertia):
    return Inertia._make(joined(*a, *b, 0.5))


def inertia_to_parent(X_PB: Pose, inertia: Inertia):
    com = vectors.plus(X_PB.p, vectors.matrix_times(X_PB.rows, inertia.com))
    return Inertia(inertia.mass, com, congruent(inertia.central, X_PB.rows))


# -- factors ----------------------------------------------------------------------------------------------------------


@tree
class MassMatrixFactor:
    """The factor L of M = L^T L: lower triangular, zero wherever neither of two rates moves the other's joint.

    L: (*batch, nv, nv). NaN where M is not positive definite: a rate moves nothing that has mass or armature.
    [Featherstone 2008, 6.5]
    """

    L: jax.Array

    def solve(self, tau: Forces) -> jax.Array:
        """M^-1 tau: the accelerations of forces, from rest.

        Args:
            tau: (*batch, nv) generalized forces: N m, N.

        Returns:
            (*batch, nv), over the common batch: rad/s^2, m/s^2.

        Raises:
            TypeError: dtypes differ.
            ValueError: shapes do not fit.

        Error: at most 4 nv (nv + 1) u cond(M) relative to the result, in 2-norms and in addition to cond(M) times that
            of `mass_matrix`, while that is small.
        Source: Higham 2002, Accuracy and stability of numerical algorithms, theorem 10.4.
        """
        given = check.as_vectors(tau, "MassMatrixFactor.solve: tau", self.L.dtype, self.L.shape[-1])
        return _solved(_wide(self.L), given)

    def inverse(self) -> jax.Array:
        """M^-1.

        Returns:
            (*batch, nv, nv).

        Error: as of `solve`, in the spectral norm.
        """
        eye = jnp.broadcast_to(jnp.eye(self.L.shape[-1], dtype=_wide(self.L).dtype), self.L.shape)
        half = jax.lax.linalg.triangular_solve(_wide(self.L), eye, left_side=True, lower=True)
        return (half @ jnp.swapaxes(half, -1, -2)).astype(self.L.dtype)

    def log_determinant(self) -> jax.Array:
        """log det M.

        Returns:
            (*batch,).

        Error: at most nv u (2 sum |log L_ii| + 4 nv (nv + 1) cond(M)), in addition to nv cond(M) times that of
            `mass_matrix`.
        """
        return 2 * jnp.log(self.L.diagonal(axis1=-2, axis2=-1)).sum(-1)


def mass_matrix_factor(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> MassMatrixFactor:
    """The factor of `mass_matrix`: for many right-hand sides, the inverse, the determinant.

    For the accelerations of one set of forces `forward_dynamics` is faster, and more accurate.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: of M, name of a precision; None takes the default. The factor is found in the dtype of q (float32 for
            16-bit types) in every precision.

    Returns:
        MassMatrixFactor (*batch,); NaN where M is not positive definite.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: |L^T L - M| at most 2 nv (nv + 1) u |M|, in spectral norms and in addition to that of `mass_matrix`.
    Source: Featherstone 2008, 6.5; Higham 2002, Accuracy and stability of numerical algorithms, theorem 10.3.
    """
    return factored(mass_matrix(mechanism, q, precision=precision))


def factored(M: jax.Array):
    return MassMatrixFactor(_factor(M).astype(M.dtype))


def _factor(M: jax.Array) -> jax.Array:
    """L of M, by Cholesky from the last rate to the first, which fills no zero in."""
    backward = cast(jax.Array, jnp.linalg.cholesky(jnp.flip(_wide(M), (-2, -1))))
    return jnp.flip(backward, (-2, -1)).swapaxes(-1, -2)


def _solved(L: jax.Array, tau: Array) -> jax.Array:
    b, solve = _wide(tau)[..., None], jax.lax.linalg.triangular_solve
    lower, b = (jnp.broadcast_to(x, (*np.broadcast_shapes(L.shape[:-2], b.shape[:-2]), *x.shape[-2:])) for x in (L, b))
    half = solve(lower, b, left_side=True, lower=True, transpose_a=True)
    return solve(lower, half, left_side=True, lower=True)[..., 0].astype(tau.dtype)


def _wide(x: Any) -> jax.Array:
    return x.astype(np.promote_types(x.dtype, np.float32) if x.dtype.itemsize > 2 else np.dtype(np.float32))

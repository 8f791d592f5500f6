"""Composite rigid bodies: the mass matrix and its factors.

[Walker, Orin 1982; Featherstone 2008, table 6.2]
"""

from collections.abc import Callable
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.algorithm import BODIES, algorithm, checked
from jaxspatial.engine.composite import composite
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.inertia.composition import combined
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import elimination, floats
from jaxspatial.numerics.linear import Inertia, Motion, Pose, Vector, Wrench, cross
from jaxspatial.numerics.numbers import Number, Numbers, Rounded, high, is_constant, shape_of, where
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.promise import Normwise, promises
from jaxspatial.numerics.quantity import tree
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import algebra

# The two parts of a motion or wrench in world axes, and the position of its point from the root.
Placed = tuple[Vector, Vector, Vector]

# Error bounds of the factor and its solutions; nv is the size of M.
FACTOR = Normwise(2, "|M|", per="nv (nv + 1)", rounded=2)
SOLVED = Normwise(4, "cond(M)", per="nv (nv + 1)", rounded=4)
LOG_DETERMINANT = Normwise(1, "(2 sum |log L_ii| + 4 nv (nv + 1) cond(M))", per="nv", rounded=1)


@promises(bound=ALGORITHM)
def mass_matrix(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The mass matrix M(q): v^T M v / 2 is the kinetic energy. Armature is on its diagonal.

    For a product M x with one vector `inverse_dynamics` from rest and without gravity is faster, several times for a
    humanoid; for M^-1 x, `forward_dynamics` likewise.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv, nv), symmetric to the last bit; kg m^2, kg m, kg.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Walker, Orin 1982, Efficient dynamic computer simulation of robotic mechanisms; Featherstone 2008, table
        6.2.

    Example:
        >>> print(js.mass_matrix(arm, q))
        [[5.2935 1.6467]
         [1.6467 0.6667]]
    """
    return _mass_matrix(precision, mechanism, q)


@algorithm(*BODIES, "armature", result_shape=lambda t, _: (t.nv, t.nv))
def _mass_matrix(state: MechanismState):
    return state.rounded(matrix_of(state))


def matrix_of(state: MechanismState) -> Number:
    """M as numbers (nv, nv, B)."""
    links, placed = state.links(), matrices.poses_from_root(state)
    rows, columns = list[tuple[int, Placed]](), list[tuple[int, Placed]]()
    for link, inertia, X in zip(links, composites(state), placed, strict=True):
        S = stacking.stacked_trees(link.joint.subspace)
        rows.append((len(link.joint.subspace), in_world_axes(X, S)))
        columns.append((len(link.joint.subspace), in_world_axes(X, algebra.apply_inertia(inertia, S))))
    (upper,) = matrices.matrices(state, lambda row, column: (generalized_force(row, column),), rows, columns)
    return with_armature(state, links, matrices.symmetric_of(upper))


def in_world_axes(X: Pose, vector: Motion | Wrench) -> Placed:
    """A motion or wrench in world axes, with the position of its point from the root."""
    x, y = vector
    return X.R @ x, X.R @ y, X.p


def generalized_force(motion: Placed, wrench: Placed) -> Number:
    """S . F, of a motion and a wrench about different points."""
    (w, v, p), (tau, f, p2) = motion, wrench
    return algebra.power((tau + cross(p2 - p, f), f), (w, v))


def with_armature(state: MechanismState, links: list[Link], M: Number) -> Number:
    """Reduces a matrix over the velocities of all joints to one over v, and adds armature to its diagonal."""
    whole = matrices.by_velocity(state, matrices.by_velocity(state, M, 0), 1)
    if all(is_constant(x) and x.value == 0 for link in links for x in link.armature):
        return whole
    rotors = state.of_independent_joints([link.armature for link in links])
    on_diagonal = jnp.asarray(np.eye(shape_of(whole)[0], dtype=bool)[:, :, None])
    return where(on_diagonal, whole + stacking.mapped(lambda w: w[:, None], rotors), whole)


# -- composite bodies -------------------------------------------------------------------------------------------------


def composites(state: MechanismState) -> list[Inertia]:
    """The composite inertia of the subtree of every body, about J in its axes."""
    return recursion.inward(state, _composite, state.zero_inertia, state.links(), join=combined)


def _composite(link: Link, children: Inertia) -> tuple[Inertia, Inertia]:
    """The composite inertia of a body and its children: (about J, about the parent's origin in its axes)."""
    inertia = combined(link.inertia, children)
    return inertia, algebra.acted_inertia(link.X_PB, inertia)


# -- factors ----------------------------------------------------------------------------------------------------------


@tree
class MassMatrixFactor:
    """The factor L of M = L^T L: lower triangular, zero where neither of two joints carries the other.

    L: (*batch, nv, nv). NaN where M is not positive definite: some joint moves neither mass nor armature.
    [Featherstone 2008, 6.5]

    Example:
        >>> L = js.mass_matrix_factor(arm, q).L
        >>> print(L.T @ L)
        [[5.2935 1.6467]
         [1.6467 0.6667]]
    """

    L: jax.Array

    @promises(bound=SOLVED)
    def solve(self, tau: ArrayLike) -> jax.Array:
        """M^-1 tau: the accelerations that generalized forces cause from rest, without gravity.

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

        Example:
            >>> vdot = js.mass_matrix_factor(arm, q).solve(tau)
            >>> print(js.mass_matrix(arm, q) @ vdot)
            [10.  2.]
        """
        tau = floats.as_vectors(tau, "MassMatrixFactor.solve: tau", self.L.dtype, self.L.shape[-1])
        n = tau.shape[-1]
        if not 0 < n * n <= _MOST_ENTRIES:
            return _substituted(self.L, tau)
        return _solved(resolve(None), (), self.L.reshape(*self.L.shape[:-2], n * n), tau)

    def inverse(self) -> jax.Array:
        """The inverse M^-1.

        Returns:
            (*batch, nv, nv).

        Error: as of `solve`, in the spectral norm.

        Example:
            >>> print(js.mass_matrix_factor(arm, q).inverse())
            [[ 0.8157 -2.015 ]
             [-2.015   6.4772]]
        """
        eye = jnp.broadcast_to(jnp.eye(self.L.shape[-1], dtype=_wide(self.L).dtype), self.L.shape)
        half = lax.linalg.triangular_solve(_wide(self.L), eye, left_side=True, lower=True)
        return jnp.matmul(half, jnp.swapaxes(half, -1, -2), precision=lax.Precision.HIGHEST).astype(self.L.dtype)

    @promises(bound=LOG_DETERMINANT)
    def log_determinant(self) -> jax.Array:
        """The logarithm of the determinant, log det M.

        Returns:
            (*batch,).

        Error: at most nv u (2 sum |log L_ii| + 4 nv (nv + 1) cond(M)), in addition to nv cond(M) times that of
            `mass_matrix`.

        Example:
            >>> determinant = jnp.exp(js.mass_matrix_factor(arm, q).log_determinant())
            >>> print(round(float(determinant), 3))
            0.817
        """
        return 2 * jnp.log(self.L.diagonal(axis1=-2, axis2=-1)).sum(-1)


@promises(bound=FACTOR)
def mass_matrix_factor(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> MassMatrixFactor:
    """The factor of `mass_matrix`, for many right-hand sides, the inverse, or the determinant.

    For a single vector of forces `forward_dynamics` is faster and more accurate.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: of M, name of a precision; None takes the default. The factor is computed in the dtype of q (float32
            for 16-bit types) in every precision.

    Returns:
        MassMatrixFactor (*batch,); NaN where M is not positive definite.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: |L^T L - M| is at most 2 nv (nv + 1) u |M|, in spectral norms and in addition to that of `mass_matrix`.
    Source: Featherstone 2008, 6.5; Higham 2002, Accuracy and stability of numerical algorithms, theorem 10.3.

    Example:
        >>> factor = js.mass_matrix_factor(arm, q)
        >>> print(js.mass_matrix(arm, q) @ factor.solve(tau))
        [10.  2.]
    """
    (q,) = checked("mass_matrix_factor", mechanism, q=q)
    if not mechanism.nv:
        return factored(mass_matrix(mechanism, q, precision=precision))
    return _factor(resolve(precision), (mechanism,), q)


@composite
def _factor(precision: Precision, scene: tuple[Mechanism], q: jax.Array) -> MassMatrixFactor:
    """As one program."""
    L = factored(mass_matrix(scene[0], q, precision=precision.value)).L
    # Columns before a pivot that is not positive are numbers.
    return MassMatrixFactor(jnp.where(jnp.isnan(jnp.sum(jnp.diagonal(L))), jnp.full_like(L, np.nan), L))


# The entries of a factor whose products with a vector are written out, one by one, in a program of machine code: more
# take longer to compile than they save.
_MOST_ENTRIES = 4000


@composite
def _solved(precision: Precision, scene: tuple[()], entries: jax.Array, tau: jax.Array) -> jax.Array:
    """As one program: a tenth of the time of a library, which is called for each state."""
    return _substituted(entries.reshape(len(tau), -1), tau)


def _substituted(L: jax.Array, tau: jax.Array) -> jax.Array:
    batch = floats.broadcast_shapes(L.shape[:-2], tau.shape[:-1])
    L, b = (jnp.broadcast_to(x, (*batch, *x.shape[-2:])) for x in (_wide(L), _wide(tau)[..., None]))
    half = lax.linalg.triangular_solve(L, b, left_side=True, lower=True, transpose_a=True)
    return lax.linalg.triangular_solve(L, half, left_side=True, lower=True)[..., 0].astype(tau.dtype)


def factored(M: jax.Array) -> MassMatrixFactor:
    """The factor of M, by Cholesky from the last velocity to the first, without fill-in."""
    if not M.shape[-1]:
        return MassMatrixFactor(M)
    backward = cast(jax.Array, jnp.linalg.cholesky(jnp.flip(_wide(M), (-2, -1))))
    return MassMatrixFactor(jnp.flip(backward, (-2, -1)).swapaxes(-1, -2).astype(M.dtype))


def solver(topology: Topology, M: jax.Array, precision: Precision) -> Callable[[jax.Array], jax.Array]:
    """Factors M of one state, and returns the function that computes M^-1 B for a matrix B (nv, k). It works on single
    numbers, as programs of machine code need it.

    Sums and products are rounded to the dtype of M (float32 for 16-bit types) in every precision. Where a pivot is not
    positive, all results for the tree of its velocity are NaN.
    """
    carriers, n = topology.velocity_carriers, topology.nv

    def numbers_of(array: jax.Array) -> Numbers:
        return tuple(Rounded(precision.of_one_limb, x) for x in jnp.unstack(array))

    entries = numbers_of(_wide(M).reshape(-1))
    lower = [{i: entries[k * n + i] for i in (*before, k)} for k, before in enumerate(carriers)]
    factors = elimination.tree_factors(lower, carriers)

    def solved(column: jax.Array) -> jax.Array:
        return jnp.stack([*map(high, elimination.solve_tree(factors, carriers, numbers_of(column)))])

    return lambda B: lax.map(solved, _wide(B).T).T.astype(M.dtype)


def _wide(x) -> jax.Array:
    """x in its dtype, or in float32 for 16-bit types."""
    return x.astype(np.promote_types(x.dtype, np.float32) if x.dtype.itemsize > 2 else np.dtype(np.float32))

"""The mass matrix, by composite rigid bodies, and its factors."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.tree import tree
from jaxspatial.dynamics import columns, recursion
from jaxspatial.dynamics.links import across, to_parent
from jaxspatial.dynamics.scene import Inertia, algorithm, checked
from jaxspatial.inertia import symmetric
from jaxspatial.inertia.addition import joined
from jaxspatial.inertia.articulated import congruent


def mass_matrix(mechanism, q, *, precision=None):
    """M(q) (*batch, nv, nv), symmetric, with v^T M v / 2 the kinetic energy; armature is on its diagonal.

    mechanism: Mechanism; q (*batch, nq). Symmetric to the last bit.
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two. [Walker, Orin 1982; Featherstone 2008, table 6.2]
    """
    (q,) = checked("mass_matrix", mechanism, q=q)
    return _mass_matrix(precision, mechanism, q)


@algorithm
def _mass_matrix(scene):
    links = scene.links(None, None)
    found = columns.blocks(scene, _WRENCHES._replace(size=scene.size), list(zip(links, composites(scene), strict=True)))
    upper = columns.whole(found, sum(map(scene.size, scene.segments)))
    is_upper = np.triu(np.ones(upper.shape, bool))
    return columns.without_mimics(scene, jnp.where(is_upper, upper, upper.T))


# -- composite bodies -------------------------------------------------------------------------------------------------


def composites(scene):
    """The inertia of every segment with all that hangs on it, about J in its axes."""
    zero = scene.known(0.0)
    nothing = Inertia(zero, (zero,) * 3, (zero,) * 6)
    return recursion.inward(scene.segments, _composite, nothing, scene.links(None, None), joined=together)[0]


def _composite(link, held):
    """(the inertia of a body with all that hangs on it, the same seen from its parent)."""
    inertia = together(link.inertia, held)
    return inertia, inertia_to_parent(across(link.placement, link.hinge), inertia)


def together(a, b):
    return Inertia(*joined(*a, *b, 0.5))


def inertia_to_parent(X_PB, inertia):
    com = vectors.plus(X_PB.p, vectors.matrix_times(X_PB.rows, inertia.com))
    return Inertia(inertia.mass, com, congruent(inertia.central, X_PB.rows))


# -- the wrench that a unit rate takes --------------------------------------------------------------------------------


def _of_rates(own):
    link, composite = own
    return [felt(composite, motion) for motion in link.hinge.subspace]


def felt(inertia, motion):
    """The wrench that a unit of a motion takes, at rest."""
    w, v = motion
    f = vectors.times(inertia.mass, vectors.plus(v, vectors.cross(w, inertia.com)))
    turning = vectors.matrix_times(symmetric.rows(inertia.central), w)
    return *vectors.plus(turning, vectors.cross(inertia.com, f)), *f


def _rows(place, own, wrenches):
    link, _ = own
    rows = [recursion.each_column(crossing, motion, wrenches) for motion in link.hinge.subspace]
    n = len(rows)
    return tuple(recursion.added_at(row, place * n + k, link.armature[k]) for k, row in enumerate(rows))


def crossing(motion, wrench):
    """What of a wrench a joint feels."""
    return vectors.dot((*motion[0], *motion[1]), wrench)


def carried_wrench(own, wrench):
    """A wrench on a body, of numbers that begin with its link, as its parent has it."""
    return wrench_to_parent(across(own[0].placement, own[0].hinge), wrench)


def wrench_to_parent(X_PB, wrench):
    tau, f = to_parent(X_PB, wrench[:3], wrench[3:])
    return *tau, *f


_WRENCHES = columns.Matrix(None, 6, _of_rates, _rows, carried_wrench)


# -- factors ----------------------------------------------------------------------------------------------------------


@tree
class MassMatrixFactor:
    """M = L^T L, with L lower triangular and zero wherever neither of two rates moves the other's joint.

    L: (*batch, nv, nv). NaN where M is not positive: bodies without mass or armature that a rate moves.
    [Featherstone 2008, 6.5]
    """

    L: jax.Array

    def solve(self, tau):
        """M^-1 tau of (*batch, nv): the accelerations of forces, from rest."""
        tau = check.as_vectors(tau, "MassMatrixFactor.solve: tau", self.L.dtype, self.L.shape[-1])
        return _solved(_wide(self.L), tau)

    def inverse(self):
        """M^-1 (*batch, nv, nv)."""
        eye = jnp.broadcast_to(jnp.eye(self.L.shape[-1], dtype=_wide(self.L).dtype), self.L.shape)
        half = jax.lax.linalg.triangular_solve(_wide(self.L), eye, left_side=True, lower=True)
        return (half @ jnp.swapaxes(half, -1, -2)).astype(self.L.dtype)

    def log_determinant(self):
        """log det M (*batch,)."""
        return 2 * jnp.log(jnp.diagonal(self.L, axis1=-2, axis2=-1)).sum(-1)


def mass_matrix_factor(mechanism, q, *, precision=None):
    """MassMatrixFactor of `mass_matrix`: for many right-hand sides, the inverse, the determinant.

    For accelerations of one set of forces `forward_dynamics` is faster, and more accurate. Factored in the dtype of q,
    in float32 for 16-bit types, whatever the precision, which is that of M.
    """
    return factored(mass_matrix(mechanism, q, precision=precision))


def factored(M):
    return MassMatrixFactor(_factor(M).astype(M.dtype))


def solved(M, tau):
    """M^-1 tau, without rounding the factor to 16 bits."""
    return _solved(_factor(M), tau)


def _factor(M):
    """L of M, by Cholesky from the last rate to the first, which fills no zero in."""
    backward = jnp.flip(_wide(M), (-2, -1))
    return jnp.flip(jnp.linalg.cholesky(backward), (-2, -1)).swapaxes(-1, -2)


def _solved(L, tau):
    b, solve = _wide(tau)[..., None], jax.lax.linalg.triangular_solve
    L, b = (jnp.broadcast_to(x, (*np.broadcast_shapes(L.shape[:-2], b.shape[:-2]), *x.shape[-2:])) for x in (L, b))
    half = solve(L, b, left_side=True, lower=True, transpose_a=True)
    return solve(L, half, left_side=True, lower=True)[..., 0].astype(tau.dtype)


def _wide(x):
    return x.astype(np.promote_types(x.dtype, np.float32) if x.dtype.itemsize > 2 else np.dtype(np.float32))

"""The mass matrix, by composite rigid bodies."""

import functools

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import shared
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.links import across, to_parent
from jaxspatial.dynamics.scene import Inertia, algorithm, checked
from jaxspatial.inertia import symmetric
from jaxspatial.inertia.addition import joined
from jaxspatial.inertia.articulated import congruent


def mass_matrix(mechanism, q, *, precision=None):
    """M(q) (*batch, nv, nv), symmetric, with v^T M v / 2 the kinetic energy; armature is on its diagonal.

    mechanism: Mechanism; q (*batch, nq). Symmetric to the last bit. [Walker, Orin 1982; Featherstone 2008, table 6.2]
    """
    (q,) = checked("mass_matrix", mechanism, q=q)
    return _mass_matrix(precision, mechanism, q)


@algorithm
def _mass_matrix(scene):
    links = scene.links(None, None)
    zero = scene.known(0.0)
    nothing = Inertia(zero, (zero,) * 3, (zero,) * 6)
    composites, _ = recursion.inward(scene.segments, _composite, nothing, links, joined=_joined)
    return _without_mimics(scene, _whole(_rows(scene, links, composites)))


def _composite(link, held):
    """(the inertia of a body with all that hangs on it, the same seen from its parent)."""
    inertia = _joined(link.inertia, held)
    X_PB = across(link.placement, link.hinge)
    com = vectors.plus(X_PB.p, vectors.matrix_times(X_PB.rows, inertia.com))
    return inertia, Inertia(inertia.mass, com, congruent(inertia.central, X_PB.rows))


def _joined(a, b):
    return Inertia(*joined(*a, *b, 0.5))


# -- rows of the upper triangle ---------------------------------------------------------------------------------------
#
# The wrench that a unit rate of one joint takes at another is carried from tip to base, those of all joints behind a
# body at once: numbers that are arrays over rates. These are in the order of bodies, depth first, those of a mimic
# among them, so that the ones behind a body follow its own.


def _rows(scene, links, composites):
    """The rows of every segment, each from its first rate to the last one behind it: [(where it starts, rows)]."""
    arrived, blocks, start = {}, [], sum(map(scene.size, scene.segments))
    for segment, link, composite in zip(reversed(scene.segments), reversed(links), reversed(composites), strict=True):
        start -= scene.size(segment)
        own = [_zeros(scene, scene.size(segment))]
        columns = recursion.concatenated([*own, *arrived.pop(segment.stop - 1, [])])
        along = jnp.arange(segment.stop - segment.start)
        step = functools.partial(_step, len(link.hinge.subspace))
        if segment.is_chain:
            rows, columns = recursion.along(step, (along, link, composite), columns, reverse=True)
        else:
            rows, columns = shared(step)((along[0], link, composite), columns)
        arrived[segment.parent] = [columns, *arrived.get(segment.parent, [])]
        blocks.append((start, [scene.rounded(row) for row in rows]))
    return blocks[::-1]


def _step(n, own, columns):
    """(the rows of one body, the wrenches seen from its parent), with its own n put among those behind it."""
    place, link, composite = own
    for k, motion in enumerate(link.hinge.subspace):
        columns = recursion.with_column(columns, place * n + k, _felt(composite, motion))
    X_PB = across(link.placement, link.hinge)
    rows = [recursion.each_column(_crossing, motion, columns) for motion in link.hinge.subspace]
    rows = [recursion.added_at(row, place * n + k, link.armature[k]) for k, row in enumerate(rows)]
    return tuple(rows), recursion.each_column(_to_parent, X_PB, columns)


def _felt(inertia, motion):
    """The wrench that a unit rate takes, at rest."""
    w, v = motion
    f = vectors.times(inertia.mass, vectors.plus(v, vectors.cross(w, inertia.com)))
    turning = vectors.matrix_times(symmetric.rows(inertia.central), w)
    return *vectors.plus(turning, vectors.cross(inertia.com, f)), *f


def _crossing(motion, wrench):
    """What of a wrench a joint feels."""
    return vectors.dot((*motion[0], *motion[1]), wrench)


def _to_parent(X_PB, wrench):
    tau, f = to_parent(X_PB, wrench[:3], wrench[3:])
    return *tau, *f


def _zeros(scene, n):
    return tuple(recursion.repeated_along(scene.known(0.0), n) for _ in range(6))


# -- put together -----------------------------------------------------------------------------------------------------


def _whole(blocks):
    """(n, n), symmetric, of the blocks of its upper triangle."""
    n = sum(np.prod(rows[0].shape[:-1], dtype=int) * len(rows) for _, rows in blocks)
    upper = jnp.concatenate([_padded(start, rows, n) for start, rows in blocks])
    is_upper = np.triu(np.ones((n, n), bool))
    return jnp.where(is_upper, upper, upper.T)


def _padded(start, rows, n):
    """The rows of a segment, those of one body after those of the one before, in full length."""
    interleaved = jnp.stack(rows, -2).reshape((-1, rows[0].shape[-1]))
    return jnp.pad(interleaved, ((0, 0), (start, n - start - interleaved.shape[1])))


def _without_mimics(scene, M):
    """What the rate of a mimic does, its master's does."""
    t = scene.topology
    starts = np.cumsum([0, *(t.kind(i).nv for i in range(len(t)))])
    mimics = [i for i in range(len(t)) if t.is_mimic(i)]
    for i in mimics:
        factor, own, master = scene.mechanism.mimics[i, 0].astype(M.dtype), starts[i], starts[t.masters[i]]
        M = M.at[:, master].add(factor * M[:, own])
        M = M.at[master].add(factor * M[own])
    kept = [k for k in range(len(M)) if k not in {starts[i] for i in mimics}]
    return M[np.ix_(kept, kept)] if mimics else M

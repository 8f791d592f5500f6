"""Articulated-body inertia over numbers: six of J, nine of F and six of M, see `ArticulatedInertia`."""

import numpy as np

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import constant, high, noinline, noinline_pairs, where
from jaxspatial.arithmetic.numbers.protocol import Mask, Motion, Number, Numbers, Rows, Symmetric, Three
from jaxspatial.inertia.composition import steiner
from jaxspatial.spatial import algebra

Symmetrics = tuple[Symmetric, Numbers, Symmetric]  # J, F and M

# Of the six numbers of a symmetric matrix.
_PLACES = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))

# Where among the 21 entries those of a 6 x 6 matrix are, and these in it: rotational and translational in the lower
# triangle, the coupling, transposed, in the lower left block.
_ROTATIONAL, _TRANSLATIONAL = (np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]]) + first for first in (0, 15))
_COUPLING = np.arange(6, 15).reshape(3, 3)
TO_MATRIX = np.block([[_ROTATIONAL, _COUPLING], [_COUPLING.T, _TRANSLATIONAL]]).ravel().astype(np.int32)
OF_MATRIX = np.array([0, 6, 7, 12, 13, 14, 18, 24, 30, 19, 25, 31, 20, 26, 32, 21, 27, 28, 33, 34, 35], np.int32)


@formula(of_sums=True)
def with_mass(mass: Numbers, com: Three) -> list[Numbers]:
    return list(moments_of(mass[0], com))


def moments_of(mass: Number, com: Three) -> tuple[Numbers, Symmetric]:
    """Of numbers: F = m [c]x, M = m 1."""
    zero = constant(com[0], 0)
    return vectors.flat(algebra.skew(vectors.times(mass, com))), (mass, zero, mass, zero, zero, mass)


@formula(of_sums=True)
def shifted_arrays(j: Symmetric, f: Numbers, m: Symmetric, p: Three) -> list[Numbers]:
    found = shifted(j, f, m, p)
    return [vectors.laid_out_as(j, found[0]), vectors.laid_out_as(f, found[1]), m]


def shifted(j: Symmetric, f: Numbers, m: Symmetric, p: Three) -> Symmetrics:
    """Of numbers: F' = F - [p]x M, whose columns are those of F less p x m_k; J' = J + (F [p]x)^T + F' [p]x."""
    old = vectors.rows(f)
    moved = vectors.transpose([vectors.cross(p, row) for row in symmetric.rows(m)])
    new = tuple(tuple(a - b for a, b in zip(x, y, strict=True)) for x, y in zip(old, moved, strict=True))
    before, after = ([vectors.cross(row, p) for row in rows] for rows in (old, new))
    rotational = tuple(a + (before[k][i] + after[i][k]) for a, (i, k) in zip(j, _PLACES, strict=True))
    return rotational, vectors.flat(new), m


def of_body(mass: Number, com: Three, central: Symmetric) -> Symmetrics:
    """Of numbers: J = I + m (|c|^2 1 - c c^T), F = m [c]x, M = m 1."""
    coupling, translational = moments_of(mass, com)
    return vectors.plus(central, steiner(mass, com)), coupling, translational


def times_motion(j: Symmetric, f: Numbers, m: Symmetric, alpha: Three, a: Three) -> Numbers:
    """Of numbers: P (alpha, a), as six."""
    top, bottom = by_rows(j, f, m)
    return tuple(algebra.power(row, (alpha, a)) for row in top + bottom)


@formula
def rotated(j: Symmetric, f: Numbers, m: Symmetric, entries: Numbers) -> list[Numbers]:
    return list(reexpressed(j, f, m, vectors.rows(entries)))


def reexpressed(j: Symmetric, f: Numbers, m: Symmetric, rows: Rows) -> Symmetrics:
    """Of numbers: R J R^T, R F R^T, R M R^T."""
    return congruent(j, rows), vectors.flat(sandwiched(vectors.rows(f), rows)), congruent(m, rows)


sandwiched, congruent = noinline(algebra.sandwiched), noinline(algebra.congruent)


@formula
@noinline
def acted(j: Symmetric, f: Numbers, m: Symmetric, entries: Numbers, p: Three) -> list[Numbers]:
    """From frame B at Bo to frame A at Ao: rotated, then shifted."""
    return list(noinline_pairs(shifted)(*reexpressed(j, f, m, vectors.rows(entries)), vectors.negative(p)))


@formula
@noinline
def acted_inverse(j: Symmetric, f: Numbers, m: Symmetric, entries: Numbers, p: Three) -> list[Numbers]:
    """From frame A at Ao to frame B at Bo: shifted, then rotated."""
    return list(reexpressed(*noinline_pairs(shifted)(j, f, m, p), vectors.transpose(vectors.rows(entries))))


@formula(of_sums=True)
def times_motion_arrays(j: Symmetric, f: Numbers, m: Symmetric, alpha: Three, a: Three) -> list[Numbers]:
    found = times_motion(j, f, m, alpha, a)
    return [vectors.laid_out_as(alpha, found[:3]), vectors.laid_out_as(a, found[3:])]


def by_rows(j: Symmetric, f: Numbers, m: Symmetric) -> tuple[list[Motion], list[Motion]]:
    """The upper and lower three rows, each as the halves of its six components."""
    rows = vectors.rows(f)
    top = list(zip(symmetric.rows(j), rows, strict=True))
    return top, list(zip(vectors.transpose(rows), symmetric.rows(m), strict=True))


# -- a joint projected out --------------------------------------------------------------------------------------------


@formula
def projected(j: Symmetric, f: Numbers, m: Symmetric, *arms_and_parts: Numbers, n: int) -> list[Numbers]:
    """[J, F, M] of what is left, and for each of n motions the halves of U, and (D,)."""
    arms, parts = arms_and_parts[:n], arms_and_parts[n:]
    found: list[Numbers] = []
    for (arm,), w, v in zip(arms, parts[::2], parts[1::2], strict=True):
        (j, f, m), U, D = _through_motion(j, f, m, w, v, arm)
        found += [U[:3], U[3:], (D,)]
    return [j, f, m, *found]


def _through_motion(
    j: Symmetric, f: Numbers, m: Symmetric, w: Three, v: Three, arm: Number
) -> tuple[Symmetrics, Numbers, Number]:
    """(P seen through a motion S = (w, v) that is free, U, D)."""
    U, D = U_and_D(j, f, m, w, v, arm)
    return rank_one_downdate(j, f, m, U, UDinv_of(U, D)), U, D


@noinline
def U_and_D(j: Symmetric, f: Numbers, m: Symmetric, w: Three, v: Three, arm: Number) -> tuple[Numbers, Number]:
    """U = P S, D = S^T U + armature."""
    U = times_motion(j, f, m, w, v)
    return U, algebra.power((U[:3], U[3:]), (w, v)) + arm


@noinline
def UDinv_of(U: Numbers, D: Number) -> Numbers:
    """U D^-1, 0 where D is not positive."""
    is_none = high(D) <= 0
    divisor = where(is_none, 1.0, D)
    return tuple(where(is_none, 0.0, x / divisor) for x in U)


@noinline
def rank_one_downdate(j: Symmetric, f: Numbers, m: Symmetric, U: Numbers, UDinv: Numbers) -> Symmetrics:
    """P - U D^-1 U^T, with UDinv = U D^-1."""
    rotational = tuple(x - U[a] * UDinv[b] for x, (a, b) in zip(j, _PLACES, strict=True))
    translational = tuple(x - U[3 + a] * UDinv[3 + b] for x, (a, b) in zip(m, _PLACES, strict=True))
    return rotational, tuple(x - U[i // 3] * UDinv[3 + i % 3] for i, x in enumerate(f)), translational


# -- validity ---------------------------------------------------------------------------------------------------------


@formula
def is_valid(j: Symmetric, f: Numbers, m: Symmetric, tolerance: float) -> Mask:
    """Whether all pivots of P + tolerance 1 are positive, P in units in which J and M are of size 1."""
    J, M = (_size(x) for x in (j, m))
    root = J.sqrt() * M.sqrt()
    j, f, m = ([x / s for x in part] for part, s in ((j, J), (f, root), (m, M)))
    top, bottom = by_rows(j, f, m)
    rows: list[Numbers] = [[*a, *b] for a, b in top + bottom]
    is_valid = high(rows[0][0]) + tolerance > 0
    for k in range(6):
        pivot = rows[k][k] + tolerance
        is_valid = is_valid & (high(pivot) > 0)
        rows = [_eliminated(row, rows[k], k, pivot) if i > k else row for i, row in enumerate(rows)]
    return is_valid


def _eliminated(row: Numbers, by: Numbers, k: int, pivot: Number) -> Numbers:
    """The row less so much of another that its k-th entry is 0."""
    factor = row[k] / pivot
    return [x if i <= k else x - factor * y for i, (x, y) in enumerate(zip(row, by, strict=True))]


def _size(six: Symmetric) -> Number:
    size = vectors.recursive_sum([abs(x) for x in six])
    return where(high(size) == 0, 1.0, size)

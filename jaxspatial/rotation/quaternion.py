"""Quaternions (w, x, y, z), and matrices by their rows, as tuples of numbers."""

import operator

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Number, Numbers, Rows, doubled, each, high, noinline, where


@noinline
def to_matrix(q: Numbers) -> Rows:
    """The matrix of a unit quaternion, as good as that of the exact one in the direction of q.

    What rounding did to the length would count twice. The squares it is taken off with are those of the diagonal, so
    that their own errors cancel.
    """
    w, x, y, z = q
    ww, xx, yy, zz, *doubles = each(operator.mul, (w, x, y, z, x, x, y, w, w, w), (w, x, y, z, y, z, z, x, y, z))
    missing = 1 - ((ww + xx) + (yy + zz))
    xy, xz, yz, wx, wy, wz = map(doubled, doubles)
    low = vectors.minus((ww, ww, ww, xx, yy, zz, xy, xz, yz), (yy, xx, xx, zz, zz, yy, wz, wy, wx))
    a, e, i, b, f, g = vectors.plus((*low[:3], xy, xz, yz), (low[3], low[4], low[5], wz, wy, wx))
    m = (a, low[6], f, b, e, low[8], low[7], g, i)
    return vectors.rows(vectors.plus(m, vectors.times(missing, m)))


def from_matrix(m: Rows) -> Numbers:
    """The unit quaternion with w >= 0 of a matrix, nearly a rotation."""
    return vectors.unit(proportional(m))


@noinline
def proportional(m: Rows) -> Numbers:
    """A quaternion with w >= 0, of a length from 1/2 to 1, of a matrix, nearly a rotation.

    4 q q^T has rows that are sums of entries of m; the one with the largest diagonal is 4 q_i q, with |q_i| >= 1/2.
    [Shepperd 1978]
    """
    (a, b, c), (d, e, f), (g, h, i) = m
    plus, minus, total, rest = 1 + a, 1 - a, e + i, e - i
    p, q, bd, cg, fh = vectors.plus((plus, minus, b, c, f), (total, rest, d, g, h))
    r, s, hf, gc, db = vectors.minus((plus, minus, h, c, d), (total, rest, f, g, b))
    rows = (p, hf, gc, db), (hf, r, bd, cg), (gc, bd, q, fh), (db, cg, fh, s)
    largest = rows[0]
    for k in (1, 2, 3):
        is_larger = high(rows[k][k]) > high(_diagonal(rows, k))
        largest = tuple(where(is_larger, x, y) for x, y in zip(rows[k], largest, strict=True))
    return with_positive_real_part(tuple(doubled(x, -2) for x in largest))


def _diagonal(rows: Rows, k: int) -> Number:
    """The largest diagonal entry of the rows before k."""
    largest = rows[0][0]
    for i in range(1, k):
        largest = where(high(rows[i][i]) > high(largest), rows[i][i], largest)
    return largest


def with_positive_real_part(q: Numbers) -> Numbers:
    """q or -q, which mean the same rotation; as it is where w is 0."""
    is_negative = high(q[0]) < 0
    return tuple(where(is_negative, -x, x) for x in q)


def hamilton_product(p: Numbers, q: Numbers) -> Numbers:
    """p q: first q, then p."""
    (a, *v), (b, *w) = p, q
    return (a * b - vectors.dot(v, w), *vectors.plus(vectors.times(a, w), vectors.times(b, v), vectors.cross(v, w)))

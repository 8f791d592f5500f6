"""Rotations from directions and from matrices that are nearly rotations, as formulas over numbers."""

import math

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Mask, Number, Numbers, Rows, Three, doubled, high, repeated, where


def from_one_vector(u: Three, axis: int) -> Rows:
    """The columns of a rotation whose column `axis` is u / |u|; the next one is perpendicular to the coordinate axis
    along which u is smallest."""
    u = vectors.unit(u)
    smallest = _smallest(u)
    helper = tuple(where(s, 1.0, 0 * c) for s, c in zip(smallest, u, strict=True))
    v = vectors.unit(vectors.cross(helper, u))
    return _placed(axis, u, v, vectors.cross(u, v))


def _smallest(u: Three) -> tuple[Mask, Mask, Mask]:
    """Masks over the components: of the smallest in absolute value, the first of equals."""
    a, b, c = (abs(high(x)) for x in u)
    is_first, is_second = (a <= b) & (a <= c), b <= c
    return is_first, ~is_first & is_second, ~is_first & ~is_second


def from_two_vectors(u: Three, v: Three, axes: tuple[int, int]) -> Rows:
    """The columns of a rotation whose column axes[0] is u / |u|, with v in the half plane of that column and column
    axes[1], on its positive side."""
    u = vectors.unit(u)
    normal = vectors.unit(vectors.cross(u, vectors.unit(v)))
    second = vectors.cross(normal, u)
    first, other = axes
    if (other - first) % 3 == 1:
        return _placed(first, u, second, normal)
    return _placed(first, u, tuple(-x for x in normal), second)


def _placed(axis: int, *columns: Three) -> Rows:
    """Rows of the matrix with the columns axis, axis + 1, axis + 2."""
    return vectors.transpose(tuple(columns[(k - axis) % 3] for k in range(3)))


def between(a: Three, b: Three) -> Numbers:
    """The quaternion of the smallest rotation that takes the direction of a to that of b.

    Half way between, h = (a + b) / |a + b|, it is (a . h, a x h). For opposite directions h is any perpendicular one.
    """
    a, b = vectors.unit(a), vectors.unit(b)
    half = vectors.plus(a, b)
    is_opposite = high(vectors.dot(half, half)) == 0
    helper = tuple(where(s, 1.0, 0 * c) for s, c in zip(_smallest(a), a, strict=True))
    sideways = vectors.cross(a, helper)
    h = vectors.unit(tuple(where(is_opposite, s, x) for s, x in zip(sideways, half, strict=True)))
    return vectors.dot(a, h), *vectors.cross(a, h)


def nearest(m: Rows) -> Rows:
    """The rotation nearest to a matrix of positive determinant, by its rows: its orthogonal polar factor.

    Newton's iteration, the mean of the matrix and its inverse transpose, scaled at the start so that it converges in as
    many steps as the squares of errors need. [Higham 1986, Computing the polar decomposition; 2008, Functions of
    matrices, 8.6]
    """
    return vectors.rows(repeated(_newton, 12, vectors.scaled(vectors.flat(m))[0]))


def _newton(entries: Numbers) -> Numbers:
    """(s m + m^-T / s) / 2 with s^2 = |m^-T| / |m|: both of about one size."""
    m = vectors.rows(entries)
    cofactors = (*vectors.cross(m[1], m[2]), *vectors.cross(m[2], m[0]), *vectors.cross(m[0], m[1]))
    determinant = vectors.dot(m[0], cofactors[:3])
    is_proper = (high(determinant) > 0) & (high(determinant) < math.inf)
    inverse = vectors.times(1 / where(is_proper, determinant, math.nan), cofactors)
    s = (_size(inverse) / _size(entries)).sqrt()
    mean = vectors.plus(vectors.times(s, entries), vectors.times(1 / s, inverse))
    return tuple(doubled(x, -1) for x in mean)


def _size(entries: Numbers) -> Number:
    return vectors.dot(entries, entries).sqrt()

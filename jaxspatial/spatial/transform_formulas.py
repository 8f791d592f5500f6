"""Rigid transforms in numbers: the nine entries of a rotation, and a translation."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import constant
from jaxspatial.rotation import exponential


@formula(of_sums=True)
def moved(entries, translation, p):
    return vectors.plus(translation, vectors.matrix_times(vectors.rows(entries), p))


@formula(of_sums=True)
def moved_back(entries, origin, p):
    back = vectors.transpose(vectors.rows(entries))
    return vectors.laid_out_as(p, vectors.matrix_times(back, vectors.minus(p, origin)))


@formula(of_sums=True)
def motion_matrix(entries, p):
    rows = vectors.rows(entries)
    lower = vectors.transpose([vectors.cross(p, column) for column in vectors.transpose(rows)])
    return _blocks(rows, lower)


@formula
def to_matrix(entries, p):
    top = tuple(x for row, y in zip(vectors.rows(entries), p, strict=True) for x in (*row, y))
    return *top, *(constant(p[0], int(i == 3)) for i in range(4))


@formula
def exp(w, v):
    m, p = exponential.motion(w, v)
    return [vectors.flat(m), p]


@formula
def log(entries, p):
    return list(exponential.motion_logarithm(vectors.rows(entries), p))


@formula
def interpolated(start, p_start, end, p_end, t):
    start, end = vectors.rows(start), vectors.rows(end)
    back = vectors.transpose(start)
    arm = vectors.matrix_times(back, tuple(b - a for a, b in zip(p_start, p_end, strict=True)))
    w, v = exponential.motion_logarithm(vectors.matrix_product(back, end), arm)
    turned, moved = exponential.motion(vectors.times(*t, w), vectors.times(*t, v))
    return [
        vectors.flat(vectors.matrix_product(start, turned)),
        vectors.plus(p_start, vectors.matrix_times(start, moved)),
    ]


@formula
def left_jacobian(w, v):
    return _blocks(exponential.left_jacobian(w), exponential.coupling(w, v))


@formula
def left_jacobian_inverse(w, v):
    return _blocks(exponential.left_jacobian_inverse(w), exponential.inverse_coupling(w, v))


def _blocks(diagonal, lower):
    """The entries of [[diagonal, 0], [lower, diagonal]]."""
    zero = (constant(diagonal[0][0], 0),) * 3
    top = tuple(x for row in diagonal for x in (*row, *zero))
    return top + tuple(x for a, b in zip(lower, diagonal, strict=True) for x in (*a, *b))

"""Rigid transforms in numbers: the nine entries of a rotation, and a translation."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Numbers, Rows, Three, constant
from jaxspatial.rotation import exponential


@formula(of_sums=True)
def moved(entries: Numbers, translation: Three, p: Three) -> Three:
    return vectors.plus(translation, vectors.matrix_times(vectors.rows(entries), p))


@formula(of_sums=True)
def moved_back(entries: Numbers, origin: Three, p: Three) -> Three:
    back = vectors.transpose(vectors.rows(entries))
    return vectors.laid_out_as(p, vectors.matrix_times(back, vectors.minus(p, origin)))


@formula(of_sums=True)
def motion_matrix(entries: Numbers, p: Three) -> Numbers:
    rows = vectors.rows(entries)
    lower = vectors.transpose([vectors.cross(p, column) for column in vectors.transpose(rows)])
    return _blocks(rows, lower)


@formula
def to_matrix(entries: Numbers, p: Three) -> Numbers:
    top = tuple(x for row, y in zip(vectors.rows(entries), p, strict=True) for x in (*row, y))
    return *top, *(constant(p[0], int(i == 3)) for i in range(4))


@formula
def exp(w: Three, v: Three) -> list[Numbers]:
    m, p = exponential.motion(w, v)
    return [vectors.flat(m), p]


@formula
def log(entries: Numbers, p: Three) -> list[Three]:
    return list(exponential.motion_logarithm(vectors.rows(entries), p))


@formula
def interpolated(start: Numbers, p_start: Three, end: Numbers, p_end: Three, t: Numbers) -> list[Numbers]:
    rows = vectors.rows(start)
    back = vectors.transpose(rows)
    arm = vectors.matrix_times(back, tuple(b - a for a, b in zip(p_start, p_end, strict=True)))
    w, v = exponential.motion_logarithm(vectors.matrix_product(back, vectors.rows(end)), arm)
    turned, moved = exponential.motion(vectors.times(t[0], w), vectors.times(t[0], v))
    p = vectors.plus(p_start, vectors.matrix_times(rows, moved))
    return [vectors.flat(vectors.matrix_product(rows, turned)), p]


@formula
def left_jacobian(w: Three, v: Three) -> Numbers:
    return _blocks(exponential.left_jacobian(w), exponential.coupling(w, v))


@formula
def left_jacobian_inverse(w: Three, v: Three) -> Numbers:
    return _blocks(exponential.left_jacobian_inverse(w), exponential.inverse_coupling(w, v))


def _blocks(diagonal: Rows, lower: Rows) -> Numbers:
    """The entries of [[diagonal, 0], [lower, diagonal]]."""
    zero = (constant(diagonal[0][0], 0),) * 3
    top = tuple(x for row in diagonal for x in (*row, *zero))
    return top + tuple(x for a, b in zip(lower, diagonal, strict=True) for x in (*a, *b))

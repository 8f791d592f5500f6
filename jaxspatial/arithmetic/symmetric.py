"""Symmetric matrices as six numbers, [xx, xy, yy, xz, yz, zz]: Pinocchio's order, the lower triangle by rows."""

import functools
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.functions import unit_roundoff
from jaxspatial.arithmetic.numbers import Mask, Number, Numbers, Rows, Symmetric, constant, high, where
from jaxspatial.arithmetic.numbers.double_word import DoubleWord, of_words
from jaxspatial.arithmetic.numbers.number import as_data, noinline_pairs, repeated, shape_of, times_power_of_two
from jaxspatial.arithmetic.numbers.trees import from_double_word
from jaxspatial.arithmetic.precision import Precision

# Indices of 32 bits: those of 64, first used while 64-bit types are off, fail for good once they are on (jax 0.10).
_TO_NINE = np.array([0, 1, 3, 1, 2, 4, 3, 4, 5], np.int32)
_OF_NINE = np.array([0, 3, 4, 6, 7, 8], np.int32)
# Jacobi's sweeps until nothing changes any more, found on random, graded and clustered matrices.
_SWEEPS = {np.dtype(np.float32): 5, np.dtype(np.float64): 6}
_SWEEPS_OF_DOUBLE_WORDS = 7


def to_matrix(six: jax.Array) -> jax.Array:
    """(*batch, 3, 3) of (*batch, 6)."""
    return picked(six, _TO_NINE).reshape((*six.shape[:-1], 3, 3))


def picked(x: Any, places: np.ndarray) -> Any:
    """x[..., places], of slices: an index by arrays would be a gather. What is known stays so."""
    if not isinstance(x, (jax.Array, DoubleWord)):
        return x[..., places]

    def of_word(word: Any) -> jax.Array:
        return jnp.stack([word[..., i] for i in places.tolist()], -1)

    return jax.tree.map(of_word, x)


def from_matrix(m: jax.Array) -> jax.Array:
    """(*batch, 6) of (*batch, 3, 3), of which the lower triangle is read."""
    return m.reshape((*m.shape[:-2], 9))[..., _OF_NINE]


# -- of numbers -------------------------------------------------------------------------------------------------------


def rows(six: Symmetric) -> Rows:
    """The rows of the matrix."""
    xx, xy, yy, xz, yz, zz = six
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def six_of(m: Rows) -> Symmetric:
    """The six components of a matrix by its rows, of which the lower triangle is read."""
    return m[0][0], m[1][0], m[1][1], m[2][0], m[2][1], m[2][2]


def trace_minus(six: Symmetric) -> Symmetric:
    """tr(S) 1 - S: from second moments to an inertia, without a difference on the diagonal."""
    xx, xy, yy, xz, yz, zz = six
    return yy + zz, -xy, xx + zz, -xz, -yz, xx + yy


# -- eigenvalues ------------------------------------------------------------------------------------------------------


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def eigen(precision: Precision, six: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(eigenvalues (*batch, 3) ascending, eigenvectors (*batch, 9)), of (*batch, 6), arrays or double words.

    The eigenvectors are the columns of a rotation matrix, given row by row: signed unit vectors where the matrix is
    diagonal up to 2 eps of the trace, the identity where the eigenvalues differ by no more than 4 eps of it. Cyclic
    Jacobi: error of the eigenvalues at most 8 u times the largest, of the eigenvectors that over the distance between
    eigenvalues. [Golub and Van Loan 2013, 8.5]

    Derivatives, with eps the derivative of the matrix in the frame of the eigenvectors: d l_i = eps_ii and dQ = Q W
    with W_ij = eps_ij / (l_j - l_i), 0 where l_i = l_j: there eigenvectors have no derivative, and this is one of the
    rotations that leave them eigenvectors. Accurate as in "reproducible", whatever the precision.
    """
    return tuple(_decomposed(precision, six, eps=check.eps(six.dtype)))


@eigen.defjvp  # pyright: ignore[reportFunctionMemberAccess]
def _eigen_jvp(precision: Precision, primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    moments, axes = cast(tuple[Any, Any], eigen(precision, *primals))
    plain = from_double_word((moments, axes, *tangents))
    rates = _rates(Precision.REPRODUCIBLE, *plain)
    return (moments, axes), tuple(map(_tangent_like, (moments, axes), rates))


def _tangent_like(x: Any, rate: Any) -> Any:
    """The tangent of a double word lies in its first word."""
    return of_words((rate, jnp.zeros_like(rate))) if _is_double(x) else rate


def _is_double(x: Any) -> bool:
    return isinstance(x, DoubleWord)


@formula
def _rates(moments: Numbers, axes: Numbers, d_six: Symmetric) -> list[Numbers]:
    q = vectors.rows(axes)
    turned = vectors.matrix_product(vectors.transpose(q), vectors.matrix_product(rows(d_six), q))
    spin = tuple(tuple(_spin(moments, turned, i, j) for j in range(3)) for i in range(3))
    return [tuple(turned[i][i] for i in range(3)), vectors.flat(vectors.matrix_product(q, spin))]


def _spin(moments: Numbers, turned: Rows, i: int, j: int) -> Number:
    gap = moments[j] - moments[i]
    is_none = high(gap) == 0
    return turned[i][j] * where(is_none, 0.0, 1 / where(is_none, 1.0, gap))


@formula
def _decomposed(six: Symmetric, eps: float) -> list[Numbers]:
    six, e = vectors.scaled(six)
    moments, axes = _sorted(*_jacobi(six))
    xx, xy, yy, xz, yz, zz = six
    trace = abs(high(xx + yy + zz))
    largest = functools.reduce(jnp.maximum, (abs(high(x)) for x in (xy, xz, yz)))
    is_round = high(moments[2] - moments[0]) <= 4 * eps * trace
    identity = _identity(xx)
    _, permutation = _sorted((xx, yy, zz), identity)
    axes = _chosen(is_round, identity, _chosen(largest <= 2 * eps * trace, permutation, axes))
    return [tuple(times_power_of_two(x, e) for x in moments), vectors.flat(axes)]


def _chosen(mask: Mask, a: Rows, b: Rows) -> Rows:
    return tuple(tuple(where(mask, x, y) for x, y in zip(p, q, strict=True)) for p, q in zip(a, b, strict=True))


def _identity(like: Number) -> Rows:
    return tuple(tuple(constant(like, int(i == j)) for j in range(3)) for i in range(3))


def _sorted(moments: Numbers, axes: Rows) -> tuple[Numbers, Rows]:
    """In ascending order, equal ones as they are. Where that is an odd permutation the third axis is reversed."""
    moments, columns = list(moments), list(vectors.transpose(axes))
    is_odd = np.False_
    for i, j in ((0, 1), (1, 2), (0, 1)):
        swap = high(moments[i]) > high(moments[j])
        moments[i], moments[j] = _exchanged(swap, moments[i], moments[j])
        pairs = [_exchanged(swap, x, y) for x, y in zip(columns[i], columns[j], strict=True)]
        columns[i], columns[j] = zip(*pairs, strict=True)
        is_odd = is_odd ^ swap
    columns[2] = tuple(where(is_odd, -x, x) for x in columns[2])
    return tuple(moments), vectors.transpose(columns)


def _exchanged(swap: Mask, a: Number, b: Number) -> tuple[Number, Number]:
    return where(swap, b, a), where(swap, a, b)


def _jacobi(six: Symmetric) -> tuple[Numbers, Rows]:
    """(the diagonal, the rotation by its rows), in a loop over sweeps: fused into one another, rotations would be
    computed again for every component of the result."""
    start = [*six, *vectors.flat(_identity(six[0]))]
    shape = np.broadcast_shapes(*map(shape_of, start))
    sweeps = _SWEEPS_OF_DOUBLE_WORDS if _is_double(six[0]) else _SWEEPS[six[0].dtype]
    found = repeated(_swept, sweeps, [as_data(x, shape) for x in start])
    return (found[0], found[2], found[5]), vectors.rows(found[6:])


def _swept(numbers: Numbers) -> Numbers:
    """One rotation in each of the three planes."""
    a, columns = rows(numbers[:6]), vectors.transpose(vectors.rows(numbers[6:]))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        a, columns = _rotated(a, columns, i, j)
    return *six_of(a), *vectors.flat(vectors.transpose(columns))


def _rotated(a: Rows, columns: Rows, i: int, j: int) -> tuple[Rows, Rows]:
    """After the rotation about the third axis that makes a_ij zero."""
    k = 3 - i - j
    t, c, s = _rotation(a[i][i], a[i][j], a[j][j])
    moved = t * a[i][j]
    entries = {(i, i): a[i][i] - moved, (j, j): a[j][j] + moved, (k, k): a[k][k], (i, j): constant(t, 0)}
    entries[i, k], entries[j, k] = c * a[i][k] - s * a[j][k], s * a[i][k] + c * a[j][k]
    turned = [c * x - s * y for x, y in zip(columns[i], columns[j], strict=True)]
    across = [s * x + c * y for x, y in zip(columns[i], columns[j], strict=True)]
    new = {i: turned, j: across, k: columns[k]}
    symmetric = tuple(tuple(entries[(m, n) if (m, n) in entries else (n, m)] for n in range(3)) for m in range(3))
    return symmetric, tuple(tuple(new[m]) for m in range(3))


@noinline_pairs
def _rotation(a_ii: Number, a_ij: Number, a_jj: Number) -> tuple[Number, Number, Number]:
    """(tangent, cosine, sine) of the smaller angle that does; none where a_ij is nothing next to a matrix of size 1."""
    across, apart_by = 2 * a_ij, a_jj - a_ii
    is_nothing = abs(high(across)) <= float(unit_roundoff(across)) ** 2
    across = where(is_nothing, 0.0, across)
    distance = (apart_by * apart_by + across * across).sqrt()
    denominator = abs(apart_by) + distance
    t = across / where(is_nothing, 1.0, denominator)
    t = where(high(apart_by) < 0, -t, t)
    c = 1 / (1 + t * t).sqrt()
    return t, c, t * c

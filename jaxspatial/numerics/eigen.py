"""Eigenvalues and axes of symmetric 3 x 3 matrices; and arrays of their six numbers as arrays of matrices.

The six are in the order of `linear.Symmetric`.
"""

import functools
import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.functions import unit_roundoff
from jaxspatial.numerics.linear import PLACES, WHICH_OF_SIX, Matrix, Symmetric, Vector, scaled
from jaxspatial.numerics.numbers import Number, constant, high, where
from jaxspatial.numerics.numbers.double_word import DoubleWord, from_double_word, of_limbs
from jaxspatial.numerics.numbers.number import as_data, noinline_pairs, repeated, shape_of, times_power_of_two
from jaxspatial.numerics.precision import Precision

# Indices of 32 bits: those of 64, first used while 64-bit types are off, fail for good once they are on (jax 0.10).
_TO_NINE = np.array(WHICH_OF_SIX, np.int32).ravel()
_OF_NINE = np.array([3 * i + k for i, k in PLACES], np.int32)
# Jacobi's sweeps until nothing changes any more, counted on random, graded and clustered matrices.
_SWEEPS = {np.dtype(np.float32): 5, np.dtype(np.float64): 6}
_SWEEPS_OF_DOUBLE_WORDS = 7


def matrix_of_six(six: jax.Array) -> jax.Array:
    """(*batch, 3, 3) of (*batch, 6)."""
    return at_places(six, _TO_NINE).reshape((*six.shape[:-1], 3, 3))


def at_places(x, places: np.ndarray):
    """x[..., places], of slices: an index by arrays would be a gather. What is known stays so."""
    if not isinstance(x, (jax.Array, DoubleWord)):
        return x[..., places]
    return jax.tree.map(lambda limb: jnp.stack([limb[..., i] for i in places.tolist()], -1), x)


def six_of_matrix(m: jax.Array) -> jax.Array:
    """(*batch, 6) of (*batch, 3, 3), of which the lower triangle is read."""
    return m.reshape((*m.shape[:-2], 9))[..., _OF_NINE]


# -- eigenvalues and axes ----------------------------------------------------------------------------------------------


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def decomposition(precision: Precision, six: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(eigenvalues (*batch, 3) ascending, eigenvectors (*batch, 9)), of (*batch, 6), arrays or double words.

    The eigenvectors are the columns of a rotation matrix, row by row: signed unit vectors where the matrix is
    diagonal up to 2 eps of the trace, the identity where the eigenvalues differ by no more than 4 eps of it. Cyclic
    Jacobi: error of the eigenvalues at most 8 u times the largest, of the eigenvectors that over the distance between
    eigenvalues. [Golub and Van Loan 2013, 8.5]

    Derivatives, with eps the derivative of the matrix in the frame of the eigenvectors: d l_i = eps_ii and dQ = Q W
    with W_ij = eps_ij / (l_j - l_i), 0 where l_i = l_j: there eigenvectors have no derivative, and this is one of the
    rotations that leave them eigenvectors. Accurate as in "reproducible", whatever the precision.
    """
    return tuple(_decomposed(precision, six, eps=floats.eps(six.dtype)))


@decomposition.defjvp
def _decomposition_jvp(precision: Precision, primals: tuple[Any], tangents: tuple[Any]) -> tuple:
    results = decomposition(precision, *primals)
    moved = _tangents(Precision.REPRODUCIBLE, *from_double_word((*results, *tangents)))
    if isinstance(results[0], DoubleWord):
        # The tangent of a double word lies in its leading limb.
        moved = [of_limbs((x, jnp.zeros_like(x))) for x in moved]
    return results, tuple(moved)


@formula
def _tangents(moments: Vector, Q: Matrix, d_six: Symmetric) -> list:
    turned, spin = Q.T @ (d_six @ Q), list[Number]()
    for i, j in itertools.product(range(3), repeat=2):
        gap = moments[j] - moments[i]
        is_none = high(gap) == 0
        spin.append(turned[i][j] * where(is_none, 0.0, 1 / where(is_none, 1.0, gap)))
    return [Vector(*(turned[i][i] for i in range(3))), Q @ Matrix.of_entries(spin)]


@formula
def _decomposed(six: Symmetric, eps: float) -> list:
    six, e = scaled(six)
    moments, axes = _sorted(*_jacobi(six))
    trace = abs(high(six.xx + six.yy + six.zz))
    largest = functools.reduce(jnp.maximum, (abs(high(x)) for x in (six.xy, six.xz, six.yz)))
    is_round = high(moments[2] - moments[0]) <= 4 * eps * trace
    identity = _identity(six.xx)
    _, permutation = _sorted((six.xx, six.yy, six.zz), identity)
    axes = _where(is_round, identity, _where(largest <= 2 * eps * trace, permutation, axes))
    return [Vector(*(times_power_of_two(x, e) for x in moments)), axes]


def _where(mask: jax.Array, a: Matrix, b: Matrix) -> Matrix:
    return Matrix.of_entries([where(mask, x, y) for x, y in zip(a.entries, b.entries, strict=True)])


def _identity(like: Number) -> Matrix:
    return Matrix.of_entries([constant(like, int(i == j)) for i in range(3) for j in range(3)])


def _sorted(moments: Sequence[Number], axes: Matrix) -> tuple[Sequence[Number], Matrix]:
    """In ascending order, equal ones as they are. Where that is an odd permutation the third axis is reversed."""
    columns, is_odd = [(m, *column) for m, column in zip(moments, axes.T, strict=True)], np.False_
    for i, j in ((0, 1), (1, 2), (0, 1)):
        swap = high(columns[i][0]) > high(columns[j][0])
        exchanged = [(where(swap, y, x), where(swap, x, y)) for x, y in zip(columns[i], columns[j], strict=True)]
        columns[i], columns[j] = zip(*exchanged, strict=True)
        is_odd = is_odd ^ swap
    first, second, third = (Vector(*column[1:]) for column in columns)
    third = Vector(*(where(is_odd, -x, x) for x in third))
    return [column[0] for column in columns], Matrix(first, second, third).T


def _jacobi(six: Symmetric) -> tuple[Sequence[Number], Matrix]:
    """(the diagonal, the rotation), in a loop over sweeps: fused into one another, rotations would be computed again
    for every component of the result."""
    start = [*six, *_identity(six.xx).entries]
    shape = floats.broadcast_shapes(*map(shape_of, start))
    sweeps = _SWEEPS_OF_DOUBLE_WORDS if isinstance(six.xx, DoubleWord) else _SWEEPS[six.xx.dtype]

    def sweep(numbers: Sequence[Number]) -> Sequence[Number]:
        """One rotation in each of the three planes."""
        a, columns = Symmetric(*numbers[:6]).matrix, Matrix.of_entries(numbers[6:]).T
        for i, j in ((0, 1), (0, 2), (1, 2)):
            a, columns = _rotated(a, columns, i, j)
        return *Symmetric.of_matrix(a), *columns.T.entries

    result = repeated(sweep, sweeps, [as_data(x, shape) for x in start])
    six = Symmetric(*result[:6])
    return (six.xx, six.yy, six.zz), Matrix.of_entries(result[6:])


def _rotated(a: Matrix, columns: Matrix, i: int, j: int) -> tuple[Matrix, Matrix]:
    """After the rotation about the third axis that makes a_ij zero."""
    k = 3 - i - j
    t, c, s = _rotation(a[i][i], a[i][j], a[j][j])
    moved = t * a[i][j]
    entries = {(i, i): a[i][i] - moved, (j, j): a[j][j] + moved, (k, k): a[k][k], (i, j): constant(t, 0)}
    entries[i, k], entries[j, k] = c * a[i][k] - s * a[j][k], s * a[i][k] + c * a[j][k]
    new = list(columns)
    new[i] = Vector(*(c * x - s * y for x, y in zip(columns[i], columns[j], strict=True)))
    new[j] = Vector(*(s * x + c * y for x, y in zip(columns[i], columns[j], strict=True)))
    symmetric = [entries[(m, n) if (m, n) in entries else (n, m)] for m in range(3) for n in range(3)]
    return Matrix.of_entries(symmetric), Matrix(*new)


@noinline_pairs
def _rotation(a_ii: Number, a_ij: Number, a_jj: Number) -> tuple[Number, Number, Number]:
    """(tangent, cosine, sine) of the smaller angle that does; none where a_ij is nothing next to a matrix of size 1."""
    across, difference = 2 * a_ij, a_jj - a_ii
    is_nothing = abs(high(across)) <= float(unit_roundoff(across)) ** 2
    across = where(is_nothing, 0.0, across)
    distance = (difference * difference + across * across).sqrt()
    denominator = abs(difference) + distance
    t = across / where(is_nothing, 1.0, denominator)
    t = where(high(difference) < 0, -t, t)
    c = 1 / (1 + t * t).sqrt()
    return t, c, t * c

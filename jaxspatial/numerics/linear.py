"""Vectors, 3 x 3 matrices, motions, wrenches, poses and inertias, whose entries are numbers of any kind.

They are named tuples, so JAX treats them as trees, and they have the operators of the textbooks:

    v + cross(w, p)        R @ v        R.T @ (tau - cross(p, f))        m * (a + E @ c)

Each operation is written out entry by entry: no axis of length 3 is reduced, and no matrix product calls a BLAS.
"""

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree import scaling
from jaxspatial.numerics.numbers import Number, Rounded, is_constant
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.numbers.number import constant, frozen, high, noinline_pairs, times_power_of_two, where
from jaxspatial.numerics.numbers.rounded import is_known


def entrywise(operation: Callable[..., Number], *lists: Sequence) -> list:
    """Applies an operation to each entry of some lists: [operation(a, b), ...].

    Double words are stacked first, so that the operation is compiled once for all entries.
    """
    if DoubleWord not in map(type, itertools.chain(*lists)) or len(lists[0]) == 1:
        return list(map(operation, *lists))
    pairs = [x for x in itertools.chain(*lists) if isinstance(x, DoubleWord)]
    shape = floats.broadcast_shapes(*(x.shape for x in pairs))
    both = [[x if isinstance(x, DoubleWord) else constant(pairs[0], x) for x in numbers] for numbers in lists]
    stacked = (jax.tree.map(lambda *y: jnp.stack([jnp.broadcast_to(z, shape) for z in y]), *x) for x in both)
    result: Any = noinline_pairs(operation)(*stacked)
    return [result[i] for i in range(len(lists[0]))]


class Partwise:
    """Adds `+ -` and multiples, part by part, to a named tuple of vectors and matrices."""

    __slots__ = ()
    # A NumPy number on the left of an operator then calls ours.
    __array_ufunc__ = None

    def __add__(self: Any, other):
        return self._make(map(operator.add, self, other))

    def __sub__(self: Any, other):
        return self._make(map(operator.sub, self, other))

    def __neg__(self: Any):
        return self._make(map(operator.neg, self))

    def __rmul__(self: Any, s: Number | float):
        return self._make([s * part for part in self])


class Entrywise(Partwise):
    """Adds `+ - * /`, entry by entry, to a named tuple of numbers."""

    __slots__ = ()

    def __add__(self: Any, other):
        return self._make(entrywise(operator.add, self, other))

    def __sub__(self: Any, other):
        return self._make(entrywise(operator.sub, self, other))

    def __mul__(self: Any, s: Number | float):
        return self._make(entrywise(operator.mul, self, (s,) * len(self)))

    def __rmul__(self: Any, s: Number | float):
        return self._make(entrywise(operator.mul, (s,) * len(self), self))

    def __truediv__(self: Any, s: Number | float):
        return self._make(entrywise(operator.truediv, self, (s,) * len(self)))


class _Three(NamedTuple):
    x: Number
    y: Number
    z: Number


class Vector(Entrywise, _Three):
    """Three Cartesian components."""

    __slots__ = ()


class _ThreeRows(NamedTuple):
    x: Vector
    y: Vector
    z: Vector


class Matrix(Partwise, _ThreeRows):
    """A 3 x 3 matrix by its rows."""

    __slots__ = ()

    @classmethod
    def of_entries(cls, nine: Sequence[Number]) -> "Matrix":
        """From nine numbers, row by row."""
        return cls(Vector(*nine[:3]), Vector(*nine[3:6]), Vector(*nine[6:]))

    @property
    def entries(self) -> tuple[Number, ...]:
        """The nine numbers, row by row."""
        return *self.x, *self.y, *self.z

    @property
    def T(self) -> "Matrix":
        return Matrix(*map(Vector, *self))

    def __matmul__(self, other) -> Any:
        """The product with a Vector, a Matrix or a Symmetric."""
        if isinstance(other, Matrix):
            columns = other.T
            return Matrix.of_entries(dots([(row, column) for row in self for column in columns]))
        if isinstance(other, Symmetric):
            return self @ other.matrix
        if isinstance(other, Vector):
            return Vector(*dots([(row, other) for row in self]))
        return NotImplemented


class _Six(NamedTuple):
    xx: Number
    xy: Number
    yy: Number
    xz: Number
    yz: Number
    zz: Number


# Where the six numbers stand in the matrix, and which of them each entry is.
PLACES = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
WHICH_OF_SIX = ((0, 1, 3), (1, 2, 4), (3, 4, 5))


class Symmetric(Entrywise, _Six):
    """A symmetric 3 x 3 matrix by six numbers: Pinocchio's order, the lower triangle row by row."""

    __slots__ = ()

    @classmethod
    def of_matrix(cls, m: Matrix) -> "Symmetric":
        """From the lower triangle of a matrix."""
        return cls(*(m[i][k] for i, k in PLACES))

    @classmethod
    def diagonal(cls, xx: Number, yy: Number, zz: Number) -> "Symmetric":
        zero = constant(xx, 0)
        return cls(xx, zero, yy, zero, zero, zz)

    @property
    def matrix(self) -> Matrix:
        xx, xy, yy, xz, yz, zz = self
        return Matrix(Vector(xx, xy, xz), Vector(xy, yy, yz), Vector(xz, yz, zz))

    def trace_minus(self) -> "Symmetric":
        """tr(S) 1 - S: the rotational inertia of second moments S. No diagonal entry is a difference."""
        xx, xy, yy, xz, yz, zz = self
        return Symmetric(yy + zz, -xy, xx + zz, -xz, -yz, xx + yy)

    def __matmul__(self, v) -> Any:
        return self.matrix @ v


class _Motion(NamedTuple):
    w: Vector
    v: Vector


class Motion(Partwise, _Motion):
    """A motion about a point: angular and linear velocity (w, v), or acceleration (alpha, a)."""

    __slots__ = ()


class _Wrench(NamedTuple):
    tau: Vector
    f: Vector


class Wrench(Partwise, _Wrench):
    """A wrench about a point: torque and force; or a momentum, angular and linear."""

    __slots__ = ()


class Pose(NamedTuple):
    """X_AB: rotation R_AB and position p_AoBo_A of frame B in frame A."""

    R: Matrix
    p: Vector


class Inertia(NamedTuple):
    """A rigid body about a point: mass, centre of mass from the point, inertia about the centre of mass."""

    mass: Number
    com: Vector
    central: Symmetric


class _Articulated(NamedTuple):
    J: Symmetric
    F: Matrix
    M: Symmetric


class Articulated(Partwise, _Articulated):
    """An articulated inertia [[J, F], [F^T, M]] about a point, see `jaxspatial.ArticulatedInertia`."""

    __slots__ = ()


class Summed(NamedTuple):
    """The pairwise sum of a vector over the last axis of the batch. A formula may return it, not compute with it."""

    vector: Any


_BY_SIZE: dict[int, Any] = {3: Vector._make, 6: Symmetric._make, 9: Matrix.of_entries}


def by_size(numbers: Sequence) -> Any:
    """Three numbers as a Vector, six as a Symmetric, nine as a Matrix; any other count as a tuple."""
    return _BY_SIZE.get(len(numbers), tuple)(numbers)


# -- products ----------------------------------------------------------------------------------------------------------


def left_sum(numbers: Iterable[Number]) -> Number:
    """Their sum, from the left. [Higham 2002, 4.1: recursive summation]"""
    return functools.reduce(operator.add, numbers)


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """a . b, summed from the left."""
    return left_sum(entrywise(operator.mul, a, b))


def dots(pairs: Sequence[tuple[Sequence[Number], Sequence[Number]]]) -> list[Number]:
    """The dot products of pairs of vectors of one length."""
    n = len(pairs[0][0])
    a, b = zip(*pairs, strict=True)
    products = entrywise(operator.mul, [x for v in a for x in v], [x for v in b for x in v])
    result = products[::n]
    for i in range(1, n):
        result = entrywise(operator.add, result, products[i::n])
    return result


def cross(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    """a x b."""
    (ax, ay, az), (bx, by, bz) = a, b
    products = entrywise(operator.mul, (ay, az, ax, az, ax, ay), (bz, bx, by, by, bz, bx))
    return Vector(*entrywise(operator.sub, products[:3], products[3:]))


def congruence(R: Matrix, S: Symmetric) -> Symmetric:
    """R S R^T: a symmetric matrix in other axes."""
    turned = R @ S
    return Symmetric(*(dot(turned[i], R[k]) for i, k in PLACES))


def skew(v: Sequence[Number]) -> Matrix:
    """[v]x, with [v]x y = v x y."""
    x, y, z = v
    zero = constant(x, 0)
    return Matrix(Vector(zero, -z, y), Vector(z, zero, -x), Vector(-y, x, zero))


def square(v: Sequence[Number]) -> tuple[Number, Number | None]:
    """|v|^2 as (rounded value, rounding error), for |v| <= 64; beyond, only as accurate as `dot`.

    Each component is rounded to a grid so coarse that the squares of its points add up without rounding. Numbers of two
    limbs need no such care: of these it is (dot(v, v), None).
    """
    if not isinstance(v[0], Rounded):
        return dot(v, v), None
    bits = floats.finfo(v[0].dtype).nmant + 1
    shift = constant(v[0], 1.5 * 2 ** (bits - 1 - (bits - 12) // 2))
    grid = tuple((x + shift) - shift for x in v)
    coarse = dot(grid, grid)
    fine = left_sum([(x + y) * (x - y) for x, y in zip(v, grid, strict=True)])
    rounded = coarse + fine
    return rounded, frozen(fine - (rounded - coarse))


# -- lengths -----------------------------------------------------------------------------------------------------------


def scaled(v: Sequence[Number]) -> tuple:
    """(v 2^-e, e), with the largest component between 1/2 and 1, so that squares neither over- nor underflow."""
    values = [high(x) for x in v]
    if all(map(is_known, values)):
        largest = float(max(abs(x) for x in values))
        e = np.int32(math.frexp(largest)[1] if math.isfinite(largest) else 0)
    else:
        e = scaling.exponent(values)
    return by_size([times_power_of_two(x, -e) for x in v]), e


@noinline_pairs
def unit(v: Sequence[Number]):
    """v / |v|: NaN for zero, and where a component is infinite or NaN."""
    if isinstance(v[0], DoubleWord) or all(map(is_constant, v)):
        v = scaled(v)[0]
    else:
        # Some power of two that keeps squares in range; which one, nobody asks.
        s = scaling.reciprocal([high(x) for x in v])
        v = [x.with_limbs(w if is_known(w, 0) else w * s for w in x.limbs) for x in v]
    length = dot(v, v).sqrt()
    length = where(high(length) < math.inf, length, math.nan)
    return by_size(entrywise(operator.truediv, v, (length,) * len(v)))


@noinline_pairs
def norm(v: Sequence[Number]) -> Number:
    """|v|, without intermediate over- or underflow. At 0 its derivatives are 0: the subgradient of least norm."""
    v, e = scaled(v)
    squared = dot(v, v)
    is_zero = high(squared) == 0
    length = where(is_zero, 0.0, where(is_zero, 1.0, squared).sqrt())
    return times_power_of_two(length, e)

"""Inputs on which bounds are tried, with exact results: every family and condition number in one batch.

One batch, because compiling is what takes the time; and exact results are shared by all precisions and surroundings.
"""

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.measure.error import rationals, unit_roundoff
from jaxspatial.measure.inputs import CONDITIONED, FAMILIES, products_with_condition
from jaxspatial.numerics.promise import EXACT
from tests.helpers.operation import Operation, violations
from tests.helpers.operations import OPERATIONS

N, FEW = 12, 2


class Case(NamedTuple):
    """Arrays for an operation, and what it makes of them exactly."""

    operation: Operation
    arrays: list
    exact: Any

    def check(self, precision, results, note, parts=None, flushed=0):
        """Asserts that the results, by default all parts, keep their bounds."""
        parts = range(len(self.exact)) if parts is None else parts
        for part, computed in zip(parts, results, strict=True):
            bound = (self.operation.bounds or ())[part]
            given = "compensated" if str(precision) == "faithful" and not self.operation.is_of_sums else str(precision)
            wrong = _violations(bound, given, np.asarray(computed), _Key(self.exact[part]), flushed)
            assert not wrong.any(), (self.operation.name, note, part, self.example(wrong, np.asarray(computed), part))

    def example(self, wrong, computed, part):
        """The first item on which a bound is broken."""
        i = np.argwhere(wrong)[0][0]
        exactly = [float(x.value) for x in np.ravel(self.exact[part][i])]
        return f"{wrong.sum()} wrong", "first", i, [x[i].tolist() for x in self.arrays], computed[i], exactly


def single_items(f):
    """One compiled call for each item: on scalars the compiler rewrites what it leaves alone in batches."""
    compiled = jax.jit(f)

    def call(*arrays):
        # Of NumPy: to take JAX's apart is a program of its own, which compiles long.
        items = zip(*map(np.asarray, arrays), strict=True)
        return [np.stack(x) for x in zip(*(compiled(*item) for item in items), strict=True)]

    return call


# How a function of one item is applied to all: in one program of arrays, and in programs of scalars.
SURROUNDINGS = {
    "jit vmap": lambda f: jax.jit(jax.vmap(f)),
    "single items": single_items,
    "lax.map": lambda f: jax.jit(lambda *a: lax.map(lambda item: f(*item), a)),
}


class _Key(NamedTuple):
    array: Any

    def __hash__(self):
        return id(self.array)

    def __eq__(self, other):
        return self.array is other.array


_known = {}


def _violations(bound, precision, computed, key, flushed):
    """Of one result only once, however many surroundings give the same bits."""
    where = (bound, precision, computed.dtype, computed.tobytes(), key, flushed)
    if where not in _known:
        _known[where] = violations(bound, precision, computed, key.array, flushed)
    return _known[where]


@functools.cache
def case(name, dtype):
    """The Case of an operation: all families of `measure.inputs`, and condition numbers from 10 to infinity."""
    return made(name, _drawn(name, dtype, np.random.default_rng(7), N))


@functools.cache
def case_of_few(name, dtype):
    """As `case`, few of each; and some of which nearly all cancels, whatever the operation."""
    rng = np.random.default_rng(7)
    groups = [_drawn(name, dtype, rng, FEW), *(cancelling(name, rng, FEW, dtype, numbers) for numbers in (1, 2, 3))]
    return made(name, [np.concatenate(x) for x in zip(*groups, strict=True)])


def _drawn(name, dtype, rng, n):
    groups = [arranged(name, family, rng, n, dtype) for family in FAMILIES.values()]
    if name in _CONDITIONED:
        groups += [_CONDITIONED[name](rng, n, dtype, condition) for condition in conditions(dtype)]
    return [np.concatenate(x) for x in zip(*groups, strict=True)]


def made(name, arrays):
    """The Case of an operation for these arrays."""
    operation = OPERATIONS[name]
    if name in _DEFINED:
        arrays = [x[np.asarray(_DEFINED[name](*arrays), bool)] for x in arrays]
    return Case(operation, arrays, operation.sized(arrays))


def arranged(name, family, rng, n, dtype):
    """Arrays of a family in the shapes that the operation takes."""
    shapes = OPERATIONS[name].shapes
    rows = max(-(-math.prod(shape) // 3) for shape in shapes)
    vectors = family(rng, len(shapes), n * rows, jnp.dtype(dtype))
    flat = (x.reshape(n, -1) for x in vectors)
    return [x[:, : math.prod(shape)].reshape(n, *shape) for x, shape in zip(flat, shapes, strict=True)]


def cancelling(name, rng, n, dtype, numbers):
    """Arrays of which one number of the result is left with about u^numbers of its terms, for any operation.

    In each item so many numbers of the arguments, each u times as large as the one before, are set in turn to where the
    number of the result is zero, by a secant: of sums of products a step or two away.
    """
    operation, u = OPERATIONS[name], float(unit_roundoff(dtype))
    drawn = operation.arrays((n,), "float64", int(rng.integers(1 << 30)))
    flat, items = np.concatenate([x.reshape(n, -1) for x in drawn], 1), np.arange(n)
    places = [rng.permutation(flat.shape[1])[:numbers] for _ in range(n)]
    for k, at in enumerate(np.transpose(places)):
        flat[items, at] *= u**k
    flat = flat.astype(jnp.dtype(dtype))
    of_result = rng.integers(1 << 30, size=n)

    def arrays(flat):
        parts = np.split(flat, np.cumsum([math.prod(shape) for shape in operation.shapes])[:-1], 1)
        return [x.reshape(n, *shape) for x, shape in zip(parts, operation.shapes, strict=True)]

    def number(exact):
        found = operation.over(arrays(exact))
        parts = [x for x, bound in zip(found, operation.bounds, strict=True) if bound != EXACT]
        results = np.concatenate([np.reshape(x, (n, -1)) for x in parts], 1)
        return results[items, of_result % results.shape[1]] + 0 * exact[:, 0]

    for at in np.transpose(places):
        before = rationals(flat)
        after = before.copy()
        step = np.where(before[items, at] == 0, 1, before[items, at])
        after[items, at] += step
        value = number(before)
        slope = (number(after) - value) / step
        moved = before[items, at] - value / np.where(slope == 0, 1, slope) * (slope != 0)
        flat[items, at] = moved.astype(float).astype(flat.dtype)
    return arrays(flat)


def conditions(dtype):
    u = float(unit_roundoff(dtype))
    return (10.0, u**-0.5, 0.3 / u, 3 / u, u**-1.5, np.inf)


def _conditioned(name, *order):
    """The generator of that name, its arrays in another order."""
    return lambda *arguments: [CONDITIONED[name](*arguments)[i] for i in order]


def _opposed(rng, n, dtype, condition):
    """w, v, x, y: w x y + v x x has about that condition number, v being y and x being w but for 1 / condition."""
    w, y, d, e = rng.standard_normal((4, n, 3))
    w, y = w.astype(dtype), y.astype(dtype)
    return [w, (y + d / condition).astype(dtype), (w + e / condition).astype(dtype), y]


def _opposed_force(*arguments):
    w, v, x, y = _opposed(*arguments)
    return [w, v, y, x]


def wrench(rng, n, dtype, condition, items=5):
    """points, forces (n, items, 3): tau_z = sum of p_x f_y - p_y f_x has that condition number, up to 1/u^1.9."""
    condition = min(condition, float(unit_roundoff(dtype)) ** -1.9)
    x, y = products_with_condition(rng, 2 * items, n, dtype, condition)
    p, f = rng.standard_normal((2, n, items, 3)).astype(dtype)
    p[..., 0], p[..., 1] = x[:, :items], x[:, items:]
    f[..., 1], f[..., 0] = y[:, :items], -y[:, items:]
    return [p, f]


def _across(rng, v, condition):
    """Vectors whose product with v has about that condition number."""
    wide = v.astype(np.float64)
    return (np.cross(wide, rng.standard_normal(v.shape)) + wide / condition).astype(v.dtype)


def _pressed(rng, n, dtype, condition):
    """tau, f, normal: what presses cancels."""
    tau, normal = rng.standard_normal((2, n, 3)).astype(dtype)
    return [tau, _across(rng, normal, condition), normal]


def _rotated(rng, n, dtype, condition):
    """entries, tau, f: the torque is nearly orthogonal to all rows."""
    tau, f = rng.standard_normal((2, n, 3)).astype(dtype)
    return [np.concatenate([_across(rng, tau, condition) for _ in range(3)], -1), tau, f]


# Whether an item has a result at all.
_DEFINED = {
    "central_axis": lambda tau, f: (f != 0).any(-1),
    "center_of_pressure": lambda tau, f, normal: (rationals(normal) * rationals(f)).sum(-1) != 0,
}
_CONDITIONED = {
    "shift_force": _conditioned("shift_force", 0, 1, 2),
    "shift_momentum": _conditioned("shift_force", 0, 1, 2),
    "shift_velocity": _conditioned("shift_velocity", 0, 1, 2),
    "shift_acceleration": _conditioned("shift_acceleration", 0, 1, 2, 3),
    "dot_force_velocity": _conditioned("dot", 0, 1, 2, 3),
    "dot_momentum_velocity": _conditioned("dot", 0, 1, 2, 3),
    "dot_velocity_force": _conditioned("dot", 2, 3, 0, 1),
    "dot_velocity_momentum": _conditioned("dot", 2, 3, 0, 1),
    "cross_velocity": _opposed,
    "cross_acceleration": _opposed,
    "cross_force": _opposed_force,
    "cross_momentum": _opposed_force,
    "wrench_from_point_forces": wrench,
    "rotate": _rotated,
    "center_of_pressure": _pressed,
}

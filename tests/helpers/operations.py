"""The table of operations over which every transformation and every law is tested: a new operation is one line.

An operation says which arguments it takes, what it does with one item (and, by broadcasting, with a batch), and the
naive formula over the arrays that its arguments consist of. The formula runs over numbers of any kind: over NumPy
floats, rounded operation by operation, it gives the bits to expect; over fractions the exact value; over `Sized`
fractions also mag, in units of which the docstrings promise their bounds; over `duals.Dual` derivatives of all these.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js
from jaxspatial.arithmetic.promise import EXACT, Promise
from jaxspatial.inertia.promises import ABOUT, ARTICULATED_SHIFT, ARTICULATED_TIMES, ENERGY, FORCE, REGRESSOR, TORQUE
from jaxspatial.measure import error
from jaxspatial.measure.exact import attribute, rationals, sized
from jaxspatial.rotation.promises import ROTATED
from jaxspatial.rotation.rotation import composed
from jaxspatial.spatial.promises import (
    ACT,
    ACT_ACCELERATION,
    CENTRAL_AXIS,
    COMPOSED,
    COMPOSED_ACCELERATION,
    CROSS_ONE,
    CROSS_TWO,
    DOT,
    POINT,
    PRESSED,
    ROTATED_INERTIA,
    SHIFT,
    SHIFT_ACCELERATION,
    of_sum,
)
from jaxspatial.spatial.transform import transformed

N_POINTS = 5
DTYPES = ("float16", "bfloat16", "float32", "float64")

# The arguments an operation may take: the shapes of the arrays of one item, and what they are made into.
_ARGUMENTS = {
    "F": ([(3,), (3,)], js.SpatialForce),
    "L": ([(3,), (3,)], js.SpatialMomentum),
    "V": ([(3,), (3,)], js.SpatialVelocity),
    "A": ([(3,), (3,)], js.SpatialAcceleration),
    "R": ([(9,)], js.Rotation),
    "X": ([(9,), (3,)], lambda entries, p: js.RigidTransform(js.Rotation(entries), p)),
    "vector": ([(3,)], lambda x: x),
    "M": ([(), (3,), (6,)], js.SpatialInertia),
    "P": ([(6,), (9,), (6,)], js.ArticulatedInertia),
    "points": ([(N_POINTS, 3)], lambda x: x),
    "forces": ([(N_POINTS, 3), (N_POINTS, 3)], js.SpatialForce),
    "coefficients": ([(6,)], lambda x: x),
    "scalar": ([()], lambda x: x),
}


class Operation(NamedTuple):
    """One line of the table."""

    name: str
    arguments: str
    function: Callable
    formula: Callable
    # Per array of the result. None: an operation without a precision.
    bounds: tuple | None = None
    differentiable: bool = True
    # The operation that runs the same formula, of other types: what is told of that one need not be told again.
    twin: str | None = None
    # A result of many terms of many factors, which takes long to compile in precision "faithful".
    is_long: bool = False

    @property
    def shapes(self):
        """Of one item, the shapes of the arrays that the arguments consist of."""
        return [shape for argument in self.arguments.split() for shape in _ARGUMENTS[argument][0]]

    def build(self, arrays):
        """The arguments that consist of these arrays."""
        remaining = iter(arrays)
        kinds = (_ARGUMENTS[argument] for argument in self.arguments.split())
        return tuple(kind(*(next(remaining) for _ in shapes)) for shapes, kind in kinds)

    def inputs(self, batch_shape, dtype, rng):
        """Random arguments as a tuple of trees of NumPy arrays, components of size 1, none of them zero."""
        return self.build(rng.standard_normal((*batch_shape, *shape)).astype(jnp.dtype(dtype)) for shape in self.shapes)

    def on_arrays(self, precision):
        """The operation as a function of arrays that gives a list of arrays."""
        return lambda *arrays: jax.tree.leaves(self.function(*self.build(arrays), precision=precision))

    def naive(self, *inputs):
        """The result of the formula as a list of arrays, in the order of the leaves of the result of `function`."""
        leaves = jax.tree.leaves(inputs)
        if getattr(leaves[0], "dtype", None) != jnp.bfloat16:
            return [np.asarray(x) for x in self.formula(*leaves)]
        # Evaluated in float32, and rounded once.
        wide = self.formula(*(np.asarray(x).astype(np.float32) for x in leaves))
        return [np.asarray(x).astype(jnp.bfloat16) for x in wide]

    def sized(self, *inputs):
        """As `naive`, exactly: arrays of `Sized`."""
        return [np.asarray(x) for x in self.formula(*map(sized, jax.tree.leaves(inputs)))]


def violations(bound, precision, computed, exact, flushed=0):
    """The places of a computed array where the bound is broken, as a mask; `flushed`: so many finfo.tiny are forgiven.

    Where the exact value is below the smallest normal number, that number is forgiven: it may be flushed to zero.
    Where it is above the largest, nothing is promised here.
    """
    computed = np.asarray(computed)
    tiny, largest = (Fraction(float(getattr(jnp.finfo(computed.dtype), name))) for name in ("tiny", "max"))
    value = attribute(exact, "value")
    allowed = _allowed(bound, precision, exact, computed.dtype) + flushed * tiny
    allowed = allowed + tiny * ((value != 0) & (abs(value) < tiny)).astype(int) if bound != EXACT else allowed
    finite = np.isfinite(computed.astype(np.float64))
    wrong = abs(rationals(np.where(finite, computed, np.zeros_like(computed))) - value) > allowed
    in_range = (abs(value) <= largest).astype(bool)
    condition = attribute(exact, "condition")
    is_promised = bound.is_given(precision, error.unit_roundoff(computed.dtype), condition).astype(bool)
    return (~finite | wrong.astype(bool)) & in_range & is_promised


def _allowed(promise, precision, exact, dtype):
    """For every number of an array of `Sized`, as Fractions."""
    value, mag, condition = (attribute(exact, name) for name in ("value", "mag", "condition"))
    return error.allowed(promise, precision, value, mag, dtype, condition)


def _sum_of_three(x):
    return (x[..., 0] + x[..., 1]) + x[..., 2]


def _sum_of_points(x):
    return ((x[..., 0, :] + x[..., 4, :]) + x[..., 2, :]) + (x[..., 1, :] + x[..., 3, :])


def _pairing(tau, f, w, v):
    return (_sum_of_three(tau * w) + _sum_of_three(f * v),)


def _reversed_pairing(w, v, tau, f):
    return _pairing(tau, f, w, v)


def _shifted_force(tau, f, p):
    return tau - np.cross(p, f), f


def _cross_motion(w, v, x, y):
    return np.cross(w, x), np.cross(w, y) + np.cross(v, x)


def _cross_force(w, v, tau, f):
    return np.cross(w, tau) + np.cross(v, f), np.cross(w, f)


def _rows(entries):
    return entries.reshape((*entries.shape[:-1], 3, 3))


def _columns(entries):
    return np.swapaxes(_rows(entries), -1, -2)


def _turned(rows, v):
    return _sum_of_three(rows * v[..., None, :])


def _rotated(entries, tau, f):
    return tuple(_turned(_rows(entries), part) for part in (tau, f))


def _product(left, right):
    entries = _sum_of_three(_rows(left)[..., :, None, :] * _columns(right)[..., None, :, :])
    return entries.reshape((*entries.shape[:-2], 9))


def _transformed(entries, p, q):
    return (p + _turned(_rows(entries), q),)


def _transforms(entries, p, entries2, p2):
    return _product(entries, entries2), *_transformed(entries, p, p2)


def _inverse_times(entries, p, entries2, p2):
    inverse = _columns(entries).reshape(entries.shape)
    return _product(inverse, entries2), _turned(_columns(entries), p2 - p)


def _moved(entries, p, x, y):
    new = _turned(_rows(entries), x)
    return new, _turned(_rows(entries), y) + np.cross(p, new)


def _moved_back(entries, p, x, y):
    return _turned(_columns(entries), x), _turned(_columns(entries), y - np.cross(p, x))


def _moved_acceleration(entries, p, alpha, a, w):
    new, spin = (_turned(_rows(entries), x) for x in (alpha, w))
    moved = _turned(_rows(entries), a) + np.cross(p, new)
    return new, moved + np.cross(spin, np.cross(p, spin))


def _acceleration_moved_back(entries, p, alpha, a, w):
    moved = (a + np.cross(alpha, p)) + np.cross(w, np.cross(w, p))
    return _turned(_columns(entries), alpha), _turned(_columns(entries), moved)


def _composed_velocity(w, v, p, w2, v2):
    return w + w2, (v + np.cross(w, p)) + v2


def _composed_acceleration(alpha, a, p, w, w2, v2, alpha2, a2):
    coriolis = np.cross(w, v2)
    moved = (a + np.cross(alpha, p)) + np.cross(w, np.cross(w, p))
    return (alpha + alpha2) + np.cross(w, w2), (moved + (coriolis + coriolis)) + a2


_SYMMETRIC = np.array([0, 1, 3, 1, 2, 4, 3, 4, 5])


def _turned_six(rows, six):
    """R S R^T by its six entries."""
    half = _sum_of_three(_rows(six[..., _SYMMETRIC])[..., None, :, :] * rows[..., :, None, :])
    full = _sum_of_three(half[..., :, None, :] * rows[..., None, :, :])
    return np.stack([full[..., i, j] for i in range(3) for j in range(i + 1)], -1)


def _rotated_inertia(entries, mass, com, central):
    return mass, _turned(_rows(entries), com), _turned_six(_rows(entries), central)


def _acted_inertia(entries, p, mass, com, central):
    return mass, p + _turned(_rows(entries), com), _turned_six(_rows(entries), central)


def _inertia_acted_back(entries, p, mass, com, central):
    return mass, _turned(_columns(entries), com - p), _turned_six(_columns(entries), central)


def _applied(mass, com, central, alpha, a):
    f = mass[..., None] * (a + np.cross(alpha, com))
    return _turned(_rows(central[..., _SYMMETRIC]), alpha) + np.cross(com, f), f


def _twice_energy(mass, com, central, w, v):
    moved = v + np.cross(w, com)
    spinning = _sum_of_three(w * _turned(_rows(central[..., _SYMMETRIC]), w))
    return (mass * _sum_of_three(moved * moved) + spinning,)


def _from_origin(M, precision=None):
    return js.SpatialInertia.from_origin(M.mass, M.com, M.central, precision=precision)


def _first_moment(mass, com):
    return mass[..., None] * com


def _steiner(mass, com):
    """m (|c|^2 1 - c c^T) by its six entries."""
    p = _first_moment(mass, com)
    xx, yy, zz = (p[..., i] * com[..., i] for i in range(3))
    xy, xz, yz = (p[..., i] * com[..., j] for i, j in ((0, 1), (0, 2), (1, 2)))
    return np.stack([yy + zz, -xy, xx + zz, -xz, -yz, xx + yy], -1)


def _about_origin(mass, com, central):
    return central + _steiner(mass, com)


def _skew(v):
    zero, (x, y, z) = v[..., 0] - v[..., 0], (v[..., i] for i in range(3))
    return _matrix([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


def _matrix(rows):
    return np.stack([np.stack(row, -1) for row in rows], -2)


def _times_one(m):
    zero = m - m
    return _matrix([[m if i == j else zero for j in range(3)] for i in range(3)])


def _blocks(a, b, c, d):
    return np.concatenate([np.concatenate(row, -1) for row in ((a, b), (c, d))], -2)


def _six_by_six(mass, com, central):
    arm = _skew(_first_moment(mass, com))
    inertia = _rows(_about_origin(mass, com, central)[..., _SYMMETRIC])
    return (_blocks(inertia, arm, np.swapaxes(arm, -1, -2), _times_one(mass)),)


def _dynamic_parameters(mass, com, central):
    parts = mass[..., None], _first_moment(mass, com), _about_origin(mass, com, central)
    return (np.concatenate(parts, -1),)


def _twice_pseudo_inertia(mass, com, central):
    p = _first_moment(mass, com)
    xx, xy, yy, xz, yz, zz = (central[..., i] for i in range(6))

    def diagonal(i, a, b, minus):
        square = p[..., i] * com[..., i]
        return ((a + b) - minus) + (square + square)

    def product(i, j, entry):
        half = p[..., i] * com[..., j] - entry
        return half + half

    a, b, c = diagonal(0, yy, zz, xx), diagonal(1, xx, zz, yy), diagonal(2, xx, yy, zz)
    d, e, f = product(0, 1, xy), product(0, 2, xz), product(1, 2, yz)
    x, y, z = (p[..., i] + p[..., i] for i in range(3))
    return (_matrix([[a, d, e, x], [d, b, f, y], [e, f, c, z], [x, y, z, mass + mass]]),)


def _motion_matrix(entries, p):
    rows = _rows(entries)
    moved = np.swapaxes(np.cross(p[..., None, :], np.swapaxes(rows, -1, -2)), -1, -2)
    return (_blocks(rows, rows - rows, moved, rows),)


def _inverse(entries, p):
    return _columns(entries).reshape(entries.shape), -_turned(_columns(entries), p)


def _articulated(mass, com, central):
    arm = _skew(_first_moment(mass, com))
    m = _times_one(mass)
    lower = np.stack([m[..., i, j] for i in range(3) for j in range(i + 1)], -1)
    return _about_origin(mass, com, central), arm.reshape((*arm.shape[:-2], 9)), lower


def _articulated_times(j, f, m, alpha, a):
    J, F, M = _rows(j[..., _SYMMETRIC]), _rows(f), _rows(m[..., _SYMMETRIC])
    return _turned(J, alpha) + _turned(F, a), _turned(np.swapaxes(F, -1, -2), alpha) + _turned(M, a)


def _articulated_shifted(j, f, m, p):
    F, M, arm = _rows(f), _rows(m[..., _SYMMETRIC]), p[..., None, :]
    new = F - np.swapaxes(np.cross(arm, M), -1, -2)
    before, after = np.cross(F, arm), np.cross(new, arm)
    added = [before[..., k, i] + after[..., i, k] for i in range(3) for k in range(i + 1)]
    return j + np.stack(added, -1), new.reshape((*new.shape[:-2], 9)), m


def _regressor(alpha, a, w):
    """Rows of m, of m c, of the moments."""
    alpha, a, w = np.broadcast_arrays(alpha, a, w)
    torque = _moments(alpha) + np.cross(w[..., None, :], np.swapaxes(_moments(w), -1, -2)).swapaxes(-1, -2)
    force = _skew(alpha) + np.cross(w[..., None, :], np.swapaxes(_skew(w), -1, -2)).swapaxes(-1, -2)
    nothing = a[..., None] - a[..., None]
    none = torque - torque
    return (_blocks_of_ten((nothing, -_skew(a), torque), (a[..., None], force, none)),)


def _blocks_of_ten(top, bottom):
    return np.concatenate([np.concatenate(row, -1) for row in (top, bottom)], -2)


def _moments(x):
    """The matrix that gives I x of the six moments."""
    zero, (x, y, z) = x[..., 0] - x[..., 0], (x[..., i] for i in range(3))
    return _matrix([[x, y, zero, z, zero, zero], [zero, x, y, zero, z, zero], [zero, zero, zero, x, y, z]])


def _swapped(formula):
    """Of a force, whose translational part is what turns the other."""
    return lambda entries, p, tau, f: formula(entries, p, f, tau)[::-1]


def _twice(*parts):
    return tuple(np.stack((part, part), -2) for part in parts)


def _wrench(points, forces):
    return _sum_of_points(np.cross(points, forces)), _sum_of_points(forces)


def _axis(tau, f):
    squared = _sum_of_three(f * f)
    return _sum_of_three(f * tau) / squared, np.cross(f, tau) / squared[..., None]


def _pressed(tau, f, normal):
    return (np.cross(normal, tau) / _sum_of_three(normal * f)[..., None],)


def _differences(x, y, x2, y2):
    return np.abs(x - x2).max(-1), np.abs(y - y2).max(-1)


def _near(rotational_tolerance, translational_tolerance, *parts):
    rotational, translational = _differences(*parts)
    return ((rotational <= rotational_tolerance) & (translational <= translational_tolerance),)


def _scaled_force(tau, f, s):
    return tau * s[..., None], f * s[..., None]


SUMMED, PLAIN_SUM = of_sum(N_POINTS, each=2), of_sum(N_POINTS)
ROUNDED_ONCE = Promise(u=1)

OPERATIONS = {
    operation.name: operation
    for operation in (
        Operation("shift_force", "F vector", js.shift, _shifted_force, (SHIFT, EXACT)),
        Operation("shift_momentum", "L vector", js.shift, _shifted_force, (SHIFT, EXACT),
                  twin="shift_force"),
        Operation("shift_velocity", "V vector", js.shift, lambda w, v, p: (w, v + np.cross(w, p)), (EXACT, SHIFT)),
        Operation("shift_acceleration", "A vector vector", js.shift,
                  lambda alpha, a, p, w: (alpha, (a + np.cross(alpha, p)) + np.cross(w, np.cross(w, p))),
                  (EXACT, SHIFT_ACCELERATION)),
        Operation("dot_force_velocity", "F V", js.dot, _pairing, (DOT,)),
        Operation("dot_velocity_force", "V F", js.dot, _reversed_pairing, (DOT,),
                  twin="dot_force_velocity"),
        Operation("dot_momentum_velocity", "L V", js.dot, _pairing, (DOT,),
                  twin="dot_force_velocity"),
        Operation("dot_velocity_momentum", "V L", js.dot, _reversed_pairing, (DOT,),
                  twin="dot_force_velocity"),
        Operation("cross_velocity", "V V", js.cross, _cross_motion, (CROSS_ONE, CROSS_TWO)),
        Operation("cross_acceleration", "V A", js.cross, _cross_motion, (CROSS_ONE, CROSS_TWO),
                  twin="cross_velocity"),
        Operation("cross_force", "V F", js.cross, _cross_force, (CROSS_TWO, CROSS_ONE)),
        Operation("cross_momentum", "V L", js.cross, _cross_force, (CROSS_TWO, CROSS_ONE),
                  twin="cross_force"),
        Operation("rotate", "R F", js.rotate, _rotated, (ROTATED, ROTATED)),
        Operation("compose_rotations", "R R", lambda R, S, precision=None: composed(R, S, precision=precision),
                  lambda *entries: (_product(*entries),), (ROTATED,)),
        Operation("transform_point", "X vector", lambda X, p, precision=None: transformed(X, p, precision=precision),
                  _transformed, (POINT,)),
        Operation("compose_transforms", "X X", lambda X, Y, precision=None: transformed(X, Y, precision=precision),
                  _transforms, (ROTATED, POINT), twin="transform_point"),
        Operation("inverse_times", "X X", js.RigidTransform.inverse_times, _inverse_times, (ROTATED, ACT)),
        Operation("act_velocity", "X V", js.act, _moved, (ROTATED, ACT)),
        Operation("act_force", "X F", js.act, _swapped(_moved), (ACT, ROTATED), twin="act_velocity"),
        Operation("act_inverse_velocity", "X V", js.act_inverse, _moved_back, (ROTATED, ACT)),
        Operation("act_inverse_momentum", "X L", js.act_inverse, _swapped(_moved_back), (ACT, ROTATED),
                  twin="act_inverse_velocity"),
        Operation("act_acceleration", "X A vector", js.act, _moved_acceleration,
                  (ROTATED, ACT_ACCELERATION), is_long=True),
        Operation("act_inverse_acceleration", "X A vector", js.act_inverse, _acceleration_moved_back,
                  (ROTATED, ACT_ACCELERATION), is_long=True),
        Operation("compose_velocity", "V vector V", js.SpatialVelocity.compose_with_moving_frame, _composed_velocity,
                  (CROSS_ONE, COMPOSED)),
        Operation("compose_acceleration", "A vector vector V A", js.SpatialAcceleration.compose_with_moving_frame,
                  _composed_acceleration, (COMPOSED, COMPOSED_ACCELERATION), is_long=True),
        Operation("to_featherstone", "A V", js.SpatialAcceleration.to_featherstone,
                  lambda alpha, a, w, v: (np.concatenate((alpha, a - np.cross(w, v)), -1),), (SHIFT,),
                  twin="shift_force"),
        Operation("shift_inertia", "M vector", js.shift, lambda m, c, i, p: (m, c - p, i),
                  (EXACT, ROUNDED_ONCE, EXACT)),
        Operation("rotate_inertia", "R M", js.rotate, _rotated_inertia, (EXACT, ROTATED, ROTATED_INERTIA)),
        Operation("act_inertia", "X M", js.act, _acted_inertia, (EXACT, POINT, ROTATED_INERTIA), twin="rotate_inertia"),
        Operation("act_inverse_inertia", "X M", js.act_inverse, _inertia_acted_back, (EXACT, ACT, ROTATED_INERTIA),
                  twin="rotate_inertia"),
        Operation("apply_acceleration", "M A", js.SpatialInertia.apply, _applied, (TORQUE, FORCE), is_long=True),
        Operation("apply_velocity", "M V", js.SpatialInertia.apply, _applied, (TORQUE, FORCE),
                  twin="apply_acceleration"),
        Operation("kinetic_energy", "M V", lambda M, V, precision=None: M.kinetic_energy(V, precision=precision) * 2,
                  _twice_energy, (ENERGY,), is_long=True),
        Operation("from_origin", "M", _from_origin, lambda m, c, i: (m, c, i - _steiner(m, c)), (EXACT, EXACT, ABOUT)),
        Operation("inertia_about_origin", "M", js.SpatialInertia.inertia_about_origin,
                  lambda *parts: (_rows(_about_origin(*parts)[..., _SYMMETRIC]),), (ABOUT,), twin="from_origin"),
        Operation("to_matrix", "M", js.SpatialInertia.to_matrix, _six_by_six, (ABOUT,)),
        Operation("to_dynamic_parameters", "M", js.SpatialInertia.to_dynamic_parameters, _dynamic_parameters,
                  (ABOUT,), twin="to_matrix"),
        Operation("to_pseudo_inertia", "M",
                  lambda M, precision=None: M.to_pseudo_inertia(precision=precision) * 2, _twice_pseudo_inertia,
                  (ABOUT,), twin="to_matrix"),
        Operation("newton_euler_regressor", "A vector", js.newton_euler_regressor, _regressor,
                  (REGRESSOR,), is_long=True),
        Operation("motion_matrix", "X", js.RigidTransform.to_motion_matrix, _motion_matrix),
        Operation("inverse_transform", "X", js.RigidTransform.inverse, _inverse, (EXACT, ROTATED)),
        Operation("to_articulated", "M", js.ArticulatedInertia.from_spatial_inertia, _articulated,
                  (ABOUT, CROSS_ONE, EXACT), twin="to_matrix"),
        Operation("articulated_times", "P A", js.ArticulatedInertia.times, _articulated_times,
                  (ARTICULATED_TIMES, ARTICULATED_TIMES), is_long=True),
        Operation("articulated_shift", "P vector", js.ArticulatedInertia.shift, _articulated_shifted,
                  (ARTICULATED_SHIFT, ARTICULATED_SHIFT, EXACT), is_long=True),
        Operation("add", "F F", lambda F, G: F + G, lambda tau, f, tau2, f2: (tau + tau2, f + f2)),
        Operation("subtract", "V V", lambda V, W: V - W, lambda w, v, w2, v2: (w - w2, v - v2)),
        Operation("negate", "L", lambda L: -L, lambda *parts: tuple(-x for x in parts)),
        Operation("multiply", "F scalar", lambda F, s: F * s, _scaled_force),
        Operation("multiply_from_left", "scalar F", lambda s, F: s * F, lambda s, tau, f: _scaled_force(tau, f, s)),
        Operation("divide", "A scalar", lambda A, s: A / s,
                  lambda alpha, a, s: (alpha / s[..., None], a / s[..., None])),
        Operation("wrench_from_point_forces", "points points", js.wrench_from_point_forces, _wrench,
                  (SUMMED, SUMMED)),
        Operation("sum", "forces", lambda F, precision=None: F.sum(-1, precision=precision),
                  lambda tau, f: (_sum_of_points(tau), _sum_of_points(f)), (PLAIN_SUM, PLAIN_SUM)),
        Operation("at_batch", "forces", lambda F: F.at_batch((..., 2)), lambda tau, f: (tau[..., 2, :], f[..., 2, :])),
        Operation("stack", "X", lambda X: js.stack([X, X], -1), _twice),
        Operation("equal", "L L", lambda L, L2: L == L2,
                  lambda *parts: (np.all(np.equal(parts[:2], parts[2:]), (0, -1)),), differentiable=False),
        Operation("central_axis", "F", js.central_axis, _axis, (CENTRAL_AXIS, CENTRAL_AXIS)),
        Operation("center_of_pressure", "F vector", js.center_of_pressure, _pressed, (PRESSED,)),
        Operation("to_array", "V", js.SpatialVelocity.to_array, lambda w, v: (np.concatenate((w, v), -1),)),
        Operation("from_array", "coefficients", js.SpatialMomentum.from_array, lambda x: (x[..., :3], x[..., 3:])),
        Operation("maximum_absolute_differences", "F F",
                  js.SpatialForce.get_maximum_absolute_differences, _differences),
        Operation("is_nearly_equal", "A A", lambda A, B: A.is_nearly_equal_within_absolute_tolerance(B, 2.0, 1.5),
                  lambda *parts: _near(2.0, 1.5, *parts), differentiable=False),
        Operation("is_approx", "V V", lambda V, W: V.is_approx(W, 2.0),
                  lambda *parts: _near(2.0, 2.0, *parts), differentiable=False),
    )
}  # fmt: skip
WITH_PRECISION = [name for name, operation in OPERATIONS.items() if operation.bounds]
# One of each formula.
FORMULAS = [name for name in WITH_PRECISION if not OPERATIONS[name].twin]
# Of each kind of arithmetic one, which is tried in every surrounding.
REPRESENTATIVES = (
    "shift_force",
    "shift_acceleration",
    "dot_force_velocity",
    "cross_velocity",
    "act_velocity",
    "wrench_from_point_forces",
)

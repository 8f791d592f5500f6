"""The table of operations over which every transformation is tested: a new operation is one line.

An operation says which arguments it takes, what it does with one item (and, by broadcasting, with a batch), and the
naive formula over the arrays that its arguments consist of. The formula runs over numbers of any kind: over NumPy
floats, rounded operation by operation, it gives the bits to expect; over fractions the exact value; over `Sized`
fractions also mag, in units of which the docstrings promise their bounds.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js
from jaxspatial.measure.exact import sized

N_POINTS = 5

# The arguments an operation may take: function of draw(*item_shape), an array with the batch in front.
_ARGUMENTS = {
    "F": lambda draw: js.SpatialForce(draw(3), draw(3)),
    "L": lambda draw: js.SpatialMomentum(draw(3), draw(3)),
    "V": lambda draw: js.SpatialVelocity(draw(3), draw(3)),
    "A": lambda draw: js.SpatialAcceleration(draw(3), draw(3)),
    "vector": lambda draw: draw(3),
    "points": lambda draw: draw(N_POINTS, 3),
    "coefficients": lambda draw: draw(6),
    "scalar": lambda draw: draw(),
}


class Operation(NamedTuple):
    """One line of the table."""

    name: str
    arguments: str
    function: Callable
    formula: Callable
    # Per array of the result (k, l): the error is at most k u mag + l u |r| c, with c the condition number of the
    # denominator of r (1 where nothing is divided). None: an operation without a precision.
    bounds: tuple | None = None
    differentiable: bool = True

    def inputs(self, batch_shape, dtype, rng):
        """Random arguments as a tuple of trees of NumPy arrays, components of size 1, none of them zero."""

        def draw(*item_shape):
            return rng.standard_normal((*batch_shape, *item_shape)).astype(jnp.dtype(dtype))

        return tuple(_ARGUMENTS[argument](draw) for argument in self.arguments.split())

    def naive(self, *inputs):
        """The result of the formula as a list of arrays, in the order of the leaves of the result of `function`."""
        return [np.asarray(x) for x in self.formula(*jax.tree.leaves(inputs))]

    def sized(self, *inputs):
        """As `naive`, exactly: arrays of `Sized`."""
        return [np.asarray(x) for x in self.formula(*map(sized, jax.tree.leaves(inputs)))]


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


EXACT, SHIFT, SHIFT_A, SINGLE, SUM, DOT = (0, 0), (3, 0), (7, 0), (2, 0), (3, 0), (4, 0)

OPERATIONS = {
    operation.name: operation
    for operation in (
        Operation("shift_force", "F vector", js.shift, _shifted_force, (SHIFT, EXACT)),
        Operation("shift_momentum", "L vector", js.shift, _shifted_force, (SHIFT, EXACT)),
        Operation("shift_velocity", "V vector", js.shift, lambda w, v, p: (w, v + np.cross(w, p)), (EXACT, SHIFT)),
        Operation("shift_acceleration", "A vector vector", js.shift,
                  lambda alpha, a, p, w: (alpha, (a + np.cross(alpha, p)) + np.cross(w, np.cross(w, p))),
                  (EXACT, SHIFT_A)),
        Operation("dot_force_velocity", "F V", js.dot, _pairing, (DOT,)),
        Operation("dot_velocity_force", "V F", js.dot, _reversed_pairing, (DOT,)),
        Operation("dot_momentum_velocity", "L V", js.dot, _pairing, (DOT,)),
        Operation("dot_velocity_momentum", "V L", js.dot, _reversed_pairing, (DOT,)),
        Operation("cross_velocity", "V V", js.cross, _cross_motion, (SINGLE, SUM)),
        Operation("cross_acceleration", "V A", js.cross, _cross_motion, (SINGLE, SUM)),
        Operation("cross_force", "V F", js.cross, _cross_force, (SUM, SINGLE)),
        Operation("cross_momentum", "V L", js.cross, _cross_force, (SUM, SINGLE)),
        Operation("add", "F F", lambda F, G: F + G, lambda tau, f, tau2, f2: (tau + tau2, f + f2)),
        Operation("subtract", "V V", lambda V, W: V - W, lambda w, v, w2, v2: (w - w2, v - v2)),
        Operation("negate", "L", lambda L: -L, lambda *parts: tuple(-x for x in parts)),
        Operation("multiply", "F scalar", lambda F, s: F * s, _scaled_force),
        Operation("multiply_from_left", "scalar F", lambda s, F: s * F, lambda s, tau, f: _scaled_force(tau, f, s)),
        Operation("divide", "A scalar", lambda A, s: A / s,
                  lambda alpha, a, s: (alpha / s[..., None], a / s[..., None])),
        Operation("wrench_from_point_forces", "points points", js.wrench_from_point_forces, _wrench, ((5, 0), (5, 0))),
        Operation("central_axis", "F", js.central_axis, _axis, ((7, 0), (7, 0))),
        Operation("center_of_pressure", "F vector", js.center_of_pressure, _pressed, ((3.5, 4),)),
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

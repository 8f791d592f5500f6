"""What of this library the benchmark of dynamics runs, on which states, and what it is compared with."""

import functools
import warnings
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from dynamics_claims import (
    BY_INERTIAS,
    FORWARD,
    FORWARD_BY_JVP,
    FORWARD_BY_MATRICES,
    FORWARD_DERIVATIVES,
    FRAX,
    GRADIENT,
    GRADIENT_OF_STEP,
    INVERSE,
    INVERSE_BY_JVP,
    INVERSE_BY_MATRICES,
    INVERSE_DERIVATIVES,
    INVERSE_MASS_TIMES,
    JACFWD_FORWARD,
    JACFWD_INVERSE,
    JACOBIAN,
    JACOBIAN_BY_PULLBACK,
    JACOBIAN_TIMES,
    KINEMATICS,
    MASS,
    MASS_BY_DYNAMICS,
    MASS_TIMES,
    OURS,
    PINOCCHIO,
    PRODUCTS,
    STEP,
)
from dynamics_peers import DT, pulled_back

import jaxspatial as js

# How we are run: with known numbers folded in the default precision, which is what is claimed; in "fast"; and as one
# program for all numbers of such a robot.
FAST, AS_DATA = f"{OURS}, fast", f"{OURS}, numbers as data"
PROGRAMS = (OURS, FAST, AS_DATA)


def mechanism(robot):
    """Of its file, with known numbers; what of the file is not read is not told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return js.Mechanism.from_urdf(robot.urdf, robot.floating_base, dtype=np.float64)


class Orders(NamedTuple):
    """Where the coordinates of others are in ours: x[pin_q] is in Pinocchio's order. A floating base is [quaternion
    wxyz, position] and (angular, linear) here, [position, quaternion xyzw] and (linear, angular) in Pinocchio, with
    wxyz in MuJoCo and frax."""

    is_floating: bool
    pin_q: Any
    pin_v: Any
    bodies: Any


def orders(robot, mech, model):
    pin_q, pin_v = np.arange(mech.nq), np.arange(mech.nv)
    for name in mech.joint_names:
        joint = model.joints[model.getJointId(name)]
        q, v = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
        is_free = len(q) == 7
        pin_q[joint.idx_q : joint.idx_q + len(q)] = q[[4, 5, 6, 1, 2, 3, 0]] if is_free else q
        pin_v[joint.idx_v : joint.idx_v + len(v)] = v[[3, 4, 5, 0, 1, 2]] if is_free else v
    bodies = np.argsort([model.getJointId(name) for name in mech.joint_names])
    return Orders(robot.floating_base, pin_q, pin_v, bodies)


class States:
    """Random states q, v, a or tau, c: a cotangent of rates; in our order and in that of others."""

    def __init__(self, orders, mech, n):
        rng = np.random.default_rng(0)
        self.orders = orders
        with jax.enable_x64(True):
            self.q = np.asarray(js.random_configuration(mech, jax.random.key(0), n, np.float64))
        self.of_rates = rng.standard_normal((3, n, mech.nv))

    def ours(self, dtype):
        return [jnp.asarray(x.astype(dtype)) for x in (self.q, *self.of_rates)]

    def pinocchios(self, dtype, n=None):
        arrays = self.q[:n, self.orders.pin_q], *self.of_rates[:, :n, self.orders.pin_v]
        return [np.ascontiguousarray(x.astype(dtype)) for x in arrays]

    def mujocos(self, dtype):
        """Velocities of a base are in its axes for one and in the world for the other: other numbers, equal work."""
        q, *rates = self.pinocchios(dtype)
        return [q[:, [0, 1, 2, 6, 3, 4, 5, *range(7, q.shape[1])]] if self.orders.is_floating else q, *rates]


# -- programs: of a mechanism and a precision, a function of a batch of (q, v, a, c) ----------------------------------


def program(mech, tip, algorithm, precision=None):
    function = _STATES.get(algorithm)
    if function is None:
        return _by_inertias(mech, precision)
    return jax.vmap(lambda *state: function(mech, tip, precision, *state))


def _forward(mech, precision):
    return lambda q, v, tau: js.forward_dynamics(mech, q, v, tau, precision=precision)


def _step(mech, precision):
    return lambda q, v, tau: js.semi_implicit_step(mech, q, v, tau, DT, precision=precision)


def _frame(mech, tip):
    return mech.body_names[mech.joint_names.index(tip)]


def _jacobian(mech, tip, precision, q, v, a, c):
    return js.jacobian(mech, q, _frame(mech, tip), precision=precision)


def _jacfwd(algorithm, mech, precision, *state):
    return jax.jacfwd(functools.partial(algorithm, mech, precision=precision), (0, 1, 2))(*state)


def _gradient(mech, tip, precision, q, v, tau, c):
    return pulled_back(_forward(mech, precision), (q, v, tau), c)


def _gradient_of_step(mech, tip, precision, q, v, tau, c):
    return pulled_back(_step(mech, precision), (q, v, tau), (jnp.ones_like(q), c))


# -- matrices times vectors: c is what M and its inverse are multiplied by, its first six numbers are a wrench, and
# (c, a, v) are the directions of derivatives by (q, v, a) --


def _mass_times(mech, tip, precision, q, v, a, c):
    return js.mass_matrix(mech, q, precision=precision) @ c


# For one vector the documentation of `mass_matrix` and of `mass_matrix_factor` tells to take dynamics, from rest and
# without gravity, and that of `jacobian` the pull-back of the velocity of the frame.


def _mass_by_dynamics(mech, tip, precision, q, v, a, c):
    return js.inverse_dynamics(_weightless(mech), q, np.zeros(mech.nv, c.dtype), c, precision=precision)


def _inverse_mass_times(mech, tip, precision, q, v, a, c):
    return js.forward_dynamics(_weightless(mech), q, np.zeros(mech.nv, c.dtype), c, precision=precision)


def _weightless(mech):
    return mech.replace(gravity=np.zeros(3, mech.dtype))


def _jacobian_by_pullback(mech, tip, precision, q, v, a, c):
    def velocity(v):
        return js.body_velocities(mech, q, v, _frame(mech, tip), precision=precision).to_array()

    return pulled_back(velocity, (v,), c[:6])[0]


def _jacobian_times(mech, tip, precision, q, v, a, c):
    return _jacobian(mech, tip, precision, q, v, a, c).T @ c[:6]


def _by_matrices(derivatives, mech, precision, q, v, a, c):
    by_q, by_v, by_a = derivatives(mech, q, v, a, precision=precision)
    return by_q @ c + by_v @ a + by_a @ v


def _by_jvp(algorithm, mech, precision, q, v, a, c):
    directions = js.configuration_rates(mech, q, c), a, v
    return jax.jvp(functools.partial(algorithm, mech, precision=precision), (q, v, a), directions)[1]


_STATES = {
    INVERSE: lambda mech, tip, p, q, v, a, c: js.inverse_dynamics(mech, q, v, a, precision=p),
    FORWARD: lambda mech, tip, p, q, v, tau, c: _forward(mech, p)(q, v, tau),
    MASS: lambda mech, tip, p, q, v, a, c: js.mass_matrix(mech, q, precision=p),
    KINEMATICS: lambda mech, tip, p, q, v, a, c: js.forward_kinematics(mech, q, precision=p),
    JACOBIAN: _jacobian,
    INVERSE_DERIVATIVES: lambda mech, tip, p, q, v, a, c: js.inverse_dynamics_derivatives(mech, q, v, a, precision=p),
    FORWARD_DERIVATIVES: lambda mech, tip, p, q, v, t, c: js.forward_dynamics_derivatives(mech, q, v, t, precision=p),
    JACFWD_INVERSE: lambda mech, tip, p, q, v, a, c: _jacfwd(js.inverse_dynamics, mech, p, q, v, a),
    JACFWD_FORWARD: lambda mech, tip, p, q, v, tau, c: _jacfwd(js.forward_dynamics, mech, p, q, v, tau),
    GRADIENT: _gradient,
    MASS_TIMES: _mass_times,
    MASS_BY_DYNAMICS: _mass_by_dynamics,
    INVERSE_MASS_TIMES: _inverse_mass_times,
    JACOBIAN_TIMES: _jacobian_times,
    JACOBIAN_BY_PULLBACK: _jacobian_by_pullback,
    INVERSE_BY_MATRICES: lambda mech, tip, p, *state: _by_matrices(js.inverse_dynamics_derivatives, mech, p, *state),
    INVERSE_BY_JVP: lambda mech, tip, p, *state: _by_jvp(js.inverse_dynamics, mech, p, *state),
    FORWARD_BY_MATRICES: lambda mech, tip, p, *state: _by_matrices(js.forward_dynamics_derivatives, mech, p, *state),
    FORWARD_BY_JVP: lambda mech, tip, p, *state: _by_jvp(js.forward_dynamics, mech, p, *state),
    STEP: lambda mech, tip, p, q, v, tau, c: _step(mech, p)(q, v, tau),
    GRADIENT_OF_STEP: _gradient_of_step,
}
ALGORITHMS = (*(name for name in _STATES if name not in (STEP, GRADIENT_OF_STEP)), BY_INERTIAS, STEP, GRADIENT_OF_STEP)


def _by_inertias(mech, precision):
    """The gradient that learning takes: of the whole batch, by ten parameters of every body."""
    at = mech.inertias.to_dynamic_parameters()

    def gradient(q, v, a, c):
        def torques(parameters):
            inertias = js.SpatialInertia.from_dynamic_parameters(parameters)
            return js.inverse_dynamics(mech.replace(inertias=inertias), q, v, a, precision=precision)

        return pulled_back(torques, (jnp.asarray(at, q.dtype),), c)[0]

    return gradient


# -- results, as Pinocchio's library writes them ----------------------------------------------------------------------


def error(orders, algorithm, who, found, expected):
    """The largest over the largest number; None for others than Pinocchio and us, whose conventions differ, but where
    coordinates and results are the same."""
    alike = who == FRAX and algorithm in (INVERSE, FORWARD) and not orders.is_floating
    if expected is None or who not in (*PROGRAMS, PINOCCHIO) and not alike:
        return None
    found = _in_order(orders, algorithm, found) if who in PROGRAMS else np.asarray(found, float)
    found, expected = _compared(orders, algorithm, found[: len(expected)], expected)
    return float(abs(found - expected).max() / abs(expected).max())


def _in_order(orders, algorithm, found):
    """(n, numbers of a state)."""
    v, bodies = orders.pin_v, orders.bodies
    if algorithm == BY_INERTIAS:
        return np.asarray(found, float)[bodies].ravel()
    arrays = [np.asarray(x, float) for x in jax.tree.leaves(_plain(found))]
    if algorithm in (INVERSE, FORWARD, *PRODUCTS):
        parts = [arrays[0][:, v]]
    elif algorithm == KINEMATICS:
        parts = [np.concatenate([x.reshape((len(x), x.shape[1], -1)) for x in arrays], -1)[:, bodies]]
    elif algorithm == JACOBIAN:
        parts = [arrays[0][:, [3, 4, 5, 0, 1, 2]][:, :, v].swapaxes(1, 2)]
    elif algorithm in (GRADIENT, STEP):
        parts = [arrays[0][:, orders.pin_q], *(x[:, v] for x in arrays[1:])]
    else:
        parts = [x[:, v][:, :, v].swapaxes(1, 2) for x in arrays]
    return np.concatenate([x.reshape((len(x), -1)) for x in parts], 1)


def _plain(found):
    """Rotations by columns, as their matrices are written, then positions."""
    if isinstance(found, js.RigidTransform):
        return found.rotation.to_matrix().swapaxes(-1, -2), found.translation
    return found


def _compared(orders, algorithm, found, expected):
    """Of symmetric matrices the upper triangle, which is all that Pinocchio writes; of gradients by coordinates what
    has no part for a quaternion; of steps of a floating base no position and no linear velocity."""
    n = len(orders.pin_v)
    if algorithm in (MASS, INVERSE_DERIVATIVES, FORWARD_DERIVATIVES):
        upper = np.triu(np.ones((n, n), bool)).T.ravel()  # by columns
        kept = upper if algorithm == MASS else np.concatenate([np.ones(2 * n * n, bool), upper])
        return found[:, kept], expected[:, kept]
    if algorithm == GRADIENT and orders.is_floating:
        return found[:, -2 * n :], expected[:, -2 * n :]
    if algorithm == STEP and orders.is_floating:
        # Pinocchio's side keeps the linear velocity of the base along axes that turn: by dt |w| |v| from ours.
        base = np.isin(np.arange(found.shape[1]), [0, 1, 2, *(len(orders.pin_q) + np.arange(3))])
        return found[:, ~base], expected[:, ~base]
    return found, expected

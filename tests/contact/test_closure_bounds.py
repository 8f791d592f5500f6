"""The bounds of `constraint_error` and `constraint_jacobian`, against 60 digits: two arms of three hinges."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.numerics.precision import Precision
from tests.helpers.interpreted import evaluated
from tests.helpers.marks import slow_but

KINDS = "weld", "hinge", "universal", "ball", "distance"
# Of each arm: axes of hinges by number, and arms from one to the next, the last to the frame. Numbers of float32.
AXES = {"a": (2, 0, 1), "b": (1, 2, 0)}
ARMS = {
    name: np.float64(np.float32(x))
    for name, x in {
        "a": [[0.1, -0.7, 0.3], [1.1, 0.2, -0.4], [0.3, 0.9, 0.1], [-0.2, 0.5, 0.8]],
        "b": [[-0.3, 0.6, 0.2], [0.7, -1.2, 0.1], [0.4, 0.3, 0.9], [0.6, -0.1, 0.5]],
    }.items()
}


def arms():
    bodies, joints, frames = [], [], []
    for name, axes in AXES.items():
        for k, axis in enumerate(axes):
            X = js.RigidTransform(js.Rotation.identity(), ARMS[name][k])
            bodies.append(js.Body(f"{name}{k}"))
            parent = f"{name}{k - 1}" if k else "world"
            joints.append(js.Joint(f"to {name}{k}", "revolute", parent, f"{name}{k}", X, axis=np.eye(3)[axis]))
        frames.append(js.Frame(name, f"{name}2", js.RigidTransform(js.Rotation.identity(), ARMS[name][3])))
    return js.Mechanism.build(bodies, joints, frames, dtype=np.float64)


def vector(x):
    return mp.matrix([mp.mpf(float(c)) for c in x])


def cross(a, b):
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def length(x):
    return mp.sqrt(sum(c * c for c in x))


def about(axis, angle):
    c, s, R = mp.cos(angle), mp.sin(angle), mp.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def placed(name, q):
    """(R, p, [(axis, origin) of each hinge]) of the frame of an arm, in the world."""
    R, p, hinges = mp.eye(3), mp.matrix(3, 1), []
    for axis, arm, angle in zip(AXES[name], ARMS[name][:3], q, strict=True):
        p = p + R * vector(arm)
        R = R * about(axis, mp.mpf(float(angle)))
        hinges.append((R[:, axis], p))
    return R, p + R * vector(ARMS[name][3]), hinges


def rotation_vector(R):
    twice = mp.matrix([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    angle = mp.atan2(length(twice), R[0, 0] + R[1, 1] + R[2, 2] - 1)
    return twice * (angle / length(twice))


def exactly(kind, q, distance):
    """(the error, J) of a closure from frame a to frame b."""
    (R_A, p_A, of_a), (R_B, p_B, of_b) = placed("a", q[:3]), placed("b", q[3:])
    R, p = R_A.T * R_B, R_A.T * (p_B - p_A)
    z = R[:, 2]
    tilt = mp.matrix([-z[1], z[0]])
    turned = {
        "weld": lambda: list(rotation_vector(R)),
        "hinge": lambda: list(tilt * (mp.atan2(length(tilt), z[2]) / length(tilt))),
        "universal": lambda: [-R[2, 0]],
    }
    error = turned.get(kind, list)() + ([length(p) - distance] if kind == "distance" else list(p))
    columns = []
    for sign, hinges in ((-1, of_a), (1, of_b)):
        for axis, origin in hinges:
            # The velocity of the origin of B, as carried by either frame.
            w, v = R_A.T * axis * sign, R_A.T * cross(axis, p_B - origin) * sign
            along = {
                "weld": lambda w=w: list(w),
                "hinge": lambda w=w: list(w[:2]),
                "universal": lambda w=w: [(w.T * cross(mp.matrix([0, 0, 1]), R[:, 0]))[0]],
            }.get(kind, list)()
            columns.append(along + ([(p.T * v)[0] / length(p)] if kind == "distance" else list(v)))
    return np.array(error), np.array(columns).T


def states():
    """Any; orientations that are nearly the same, and nearly half a turn apart."""
    rng = np.random.default_rng(3)
    q = np.concatenate([rng.uniform(-3, 3, (6, 6)), np.zeros((2, 6))])
    q[6], q[7] = [0, 0, 0, 1e-3, -2e-4, 3e-4], [0, 0, 0, 3.1, 1e-3, -1e-3]
    return np.float64(np.float32(q))


CASES = [(str(precision), dtype) for precision in Precision for dtype in ("float32", "float64")]


@pytest.mark.parametrize(
    ("precision", "dtype"), slow_but([("reproducible", "float32"), ("compensated", "float64")], CASES)
)
def test_errors_and_jacobians(precision, dtype):
    """8 u of what they are made of, and what forward kinematics and Jacobians of frames add on both sides."""
    distance, q = 0.75, states()
    with jax.enable_x64(True):
        mech = arms().astype(dtype)
    loops = [js.LoopClosure("a", "b", kind, *[distance] * (kind == "distance")) for kind in KINDS]

    def both(q):
        found = js.constraint_error(mech, q, loops, precision=precision)
        return found, js.constraint_jacobian(mech, q, loops, precision=precision)

    with jax.enable_x64(dtype == "float64"):
        found = evaluated(precision, both)(jnp.asarray(q.astype(dtype)))
    u, size = np.finfo(dtype).eps / 2, sum(np.linalg.norm(x, axis=1).sum() for x in ARMS.values())
    # Rows are sums over three numbers of two frames.
    of_frames = 2 * np.sqrt(3) * ALGORITHM.allowed(precision, u, 3 * size)
    for i, state in enumerate(q):
        exact = [exactly(kind, state, distance) for kind in KINDS]
        largest = max(1, *(float(abs(c)) for at in (("a", state[:3]), ("b", state[3:])) for c in placed(*at)[1]))
        expected = [np.concatenate([x[k] for x in exact]) for k in (0, 1)]
        for ours, theirs in zip(found, expected, strict=True):
            worst = max(abs(mp.mpf(float(a)) - b) for a, b in zip(np.ravel(ours[i]), theirs.ravel(), strict=True))
            assert worst <= 8 * u * largest + of_frames, (i, float(worst / u))

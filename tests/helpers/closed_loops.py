"""Mechanisms with a closed loop, as MJCF of MuJoCo, and closed states of them.

The loop is between two sites, "A" and "B": A is where B is at given coordinates.
"""

import functools
from typing import NamedTuple

import jax
import mujoco
import numpy as np

import jaxspatial as js
from tests.helpers.interpreted import interpreted

# (body, what it hangs on, the axis of its hinge; None for a random one). The loop is between the bodies "A on", "B on".
PLANAR = "four-bar", "five-bar"
BODIES = {
    "four-bar": [("a", "world", "y"), ("b", "a", "y"), ("c", "world", "y")],
    "five-bar": [("a", "world", "y"), ("b", "a", "y"), ("c", "world", "y"), ("d", "c", "y")],
    # A chain of the hip, the knee and springs down to the tarsus, and a rod from the thigh to the heel.
    "leg": [
        ("roll", "world", "x"), ("yaw", "roll", "z"), ("thigh", "yaw", "y"), ("shin", "thigh", "y"),
        ("spring", "shin", "y"), ("tarsus", "spring", "y"), ("rod", "thigh", "y"), ("rod end", "rod", "z"),
    ],
    # With the closure 7 hinges, one more than a loop in space needs to move.
    "hinges": [(f"b{i}", f"b{i - 1}" if i else "world", None) for i in range(6)],
    "arms": [(f"{arm}{i}", f"{arm}{i - 1}" if i else "world", None) for arm in "lr" for i in range(7)],
}  # fmt: skip
CLOSURES = {
    "four-bar": ("c", "b", "ball"),
    "five-bar": ("d", "b", "ball"),
    "leg": ("tarsus", "rod end", "ball"),
    "hinges": ("world", "b5", "hinge"),
    "arms": ("l6", "r6", "weld"),
}
AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


class Closed(NamedTuple):
    """A mechanism, its closure, the same as a model of MuJoCo, and states: q, v (n, nv), closed, and tau."""

    mech: js.Mechanism
    loops: tuple[js.LoopClosure, ...]
    model: mujoco.MjModel
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


@functools.cache
def closed(name, n=4):
    """In float64."""
    text = mjcf(name)
    model, rng = mujoco.MjModel.from_xml_string(text), np.random.default_rng(1)
    with jax.enable_x64(True):
        mech, loops = js.Mechanism.from_mjcf(text, dtype=np.float64), (js.LoopClosure("A", "B", CLOSURES[name][2]),)
        near = angles(name) + 0.2 * rng.standard_normal((n, mech.nv))
        q, residual = interpreted(lambda q: js.close_loops(mech, q, loops))(near)
        assert residual.max() < 1e-13 and abs(q - angles(name)).max() > 0.01
        J = interpreted(lambda q: js.constraint_jacobian(mech, q, loops))(q)
        v, tau = rng.standard_normal((2, n, mech.nv))
        return Closed(mech, loops, model, q, v - (np.linalg.pinv(J) @ (J @ v[..., None]))[..., 0], tau)


@functools.cache
def constrained(name, n=4):
    """What `constrained_forward_dynamics` finds at the states of `closed`."""
    s = closed(name, n)
    with jax.enable_x64(True):
        return interpreted(lambda *x: js.constrained_forward_dynamics(s.mech, *x, s.loops))(s.q, s.v, s.tau)


def angles(name):
    """Coordinates at which the loop is closed."""
    return np.random.default_rng(2).uniform(-1, 1, len(BODIES[name]))


@functools.cache
def mjcf(name):
    """A is a site that is put, by its numbers, where B is."""
    on_a, on_b, _ = CLOSURES[name]
    site_b = _site("B", *_pose(np.random.default_rng(3), name))
    model = mujoco.MjModel.from_xml_string(_text(name, {on_b: site_b}))
    data = mujoco.MjData(model)
    data.qpos = angles(name)
    mujoco.mj_kinematics(model, data)
    R_WA, R_WB = (data.xmat[model.body(on_a).id].reshape(3, 3), data.site("B").xmat.reshape(3, 3))
    p, wxyz = R_WA.T @ (data.site("B").xpos - data.xpos[model.body(on_a).id]), np.zeros(4)
    mujoco.mju_mat2Quat(wxyz, (R_WA.T @ R_WB).ravel())
    return _text(name, {on_b: site_b, on_a: _site("A", p, wxyz)})


def _text(name, sites):
    rng = np.random.default_rng(0)
    parts = {body: _parts(rng, name, axis) for body, _, axis in BODIES[name]}

    def nested(on):
        inner = [
            f'<body name="{b}" {parts[b][0]}>{parts[b][1]}{nested(b)}</body>' for b, o, _ in BODIES[name] if o == on
        ]
        return sites.get(on, "") + "".join(inner)

    return f'<mujoco><compiler angle="radian"/><worldbody>{nested("world")}</worldbody></mujoco>'


def _parts(rng, name, axis):
    """(the pose of a body, its joint and inertia)."""
    p, wxyz = _pose(rng, name)
    wxyz = np.eye(4)[0] if axis else wxyz
    turned = numbers(rng.standard_normal(3)) if axis is None else numbers(AXES[axis])
    moments, com = rng.uniform(0.02, 0.04, 3), 0.1 * rng.standard_normal(3)
    inertial = f'<inertial mass="{rng.uniform(0.5, 2)!r}" pos="{numbers(com)}" diaginertia="{numbers(moments)}"/>'
    return f'pos="{numbers(p)}" quat="{numbers(wxyz)}"', f'<joint axis="{turned}"/>{inertial}'


def _pose(rng, name):
    p, wxyz = rng.uniform(0.2, 0.6, 3), rng.standard_normal(4)
    return (p * (1, 0, 1), np.eye(4)[0]) if name in PLANAR else (p, wxyz / np.linalg.norm(wxyz))


def _site(name, p, wxyz):
    return f'<site name="{name}" pos="{numbers(p)}" quat="{numbers(wxyz)}"/>'


def numbers(x):
    return " ".join(map(repr, np.asarray(x, float).tolist()))


def kkt(M, h, tau, J, bias):
    """(vdot, J^T l) of M vdot + h = tau + J^T l, J vdot + bias = 0, of all equations together."""
    n, m = len(M), len(J)
    left = np.block([[M, -J.T], [J, np.zeros((m, m))]])
    x = np.linalg.lstsq(left, np.concatenate([tau - h, -bias]), rcond=1e-12)[0]
    return x[:n], J.T @ x[n:]

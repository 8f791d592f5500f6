"""The built-in scene: wrenches on a body that turns while it travels."""

from typing import NamedTuple

import numpy as np


class Wrenches(NamedTuple):
    """Wrenches on a body about points P, with the motion of the body there; all (n, 3), one frame, SI units."""

    tau: np.ndarray
    f: np.ndarray
    w: np.ndarray
    v: np.ndarray


def rotating_body(n, seed=0):
    """n wrenches at instants of one turn of a body that spins about a tilted axis while its centre moves on.

    Each acts about its own contact point P on the body, at most 0.5 m from the centre: forces of about 100 N, friction
    torques of about 1 N m, 3 rad/s, 1 m/s.
    """
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2 * np.pi, n, endpoint=False)
    p_CP_B = rng.uniform(-0.5, 0.5, (n, 3))
    f_P_B = rng.normal(0.0, 100.0, (n, 3))
    axis = np.array([0.6, 0.0, 0.8])
    w = np.broadcast_to(3.0 * axis, (n, 3)).copy()
    v = np.array([1.0, 0.0, 0.2]) + np.cross(w, _turned(axis, angle, p_CP_B))
    return Wrenches(rng.normal(0.0, 1.0, (n, 3)), _turned(axis, angle, f_P_B), w, v)


def _turned(axis, angle, x):
    """x turned by angle about axis. [Rodrigues 1840]"""
    along = (x @ axis)[:, None] * axis
    return along + np.cos(angle)[:, None] * (x - along) + np.sin(angle)[:, None] * np.cross(axis, x)

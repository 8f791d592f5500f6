"""Wrenches and velocities at the joints of real robots, which Pinocchio computes along a smooth motion."""

import importlib.metadata
from typing import NamedTuple

import numpy as np
import pinocchio as pin

_URDF = {"panda": "panda.urdf", "g1": "g1_29dof_rev_1_0.urdf"}
_FLOATING = {"g1"}
_SECONDS = 4.0


class JointWrenches(NamedTuple):
    """(n, 3) each, one row per joint and moment: about the joint's origin, in the axes of the joint's frame.

    tau, f: the wrench that the joint passes on to its child, N m and N.  w, v: velocity of the child, rad/s and m/s.
    names: n names "joint@seconds".
    """

    tau: np.ndarray
    f: np.ndarray
    w: np.ndarray
    v: np.ndarray
    names: list[str]


def joint_wrenches(robot, samples=200):
    """Of "panda" (Franka Panda, 9 joints) or "g1" (Unitree G1, 29 joints and a floating base)."""
    model = load(robot)
    data = model.createData()
    rows, names = [], []
    for t in np.linspace(0.0, _SECONDS, samples):
        pin.rnea(model, data, *motion(model, t))
        for i in range(1, model.njoints):
            F, V = data.f[i], data.v[i]
            rows.append([F.angular, F.linear, V.angular, V.linear])
            names.append(f"{model.names[i]}@{t:.3f}")
    tau, f, w, v = np.array(rows).swapaxes(0, 1).copy()
    return JointWrenches(tau, f, w, v, names)


def load(robot):
    """The Pinocchio model, from the URDF in the package example-robot-data."""
    files = importlib.metadata.files("example-robot-data") or []
    paths = [str(file.locate()) for file in files if file.name == _URDF[robot]]
    base = [pin.JointModelFreeFlyer()] if robot in _FLOATING else []
    return pin.buildModelFromUrdf(paths[0], *base)


def motion(model, t):
    """(q, v, a) at time t: joints swing within their limits at frequencies of their own, a floating base sways."""
    floating = model.nq > model.nv
    joints = model.nv - 6 * floating
    low, high = model.lowerPositionLimit[-joints:], model.upperPositionLimit[-joints:]
    rate = 2 * np.pi * np.linspace(0.25, 1.0, joints)
    phase = np.arange(joints)
    reach = 0.4 * (high - low)
    q = (low + high) / 2 + reach * np.sin(rate * t + phase)
    v = reach * rate * np.cos(rate * t + phase)
    a = -reach * rate**2 * np.sin(rate * t + phase)
    if not floating:
        return q, v, a
    return tuple(np.concatenate(pair) for pair in zip(_swaying(t), (q, v, a), strict=True))


def _swaying(t):
    """A base that rocks about one axis n while its origin moves on a smooth curve.

    In the axes of the base, R: velocity (R' p', n angle'), its rate (R' p'' - n angle' x R' p', n angle'').
    """
    n = np.array([2.0, -1.0, 2.0]) / 3
    angle, rate, acceleration = 0.6 * np.sin(2 * t), 1.2 * np.cos(2 * t), -2.4 * np.sin(2 * t)
    p = np.array([0.3 * np.sin(t), 0.2 * np.cos(3 * t), 0.8 + 0.1 * np.sin(5 * t)])
    dp = np.array([0.3 * np.cos(t), -0.6 * np.sin(3 * t), 0.5 * np.cos(5 * t)])
    ddp = np.array([-0.3 * np.sin(t), -1.8 * np.cos(3 * t), -2.5 * np.sin(5 * t)])
    R = pin.exp3(n * angle)
    v = R.T @ dp
    w = n * rate
    return (
        np.concatenate([p, pin.Quaternion(R).coeffs()]),
        np.concatenate([v, w]),
        np.concatenate([R.T @ ddp - np.cross(w, v), n * acceleration]),
    )

"""Robots that touch the ground: their files, their spheres, and random states that stick, slide and fly."""

import functools
import warnings
from typing import NamedTuple

import jax
import numpy as np
from lxml import etree

import jaxspatial as js
from jaxspatial.interop import ModelFileWarning
from tests.helpers.interpreted import interpreted

BOX = """<robot name="box"><link name="box"><inertial><origin xyz="0.01 -0.02 0.03"/><mass value="2.0"/>
  <inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial></link></robot>"""


def _arm():
    """Four joints with damping and narrow limits, one of them sliding, and a tip."""
    joint = """<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{k}"/><origin xyz="{p}" rpy="{r}"/>
      <axis xyz="{a}"/><limit lower="{lo}" upper="{up}" effort="1e9" velocity="1e9"/>
      <dynamics damping="{c}"/></joint>"""
    link = """<link name="l{i}"><inertial><origin xyz="0.02 0.01 0.15"/><mass value="{m}"/>
      <inertia ixx="0.02" iyy="0.025" izz="0.01" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>"""
    rows = [
        ("revolute", "0 0 0.6", "0 0 0", "0 0 1", -0.5, 0.7, 0.1),
        ("revolute", "0 0 0.1", "0.1 0 0", "0 1 0", -0.4, 2.5, 0.0),
        ("prismatic", "0 0 0.3", "0 0.2 0", "0 0 1", -0.05, 0.1, 2.0),
        ("revolute", "0 0 0.3", "0 0 0.3", "0 1 0", -0.6, 1.0, 0.05),
    ]
    parts = [link.format(i=0, m=1.0)]
    for i, (kind, p, r, a, lo, up, c) in enumerate(rows):
        parts.append(joint.format(i=i, k=i + 1, kind=kind, p=p, r=r, a=a, lo=lo, up=up, c=c))
        parts.append(link.format(i=i + 1, m=1.5 - 0.25 * i))
    return f'<robot name="arm">{"".join(parts)}</robot>'


class Scene(NamedTuple):
    """A robot: its URDF, its mechanism in float64, the spheres (frames, positions (n, 3) in them, their radius)."""

    text: str
    mechanism: js.Mechanism
    is_floating: bool
    frames: tuple[str, ...]
    positions: np.ndarray
    radius: float
    stiffness: float
    relaxation_time: float
    friction: float

    @property
    def contacts(self):
        numbers = {name: np.float64(getattr(self, name)) for name in ("stiffness", "relaxation_time", "friction")}
        return js.PointContacts(self.frames, self.positions, np.float64(self.radius), **numbers)


def _scene(text, is_floating, frames, positions, *numbers):
    with jax.enable_x64(True), warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelFileWarning)
        mech = js.Mechanism.from_urdf(text, floating_base=is_floating, dtype=np.float64)
    # Drake's joints have no dry friction.
    mech = mech.replace(friction_loss=np.zeros(mech.nv))
    return Scene(text, mech, is_floating, frames, np.asarray(positions, float), *numbers)


@functools.cache
def box():
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.15, 0.15) for z in (-0.2, 0.2)])
    return _scene(BOX, True, ("box",) * 8, corners, 0.02, 1e4, 0.02, 0.5)


@functools.cache
def arm():
    return _scene(_arm(), False, ("l4", "l4"), [[0, 0, 0.3], [0.1, 0, 0.25]], 0.05, 5e4, 0.01, 0.8)


# What is for pictures, contact and motors.
STRIPPED = "visual", "collision", "transmission", "gazebo", "safety_controller", "contact"


@functools.cache
def solo12():
    """From example-robot-data."""
    from tests.helpers import pinocchio_models as models

    root = etree.parse(models.ROBOTS["solo12"]).getroot()
    for element in [e for tag in STRIPPED for e in root.iter(tag)]:
        element.getparent().remove(element)
    feet = tuple(f"{leg}_FOOT" for leg in ("FL", "FR", "HL", "HR"))
    return _scene(etree.tostring(root, encoding="unicode"), True, feet, np.zeros((4, 3)), 0.016, 2e4, 0.005, 0.6)


SCENES = {"box": box, "arm": arm, "solo12": solo12}
KINDS = "sticking", "sliding", "flying", "hitting"


class State(NamedTuple):
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


def states(scene, n, seed=0):
    """n random states: the deepest sphere up to 1 cm inside or, of every fourth state, above the ground; slow, fast
    along the ground, or fast. Arms come as near to that as one of 256 does."""
    rng, mech = np.random.default_rng(seed), scene.mechanism
    kinds = np.array([KINDS[i % 4] for i in range(n)])
    v, tau = rng.standard_normal((n, mech.nv)), 2 * rng.standard_normal((n, mech.nv))
    v[kinds == "sticking"] *= 0.02
    heights = rng.uniform(0, 0.01, n) * np.where(kinds == "flying", 1, -1)
    if scene.is_floating:
        q, is_upright = _in_limits(mech, rng, n), rng.random(n) < 0.5
        q[is_upright, :4] = [1, 0, 0, 0] + 0.02 * rng.standard_normal((is_upright.sum(), 4))
        q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
        v[kinds == "sliding"] *= 0.05
        v[kinds == "sliding", 3:5] += rng.standard_normal(((kinds == "sliding").sum(), 2))
        q[:, 6] += heights - _lowest(scene, q)
        tau[:, :6] = 0
    else:
        many = _in_limits(mech, rng, 256)
        q = many[abs(_lowest(scene, many) - heights[:, None]).argmin(1)]
    return list(map(State, q, v, tau))


def _in_limits(mech, rng, n):
    """Joints between their limits, every third up to 3e-3 beyond or before one of them."""
    lower, upper = (np.array(x) for x in (mech.lower, mech.upper))
    is_wide = ~(upper - lower < 6)
    lower, upper = np.where(is_wide, -1, lower), np.where(is_wide, 1, upper)
    near = np.where(rng.random((n, mech.nq)) < 0.5, lower, upper) + rng.uniform(-3e-3, 3e-3, (n, mech.nq))
    return np.where(rng.random((n, mech.nq)) < 1 / 3, near, rng.uniform(lower, upper, (n, mech.nq)))


def _lowest(scene, q):
    """The height (*batch,) of the lowest sphere above the ground."""
    mech = scene.mechanism
    with jax.enable_x64(True):
        X, p = interpreted(lambda q: js.forward_kinematics(mech, q, scene.frames))(q), scene.positions
    rows = np.asarray(X.rotation.to_matrix())[..., 2, :]
    return (np.asarray(X.translation)[..., 2] + (rows * p).sum(-1)).min(-1) - scene.radius

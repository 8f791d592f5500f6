"""The built-in scenes: wrenches on a body that turns while it travels, an arm, a long chain, a trolley and its load."""

import functools
from collections.abc import Callable
from typing import NamedTuple, ParamSpec

import jax
import numpy as np
import numpy.typing as npt

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism import Body, Frame, Joint, Mechanism
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, shift

P = ParamSpec("P")


class Wrenches(NamedTuple):
    """Wrenches on a body about points P, with the motion of the body there, None where it is not known; all (n, 3), one
    frame, SI units."""

    tau: np.ndarray
    f: np.ndarray
    w: np.ndarray | None
    v: np.ndarray | None


def rotating_body(n: int, seed: int = 0):
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


def _turned(axis: np.ndarray, angle: np.ndarray, x: np.ndarray):
    """x turned by angle about axis. [Rodrigues 1840]"""
    along = (x @ axis)[:, None] * axis
    return along + np.cos(angle)[:, None] * (x - along) + np.sin(angle)[:, None] * np.cross(axis, x)


# -- mechanisms, in float32 -------------------------------------------------------------------------------------------

_UPRIGHT = np.eye(3)
# Quarter turns about x, of rotations by 90 and by -90 degrees.
_LEFT, _RIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
# Of each link: how its joint's frame is turned and placed in the frame before, kg, and the length along the arm, m.
_LINKS = (
    (_UPRIGHT, (0.0, 0.0, 0.333), 4.0, 0.3),
    (_RIGHT, (0.0, 0.0, 0.0), 4.0, 0.3),
    (_LEFT, (0.0, -0.316, 0.0), 3.0, 0.3),
    (_LEFT, (0.0825, 0.0, 0.0), 3.0, 0.3),
    (_RIGHT, (-0.0825, 0.384, 0.0), 2.5, 0.3),
    (_LEFT, (0.0, 0.0, 0.0), 1.5, 0.1),
    (_LEFT, (0.088, 0.0, 0.0), 1.0, 0.2),
)


def _built(parts: Callable[P, tuple[list[Body], list[Joint], *tuple[list[Frame], ...]]]):
    """Builds a Mechanism of bodies, joints, frames; its numbers are float32, so that it is the same in every dtype."""

    @functools.wraps(parts)
    def build(*numbers: P.args, **named: P.kwargs):
        with jax.enable_x64(True):
            return Mechanism.build(*parts(*numbers, **named), dtype=np.float64).astype(np.float32)

    return build


@_built
def arm():
    """An arm of seven revolute joints and 19 kg that reaches 0.86 m, of the measures of Franka's Panda."""
    bodies, joints, parent = list[Body](), list[Joint](), "world"
    for i, (turn, at, mass, length) in enumerate(_LINKS):
        cylinder = SpatialInertia.solid_cylinder(np.float64(0.06), np.float64(length), mass=np.float64(mass))
        bodies.append(Body(f"link{i + 1}", shift(cylinder, np.array([0.0, 0.02, -length / 4]))))
        joints.append(_hinge(i, parent, bodies[-1].name, (0, 0, 1), _at(at, turn)))
        parent = bodies[-1].name
    return bodies, joints


def _hinge(i: int, parent: str, child: str, axis: npt.ArrayLike, placement: RigidTransform):
    return Joint(f"joint{i + 1}", "revolute", parent, child, axis=axis, placement=placement)


@_built
def chain(n: int, length: float = 0.1, mass: float = 0.2):
    """n rods one behind the other along z, m and kg each, hinged about x and y in turns; the frame "tip" at the end."""
    rod = SpatialInertia.thin_rod(np.float64(length), np.array([0.0, 0.0, 1.0]), mass=np.float64(mass))
    rod = shift(rod, np.array([0.0, 0.0, -length / 2]))
    names = ["world", *(f"rod{i + 1}" for i in range(n))]
    joints = [_hinge(i, names[i], names[i + 1], np.eye(3)[i % 2], _at((0, 0, i and length))) for i in range(n)]
    tip = Frame("tip", names[-1], _at((0.0, 0.0, length)))
    return [Body(name, rod) for name in names[1:]], joints, [tip]


@_built
def trolley(mass: float, load: float):
    """A trolley (kg) on a rail along x, from which a load (kg) hangs by a metre."""
    ball = SpatialInertia.solid_sphere(np.float64(0.01), mass=np.float64(load))
    body = SpatialInertia.point_mass(np.zeros(3), mass=np.float64(mass))
    bodies = [Body("trolley", body), Body("load", shift(ball, np.array([0, 0, 1.0])))]
    joints = [
        Joint("rail", "prismatic", "world", "trolley", axis=(1, 0, 0)),
        Joint("rope", "revolute", "trolley", "load", axis=(0, 1, 0)),
    ]
    return bodies, joints


def _at(position: npt.ArrayLike, turn: np.ndarray = _UPRIGHT):
    return RigidTransform(Rotation.from_matrix(turn), np.array(position, np.float64))

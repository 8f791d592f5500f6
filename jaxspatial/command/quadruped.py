"""The quadruped of the first look and of the demo: it stands on the ground by springs in its joints, and is pushed."""

import itertools
import pathlib
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.step import ConvexStep, convex_step
from jaxspatial.mechanism import AppliedForces, Frame, HalfSpace, Mechanism, PointContacts, add_frames
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialForce

FILE = pathlib.Path(__file__).with_name("quadruped.urdf")
# Seconds from one state to the next, a push of the trunk, N; of the controller in joints, N m / rad and N m s / rad.
DT, PUSH, _STIFFNESS, _DAMPING = np.float32(5e-3), 60.0, np.float32(60), np.float32(1)
_LEGS = [f"{end}_{side}" for end in ("front", "hind") for side in ("left", "right")]
_TOUCH: Any = {"stiffness": np.float32(2e4), "relaxation_time": np.float32(0.01), "friction": np.float32(0.8)}
FEET = PointContacts([f"{leg}_foot" for leg in _LEGS], radius=np.float32(0.02), **_TOUCH)
# Spheres at the corners of the trunk, as the file shows it.
_CORNER = np.float32(0.01)
_CORNERS = [np.array(p, np.float32) for p in itertools.product((-0.18, 0.18), (-0.07, 0.07), (-0.04, 0.04))]
# What touches the ground when it falls.
BODY = PointContacts(
    [*FEET.frames, *(f"{leg}_hip" for leg in _LEGS), *map("corner_{}".format, range(8))],
    radius=np.repeat(np.array([0.02, 0.045, _CORNER], np.float32), [4, 4, 8]),
    **_TOUCH,
)
GROUND = HalfSpace(np.array([0, 0, 1], np.float32), np.float32(0))
# Hip, thigh and knee of each leg, rad; legs of two links of 0.2 m then end 0.28 m below the trunk.
_STANCE = np.tile(np.array([0, 0.8, -1.6], np.float32), 4)


def mechanism() -> Mechanism:
    """The robot, floating, with numbers of float32. The dampers of the controller are in its joints, with those of the
    file: steps treat them implicitly, while torques by -v of this size make a shank in the air swing ever more."""
    mech = Mechanism.from_urdf(FILE.read_text(), floating_base=True, dtype=np.float32)
    return mech.replace(damping=mech.damping + np.repeat(np.array([0, _DAMPING], np.float32), [6, 12]))


def whole() -> Mechanism:
    """The same, with the corners of its trunk as frames: `BODY` needs them."""
    at = [RigidTransform(Rotation.identity(dtype=np.float32), p) for p in _CORNERS]
    return add_frames(mechanism(), [Frame(f"corner_{k}", "trunk", X) for k, X in enumerate(at)])


def standing() -> tuple[np.ndarray, np.ndarray]:
    """(q, v) on its feet, at rest but for what they give way."""
    height = 0.4 * np.cos(0.8) + 0.02
    return np.concatenate([np.array([1, 0, 0, 0, 0, 0, height], np.float32), _STANCE]), np.zeros(18, np.float32)


def step(mech: Mechanism, q, v, push, contacts: PointContacts = FEET) -> ConvexStep:
    """The state after DT, with a force `push` (3,), N in world axes, on the trunk."""
    tau = jnp.concatenate([jnp.zeros(6, q.dtype), _STIFFNESS * (_STANCE - q[7:])])
    return convex_step(mech, q, v, tau, DT, {"trunk": SpatialForce(f=push)}, contacts=contacts, ground=GROUND)


Pushes = Sequence[tuple[float, float, Sequence[float]]]


def pushed(seconds: float, pushes: Pushes, *, may_fall: bool = False) -> tuple[Mechanism, Any, list[Any]]:
    """(mechanism, q (n, 19), forces) of a motion, each push as (from, to, N); forces as `viewer.show` takes them.

    may_fall: then its trunk and its hips touch the ground as well as the feet."""
    mech, contacts = (whole(), BODY) if may_fall else (mechanism(), FEET)
    n = round(seconds / float(DT))
    t = (np.arange(n) + 0.5) * float(DT)
    force: Any = np.zeros((n, 3), np.float32)
    for begin, end, f in pushes:
        force[(begin <= t) & (t < end)] = f

    def after(state, push):
        q, v = state
        found = step(mech, q, v, push, contacts)
        return (found.q, found.v), (found.q, found.contact_forces)

    _, (q, contact_forces) = jax.jit(lambda *start: jax.lax.scan(after, start, force))(*standing())
    return mech, np.asarray(q), [AppliedForces(contacts.frames, contact_forces), {"trunk": SpatialForce(f=force)}]

"""The quadruped of the first look and of the demo: it stands on the ground by springs in its joints, and is pushed."""

import pathlib
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.step import ConvexStep, convex_step
from jaxspatial.mechanism import AppliedForces, HalfSpace, Mechanism, PointContacts
from jaxspatial.spatial import SpatialForce

FILE = pathlib.Path(__file__).with_name("quadruped.urdf")
# Seconds from one state to the next, a push of the trunk, N, and the joint stiffness of the controller, N m / rad.
DT, PUSH, _STIFFNESS = np.float32(5e-3), 60.0, np.float32(60)
FEET = PointContacts(
    [f"{end}_{side}_foot" for end in ("front", "hind") for side in ("left", "right")],
    radius=np.float32(0.02),
    stiffness=np.float32(2e4),
    relaxation_time=np.float32(0.01),
    friction=np.float32(0.8),
)
GROUND = HalfSpace(np.array([0, 0, 1], np.float32), np.float32(0))
# Hip, thigh and knee of each leg, rad; legs of two links of 0.2 m then end 0.28 m below the trunk.
_STANCE = np.tile(np.array([0, 0.8, -1.6], np.float32), 4)


def mechanism() -> Mechanism:
    """The robot, floating, with numbers of float32; dampers of the file act in its joints."""
    return Mechanism.from_urdf(FILE.read_text(), floating_base=True, dtype=np.float32)


def standing() -> tuple[np.ndarray, np.ndarray]:
    """(q, v) on its feet, at rest but for what they give way."""
    height = 0.4 * np.cos(0.8) + 0.02
    return np.concatenate([np.array([1, 0, 0, 0, 0, 0, height], np.float32), _STANCE]), np.zeros(18, np.float32)


def step(mech: Mechanism, q, v, push) -> ConvexStep:
    """The state after DT, with a force `push` (3,), N in world axes, on the trunk."""
    tau = jnp.concatenate([jnp.zeros(6, q.dtype), _STIFFNESS * (_STANCE - q[7:]) - v[6:]])
    return convex_step(mech, q, v, tau, DT, {"trunk": SpatialForce(f=push)}, contacts=FEET, ground=GROUND)


def pushed(seconds: float, pushes: Sequence[tuple[float, float, Sequence[float]]]) -> tuple[Mechanism, Any, list[Any]]:
    """(mechanism, q (n, 19), forces) of a motion, each push as (from, to, N); forces as `viewer.show` takes them."""
    mech, n = mechanism(), round(seconds / float(DT))
    t = (np.arange(n) + 0.5) * float(DT)
    force: Any = np.zeros((n, 3), np.float32)
    for begin, end, f in pushes:
        force[(begin <= t) & (t < end)] = f

    def after(state, push):
        q, v = state
        found = step(mech, q, v, push)
        return (found.q, found.v), (found.q, found.contact_forces)

    _, (q, contact_forces) = jax.jit(lambda *start: jax.lax.scan(after, start, force))(*standing())
    return mech, np.asarray(q), [AppliedForces(FEET.frames, contact_forces), {"trunk": SpatialForce(f=force)}]

"""Random mechanisms, for tests."""

import numpy as np

from jaxspatial.arithmetic.known import in_double
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import KINDS
from jaxspatial.mechanism.mechanism import Mechanism
from jaxspatial.mechanism.parts import WORLD, Body, Joint
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform


def random_mechanism(seed, n=12, kinds=None, is_chain=False, dtype=None):
    """A mechanism of n bodies that hang on each other at random, with masses, lengths and inertias of size 1.

    seed: an integer; kinds: of the joints, in turn, by default every kind there is; is_chain: each on the one before.
    The same for the same arguments. Every third axis is along one of the frame's, so that both ways are met.
    """
    rng = np.random.default_rng(seed)
    kinds = list(kinds or [name for name in KINDS if name != "fixed"])
    with in_double():
        bodies = [Body(f"body{i}", _inertia(rng)) for i in range(n)]
        joints = [_joint(rng, i, kinds[i % len(kinds)], is_chain) for i in range(n)]
        return Mechanism.build(bodies, joints, dtype=np.float64).astype(dtype or np.float64)


def _joint(rng, i, kind, is_chain):
    on = i - 1 if is_chain else int(rng.integers(-1, i))
    return Joint(
        f"joint{i}",
        kind,
        WORLD if on < 0 else f"body{on}",
        f"body{i}",
        placement=_pose(rng),
        axis=_axis(rng, i),
        second_axis=_axis(rng, i + 1),
        pitch=rng.standard_normal() if kind == "helical" else 0.0,
        armature=rng.uniform(0, 0.1) if i % 4 == 0 else 0.0,
        damping=rng.uniform(0, 1),
    )


def _axis(rng, i):
    return np.eye(3)[rng.integers(3)] if i % 3 == 0 else rng.standard_normal(3)


def _pose(rng):
    q = rng.standard_normal(4)
    R = Rotation.from_quaternion(q / np.linalg.norm(q)) if rng.random() < 0.7 else Rotation.identity(dtype=np.float64)
    return RigidTransform(R, rng.standard_normal(3))


def _inertia(rng):
    a = rng.standard_normal((3, 3))
    return SpatialInertia(
        np.float64(rng.uniform(0.5, 2.0)), rng.standard_normal(3) * 0.3, a @ a.T * 0.05 + np.eye(3) * 0.1
    )

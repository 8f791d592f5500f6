"""For tests: random mechanisms."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import AXIS, BUILT_IN, SECOND_AXIS, kind_named
from jaxspatial.mechanism.mechanism import Mechanism
from jaxspatial.mechanism.parts import WORLD, Body, Joint
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

__all__ = ["random_mechanism"]


def random_mechanism(
    seed: int, n: int = 12, kinds: Iterable[str] | None = None, is_chain: bool = False, dtype: DTypeLike | None = None
) -> Mechanism:
    """Builds a random mechanism with masses, lengths and inertias of the order of 1.

    Every third axis is along one of the frame's, so that tests meet both cases. The same arguments give the same
    mechanism.

    Args:
        seed: an integer.
        n: the number of bodies.
        kinds: the kinds of the joints, in turn; None for all built-in kinds except "fixed".
        is_chain: whether each body hangs on the one before; else it hangs on any body before it, or on the world.
        dtype: of all numbers; float64 for None.

    Returns:
        The mechanism, with NumPy numbers.

    Raises:
        KeyError: there is no such kind; lists those there are.

    Error: computed in float64, rounded once to the dtype.

    Example:
        >>> robot = js.testing.random_mechanism(0, n=4, kinds=["revolute"], dtype=np.float32)
        >>> robot.nv, robot.dtype
        (4, dtype('float32'))
    """
    rng = np.random.default_rng(seed)
    kinds = list(kinds or [kind.name for kind in BUILT_IN if kind.nv])
    with in_double():
        bodies = list[Body]()
        for i in range(n):
            a = rng.standard_normal((3, 3))
            mass, com = np.float64(rng.uniform(0.5, 2.0)), rng.standard_normal(3) * 0.3
            bodies.append(Body(f"body{i}", SpatialInertia(mass, com, a @ a.T * 0.05 + np.eye(3) * 0.1)))
        joints = [_joint(rng, i, kinds[i % len(kinds)], is_chain) for i in range(n)]
        return Mechanism.build(bodies, joints, dtype=np.float64).astype(dtype or np.float64)


def _joint(rng: np.random.Generator, i: int, kind: str, is_chain: bool):
    on = i - 1 if is_chain else int(rng.integers(-1, i))
    placement, axis, second_axis = _pose(rng), _axis(rng, i), _axis(rng, i + 1)
    # The parameters besides the axes: those of registered kinds, and fields of a joint.
    others = [p for p in kind_named(kind).parameters if p not in (AXIS, SECOND_AXIS)]
    values = {p: rng.standard_normal(p.size) for p in others}
    fields: dict[str, Any] = {p.name: x.item() for p, x in values.items() if p.field}
    return Joint(
        f"joint{i}",
        kind,
        WORLD if on < 0 else f"body{on}",
        f"body{i}",
        placement=placement,
        axis=axis,
        second_axis=second_axis,
        parameters={p.name: x for p, x in values.items() if not p.field},
        **fields,
        armature=rng.uniform(0, 0.1) if i % 4 == 0 else 0.0,
        damping=rng.uniform(0, 1),
    )


def _axis(rng: np.random.Generator, i: int):
    return np.eye(3)[rng.integers(3)] if i % 3 == 0 else rng.standard_normal(3)


def _pose(rng: np.random.Generator):
    q = rng.standard_normal(4)
    R = Rotation.from_quaternion(q / np.linalg.norm(q)) if rng.random() < 0.7 else Rotation.identity(dtype=np.float64)
    return RigidTransform(R, rng.standard_normal(3))

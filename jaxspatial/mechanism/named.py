"""Coordinates and velocities by the names of joints, and back."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import require_compatible
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


class NumbersByJoint(NamedTuple):
    """The numbers that a mapping by names of joints has: the coordinates q, or the velocities v.

    what: the argument in messages. size: "nq" or "nv". starts: the field of the Topology with the first number of each
    joint. types: of the values of some kinds.
    """

    what: str
    size: str
    starts: str
    types: dict[str, type]


POSITIONS = NumbersByJoint(
    "Mechanism.configuration: positions", "nq", "q_starts", {"free": RigidTransform, "ball": Rotation}
)
VELOCITIES = NumbersByJoint("Mechanism.velocities: velocities", "nv", "v_starts", {"free": SpatialVelocity})


def of_all_joints(t: Topology, which: NumbersByJoint, values: Mapping[str, Any], dtype: DTypeLike) -> Any:
    """The numbers (*batch, n) of all joints; NumPy where all values are."""
    if not isinstance(values, Mapping):
        check.refuse(which.what, "a mapping from names of joints", values)
    arrays = dict[int, Any]()
    for name, x in values.items():
        i = t.index(t.joint_names, name, which.what)
        if t.is_mimic(i):
            leader = t.joint_names[t.followed[i]]
            raise ValueError(f"{which.what}: {name!r} is a mimic: give {leader!r}, which it follows")
        arrays[i] = x
    like = floats.floating_dtype(*(leaf for x in arrays.values() for leaf in _leaves(x)))
    dtype = np.dtype(dtype if like is None else like)
    given = {i: _numbers(t, which, i, x, f"{which.what}[{t.joint_names[i]!r}]", dtype) for i, x in arrays.items()}
    own = list[Any]()
    for i, kind in ((i, t.kind(i)) for i in range(len(t)) if not t.is_mimic(i)):
        own.append(given.get(i, np.array(kind.neutral if which.size == "nq" else (0.0,) * kind.nv, dtype)))
    own = own or [np.zeros(0, dtype)]
    short = {t.joint_names[i]: x for i, x in given.items()} or {"": own[0]}
    batch = require_compatible(**short)
    concatenate = np.concatenate if all(isinstance(x, np.ndarray) for x in own) else jnp.concatenate
    return concatenate(floats.broadcast_batch(batch, *own), -1)


def by_joint(t: Topology, which: NumbersByJoint, x, what: str) -> dict[str, Any]:
    """{name of a joint: its numbers}, as `of_all_joints` takes them."""
    x = floats.as_vectors(x, what, size=getattr(t, which.starts)[-1])
    parts = dict[str, Any]()
    for i in (i for i in range(len(t)) if not t.is_mimic(i)):
        n, start = getattr(t.kind(i), which.size), getattr(t, which.starts)[i]
        part = x[..., start : start + n]
        parts[t.joint_names[i]] = _value(which.types.get(t.kinds[i]), part)
    return parts


def _leaves(x) -> list:
    if isinstance(x, RigidTransform):
        return [x.translation]
    return [x.entries] if isinstance(x, Rotation) else [x.v] if isinstance(x, SpatialVelocity) else [x]


def _numbers(t: Topology, which: NumbersByJoint, i: int, x, name: str, dtype: np.dtype):
    """The numbers (*batch, k) of one joint."""
    kind, n = t.kinds[i], getattr(t.kind(i), which.size)
    if isinstance(x, RigidTransform | Rotation | SpatialVelocity):
        if not isinstance(x, which.types.get(kind, ())):
            check.refuse(name, f"{_described(which, kind, n)} for a {kind!r} joint", x)
        if isinstance(x, RigidTransform):
            both = floats.broadcast_batch(x.batch_shape, x.rotation.to_quaternion(), x.translation)
            return jnp.concatenate(both, -1)
        return x.to_array() if isinstance(x, SpatialVelocity) else x.to_quaternion()
    array = floats.as_float_array(x, name, dtype)
    if n == 1:
        return array[..., None]
    if array.shape[-1:] != (n,):
        raise ValueError(f"{name}: expected {_described(which, kind, n)} for a {kind!r} joint, got shape {array.shape}")
    return array


def _described(which: NumbersByJoint, kind: str, n: int) -> str:
    array = "a number or (*batch,)" if n == 1 else f"shape (*batch, {n})"
    return f"a {which.types[kind].__name__}, or {array}" if kind in which.types else array


def _value(kind: type | None, x):
    if kind is SpatialVelocity:
        return SpatialVelocity(x[..., :3], x[..., 3:])
    if kind is Rotation:
        return Rotation.from_quaternion(x)
    if kind is RigidTransform:
        return RigidTransform(Rotation.from_quaternion(x[..., :4]), x[..., 4:])
    return x[..., 0] if x.shape[-1] == 1 else x

"""Coordinates and velocities by the names of joints, and back."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check
from jaxspatial.numerics.quantity import require_compatible
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


class Form(NamedTuple):
    """What a mapping by names stands for: the coordinates q, or the velocities v.

    what: the argument in messages. size: "nq" or "nv". starts: the field of the Topology with the first number of each
    joint. types: of the values of some kinds.
    """

    what: str
    size: str
    starts: str
    types: dict[str, type]


POSITIONS = Form("Mechanism.configuration: positions", "nq", "q_starts", {"free": RigidTransform, "ball": Rotation})
VELOCITIES = Form("Mechanism.velocities: velocities", "nv", "v_starts", {"free": SpatialVelocity})


def of_all_joints(t: Topology, form: Form, values: Mapping[str, Any], dtype: DTypeLike) -> Any:
    """The numbers (*batch, n) of all joints; NumPy where all values are."""
    if not isinstance(values, Mapping):
        check.refuse(form.what, "a mapping from names of joints", values)
    arrays = dict[int, Any]()
    for name, x in values.items():
        i = t.index(t.joint_names, name, form.what)
        if t.is_mimic(i):
            leader = t.joint_names[t.followed[i]]
            raise ValueError(f"{form.what}: {name!r} is a mimic: give {leader!r}, which it follows")
        arrays[i] = x
    like = check.floating_dtype(*(leaf for x in arrays.values() for leaf in _leaves(x)))
    dtype = np.dtype(dtype if like is None else like)
    given = {i: _numbers(t, form, i, x, f"{form.what}[{t.joint_names[i]!r}]", dtype) for i, x in arrays.items()}
    own = list[Any]()
    for i, kind in ((i, t.kind(i)) for i in range(len(t)) if not t.is_mimic(i)):
        own.append(given.get(i, np.array(kind.neutral if form.size == "nq" else (0.0,) * kind.nv, dtype)))
    own = own or [np.zeros(0, dtype)]
    short = {t.joint_names[i]: x for i, x in given.items()} or {"": own[0]}
    batch = require_compatible(**short)
    concatenate = np.concatenate if all(isinstance(x, np.ndarray) for x in own) else jnp.concatenate
    return concatenate(check.broadcast_batch(batch, *own), -1)


def by_joint(t: Topology, form: Form, x, what: str) -> dict[str, Any]:
    """{name of a joint: its numbers}, as `of_all_joints` takes them."""
    x = check.as_vectors(x, what, size=getattr(t, form.starts)[-1])
    parts = dict[str, Any]()
    for i in (i for i in range(len(t)) if not t.is_mimic(i)):
        n, start = getattr(t.kind(i), form.size), getattr(t, form.starts)[i]
        part = x[..., start : start + n]
        parts[t.joint_names[i]] = _value(form.types.get(t.kinds[i]), part)
    return parts


def _leaves(x) -> list:
    if isinstance(x, RigidTransform):
        return [x.translation]
    return [x.entries] if isinstance(x, Rotation) else [x.v] if isinstance(x, SpatialVelocity) else [x]


def _numbers(t: Topology, form: Form, i: int, x, name: str, dtype: np.dtype):
    """The numbers (*batch, k) of one joint."""
    kind, n = t.kinds[i], getattr(t.kind(i), form.size)
    if isinstance(x, RigidTransform | Rotation | SpatialVelocity):
        if not isinstance(x, form.types.get(kind, ())):
            check.refuse(name, f"{_described(form, kind, n)} for a {kind!r} joint", x)
        if isinstance(x, RigidTransform):
            both = check.broadcast_batch(x.batch_shape, x.rotation.to_quaternion(), x.translation)
            return jnp.concatenate(both, -1)
        return x.to_array() if isinstance(x, SpatialVelocity) else x.to_quaternion()
    array = check.as_float_array(x, name, dtype)
    if n == 1:
        return array[..., None]
    if array.shape[-1:] != (n,):
        raise ValueError(f"{name}: expected {_described(form, kind, n)} for a {kind!r} joint, got shape {array.shape}")
    return array


def _described(form: Form, kind: str, n: int) -> str:
    array = "a number or (*batch,)" if n == 1 else f"shape (*batch, {n})"
    return f"a {form.types[kind].__name__}, or {array}" if kind in form.types else array


def _value(kind: type | None, x):
    if kind is SpatialVelocity:
        return SpatialVelocity(x[..., :3], x[..., 3:])
    if kind is Rotation:
        return Rotation.from_quaternion(x)
    if kind is RigidTransform:
        return RigidTransform(Rotation.from_quaternion(x[..., :4]), x[..., 4:])
    return x[..., 0] if x.shape[-1] == 1 else x

"""The numbers of a model file: strict ones, within the dtype, and the mechanism that is made of them."""

import re
from collections.abc import Callable
from typing import Any, NoReturn, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt

from jaxspatial.arithmetic.numbers.folding import in_double
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.inertia import SpatialInertia
from jaxspatial.spatial import RigidTransform

# Entries of a rotation so near to 0 or 1 are what rounding made of quarter turns.
_ROUNDING = 8 * np.finfo(float).eps
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

Made = TypeVar("Made")
Refuse = Callable[[str, str, str], NoReturn]  # of "body", "joint" or "frame", its name and the reason
# What is a number per rate or coordinate, and adds up of what drives a joint and what follows it.
_OF_JOINTS = {"armature": "v", "damping": "v", "friction_loss": "v", "stiffness": "v", "spring_references": "q"}


def numbers_of(text: str):
    """The numbers of a text, as XML Schema writes finite decimals; None for anything else, "1_0" and "nan" too."""
    words = text.split()
    return [float(word) for word in words] if all(map(_NUMBER.fullmatch, words)) else None


def range_of(dtype: DTypeLike | None):
    """(the smallest normal, the largest) number of a dtype, JAX's default for None."""
    finfo: Any = jnp.finfo
    info = finfo(jax.dtypes.canonicalize_dtype(float if dtype is None else dtype))
    return float(info.tiny), float(info.max)


def built(build: Callable[..., Made], refuse: Refuse, *parts: Any):
    """build(*parts), a Mechanism; refused where what numbers make together is none of the dtype."""
    with np.errstate(over="ignore"):
        mechanism = build(*parts)
    _check_finite(mechanism, refuse)
    return mechanism


def _check_finite(mechanism: Any, refuse: Refuse):
    """Limits may be infinite."""
    of_bodies = dict.fromkeys(("placements", "child_placements", "axes", "mimics", "inertias"), "body")
    for field, what in {**of_bodies, "frame_placements": "frame"}.items():
        for leaf in jax.tree.leaves(getattr(mechanism, field)):
            bad = ~np.isfinite(leaf).all(tuple(range(1, leaf.ndim)))
            if bad.any():
                reason = f"{field}: with what is welded to it beyond the numbers of {mechanism.dtype}"
                refuse(what, getattr(mechanism, f"{what}_names")[int(bad.argmax())], reason)
    for field, size in _OF_JOINTS.items():
        array, own = getattr(mechanism, field), getattr(mechanism.topology, f"{size}_slice")
        for i, name in enumerate(mechanism.joint_names):
            if not np.isfinite(array[own(i)]).all():
                reason = f"{field}: with what drives it and follows it beyond the numbers of {mechanism.dtype}"
                refuse("joint", name, reason)


def rotation_of(entries: npt.ArrayLike):
    """(3, 3) of the entries of a rotation, in float64, without the rounding of quarter turns."""
    entries = np.asarray(entries, np.float64).reshape(3, 3)
    nearest = np.round(entries)
    return np.where(abs(entries - nearest) <= _ROUNDING, nearest, entries)


def with_moments(mass: float, X_BI: RigidTransform, moments: npt.ArrayLike):
    """M_BBo_B of a body with its centre of mass at I, and the (3, 3) moments about it in the axes of I."""
    R = X_BI.rotation.entries.reshape(3, 3)
    with in_double():
        return SpatialInertia(np.float64(mass), X_BI.translation, R @ np.asarray(moments, float) @ R.T)

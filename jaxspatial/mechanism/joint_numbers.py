"""The numbers that a joint is described with, checked: one per joint, rate or coordinate."""

from collections.abc import Iterable

import numpy as np

from jaxspatial.mechanism.joints import KINDS, Parameter
from jaxspatial.mechanism.parts import Joint, Mimic
from jaxspatial.mechanism.poses import known

# How far the length of a quaternion, or of a sine and cosine, may be from 1.
_UNIT = 1e-3


def registered_parameters(kinds: Iterable[str]):
    """What joints of these kinds are made with besides what every joint has."""
    return dict.fromkeys(p for kind in kinds for p in KINDS[kind].parameters if p.field is None)


def parameter(joint: Joint, p: Parameter):
    """The numbers of a parameter of a joint."""
    value = known(getattr(joint, p.name) if p.field else joint.parameters.get(p.name, p.default))
    if p.is_direction:
        return _unit(joint, p.name, value)
    if value.shape not in ((), (p.size,)):
        raise ValueError(
            f"Joint {joint.name!r}: {p.name}: expected {p.size} number{'s' * (p.size > 1)}, got shape {value.shape}"
        )
    return np.broadcast_to(value, (p.size,))


def _unit(joint: Joint, name: str, axis: np.ndarray):
    # By the largest first, whose square may over- or underflow.
    largest = abs(axis).max() if axis.shape == (3,) else 0.0
    if not (np.isfinite(largest) and largest > 0):
        raise ValueError(f"Joint {joint.name!r}: {name}: expected three numbers, not all zero, got {axis.tolist()}")
    axis = axis / 2.0 ** np.floor(np.log2(largest))
    return axis / np.linalg.norm(axis)


def as_of_followed(joint: Joint, mimic: Mimic):
    """(stiffness, reference) of the spring of a mimic, at the coordinate that it follows: of a q + b, and k, a^2 k."""
    stiffness = mimic.multiplier**2 * per([joint], "stiffness", "nv")[0]
    return stiffness, (spring_reference(joint) - mimic.offset) / (mimic.multiplier or 1.0)


def spring_reference(joint: Joint):
    """The coordinates at which the joint's spring rests."""
    kind = KINDS[joint.kind]
    found = np.array(kind.neutral) if joint.spring_reference is None else per([joint], "spring_reference", "nq")
    if (n := kind.sphere[0]) and abs(np.linalg.norm(found[:n]) - 1) > _UNIT:
        expected, came = "a unit quaternion" if n == 4 else f"{n} numbers of length 1", found[:n].tolist()
        raise ValueError(f"Joint {joint.name!r}: spring_reference: expected {expected} first, got {came}")
    return found


def per(joints: Iterable[Joint], name: str, size: str):
    """One number per rate or coordinate, of what is given per joint."""
    found: list[np.ndarray] = []
    for joint in joints:
        n = getattr(KINDS[joint.kind], size)
        value = known(getattr(joint, name))
        if value.shape not in ((), (n,)):
            raise ValueError(f"Joint {joint.name!r}: {name}: expected a number or {n} of them, got shape {value.shape}")
        found.append(np.broadcast_to(value, (n,)))
    return np.concatenate([np.zeros(0), *found])

"""The parts that a mechanism is built of, as a caller or a reader of files describes them: bodies, joints, frames."""

import dataclasses
import math
from collections.abc import Mapping
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from jax.core import Tracer

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import KINDS, Parameter
from jaxspatial.numerics import check, floats
from jaxspatial.spatial import RigidTransform

WORLD = "world"
# Numbers of a joint, and of a Mechanism, of which each velocity has its own.
PER_VELOCITY = "armature", "damping", "friction_loss", "stiffness", "effort_limit", "velocity_limit"
# Fields of joints that nothing real has below zero.
_AT_LEAST_ZERO = {"armature", "damping", "friction_loss", "effort_limit", "velocity_limit"}
# How far the length of a quaternion, or of a sine and cosine, may be from 1.
_UNIT = 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Args:
        name: unique among bodies and frames.
        inertia: M_BBo_B, a single SpatialInertia about the body's origin; None for a body without mass.
        lift: the part of the inertia that something holds against gravity, as a balloon does; its moments do not count.
            The force that holds it is one of the `passive_forces`. None for none.

    Example:
        >>> js.Body("upper", rod).inertia.mass
        array(2., dtype=float32)
    """

    name: str
    inertia: SpatialInertia | None = None
    lift: SpatialInertia | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """A named frame F on a body.

    Args:
        name: unique among bodies and frames.
        body: the body, or "world".
        placement: X_BF, a single RigidTransform; None where it is the body's own.

    Example:
        >>> tool = js.Frame("tool", "lower", below)
        >>> print(js.forward_kinematics(js.add_frames(arm, [tool]), jnp.zeros(2), "tool").translation[2])
        -2.0
    """

    name: str
    body: str
    placement: RigidTransform | None = None


class Mimic(NamedTuple):
    """A coordinate that follows that of another joint: multiplier q + offset, rad or m."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Joint:
    """A joint between the body `parent`, or "world", and the body `child` that it carries.

    Fields per velocity or per coordinate take a number for each, or one number for all.

    Args:
        name: unique among joints.
        kind: "fixed", "revolute", "continuous", "prismatic", "helical", "cylindrical", "universal", "planar", "ball",
            "free", or one that was registered; `jaxspatial.mechanism.joints` has their coordinates.
        parent, child: names of bodies; the parent may be "world".
        placement: X_PJ, the pose of the joint's frame J on the parent; None where they coincide.
        child_placement: X_JB at zero, the pose of the child's frame on its side of the joint; None where they coincide.
        axis, second_axis: directions in J of any length; the second serves "universal" only.
        pitch: of "helical", metres per radian.
        armature: inertia of the rotor, at the joint's side of the gears, kg m2 or kg; per velocity. The force is
            armature times the rate of the velocity: of the linear ones of "free" and "planar", whose axes turn, in the
            axes of the parent, so that these have one number for all.
        damping: N m s or N s/m; per velocity.
        friction_loss: N m or N; per velocity, along its axis: of "free" and "planar" those of the child.
        stiffness: of springs, N m/rad or N/m; per velocity. For "ball" and "free" see `passive_forces`.
        spring_reference: the coordinates that springs pull towards, zero for None; per coordinate.
        effort_limit: the largest force of the motor, N m or N; per velocity. `Actuators.torques` applies it.
        velocity_limit: rad/s or m/s; per velocity.
        lower, upper: limits of the coordinates, rad or m; per coordinate.
        mimic: (joint, multiplier, offset) where the coordinate follows that of another joint, which may follow one
            itself.
        parameters: values of the parameters that a registered kind declares, by name.
        turn_limit: of "ball", the largest angle of its rotation, rad.

    Raises:
        TypeError: the mimic has another form.
        ValueError: there is no such kind, or it has no such parameter or limit. `Mechanism.build` checks the rest.

    Example:
        >>> axle = js.Joint("axle", "continuous", "world", "wheel", axis=(1, 0, 0))
        >>> js.Mechanism.build([js.Body("wheel", rod)], [axle]).joint_names
        ('axle',)
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: RigidTransform | None = None
    child_placement: RigidTransform | None = None
    axis: Any = (0.0, 0.0, 1.0)
    second_axis: Any = (1.0, 0.0, 0.0)
    pitch: float = 0.0
    armature: Any = 0.0
    damping: Any = 0.0
    friction_loss: Any = 0.0
    stiffness: Any = 0.0
    spring_reference: Any = None
    effort_limit: Any = math.inf
    velocity_limit: Any = math.inf
    lower: Any = -math.inf
    upper: Any = math.inf
    mimic: tuple[Any, ...] | None = None
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict[str, Any])
    turn_limit: float = math.inf

    @property
    def follows(self) -> Mimic | None:
        """`mimic` with a name for each part."""
        return None if self.mimic is None else Mimic(*self.mimic)

    def __post_init__(self):
        if self.kind not in KINDS:
            known, near = ", ".join(map(repr, KINDS)), check.did_you_mean(self.kind, KINDS)
            raise ValueError(f"Joint {self.name!r}: kind: expected one of {known}, got {self.kind!r}{near}")
        if self.mimic is not None and not _is_mimic(self.mimic):
            expected = "(joint, multiplier, offset), a name and two numbers"
            raise TypeError(f"Joint {self.name!r}: mimic: expected {expected}, got {self.mimic!r}")
        if not isinstance(self.turn_limit, Real) or not self.turn_limit >= 0:
            raise ValueError(f"Joint {self.name!r}: turn_limit: expected a number >= 0, got {self.turn_limit!r}")
        if self.turn_limit != math.inf and self.kind != "ball":
            raise ValueError(f"Joint {self.name!r}: turn_limit: expected none for {self.kind!r}, got {self.turn_limit}")
        names = [p.name for p in KINDS[self.kind].parameters if p.field is None]
        for name in self.parameters:
            if name not in names:
                expected = f"one of {', '.join(map(repr, names))}" if names else f"none of {self.kind!r}"
                near = check.did_you_mean(name, names)
                raise ValueError(f"Joint {self.name!r}: parameters: expected {expected}, got {name!r}{near}")


# -- the numbers of parts, checked ------------------------------------------------------------------------------------


def _is_mimic(x: object) -> bool:
    if not isinstance(x, tuple | list) or not 1 <= len(x) <= 3:
        return False
    joint, *numbers = x
    return isinstance(joint, str) and all(isinstance(number, Real) for number in numbers)


def known(x, name: str = "Mechanism.build") -> np.ndarray:
    """Known numbers, in float64. name: what they are of, in messages."""
    if isinstance(x, Tracer):
        raise TypeError(
            "Mechanism.build: expected known numbers (NumPy), got data that is traced; build with known ones, and put "
            "data in their place with Mechanism.replace (results within jax.ensure_compile_time_eval() are known)"
        )
    return np.asarray(floats.as_float_array(x, name, np.dtype(np.float64), keep_dtype=True), np.float64)


def numbers(joint: Joint, name: str, size: str) -> np.ndarray:
    """The numbers of a field of a joint, one per generalized velocity ("nv") or coordinate ("nq")."""
    what = f"Joint {joint.name!r}: {name}"
    n, value = getattr(KINDS[joint.kind], size), known(getattr(joint, name), what)
    if value.shape not in ((), (n,)):
        raise ValueError(f"{what}: expected a number or {n} of them, got shape {value.shape}")
    is_wrong = np.isnan(value) | (value < 0 if name in _AT_LEAST_ZERO else False)
    if is_wrong.any():
        least = " of at least 0" if name in _AT_LEAST_ZERO else ""
        raise ValueError(f"{what}: expected numbers{least}, got {value.tolist()}")
    return np.broadcast_to(value, (n,))


def check_limits(joint: Joint):
    """Checks that the lower limits are not above the upper ones."""
    lower, upper = (numbers(joint, name, "nq") for name in ("lower", "upper"))
    if (lower > upper).any():
        least, most = (np.asarray(x).tolist() for x in (joint.lower, joint.upper))
        raise ValueError(f"Joint {joint.name!r}: lower: expected at most upper, {most}, got {least}")


def check_armature(joint: Joint):
    """Checks that one along axes that turn is the same along all of them: else it would make energy."""
    turned = [numbers(joint, "armature", "nv")[k] for k in KINDS[joint.kind].turned]
    if len(set(turned)) > 1:
        expected = f"one number for the linear velocities of {joint.kind!r}, whose axes turn"
        raise ValueError(f"Joint {joint.name!r}: armature: expected {expected}, got {np.array(turned).tolist()}")


def spring_reference(joint: Joint) -> np.ndarray:
    """The coordinates at which the spring of a joint rests."""
    kind = KINDS[joint.kind]
    q = np.array(kind.neutral) if joint.spring_reference is None else numbers(joint, "spring_reference", "nq")
    if (n := kind.sphere[0]) and abs(np.linalg.norm(q[:n]) - 1) > _UNIT:
        expected = "a unit quaternion" if n == 4 else f"{n} numbers of length 1"
        raise ValueError(f"Joint {joint.name!r}: spring_reference: expected {expected} first, got {q[:n].tolist()}")
    return q


def parameter(joint: Joint, p: Parameter) -> np.ndarray:
    """The numbers (size,) of a parameter of a joint; a unit vector for a direction."""
    given = getattr(joint, p.name) if p.field else joint.parameters.get(p.name, p.default)
    value = known(given, f"Joint {joint.name!r}: {p.name}")
    if p.is_direction:
        return _unit(joint, p.name, value)
    if value.shape not in ((), (p.size,)):
        expected = f"{p.size} number{'s' * (p.size > 1)}"
        raise ValueError(f"Joint {joint.name!r}: {p.name}: expected {expected}, got shape {value.shape}")
    if np.isnan(value).any():
        raise ValueError(f"Joint {joint.name!r}: {p.name}: expected numbers, got {value.tolist()}")
    return np.broadcast_to(value, (p.size,))


def _unit(joint: Joint, name: str, axis: np.ndarray):
    # Scaled by the largest entry first: the squares may over- or underflow.
    largest = abs(axis).max() if axis.shape == (3,) else 0.0
    if not (np.isfinite(largest) and largest > 0):
        raise ValueError(f"Joint {joint.name!r}: {name}: expected three numbers, not all zero, got {axis.tolist()}")
    axis = axis / 2.0 ** np.floor(np.log2(largest))
    return axis / np.linalg.norm(axis)

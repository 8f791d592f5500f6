"""What a mechanism is built of, as a caller or a reader of files describes it."""

import dataclasses
import math
import typing

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import KINDS
from jaxspatial.spatial import RigidTransform

WORLD = "world"


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """A rigid body. inertia: M_BBo_B, a single SpatialInertia about the body's origin; None for a body without mass."""

    name: str
    inertia: SpatialInertia | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """A named frame F on a body. placement: X_BF; None where it is the body's own."""

    name: str
    body: str
    placement: RigidTransform | None = None


class Mimic(typing.NamedTuple):
    """A coordinate that follows another joint's: multiplier q + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Joint:
    """What holds the body `child` against the body `parent`, or against "world".

    kind: "fixed", "revolute", "continuous", "prismatic", "helical", "cylindrical", "universal", "planar", "ball" or
        "free"; their coordinates: see `jaxspatial.mechanism.joints`
    placement: X_PJ, the pose of the joint's frame J on the parent; None where they coincide
    child_placement: X_JB at zero, the pose of the child's frame on its side of the joint; None where they coincide
    axis, second_axis: unit vectors in J; the second of "universal" only
    pitch: of "helical", metres per radian
    armature: inertia of what turns with the joint, at its side of the gears: kg m2, kg for what slides
    stiffness: of springs, N m/rad or N/m, that pull towards the coordinates spring_reference, zero for None; of "ball"
        and "free" see `passive_forces`
    damping: N m s or N s/m; friction_loss, effort_limit: N m or N; velocity_limit: rad/s or m/s
    lower, upper: limits of the coordinates. Each of these a number, or one per rate (coordinate, for the limits and
        spring_reference)
    mimic: (joint, multiplier, offset) where the coordinate follows another joint's
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: RigidTransform | None = None
    child_placement: RigidTransform | None = None
    axis: typing.Any = (0.0, 0.0, 1.0)
    second_axis: typing.Any = (1.0, 0.0, 0.0)
    pitch: float = 0.0
    armature: typing.Any = 0.0
    damping: typing.Any = 0.0
    friction_loss: typing.Any = 0.0
    stiffness: typing.Any = 0.0
    spring_reference: typing.Any = None
    effort_limit: typing.Any = math.inf
    velocity_limit: typing.Any = math.inf
    lower: typing.Any = -math.inf
    upper: typing.Any = math.inf
    mimic: Mimic | tuple | None = None

    def __post_init__(self):
        if self.kind not in KINDS:
            known = ", ".join(map(repr, KINDS))
            raise ValueError(f"Joint {self.name!r}: kind: expected one of {known}, got {self.kind!r}")

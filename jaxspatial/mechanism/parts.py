"""What a mechanism is built of, as a caller or a reader of files describes it."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from jaxspatial.arithmetic import check
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import KINDS
from jaxspatial.spatial import RigidTransform

WORLD = "world"


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """A rigid body.

    Args:
        name: how others refer to it.
        inertia: M_BBo_B, a single SpatialInertia about the body's origin; None for a body without mass.
    """

    name: str
    inertia: SpatialInertia | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """A named frame F on a body.

    Args:
        name: how others refer to it.
        body: the body, or "world".
        placement: X_BF, a single RigidTransform; None where it is the body's own.
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
    """A joint holds the body `child` against the body `parent`, or against "world".

    A number stands for each rate of the joint, or each coordinate, where several of them may be given.

    Args:
        name: how others refer to it.
        kind: "fixed", "revolute", "continuous", "prismatic", "helical", "cylindrical", "universal", "planar", "ball",
            "free", or one that was registered; their coordinates: see `jaxspatial.mechanism.joints`.
        parent, child: names of bodies; the parent may be "world".
        placement: X_PJ, the pose of the joint's frame J on the parent; None where they coincide.
        child_placement: X_JB at zero, the pose of the child's frame on its side of the joint; None where they coincide.
        axis, second_axis: directions in J, which become unit vectors; the second of "universal" only.
        pitch: of "helical", metres per radian.
        armature: inertia of what turns with the joint, at its side of the gears: kg m2, kg for what slides; per rate.
        damping: N m s or N s/m; per rate.
        friction_loss: N m or N; per rate.
        stiffness: of springs, N m/rad or N/m; per rate. Of "ball" and "free" see `passive_forces`.
        spring_reference: the coordinates that springs pull towards, zero for None; per coordinate.
        effort_limit: N m or N; per rate.
        velocity_limit: rad/s or m/s; per rate.
        lower, upper: limits of the coordinates, rad or m; per coordinate.
        mimic: (joint, multiplier, offset) where the coordinate follows that of another joint.
        parameters: what else a kind that was registered is made with, by name.

    Raises:
        ValueError: there is no such kind, or the kind has no such parameter. `Mechanism.build` checks the rest.
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

    @property
    def follows(self) -> Mimic | None:
        """What `mimic` says, with a name for each."""
        return None if self.mimic is None else Mimic(*self.mimic)

    def __post_init__(self):
        if self.kind not in KINDS:
            known, near = ", ".join(map(repr, KINDS)), check.did_you_mean(self.kind, KINDS)
            raise ValueError(f"Joint {self.name!r}: kind: expected one of {known}, got {self.kind!r}{near}")
        own = [p.name for p in KINDS[self.kind].parameters if p.field is None]
        for name in self.parameters:
            if name not in own:
                expected = f"one of {', '.join(map(repr, own))}" if own else f"none of {self.kind!r}"
                near = check.did_you_mean(name, own)
                raise ValueError(f"Joint {self.name!r}: parameters: expected {expected}, got {name!r}{near}")

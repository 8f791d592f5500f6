"""What joints are made with."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A number, or a vector, that joints of a kind are made with; m, rad or what the kind says.

    name: of a joint's `parameters`, and of the arrays (n, size) of all joints in `Mechanism.parameters`
    size: how many numbers it is
    default: its value where a joint has none
    is_direction: whether it becomes a unit vector
    field: where joints have an attribute for it, the field of a Mechanism that holds it: of the three below alone
    """

    name: str
    size: int = 1
    default: float | tuple[float, ...] = 0.0
    is_direction: bool = False
    field: str | None = None


# What the joint turns about or slides along, in its frame J; of "universal" the axis that the first one carries.
AXIS = Parameter("axis", 3, (0.0, 0.0, 1.0), is_direction=True, field="axes")
SECOND_AXIS = Parameter("second_axis", 3, (1.0, 0.0, 0.0), is_direction=True, field="second_axes")
# Metres per radian.
PITCH = Parameter("pitch", field="pitches")
OF_EVERY_JOINT = AXIS, SECOND_AXIS, PITCH

"""The error bounds of rotations and rigid motions: see `arithmetic.promise`."""

from jaxspatial.arithmetic.promise import Normwise, Promise

# R v, of a vector or of each column of a rotation.
ROTATED = Promise(3, 4)


def _normwise(u: float, of: str = "normwise") -> Normwise:
    """Of angles: in "compensated" and "faithful" every number is rounded once."""
    return Normwise(u, of, u2=16 * u)


SINE = _normwise(2, "for angles")
FROM_QUATERNION, FROM_AXIS_ANGLE, FROM_ROLL_PITCH_YAW = _normwise(6), _normwise(8), _normwise(8)
TO_QUATERNION, TO_AXIS, TO_ANGLE = _normwise(4), _normwise(6, "of the axis"), _normwise(8, "of the angle")
TO_ROLL_PITCH_YAW, TO_ROLL = _normwise(24), _normwise(24, "/ cos(pitch)")
FROM_ONE_VECTOR, FROM_TWO_VECTORS, BETWEEN, NEAREST = _normwise(6), _normwise(8), _normwise(8), _normwise(12)
EXP, LOG, EXP_TRANSLATION, LOG_TRANSLATION = _normwise(6), _normwise(6), _normwise(6, "|v|"), _normwise(8, "|v|")
# Beyond half a turn.
TURNS = Normwise(2, "|w|", rounded=0)
JACOBIAN, JACOBIAN_INVERSE = _normwise(6), _normwise(6)
MOTION_JACOBIAN, MOTION_JACOBIAN_INVERSE = _normwise(12), _normwise(16)
# And each time the whole way is gone.
INTERPOLATED, EACH_WAY = _normwise(24), _normwise(16, "|t|")

# Whose docstrings state which.
PROMISES = {
    "Rotation.__matmul__": (ROTATED,),
    "Rotation.about_x": (SINE,),
    "Rotation.between": (BETWEEN,),
    "Rotation.exp": (EXP, TURNS),
    "Rotation.from_axis_angle": (FROM_AXIS_ANGLE,),
    "Rotation.from_one_vector": (FROM_ONE_VECTOR,),
    "Rotation.from_quaternion": (FROM_QUATERNION,),
    "Rotation.from_roll_pitch_yaw": (FROM_ROLL_PITCH_YAW,),
    "Rotation.from_two_vectors": (FROM_TWO_VECTORS,),
    "Rotation.interpolate": (INTERPOLATED, EACH_WAY),
    "Rotation.left_jacobian": (JACOBIAN,),
    "Rotation.left_jacobian_inverse": (JACOBIAN_INVERSE,),
    "Rotation.log": (LOG,),
    "Rotation.nearest": (NEAREST,),
    "Rotation.to_axis_angle": (TO_AXIS, TO_ANGLE),
    "Rotation.to_quaternion": (TO_QUATERNION,),
    "Rotation.to_roll_pitch_yaw": (TO_ROLL_PITCH_YAW, TO_ROLL),
}

"""The error bounds of the operations on spatial vectors: see `arithmetic.promise`. Sums of n items: of_sum(n)."""

from jaxspatial.arithmetic.promise import OfSum, Promise
from jaxspatial.rotation import promises as of_rotations
from jaxspatial.rotation.promises import ROTATED

SHIFT, SHIFT_ACCELERATION = Promise(3, 4), Promise(7, 32)
DOT = Promise(4, 8)
# cross: the part that is one product of vectors, and the part that is the sum of two.
CROSS_ONE, CROSS_TWO = Promise(2, 4), Promise(3, 4)
ACT, ACT_ACCELERATION = Promise(8, 32), Promise(14, 128)
# R S R^T of a central inertia.
ROTATED_INERTIA = Promise(6, 32)
POINT = Promise(4, 8, mag="|R| |p_BQ| + |p_AB|")
COMPOSED, COMPOSED_ACCELERATION = Promise(4, 4), Promise(10, 32)
CENTRAL_AXIS = Promise(7, 32, mag="the sum of the absolute values of the numerator's terms over f . f")
PRESSED = Promise(3.5, 32, u_of_result=4, u2_of_result=32)

# Whose docstrings state which.
PROMISES = {
    "shift": (SHIFT, SHIFT_ACCELERATION),
    "dot": (DOT,),
    "cross": (CROSS_ONE, CROSS_TWO),
    "rotate": (ROTATED, ROTATED_INERTIA),
    "act": (ACT, ACT_ACCELERATION),
    "SpatialVelocity.compose_with_moving_frame": (COMPOSED,),
    "SpatialAcceleration.compose_with_moving_frame": (COMPOSED_ACCELERATION,),
    "central_axis": (CENTRAL_AXIS,),
    "center_of_pressure": (PRESSED,),
    **dict.fromkeys((f"Spatial{kind}.sum" for kind in ("Acceleration", "Force", "Momentum", "Velocity")), (OfSum(),)),
    "wrench_from_point_forces": (OfSum(2),),
    "RigidTransform.__matmul__": (POINT,),
    "RigidTransform.exp": (of_rotations.EXP_TRANSLATION, of_rotations.TURNS),
    "RigidTransform.interpolate": (of_rotations.INTERPOLATED, of_rotations.EACH_WAY),
    "RigidTransform.left_jacobian": (of_rotations.MOTION_JACOBIAN,),
    "RigidTransform.left_jacobian_inverse": (of_rotations.MOTION_JACOBIAN_INVERSE,),
    "RigidTransform.log": (of_rotations.LOG_TRANSLATION,),
}


def of_sum(n: int, each: int = 0) -> Promise:
    """Of n items, by halving; each: the factor of one of them, 2 for a cross product."""
    rounds = OfSum(each).factor(n)
    return Promise(u=rounds, u2=2 * rounds**2, u3=n**2)

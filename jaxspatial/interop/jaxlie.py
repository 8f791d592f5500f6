"""jaxlie: poses [wxyz; xyz], tangents [v; w], batched over leading axes as here. It has no forces."""

from jaxspatial.interop import orders
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import SpatialVelocity


def from_so3(R_AB, *, precision=None):
    """Of a jaxlie.SO3, which holds quaternions wxyz."""
    return Rotation.from_quaternion(R_AB.wxyz, precision=precision)


def to_so3(R_AB, *, precision=None):
    """jaxlie.SO3, the real part not negative."""
    import jaxlie

    return jaxlie.SO3(wxyz=R_AB.to_quaternion(precision=precision))


def from_se3(X_AB, *, precision=None):
    """Of a jaxlie.SE3, which holds [wxyz; p_AB]."""
    return orders.pose_from_wxyz_xyz(X_AB.wxyz_xyz, precision=precision)


def to_se3(X_AB, *, precision=None):
    """jaxlie.SE3, the real part not negative."""
    import jaxlie

    return jaxlie.SE3(wxyz_xyz=orders.pose_to_wxyz_xyz(X_AB, precision=precision))


def from_tangent(x6):
    """The SpatialVelocity, over unit time, of a tangent (*batch, 6) [v; w] of SE3: `exp` is the same of both."""
    return orders.from_linear_first(SpatialVelocity, x6)


def to_tangent(V):
    """The tangent (*batch, 6) [v; w] of SE3 of a SpatialVelocity over unit time."""
    return orders.to_linear_first(V)


def from_adjoint(m):
    """`RigidTransform.to_motion_matrix` of jaxlie's `SE3.adjoint()` (*batch, 6, 6), which acts on [v; w]. Exact."""
    return orders.matrix_from_linear_first(m)


def to_adjoint(m):
    """jaxlie's `SE3.adjoint()` of `RigidTransform.to_motion_matrix()`; the inverse transpose acts on [f; tau]."""
    return orders.matrix_to_linear_first(m)

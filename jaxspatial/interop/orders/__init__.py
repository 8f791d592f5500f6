"""Orders of components, on arrays: what other libraries, file formats and papers put where.

Ours: six-vectors and 6 x 6 matrices have the rotational part on top, quaternions are wxyz, symmetric 3 x 3 matrices are
their lower triangle by rows, [xx, xy, yy, xz, yz, zz] (Pinocchio's Symmetric3 is that too). Everything below only moves
numbers, exactly; poses alone are computed, since we hold a matrix where others hold a quaternion.
"""

from jaxspatial.interop.orders.poses import pose_from_wxyz_xyz as pose_from_wxyz_xyz
from jaxspatial.interop.orders.poses import pose_from_xyz_wxyz as pose_from_xyz_wxyz
from jaxspatial.interop.orders.poses import pose_from_xyz_xyzw as pose_from_xyz_xyzw
from jaxspatial.interop.orders.poses import pose_to_wxyz_xyz as pose_to_wxyz_xyz, pose_to_xyz_wxyz as pose_to_xyz_wxyz
from jaxspatial.interop.orders.poses import pose_to_xyz_xyzw as pose_to_xyz_xyzw
from jaxspatial.interop.orders.poses import quaternion_from_xyzw as quaternion_from_xyzw
from jaxspatial.interop.orders.poses import quaternion_to_xyzw as quaternion_to_xyzw
from jaxspatial.interop.orders.symmetric import single as single
from jaxspatial.interop.orders.symmetric import symmetric_from_diagonal_first as symmetric_from_diagonal_first
from jaxspatial.interop.orders.symmetric import symmetric_from_upper_triangle as symmetric_from_upper_triangle
from jaxspatial.interop.orders.symmetric import symmetric_to_diagonal_first as symmetric_to_diagonal_first
from jaxspatial.interop.orders.symmetric import symmetric_to_upper_triangle as symmetric_to_upper_triangle
from jaxspatial.interop.orders.vectors import from_linear_first as from_linear_first
from jaxspatial.interop.orders.vectors import from_rotational_first as from_rotational_first
from jaxspatial.interop.orders.vectors import matrix_from_linear_first as matrix_from_linear_first
from jaxspatial.interop.orders.vectors import matrix_to_linear_first as matrix_to_linear_first
from jaxspatial.interop.orders.vectors import to_linear_first as to_linear_first
from jaxspatial.interop.orders.vectors import to_rotational_first as to_rotational_first

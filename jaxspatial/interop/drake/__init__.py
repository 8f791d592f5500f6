"""Drake (pydrake): rotational part first, about a point, accelerations classical, quaternions wxyz: as ours.

Objects of pydrake are single and float64: what is read is NumPy, copied, in float64, known while tracing;
what is made takes one item. Read: Drake's multibody/math and multibody/tree headers, pydrake 1.51.
"""

from jaxspatial.interop.drake.frames import from_floating_positions as from_floating_positions
from jaxspatial.interop.drake.frames import from_floating_velocities as from_floating_velocities
from jaxspatial.interop.drake.frames import from_rigid_transform as from_rigid_transform
from jaxspatial.interop.drake.frames import from_rotation_matrix as from_rotation_matrix
from jaxspatial.interop.drake.frames import to_floating_positions as to_floating_positions
from jaxspatial.interop.drake.frames import to_floating_velocities as to_floating_velocities
from jaxspatial.interop.drake.frames import to_rigid_transform as to_rigid_transform
from jaxspatial.interop.drake.frames import to_rotation_matrix as to_rotation_matrix
from jaxspatial.interop.drake.inertia import from_inertia as from_inertia, to_inertia as to_inertia
from jaxspatial.interop.drake.vectors import from_acceleration as from_acceleration, from_columns as from_columns
from jaxspatial.interop.drake.vectors import from_externally_applied as from_externally_applied
from jaxspatial.interop.drake.vectors import from_force as from_force, from_momentum as from_momentum
from jaxspatial.interop.drake.vectors import from_velocity as from_velocity, to_acceleration as to_acceleration
from jaxspatial.interop.drake.vectors import to_columns as to_columns, to_externally_applied as to_externally_applied
from jaxspatial.interop.drake.vectors import to_force as to_force, to_momentum as to_momentum
from jaxspatial.interop.drake.vectors import to_velocity as to_velocity

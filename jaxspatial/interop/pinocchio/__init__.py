"""Pinocchio: Force [f; tau] and Motion [v; w], linear part first; accelerations are Featherstone's; SE3 as X_AB.

Its Force is a force as well as a momentum, its Motion a velocity as well as an acceleration: which one is meant is said
by the name of the function here. Objects are single and float64: what is read is NumPy, copied, in float64, known while
tracing; what is made takes one item. Read: Pinocchio's spatial headers, pin 4.1.
"""

from jaxspatial.interop.pinocchio.frames import from_free_flyer_configuration as from_free_flyer_configuration
from jaxspatial.interop.pinocchio.frames import from_free_flyer_velocity as from_free_flyer_velocity
from jaxspatial.interop.pinocchio.frames import from_local_world_aligned as from_local_world_aligned
from jaxspatial.interop.pinocchio.frames import from_se3 as from_se3, from_world as from_world
from jaxspatial.interop.pinocchio.frames import to_free_flyer_configuration as to_free_flyer_configuration
from jaxspatial.interop.pinocchio.frames import to_free_flyer_velocity as to_free_flyer_velocity
from jaxspatial.interop.pinocchio.frames import to_local_world_aligned as to_local_world_aligned, to_se3 as to_se3
from jaxspatial.interop.pinocchio.frames import to_world as to_world
from jaxspatial.interop.pinocchio.inertia import from_inertia as from_inertia, from_log_cholesky as from_log_cholesky
from jaxspatial.interop.pinocchio.inertia import from_pseudo_inertia as from_pseudo_inertia, to_inertia as to_inertia
from jaxspatial.interop.pinocchio.inertia import to_log_cholesky as to_log_cholesky
from jaxspatial.interop.pinocchio.inertia import to_pseudo_inertia as to_pseudo_inertia
from jaxspatial.interop.pinocchio.vectors import from_classical_acceleration as from_classical_acceleration
from jaxspatial.interop.pinocchio.vectors import from_force as from_force, from_momentum as from_momentum
from jaxspatial.interop.pinocchio.vectors import from_motion as from_motion
from jaxspatial.interop.pinocchio.vectors import from_spatial_acceleration as from_spatial_acceleration
from jaxspatial.interop.pinocchio.vectors import to_classical_acceleration as to_classical_acceleration
from jaxspatial.interop.pinocchio.vectors import to_force as to_force, to_motion as to_motion
from jaxspatial.interop.pinocchio.vectors import to_spatial_acceleration as to_spatial_acceleration

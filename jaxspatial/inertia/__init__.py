"""Layer 3: inertia of rigid and articulated bodies, and the laws of motion of one."""

from jaxspatial.inertia import placement as placement
from jaxspatial.inertia.articulated_inertia import ArticulatedInertia as ArticulatedInertia
from jaxspatial.inertia.articulated_inertia import joint_projection as joint_projection
from jaxspatial.inertia.inertia import SpatialInertia as SpatialInertia
from jaxspatial.inertia.newton_euler import kinetic_energy_regressor as kinetic_energy_regressor
from jaxspatial.inertia.newton_euler import momentum_regressor as momentum_regressor, newton_euler as newton_euler
from jaxspatial.inertia.newton_euler import newton_euler_regressor as newton_euler_regressor

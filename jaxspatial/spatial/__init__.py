"""Layer 2: spatial vectors, and the operations in which they meet."""

# What registers `act` and `act_inverse` of spatial vectors.
from jaxspatial.spatial import frames as frames
from jaxspatial.spatial.acceleration import SpatialAcceleration as SpatialAcceleration
from jaxspatial.spatial.force import SpatialForce as SpatialForce
from jaxspatial.spatial.force import SpatialMomentum as SpatialMomentum
from jaxspatial.spatial.motion_force import cross as cross
from jaxspatial.spatial.motion_force import dot as dot
from jaxspatial.spatial.operations import act as act
from jaxspatial.spatial.operations import act_inverse as act_inverse
from jaxspatial.spatial.operations import rotate as rotate
from jaxspatial.spatial.operations import shift as shift
from jaxspatial.spatial.transform import RigidTransform as RigidTransform
from jaxspatial.spatial.velocity import SpatialVelocity as SpatialVelocity
from jaxspatial.spatial.wrench import CentralAxis as CentralAxis
from jaxspatial.spatial.wrench import center_of_pressure as center_of_pressure
from jaxspatial.spatial.wrench import central_axis as central_axis
from jaxspatial.spatial.wrench import wrench_from_point_forces as wrench_from_point_forces

"""Spatial vectors, and the operations in which they meet."""

from jaxspatial.spatial.operations import act as act, act_inverse as act_inverse, cross as cross, dot as dot
from jaxspatial.spatial.operations import rotate as rotate, shift as shift
from jaxspatial.spatial.transform import RigidTransform as RigidTransform
from jaxspatial.spatial.vectors import SpatialAcceleration as SpatialAcceleration, SpatialForce as SpatialForce
from jaxspatial.spatial.vectors import SpatialMomentum as SpatialMomentum, SpatialVelocity as SpatialVelocity
from jaxspatial.spatial.wrench import CentralAxis as CentralAxis, center_of_pressure as center_of_pressure
from jaxspatial.spatial.wrench import central_axis as central_axis, wrench_from_point_forces as wrench_from_point_forces

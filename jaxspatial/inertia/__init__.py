"""Inertia of rigid and articulated bodies, and the equations of motion of one."""

from jaxspatial.inertia import regressors as regressors
from jaxspatial.inertia.articulated import ArticulatedInertia as ArticulatedInertia
from jaxspatial.inertia.articulated import joint_projection as joint_projection
from jaxspatial.inertia.divergence import bregman_divergence as bregman_divergence
from jaxspatial.inertia.inertia import SpatialInertia as SpatialInertia
from jaxspatial.inertia.newton_euler import newton_euler as newton_euler

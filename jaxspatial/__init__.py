"""Spatial (6-D) vector algebra for JAX: wrenches, velocities, momenta, and what is done with them.

    import jaxspatial as js

    F_Bp_E = js.SpatialForce(tau, f)            # torque on top of force, about point Bp
    F_Bq_E = js.shift(F_Bp_E, p_BpBq_E)         # the same wrench about Bq
    power = js.dot(F_Bq_E, V_MBq_E)

This list is what is promised; everything else may change.
"""

from importlib.metadata import version as _version
from typing import TYPE_CHECKING as _TYPE_CHECKING

# how numbers are added and multiplied
from jaxspatial.numerics.floats import NarrowingWarning as NarrowingWarning
from jaxspatial.numerics.numbers.components import Components as Components
from jaxspatial.numerics.numbers.components import from_components as from_components
from jaxspatial.numerics.numbers.double_word import DoubleWord as DoubleWord
from jaxspatial.numerics.numbers.double_word import from_double_word as from_double_word
from jaxspatial.numerics.numbers.double_word import to_double_word as to_double_word
from jaxspatial.numerics.precision import Precision as Precision
from jaxspatial.numerics.precision import default_precision as default_precision

# rotations and frames
from jaxspatial.rotation import Rotation as Rotation
from jaxspatial.spatial import RigidTransform as RigidTransform

# spatial vectors
from jaxspatial.spatial import SpatialAcceleration as SpatialAcceleration
from jaxspatial.spatial import SpatialForce as SpatialForce
from jaxspatial.spatial import SpatialMomentum as SpatialMomentum
from jaxspatial.spatial import SpatialVelocity as SpatialVelocity

# batches of all of these, and of inertias
from jaxspatial.numerics.quantity import stack as stack

# operations on them
from jaxspatial.spatial import act as act
from jaxspatial.spatial import act_inverse as act_inverse
from jaxspatial.spatial import cross as cross
from jaxspatial.spatial import dot as dot
from jaxspatial.spatial import rotate as rotate
from jaxspatial.spatial import shift as shift

# inertia
from jaxspatial.inertia import ArticulatedInertia as ArticulatedInertia
from jaxspatial.inertia import SpatialInertia as SpatialInertia
from jaxspatial.inertia import bregman_divergence as bregman_divergence
from jaxspatial.inertia import newton_euler as newton_euler

# mechanisms
from jaxspatial.mechanism import Actuators as Actuators
from jaxspatial.mechanism import AppliedForces as AppliedForces
from jaxspatial.mechanism import Body as Body
from jaxspatial.mechanism import Frame as Frame
from jaxspatial.mechanism import Joint as Joint
from jaxspatial.mechanism import LoopClosure as LoopClosure
from jaxspatial.mechanism import Mechanism as Mechanism
from jaxspatial.mechanism import PointContacts as PointContacts
from jaxspatial.mechanism import ShapeContacts as ShapeContacts
from jaxspatial.mechanism import StaticMechanism as StaticMechanism
from jaxspatial.mechanism import Tendon as Tendon
from jaxspatial.mechanism import add_frames as add_frames
from jaxspatial.mechanism import lock_joints as lock_joints
from jaxspatial.mechanism import subtree as subtree

# shapes, and distances between them
from jaxspatial.mechanism import Box as Box
from jaxspatial.mechanism import Capsule as Capsule
from jaxspatial.mechanism import ClosestPoints as ClosestPoints
from jaxspatial.mechanism import Cylinder as Cylinder
from jaxspatial.mechanism import HalfSpace as HalfSpace
from jaxspatial.mechanism import HeightField as HeightField
from jaxspatial.mechanism import SignedDistance as SignedDistance
from jaxspatial.mechanism import Sphere as Sphere
from jaxspatial.mechanism import Stairs as Stairs
from jaxspatial.mechanism import Union as Union
from jaxspatial.mechanism import closest_points as closest_points
from jaxspatial.mechanism import distance as distance

# dynamics
from jaxspatial.dynamics.centroid import center_of_mass as center_of_mass
from jaxspatial.dynamics.centroid import center_of_mass_jacobian as center_of_mass_jacobian
from jaxspatial.dynamics.centroid import center_of_mass_velocity as center_of_mass_velocity
from jaxspatial.dynamics.centroid import centroidal_momentum as centroidal_momentum
from jaxspatial.dynamics.centroid import centroidal_momentum_matrix as centroidal_momentum_matrix
from jaxspatial.contact.closed_loops import close_loops as close_loops
from jaxspatial.contact.closed_loops import constrained_forward_dynamics as constrained_forward_dynamics
from jaxspatial.contact.closed_loops import constraint_error as constraint_error
from jaxspatial.contact.closed_loops import constraint_jacobian as constraint_jacobian
from jaxspatial.dynamics.configuration import configuration_rates as configuration_rates
from jaxspatial.dynamics.configuration import difference as difference
from jaxspatial.dynamics.configuration import integrate as integrate
from jaxspatial.dynamics.configuration import interpolate as interpolate
from jaxspatial.dynamics.configuration import random_configuration as random_configuration
from jaxspatial.contact.explicit import contact_forces as contact_forces
from jaxspatial.contact.report import ContactReport as ContactReport
from jaxspatial.contact.report import contact_report as contact_report
from jaxspatial.contact.step import ConvexStep as ConvexStep
from jaxspatial.contact.step import convex_step as convex_step
from jaxspatial.dynamics.energy import kinetic_energy as kinetic_energy
from jaxspatial.dynamics.energy import potential_energy as potential_energy
from jaxspatial.dynamics.external_forces import applied_wrenches as applied_wrenches
from jaxspatial.dynamics.forward_dynamics import forward_dynamics as forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import bias_forces as bias_forces
from jaxspatial.dynamics.inverse_dynamics import gravity_forces as gravity_forces
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics as inverse_dynamics
from jaxspatial.dynamics.inverse_kinematics import inverse_kinematics as inverse_kinematics
from jaxspatial.dynamics.inverse_dynamics import joint_reactions as joint_reactions
from jaxspatial.dynamics.jacobians import jacobian as jacobian
from jaxspatial.dynamics.jacobians import jacobian_rate as jacobian_rate
from jaxspatial.dynamics.kinematics import body_accelerations as body_accelerations
from jaxspatial.dynamics.kinematics import body_velocities as body_velocities
from jaxspatial.dynamics.kinematics import forward_kinematics as forward_kinematics
from jaxspatial.dynamics.linearization import forward_dynamics_derivatives as forward_dynamics_derivatives
from jaxspatial.dynamics.linearization import inverse_dynamics_derivatives as inverse_dynamics_derivatives
from jaxspatial.dynamics.composite_bodies import mass_matrix as mass_matrix
from jaxspatial.dynamics.composite_bodies import mass_matrix_factor as mass_matrix_factor
from jaxspatial.dynamics.momentum_observer import MomentumObserver as MomentumObserver
from jaxspatial.dynamics.passive import Compliance as Compliance
from jaxspatial.dynamics.passive import passive_forces as passive_forces
from jaxspatial import regressors as regressors
from jaxspatial.dynamics.steps import rk4_step as rk4_step
from jaxspatial.dynamics.steps import semi_implicit_step as semi_implicit_step
from jaxspatial.dynamics.steps import symplectic_step as symplectic_step

# wrenches and points
from jaxspatial.spatial import center_of_pressure as center_of_pressure
from jaxspatial.spatial import central_axis as central_axis
from jaxspatial.spatial import wrench_from_point_forces as wrench_from_point_forces

# which version
__version__ = _version("jaxspatial")

# What a program that computes has no use for is imported when it is first asked for.
if _TYPE_CHECKING:
    # random mechanisms, for tests
    from jaxspatial import testing as testing

    # objects and arrays of other libraries; accuracy and speed of one's own functions
    from jaxspatial import interop as interop
    from jaxspatial import measure as measure

    # does it hold here
    from jaxspatial.measure import self_check as self_check

_LATER = {
    "testing": "jaxspatial.testing",
    "interop": "jaxspatial.interop",
    "measure": "jaxspatial.measure",
    "self_check": "jaxspatial.measure",
}


def __getattr__(name: str) -> object:
    if name not in _LATER:
        from jaxspatial.numerics.check import did_you_mean

        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{did_you_mean(name, __dir__())}")
    from importlib import import_module

    module = import_module(_LATER[name])
    return getattr(module, name, module)


# Folders, which `import` makes attributes: what of them is promised stands above.
_FOLDERS = {"command", "contact", "dynamics", "engine", "inertia", "mechanism", "numerics", "rotation", "spatial"}


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER} - _FOLDERS)

"""The table of public functions of a mechanism and a state, over which their behaviour under JAX is tested.

A new function is one line. `tests.helpers.operations` is the table of all others.
"""

import functools

import numpy as np

import jaxspatial as js

F32 = np.float32
# Two of one kind are a loop over rows.
KINDS = "revolute", "revolute", "prismatic", "ball"


@functools.cache
def mechanism():
    return js.testing.random_mechanism(0, 4, KINDS, is_chain=True, dtype=F32)


def state(batch_shape, seed=0):
    """(q, v, a) as NumPy arrays over a batch."""
    mech, rng = mechanism(), np.random.default_rng(seed)
    v, a = (rng.standard_normal((*batch_shape, mech.nv)).astype(F32) for _ in range(2))
    q = rng.standard_normal((*batch_shape, mech.nq)).astype(F32)
    return q, v, a


CONTACTS = js.PointContacts(
    ["body1", "body3"], radius=F32(0.1), stiffness=F32(1e3), relaxation_time=F32(0.02), friction=F32(0.5)
)
GROUND = js.HalfSpace(np.array([0, 0, 1], F32), F32(-0.5))
LOOPS = [js.LoopClosure("world", "body3", "ball")]


def _pushed(x):
    """Forces of the state: one over each."""
    return js.SpatialForce(x[..., :3], x[..., 1:4])


def _applied(x):
    return js.AppliedForces(["body1", "body3"], js.stack([_pushed(x), _pushed(-x)], -1), axes="frame")


def _observed(mech, q, v, a):
    return js.MomentumObserver.start(mech, q, 0.5 * v).update(mech, q, v, a, F32(0.01), F32(10)).residual


COMPLIANCE = js.Compliance(*(np.full(mechanism().nv, x, F32) for x in (1.0, 0.5, 0.1)))
H = F32(0.01)

# Each of (mech, q, v, a).
ALGORITHMS = {
    "applied_wrenches": lambda mech, q, v, a: js.applied_wrenches(mech, q, {"body1": _pushed(v)}),
    "bias_forces": lambda mech, q, v, a: js.bias_forces(mech, q, v),
    "body_accelerations": js.body_accelerations,
    "body_velocities": lambda mech, q, v, a: js.body_velocities(mech, q, v),
    "center_of_mass": lambda mech, q, v, a: js.center_of_mass(mech, q),
    "center_of_mass_jacobian": lambda mech, q, v, a: js.center_of_mass_jacobian(mech, q),
    "center_of_mass_velocity": lambda mech, q, v, a: js.center_of_mass_velocity(mech, q, v),
    "centroidal_momentum": lambda mech, q, v, a: js.centroidal_momentum(mech, q, v),
    "centroidal_momentum_matrix": lambda mech, q, v, a: js.centroidal_momentum_matrix(mech, q),
    "close_loops": lambda mech, q, v, a: js.close_loops(mech, q, LOOPS),
    "configuration_rates": lambda mech, q, v, a: js.configuration_rates(mech, q, v),
    "constrained_forward_dynamics": lambda mech, q, v, a: js.constrained_forward_dynamics(mech, q, v, a, LOOPS),
    "constraint_error": lambda mech, q, v, a: js.constraint_error(mech, q, LOOPS),
    "constraint_jacobian": lambda mech, q, v, a: js.constraint_jacobian(mech, q, LOOPS),
    "contact_forces": lambda mech, q, v, a: js.contact_forces(mech, q, v, CONTACTS, GROUND),
    "contact_report": lambda mech, q, v, a: js.contact_report(mech, q, v, CONTACTS, GROUND),
    "convex_step": lambda mech, q, v, a: js.convex_step(mech, q, v, a, H, contacts=CONTACTS, ground=GROUND),
    "difference": lambda mech, q, v, a: js.difference(mech, q, js.integrate(mech, q, v, H)),
    "forward_dynamics": js.forward_dynamics,
    "forward_dynamics_derivatives": js.forward_dynamics_derivatives,
    "forward_kinematics": lambda mech, q, v, a: js.forward_kinematics(mech, q),
    "gravity_forces": lambda mech, q, v, a: js.gravity_forces(mech, q),
    "integrate": lambda mech, q, v, a: js.integrate(mech, q, v, H),
    "interpolate": lambda mech, q, v, a: js.interpolate(mech, q, q + 0.1, F32(0.3)),
    "inverse_dynamics": lambda mech, q, v, a: js.inverse_dynamics(mech, q, v, a, _applied(v)),
    "inverse_dynamics_derivatives": js.inverse_dynamics_derivatives,
    "inverse_kinematics": lambda mech, q, v, a: js.inverse_kinematics(mech, q, "body3", v[..., :3], iterations=2),
    "jacobian": lambda mech, q, v, a: js.jacobian(mech, q, "body3"),
    "jacobian_rate": lambda mech, q, v, a: js.jacobian_rate(mech, q, v, "body3"),
    "joint_reactions": lambda mech, q, v, a: js.joint_reactions(mech, q, v, a, {"body1": _pushed(v)}),
    "kinetic_energy": lambda mech, q, v, a: js.kinetic_energy(mech, q, v),
    "mass_matrix": lambda mech, q, v, a: js.mass_matrix(mech, q),
    "mass_matrix_factor": lambda mech, q, v, a: js.mass_matrix_factor(mech, q).solve(a),
    "momentum observer": _observed,
    "passive_forces": lambda mech, q, v, a: js.passive_forces(mech, q, v, COMPLIANCE),
    "potential_energy": lambda mech, q, v, a: js.potential_energy(mech, q),
    "regressors": js.regressors.joint_torque_regressor,
    "rk4_step": lambda mech, q, v, a: js.rk4_step(mech, q, v, a, H),
    "semi_implicit_step": lambda mech, q, v, a: js.semi_implicit_step(mech, q, v, a, H),
    "symplectic_step": lambda mech, q, v, a: js.symplectic_step(mech, q, v, a, H),
}

"""Closed loops against Pinocchio's constrained dynamics, which are solved by proximal iterations too."""

import jax
import numpy as np
import pytest

from tests.helpers import closed_loops
from tests.helpers.optional import needs

needs("pinocchio")
import pinocchio as pin  # noqa: E402


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def theirs(mujoco_model):
    """Pinocchio's model of hinges at the origins of bodies. Its own reader takes the first tree of a file alone."""
    m, model, inertias = mujoco_model, pin.Model(), pin.Inertia
    for i in range(1, m.nbody):
        joint = pin.JointModelRevoluteUnaligned(m.jnt_axis[i - 1])
        placed = placement(m.body_pos[i], m.body_quat[i])
        added = model.addJoint(int(m.body_parentid[i]), joint, placed, m.body(i).name)
        inertia = inertias(m.body_mass[i], np.zeros(3), np.diag(m.body_inertia[i]))
        model.appendBodyToJoint(added, inertia, placement(m.body_ipos[i], m.body_iquat[i]))
    return model


def placement(p, wxyz):
    return pin.SE3(pin.Quaternion(*wxyz).matrix(), p)


def closures(model, mujoco_model, kind):
    """A hinge is held at two points of its axis: one of six rows is redundant."""
    sites = [mujoco_model.site(name) for name in "AB"]
    what = pin.ContactType.CONTACT_6D if kind == "weld" else pin.ContactType.CONTACT_3D
    for along in ([0, 0, 0], [0, 0, 0.3])[: 2 if kind == "hinge" else 1]:
        moved = pin.SE3(np.eye(3), np.array(along, float))
        joints = [x for s in sites for x in (int(s.bodyid[0]), placement(s.pos, s.quat) * moved)]
        yield pin.RigidConstraintModel(what, model, *joints, pin.LOCAL)


@pytest.mark.parametrize("name", closed_loops.BODIES)
def test_accelerations_and_forces(name):
    s = closed_loops.closed(name)
    model = theirs(s.model)
    data, own = model.createData(), pin.StdVec_RigidConstraintModel()
    own.extend(closures(model, s.model, closed_loops.CLOSURES[name][2]))
    datas = pin.StdVec_RigidConstraintData()
    datas.extend([x.createData() for x in own])
    pin.initConstraintDynamics(model, data, own, datas)
    found = closed_loops.constrained(name)
    for q, v, tau, ours in zip(s.q, s.v, s.tau, np.asarray(found.vdot), strict=True):
        settings = pin.ProximalSettings(1e-14, 1e-14, 1e-10, 50)
        vdot = pin.constraintDynamics(model, data, q, v, tau, own, datas, settings)
        assert abs(ours - vdot).max() <= 1e-9 * abs(vdot).max()
        # J^T l, of their mechanics.
        forces = pin.rnea(model, data, q, v, vdot) - tau
        assert abs(pin.rnea(model, data, q, v, ours) - tau - forces).max() <= 1e-9 * abs(forces).max()

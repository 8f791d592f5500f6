"""Pinocchio's models of the mechanisms with a closed loop, which `closed_loops` has as models of MuJoCo."""

import numpy as np
import pinocchio as pin


def model(mujoco_model):
    """Of hinges at the origins of bodies. Pinocchio's own reader takes the first tree of a file alone."""
    m, made, inertias = mujoco_model, pin.Model(), pin.Inertia
    for i in range(1, m.nbody):
        joint = pin.JointModelRevoluteUnaligned(m.jnt_axis[i - 1])
        placed = _placement(m.body_pos[i], m.body_quat[i])
        added = made.addJoint(int(m.body_parentid[i]), joint, placed, m.body(i).name)
        inertia = inertias(m.body_mass[i], np.zeros(3), np.diag(m.body_inertia[i]))
        made.appendBodyToJoint(added, inertia, _placement(m.body_ipos[i], m.body_iquat[i]))
    return made


def closures(model, mujoco_model, kind):
    """A hinge is held at two points of its axis: one of six rows is redundant."""
    sites = [mujoco_model.site(name) for name in "AB"]
    what = pin.ContactType.CONTACT_6D if kind == "weld" else pin.ContactType.CONTACT_3D
    for along in ([0, 0, 0], [0, 0, 0.3])[: 2 if kind == "hinge" else 1]:
        moved = pin.SE3(np.eye(3), np.array(along, float))
        joints = [x for s in sites for x in (int(s.bodyid[0]), _placement(s.pos, s.quat) * moved)]
        yield pin.RigidConstraintModel(what, model, *joints, pin.LOCAL)


def _placement(p, wxyz):
    return pin.SE3(pin.Quaternion(*wxyz).matrix(), p)

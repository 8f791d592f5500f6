"""Robots of example-robot-data, as Pinocchio's models and as ours, and states of both."""

import functools
import sysconfig

import numpy as np
import pinocchio as pin

import jaxspatial as js

FOLDER = sysconfig.get_paths()["purelib"] + "/cmeel.prefix/share/example-robot-data/robots/"
FILES = {
    "double_pendulum": "double_pendulum_description/urdf/double_pendulum.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "solo": "solo_description/robots/solo12.urdf",
    "anymal": "anymal_b_simple_description/robots/anymal.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
}


@functools.cache
def load(name, floating_base):
    """(Pinocchio's model, ours in float64)."""
    root = (pin.JointModelFreeFlyer(),) if floating_base else ()
    mech = js.Mechanism.from_urdf(FOLDER + FILES[name], floating_base, dtype=np.float64)
    return pin.buildModelFromUrdf(FOLDER + FILES[name], *root), mech


class States:
    """n random states; what Pinocchio computes of them, in the order of our rates.

    Pinocchio has the position of a floating base before its quaternion xyzw, linear velocities before angular ones, and
    cosine and sine in place of the angle of a continuous joint. Here it knows no mimics, which most of its algorithms
    refuse: `of_ours` gives its rates, those of mimics among them, of our own.
    """

    def __init__(self, model, mech, n, seed=0):
        rng = np.random.default_rng(seed)
        self.model, self.mech, self.data = model, mech, model.createData()
        self.q = np.empty((n, mech.nq))
        self.pin_q = np.empty((n, model.nq))
        self.v, self.a = rng.standard_normal((2, n, mech.nv))
        self.of_ours = np.zeros((model.nv, mech.nv))
        for name in mech.joint_names:
            joint = model.joints[model.getJointId(name)]
            own, rates = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
            self._draw(rng, name, joint, own, rates)
        self.pin_v, self.pin_a = (x @ self.of_ours.T for x in (self.v, self.a))

    def _draw(self, rng, name, joint, own, rates):
        n, start = len(self.q), joint.idx_q
        if len(own) == 7:
            unit = rng.standard_normal((n, 4))
            unit /= np.linalg.norm(unit, axis=1)[:, None]
            position = rng.standard_normal((n, 3))
            self.q[:, own] = np.hstack([unit, position])
            self.pin_q[:, start : start + 7] = np.hstack([position, unit[:, 1:], unit[:, :1]])
            self.of_ours[joint.idx_v + np.array([3, 4, 5, 0, 1, 2]), rates] = 1
            return
        t, i = self.mech.topology, self.mech.joint_names.index(name)
        multiplier, offset = self.mech.mimics[i]
        if not t.is_mimic(i):
            self.q[:, own[0]] = rng.uniform(-1, 1, n)
        x = multiplier * self.q[:, own[0]] + offset
        parts = (np.cos(x), np.sin(x)) if joint.nq == 2 else (x,)
        self.pin_q[:, start : start + len(parts)] = np.stack(parts, 1)
        self.of_ours[joint.idx_v, rates[0]] = multiplier

    def each(self, function):
        """function(model, data, q, v, a) of Pinocchio for every state, stacked."""
        states = zip(self.pin_q, self.pin_v, self.pin_a, strict=True)
        return np.stack([np.array(function(self.model, self.data, *state)) for state in states])

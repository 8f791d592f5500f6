"""Every robot of example-robot-data, as Pinocchio's model and as ours; states of both; and a table of what is compared.

One more algorithm is one more line of `ALGORITHMS`.
"""

import collections
import functools
import pathlib
import sysconfig
import warnings
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio as pin

import jaxspatial as js
from jaxspatial.interop import ModelFileWarning
from tests.helpers.interpreted import interpreted

FOLDER = pathlib.Path(sysconfig.get_paths()["purelib"], "cmeel.prefix/share/example-robot-data/robots")
N = 8
ALLOWED = {"float64": 1e-12, "float32": 2e-5}
# What has to do with the inverse of the mass matrix loses digits with its condition, here as in Pinocchio: allowed are
# so many u times that, where it is more. Articulated bodies lose fewer.
BY_INVERSE = dict.fromkeys(["mass matrix, solved", *(f"forward dynamics by {x}" for x in ("q", "v", "tau"))], 8)
BY_INVERSE |= dict.fromkeys(["forward dynamics", "forward dynamics, pushed"], 1)
# Of numbers that are zero here and rounding there, in SI units: Coriolis forces of rotors that are balanced.
NOISE = 1e-15


def _robots():
    """The file of every robot, by its stem; with the folder's name, where two have the same."""
    files = sorted(FOLDER.glob("**/*.urdf"))
    count = collections.Counter(file.stem for file in files)
    folder = {file: file.relative_to(FOLDER).parts[0].removesuffix("_description") for file in files}
    return {file.stem if count[file.stem] == 1 else f"{folder[file]}-{file.stem}": file for file in files}


ROBOTS = _robots()


@functools.cache
def load(name, floating_base):
    """(Pinocchio's model, ours in float64). Raises ValueError for what `from_urdf` refuses."""
    mech = read(ROBOTS[name], floating_base)
    root = (pin.JointModelFreeFlyer(),) if floating_base else ()
    return pin.buildModelFromUrdf(str(ROBOTS[name]), *root), mech


def read(source, floating_base):
    """In float64; what is left out is known."""
    with jax.enable_x64(True), warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelFileWarning)
        return js.Mechanism.from_urdf(source, floating_base, dtype=np.float64)


class Held(NamedTuple):
    """A joint of both: Pinocchio's, where its coordinates and rates are in ours, and what it follows them by."""

    theirs: Any
    q: np.ndarray
    v: np.ndarray
    multiplier: float
    offset: float
    is_mimic: bool

    @property
    def their_q(self):
        return slice(self.theirs.idx_q, self.theirs.idx_q + self.theirs.nq)

    @property
    def their_v(self):
        """In the order of ours."""
        return self.theirs.idx_v + np.array([3, 4, 5, 0, 1, 2] if len(self.v) == 6 else [0])


class States:
    """n random states, of numbers that a dtype has; what Pinocchio computes of them, in the order of our rates.

    Pinocchio has the position of a floating base before its quaternion xyzw, linear velocities before angular ones, and
    cosine and sine in place of the angle of a continuous joint. Here it knows no mimics, which most of its algorithms
    refuse: `of_ours` gives its rates, those of mimics among them, of our own.

    q, v, a: (n, ...) ours; pushes: (n, 6) a wrench on the last body, in world axes. a stands for forces too.
    """

    def __init__(self, name, floating_base, dtype, n=N, seed=0):
        self.model, self.mech = load(name, floating_base)
        self.data, self.dtype = self.model.createData(), dtype
        self.joints = [self._held(i, name) for i, name in enumerate(self.mech.joint_names)]
        self.frames = [self.model.getFrameId(name, pin.FrameType.BODY) for name in self.mech.frame_names[1:]]
        self.bodies = [self.model.getFrameId(name, pin.FrameType.BODY) for name in self.mech.body_names]
        self.tip = self.model.getFrameId(_tip(self.mech), pin.FrameType.BODY)
        rng = np.random.default_rng(seed)
        self.q = self._rounded(
            np.hstack([np.empty((n, 0)), *(_drawn(rng, n, x) for x in self.joints if not x.is_mimic)])
        )
        self.v, self.a = self._rounded(rng.standard_normal((2, n, self.mech.nv)))
        self.pushes = self._rounded(rng.standard_normal((n, 6)))

    def _held(self, i, name):
        rows = self.mech.joint_position_indices(name), self.mech.joint_velocity_indices(name)
        theirs = self.model.joints[self.model.getJointId(name)]
        return Held(theirs, *rows, *self.mech.mimics[i], self.mech.topology.is_mimic(i))

    def _rounded(self, x):
        return x.astype(self.dtype).astype(float)

    @functools.cached_property
    def of_ours(self):
        found = np.zeros((self.model.nv, self.mech.nv))
        for x in self.joints:
            found[x.their_v, x.v] = x.multiplier
        return found

    def own(self, rates):
        """Ours, of all of Pinocchio's: those of mimics left out."""
        found = np.empty(self.mech.nv)
        for x in self.joints:
            if not x.is_mimic:
                found[x.v] = rates[x.their_v]
        return found

    def to_pinocchio(self, q):
        """Pinocchio's coordinates of ours. What float32 has is no unit quaternion; Pinocchio's result is of one."""
        found = np.empty(self.model.nq)
        for x in self.joints:
            own = q[x.q] if len(x.q) == 7 else x.multiplier * q[x.q] + x.offset
            if len(own) == 7:
                own = np.concatenate([own[4:], np.roll(own[:4] / np.linalg.norm(own[:4]), -1)])
            found[x.their_q] = np.concatenate([np.cos(own), np.sin(own)]) if x.theirs.nq == 2 else own
        return found

    def from_pinocchio(self, q):
        found = np.empty(self.mech.nq)
        for x in self.joints:
            if x.is_mimic:
                continue
            theirs = q[x.their_q]
            if len(theirs) == 7:
                found[x.q] = np.concatenate([np.roll(theirs[3:], 1), theirs[:3]])
            else:
                found[x.q] = np.arctan2(theirs[1], theirs[0]) if len(theirs) == 2 else theirs
        return found

    # -- results, stacked over states ---------------------------------------------------------------------------------

    def ours(self, what, is_compiled=True):
        """Of an algorithm: compiled, or op by op in NumPy."""
        function = jax.vmap(functools.partial(ALGORITHMS[what][0], self.mech))
        with jax.enable_x64(self.dtype == "float64"):
            arrays = [x.astype(self.dtype) for x in (self.q, self.v, self.a, self.pushes)]
            return np.asarray((jax.jit if is_compiled else interpreted)(function)(*arrays))

    def pinocchios(self, what):
        G, function = self.of_ours, ALGORITHMS[what][1]
        states = zip(self.q, self.v, self.a, self.pushes, strict=True)
        # Copied: what Pinocchio returns is often its own memory.
        return np.stack([np.array(function(self, self.to_pinocchio(q), G @ v, G @ a, a, F)) for q, v, a, F in states])

    def error(self, what, is_compiled=True):
        return self.error_of(what, self.ours(what, is_compiled))

    def error_of(self, what, ours):
        """Relative to the largest number of the result."""
        theirs = self.pinocchios(what)
        assert ours.dtype == self.dtype and ours.shape == theirs.shape, (what, ours.dtype, ours.shape, theirs.shape)
        largest = abs(theirs).max()
        if not ours.any() and largest < NOISE:
            return 0.0
        return float(abs(ours.astype(float) - theirs).max() / largest)

    def allowed(self, what):
        limit = ALLOWED[self.dtype]
        return max(limit, BY_INVERSE.get(what, 0) * float(np.finfo(self.dtype).epsneg) * self.condition)

    def compared(self):
        """The algorithms that have a result: what is singular up to rounding has no inverse to compare."""
        return [what for what in ALGORITHMS if self.allowed(what) < 1]

    def is_noise_of_theirs(self, what):
        """Whether Pinocchio's result solves the same equations up to rounding, and ours is that of double words.

        Pinocchio adds up Coriolis forces in world axes about the world's origin. Far from it, their rounding errors
        move a joint that turns a few grams by more than its condition says.
        """
        if what not in BY_INVERSE:
            return False
        M, ours, theirs = self.pinocchios("mass matrix"), self.ours(what, is_compiled=False), self.pinocchios(what)
        with js.default_precision("faithful"):
            better = self.ours(what, is_compiled=False)
        left = np.einsum("nij,nj...->ni...", M, ours - theirs)
        sizes = np.einsum("nij,nj...->ni...", abs(M), abs(theirs))
        limit = ALLOWED[self.dtype]
        return abs(left).max() <= limit * sizes.max() and abs(ours - better).max() <= limit * abs(theirs).max()

    @functools.cached_property
    def condition(self):
        """Of the mass matrix in units that make its diagonal 1, the largest."""
        M = self.pinocchios("mass matrix")
        diagonal = np.diagonal(M, axis1=1, axis2=2)
        if not (diagonal > 0).all():
            return np.inf
        return float(np.linalg.cond(M / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])).max())


def _drawn(rng, n, joint):
    """(n, ...) coordinates of it."""
    if len(joint.q) == 1:
        return rng.uniform(-1, 1, (n, 1))
    unit, position = rng.standard_normal((n, 4)), rng.uniform(-1, 1, (n, 3))
    return np.hstack([unit / np.linalg.norm(unit, axis=1)[:, None], position])


# -- ours: (mechanism, q, v, a, push), of one state -------------------------------------------------------------------


def _pushed(m, push):
    return {m.body_names[-1]: js.SpatialForce.from_array(push)}


def _six(X):
    return jnp.concatenate([X.rotational, X.translational], -1)


def _tip(m):
    """The last frame that moves."""
    return next(name for name, carrier in reversed(m.topology.frames) if carrier >= 0)


def _poses(m, q):
    """Of all frames but the world's."""
    return js.forward_kinematics(m, q, m.frame_names[1:])


def _difference(m, q):
    return js.difference(m, q, jnp.asarray(m.neutral(), q.dtype))


# -- Pinocchio's: (states, q, v, a, tau, push), of one state ----------------------------------------------------------


def _forces(s, tau):
    """As our rates feel what Pinocchio's do."""
    return s.of_ours.T @ tau


def _of_rates(s, J):
    return J @ s.of_ours


def _swapped(x):
    """Rotational parts before translational ones."""
    return np.concatenate([x[3:], x[:3]])


def _mass_matrix(s, q):
    upper = np.triu(pin.crba(s.model, s.data, q))
    return s.of_ours.T @ (upper + np.triu(upper, 1).T) @ s.of_ours


def _at_joints(s, q, push):
    """The push on the last body, as Pinocchio takes it: in the axes of its joints, about their origins."""
    pin.framesForwardKinematics(s.model, s.data, q)
    joint = s.model.frames[s.bodies[-1]].parentJoint
    X_WB, X_WJ = s.data.oMf[s.bodies[-1]], s.data.oMi[joint]
    torque = push[:3] + np.cross(X_WB.translation - X_WJ.translation, push[3:])
    found = [pin.Force.Zero() for _ in range(s.model.njoints)]
    found[joint] = pin.Force(X_WJ.rotation.T @ push[3:], X_WJ.rotation.T @ torque)
    return found


def _accelerations(s, q, v, tau, *pushes):
    """By articulated bodies; of mimics, which these know not, by the mass matrix."""
    if s.mech.nv == s.model.nv:
        return s.own(pin.aba(s.model, s.data, q, v, s.of_ours @ tau, *pushes))
    bias = pin.rnea(s.model, s.data, q, v, 0 * v, *pushes)
    return np.linalg.solve(_mass_matrix(s, q), tau - _forces(s, bias))


def _placed(s, q, part):
    pin.framesForwardKinematics(s.model, s.data, q)
    return [getattr(s.data.oMf[f], part) for f in s.frames]


def _velocities(s, q, v):
    pin.forwardKinematics(s.model, s.data, q, v)
    found = [pin.getFrameVelocity(s.model, s.data, f, pin.LOCAL_WORLD_ALIGNED) for f in s.bodies]
    return [np.concatenate([V.angular, V.linear]) for V in found]


def _body_accelerations(s, q, v, a):
    pin.forwardKinematics(s.model, s.data, q, v, a)
    found = [pin.getFrameClassicalAcceleration(s.model, s.data, f, pin.LOCAL_WORLD_ALIGNED) for f in s.bodies]
    return [np.concatenate([A.angular, A.linear]) for A in found]


def _jacobian(s, q):
    J = pin.computeFrameJacobian(s.model, s.data, q, s.tip, pin.LOCAL_WORLD_ALIGNED)
    return _of_rates(s, _swapped(J))


def _jacobian_rate(s, q, v):
    pin.computeJointJacobiansTimeVariation(s.model, s.data, q, v)
    pin.updateFramePlacements(s.model, s.data)
    J = pin.getFrameJacobianTimeVariation(s.model, s.data, s.tip, pin.LOCAL_WORLD_ALIGNED)
    return _of_rates(s, _swapped(J))


def _center_velocity(s, q, v):
    pin.centerOfMass(s.model, s.data, q, v)
    return s.data.vcom[0]


def _momentum(s, q, v):
    L = pin.computeCentroidalMomentum(s.model, s.data, q, v)
    return np.concatenate([L.angular, L.linear])


def _regressor(s, q, v, a):
    """The parameters of one body after those of another, in our order."""
    Y = _forces(s, pin.computeJointTorqueRegressor(s.model, s.data, q, v, a))
    return np.hstack([Y[:, 10 * x.theirs.id - 10 : 10 * x.theirs.id] for x in s.joints])


def _of_inverse(s, q, v, a, which):
    found = pin.computeRNEADerivatives(s.model, s.data, q, v, a)[which]
    return _of_rates(s, _forces(s, found))


def _of_forward(s, q, v, tau, which):
    """By those of inverse dynamics, and the accelerations of unit forces from rest: Pinocchio's own derivatives, like
    its inverse of the mass matrix, are 6e-12 off for a pendulum on a light base."""
    inverse = _inverse_mass_matrix(s, q)
    if which == 2:
        return inverse
    return -inverse @ _of_inverse(s, q, v, s.of_ours @ _accelerations(s, q, v, tau), which)


def _inverse_mass_matrix(s, q):
    if s.mech.nv != s.model.nv:
        return np.linalg.inv(_mass_matrix(s, q))
    free = s.model.copy()
    free.gravity = pin.Motion.Zero()
    return np.stack([s.own(pin.aba(free, s.data, q, np.zeros(free.nv), row)) for row in s.of_ours.T], 1)


# -- what is compared -------------------------------------------------------------------------------------------------

STEP = 0.25

# (ours, Pinocchio's), each of one state.
ALGORITHMS = {
    "inverse dynamics": (
        lambda m, q, v, a, F: js.inverse_dynamics(m, q, v, a),
        lambda s, q, v, a, tau, F: _forces(s, pin.rnea(s.model, s.data, q, v, a)),
    ),
    "inverse dynamics, pushed": (
        lambda m, q, v, a, F: js.inverse_dynamics(m, q, v, a, _pushed(m, F)),
        lambda s, q, v, a, tau, F: _forces(s, pin.rnea(s.model, s.data, q, v, a, _at_joints(s, q, F))),
    ),
    "bias forces": (
        lambda m, q, v, a, F: js.bias_forces(m, q, v),
        lambda s, q, v, a, tau, F: _forces(s, pin.nonLinearEffects(s.model, s.data, q, v)),
    ),
    "gravity forces": (
        lambda m, q, v, a, F: js.gravity_forces(m, q),
        lambda s, q, v, a, tau, F: _forces(s, pin.computeGeneralizedGravity(s.model, s.data, q)),
    ),
    "forward dynamics": (
        lambda m, q, v, a, F: js.forward_dynamics(m, q, v, a),
        lambda s, q, v, a, tau, F: _accelerations(s, q, v, tau),
    ),
    "forward dynamics, pushed": (
        lambda m, q, v, a, F: js.forward_dynamics(m, q, v, a, _pushed(m, F)),
        lambda s, q, v, a, tau, F: _accelerations(s, q, v, tau, _at_joints(s, q, F)),
    ),
    "mass matrix": (
        lambda m, q, v, a, F: js.mass_matrix(m, q),
        lambda s, q, v, a, tau, F: _mass_matrix(s, q),
    ),
    "mass matrix, solved": (
        lambda m, q, v, a, F: js.mass_matrix_factor(m, q).solve(a),
        lambda s, q, v, a, tau, F: np.linalg.solve(_mass_matrix(s, q), tau),
    ),
    "positions": (
        lambda m, q, v, a, F: _poses(m, q).translation,
        lambda s, q, v, a, tau, F: _placed(s, q, "translation"),
    ),
    "rotations": (
        lambda m, q, v, a, F: _poses(m, q).rotation.to_matrix(),
        lambda s, q, v, a, tau, F: _placed(s, q, "rotation"),
    ),
    "velocities": (
        lambda m, q, v, a, F: _six(js.body_velocities(m, q, v)),
        lambda s, q, v, a, tau, F: _velocities(s, q, v),
    ),
    "accelerations": (
        lambda m, q, v, a, F: _six(js.body_accelerations(m, q, v, a)),
        lambda s, q, v, a, tau, F: _body_accelerations(s, q, v, a),
    ),
    "jacobian": (
        lambda m, q, v, a, F: js.jacobian(m, q, _tip(m)),
        lambda s, q, v, a, tau, F: _jacobian(s, q),
    ),
    "jacobian rate": (
        lambda m, q, v, a, F: js.jacobian_rate(m, q, v, _tip(m)),
        lambda s, q, v, a, tau, F: _jacobian_rate(s, q, v),
    ),
    "centre of mass": (
        lambda m, q, v, a, F: js.center_of_mass(m, q),
        lambda s, q, v, a, tau, F: pin.centerOfMass(s.model, s.data, q),
    ),
    "centre of mass, velocity": (
        lambda m, q, v, a, F: js.center_of_mass_velocity(m, q, v),
        lambda s, q, v, a, tau, F: _center_velocity(s, q, v),
    ),
    "centre of mass, jacobian": (
        lambda m, q, v, a, F: js.center_of_mass_jacobian(m, q),
        lambda s, q, v, a, tau, F: _of_rates(s, pin.jacobianCenterOfMass(s.model, s.data, q)),
    ),
    "centroidal momentum": (
        lambda m, q, v, a, F: _six(js.centroidal_momentum(m, q, v)),
        lambda s, q, v, a, tau, F: _momentum(s, q, v),
    ),
    "centroidal momentum, matrix": (
        lambda m, q, v, a, F: js.centroidal_momentum_matrix(m, q),
        lambda s, q, v, a, tau, F: _of_rates(s, _swapped(pin.computeCentroidalMap(s.model, s.data, q))),
    ),
    "kinetic energy": (
        lambda m, q, v, a, F: js.kinetic_energy(m, q, v),
        lambda s, q, v, a, tau, F: pin.computeKineticEnergy(s.model, s.data, q, v),
    ),
    "potential energy": (
        lambda m, q, v, a, F: js.potential_energy(m, q),
        lambda s, q, v, a, tau, F: pin.computePotentialEnergy(s.model, s.data, q),
    ),
    "regressor": (
        lambda m, q, v, a, F: js.regressors.joint_torque_regressor(m, q, v, a),
        lambda s, q, v, a, tau, F: _regressor(s, q, v, a),
    ),
    "inverse dynamics by q": (
        lambda m, q, v, a, F: js.inverse_dynamics_derivatives(m, q, v, a).dtau_dq,
        lambda s, q, v, a, tau, F: _of_inverse(s, q, v, a, 0),
    ),
    "inverse dynamics by v": (
        lambda m, q, v, a, F: js.inverse_dynamics_derivatives(m, q, v, a).dtau_dv,
        lambda s, q, v, a, tau, F: _of_inverse(s, q, v, a, 1),
    ),
    "forward dynamics by q": (
        lambda m, q, v, a, F: js.forward_dynamics_derivatives(m, q, v, a).dvdot_dq,
        lambda s, q, v, a, tau, F: _of_forward(s, q, v, tau, 0),
    ),
    "forward dynamics by v": (
        lambda m, q, v, a, F: js.forward_dynamics_derivatives(m, q, v, a).dvdot_dv,
        lambda s, q, v, a, tau, F: _of_forward(s, q, v, tau, 1),
    ),
    "forward dynamics by tau": (
        lambda m, q, v, a, F: js.forward_dynamics_derivatives(m, q, v, a).dvdot_dtau,
        lambda s, q, v, a, tau, F: _of_forward(s, q, v, tau, 2),
    ),
    "integrate": (
        lambda m, q, v, a, F: js.integrate(m, q, v, STEP),
        lambda s, q, v, a, tau, F: s.from_pinocchio(pin.integrate(s.model, q, v * STEP)),
    ),
    "difference": (
        lambda m, q, v, a, F: _difference(m, q),
        lambda s, q, v, a, tau, F: s.own(pin.difference(s.model, q, s.to_pinocchio(s.mech.neutral()))),
    ),
}

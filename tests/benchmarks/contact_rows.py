"""What the benchmark of contact runs: rollouts of quadrupeds on four feet, by convex_step and by mjx.step; of a Go2
also on stairs."""

import functools
import warnings
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from lxml import etree
from mujoco import mjx

import jaxspatial as js
from tests.helpers import pinocchio_models as models

CONVEX, PLAIN, WITHOUT, MJX = "convex_step", "semi_implicit_step", "convex_step without contacts", "mjx.step"
ONE, CALL = "convex_step, one state, 500 steps a call", "convex_step, one state, a call"
GRADIENT, ROLLOUT = "gradient of 60 steps, one state", "60 steps, one state"
STAIRS, MJX_STAIRS = "convex_step on stairs", "mjx.step on stairs"
DT = np.float32(5e-3)
STIFFNESS, RELAXATION_TIME, FRICTION = np.float32(2e4), np.float32(0.01), np.float32(0.7)
# What is for pictures, contact and motors.
STRIPPED = "visual", "collision", "transmission", "gazebo", "safety_controller", "contact"


class Robot(NamedTuple):
    """Frames of the feet, their radius, how it stands, and its controller.

    stance: angles of shoulder, hip and knee, rad. gain, N m/rad, and damping, N m s/rad: larger ones of an explicit
    controller throw light legs about, until states are infinite.
    """

    feet: tuple[str, ...]
    radius: float
    stance: tuple[float, ...]
    gain: float
    damping: float


ROBOTS = {
    "solo12": Robot(tuple(f"{leg}_FOOT" for leg in ("FL", "FR", "HL", "HR")), 0.016, (0, 0.8, -1.6), 10.0, 0.1),
    "go1": Robot(tuple(f"{leg}_foot" for leg in ("FR", "FL", "RR", "RL")), 0.02, (0, 0.8, -1.6), 40.0, 1.0),
    "go2": Robot(tuple(f"{leg}_foot" for leg in ("FL", "FR", "RL", "RR")), 0.022, (0, 0.8, -1.6), 40.0, 1.0),
}

# Three stairs, m. Robots stand astride a riser: their hind feet on the first tread, their front feet on the second.
COUNT, RUN, RISE = 3, np.float32(0.3), np.float32(0.15)
ON_STAIRS = ("go2",)
LINK = 0.213  # of the legs of a Go2, m: thigh and shank are as long


@functools.cache
def text(name):
    root = etree.parse(models.ROBOTS[name]).getroot()
    for element in [e for tag in STRIPPED for e in root.iter(tag)]:
        element.getparent().remove(element)
    # A base of a milligram whose inertia no body has is refused by MuJoCo.
    for mass in list(root.iter("mass")):
        if float(mass.get("value")) < 1e-5:
            mass.getparent().getparent().remove(mass.getparent())
    return etree.tostring(root, encoding="unicode")


def mechanism(name):
    """Ours, without limits, which neither has, and without damping and friction of joints."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", js.interop.ModelFileWarning)
        mech = js.Mechanism.from_urdf(text(name), floating_base=True, dtype=np.float32)
    zero, far = np.zeros(mech.nv, np.float32), np.full(mech.nq, np.inf, np.float32)
    return mech.replace(damping=zero, friction_loss=zero, lower=-far, upper=far)


def model(name, on_stairs=False):
    """MuJoCo's: the same file, with a free joint, spheres for feet, and a floor; on stairs with boxes, and with the
    damping of the controller in its joints, which is implicit."""
    robot = ROBOTS[name]
    spec = mujoco.MjSpec.from_string(text(name))
    spec.compiler.fusestatic = True
    base = spec.worldbody.first_body()
    base.add_freejoint()
    for joint in spec.joints[1:]:
        joint.limited, joint.frictionloss = mujoco.mjtLimited.mjLIMITED_FALSE, 0
        joint.damping = np.full((3, 1), robot.damping if on_stairs else 0.0)
    ball, plane = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_PLANE
    for foot in robot.feet:
        own = {"type": ball, "size": [robot.radius, 0, 0], "contype": 1, "conaffinity": 0, "mass": 0}
        spec.body(foot).add_geom(**own, friction=[FRICTION, 0, 0], condim=3)
    floor = {"type": plane, "size": [5, 5, 1], "contype": 0, "conaffinity": 1}
    spec.worldbody.add_geom(**floor, friction=[FRICTION, 0, 0], condim=3)
    for k in range(COUNT if on_stairs else 0):  # each from its riser to 1 m behind the last
        length, height = (COUNT - k) * RUN + 1, (k + 1) * RISE
        place = {"pos": [k * RUN + length / 2, 0, height / 2], "size": [length / 2, 5, height / 2]}
        box = floor | place | {"type": mujoco.mjtGeom.mjGEOM_BOX}
        spec.worldbody.add_geom(**box, friction=[FRICTION, 0, 0], condim=3)
    found = spec.compile()
    found.opt.timestep, found.opt.iterations, found.opt.ls_iterations = DT, 8, 8
    found.opt.cone, found.opt.solver = mujoco.mjtCone.mjCONE_PYRAMIDAL, mujoco.mjtSolver.mjSOL_NEWTON
    if not on_stairs:
        found.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    return found


@functools.cache
def on_mjx(name, on_stairs=False):
    """(MJX's model, its data)."""
    made = mjx.put_model(model(name, on_stairs))
    return made, mjx.make_data(made)


def start(name, mech, n, seed=0):
    """(q, v, the angles that the controller holds) of n robots above the ground."""
    robot, rng = ROBOTS[name], np.random.default_rng(seed)
    hold = np.tile(np.float32(robot.stance), 4)
    q, v = np.zeros((n, mech.nq), np.float32), 0.3 * rng.standard_normal((n, mech.nv))
    q[:, 0], q[:, 7:] = 1, hold + 0.1 * rng.standard_normal((n, len(hold)))
    X = js.forward_kinematics(mech, jnp.asarray(q), robot.feet)
    q[:, 6] = robot.radius - np.asarray(X.translation)[..., 2].min(-1) + rng.uniform(-5e-3, 0.02, n)
    return jnp.asarray(q), jnp.asarray(v, np.float32), hold


def start_on_stairs(name, mech, n, seed=0):
    """As `start`, of robots astride a riser: their trunks are level, for the front legs are shorter by a riser."""
    robot, rng = ROBOTS[name], np.random.default_rng(seed)
    bent = [np.arccos((0.3 + rise) / (2 * LINK)) for rise in (-RISE / 2, RISE / 2)]
    hold = np.float32([[0, angle, -2 * angle] for angle in (bent[0], bent[0], bent[1], bent[1])]).ravel()
    q, v = np.zeros((n, mech.nq), np.float32), 0.3 * rng.standard_normal((n, mech.nv))
    q[:, 0], q[:, 4], q[:, 7:] = 1, RUN + rng.uniform(-0.02, 0.02, n), hold + 0.05 * rng.standard_normal((n, len(hold)))
    p_WF = np.asarray(js.forward_kinematics(mech, jnp.asarray(q), robot.feet).translation)
    treads = RISE * (1 + (p_WF[..., 0] // RUN))
    q[:, 6] = robot.radius - (p_WF[..., 2] - treads).min(-1) + rng.uniform(-5e-3, 0.02, n)
    return jnp.asarray(q), jnp.asarray(v, np.float32), hold


def torques(robot, hold, q, v, gain):
    """Of the controller; q and v without the floating base's."""
    zero = jnp.zeros((*q.shape[:-1], 6), q.dtype)
    return jnp.concatenate([zero, gain * (hold - q) - np.float32(robot.damping) * v], -1)


def feet(name):
    law = {"stiffness": STIFFNESS, "relaxation_time": RELAXATION_TIME, "friction": FRICTION}
    return js.PointContacts(ROBOTS[name].feet, None, np.float32(ROBOTS[name].radius), **law)


def calls(name, n, steps, mech=None):
    """case -> (function, arguments), each a rollout of n states over so many steps; and of one state.

    mech: another form of `mechanism(name)`.
    """
    mech, robot = mechanism(name) if mech is None else mech, ROBOTS[name]
    q, v, hold = start(name, mech, n)
    hold, gain = jnp.asarray(hold), np.float32(robot.gain)
    contacts = feet(name)

    def rolled(step, q, v, steps=steps, gain=gain):
        def one(state, _):
            q, v = state
            target = jnp.broadcast_to(hold, q[..., 7:].shape)
            return step(q, v, torques(robot, target, q[..., 7:], v[..., 6:], gain)), None

        return jax.lax.scan(one, (q, v), None, steps)[0]

    def convex(q, v, tau):
        return js.convex_step(mech, q, v, tau, DT, contacts=contacts)[:2]

    def once(q, v):
        return convex(q, v, torques(robot, hold, q[7:], v[6:], gain))

    def without(q, v, tau):
        return js.convex_step(mech, q, v, tau, DT)[:2]

    def plain(q, v, tau):
        return js.semi_implicit_step(mech, q, v, tau, DT)

    on_device, data = on_mjx(name)

    def mjx_rolled(qpos, qvel):
        def one(state, _):
            # A floating base has six rates in MuJoCo, too; its hinges have our order.
            tau = torques(robot, hold, state.qpos[7:], state.qvel[6:], gain)
            return mjx.step(on_device, state.replace(qfrc_applied=tau)), None

        after = jax.lax.scan(one, data.replace(qpos=qpos, qvel=qvel), None, steps)[0]
        return after.qpos, after.qvel

    def height(gain, q, v):
        return rolled(convex, q, v, 60, gain)[0][6]

    qpos, qvel = js.interop.mujoco.to_qpos(mech, q), js.interop.mujoco.to_qvel(mech, q, v)
    found = {
        CONVEX: (lambda q, v: rolled(convex, q, v), (q, v)),
        PLAIN: (lambda q, v: rolled(plain, q, v), (q, v)),
        WITHOUT: (lambda q, v: rolled(without, q, v), (q, v)),
        MJX: (jax.vmap(mjx_rolled), (qpos, qvel)),
        ONE: (lambda q, v: rolled(convex, q, v, 500), (q[0], v[0])),
        CALL: (once, (q[0], v[0])),
        ROLLOUT: (height, (gain, q[0], v[0])),
        GRADIENT: (jax.grad(height), (gain, q[0], v[0])),
    }
    return found | calls_on_stairs(name, n, steps, mech) if name in ON_STAIRS else found


def calls_on_stairs(name, n, steps, mech):
    """As `calls`; the damping of the controller is that of the joints, which both steps take implicitly."""
    robot, contacts, ground = ROBOTS[name], feet(name), js.Stairs(COUNT, RUN, RISE)
    mech = mech.replace(damping=np.repeat(np.float32([0, robot.damping]), [6, mech.nv - 6]))
    q, v, hold = start_on_stairs(name, mech, n)
    on_device, data = on_mjx(name, on_stairs=True)

    def pulled(q):
        return jnp.concatenate([jnp.zeros((*q.shape[:-1], 6), q.dtype), np.float32(robot.gain) * (hold - q)], -1)

    def rolled(q, v):
        def one(state, _):
            q, v = state
            return js.convex_step(mech, q, v, pulled(q[..., 7:]), DT, contacts=contacts, ground=ground)[:2], None

        return jax.lax.scan(one, (q, v), None, steps)[0]

    def mjx_rolled(qpos, qvel):
        def one(state, _):
            return mjx.step(on_device, state.replace(qfrc_applied=pulled(state.qpos[7:]))), None

        after = jax.lax.scan(one, data.replace(qpos=qpos, qvel=qvel), None, steps)[0]
        return after.qpos, after.qvel

    qpos, qvel = js.interop.mujoco.to_qpos(mech, q), js.interop.mujoco.to_qvel(mech, q, v)
    return {STAIRS: (rolled, (q, v)), MJX_STAIRS: (jax.vmap(mjx_rolled), (qpos, qvel))}


def per_step(case, n, steps):
    """How many steps of a state a call takes."""
    return {ONE: 500, CALL: 100, ROLLOUT: 60, GRADIENT: 60}.get(case, n * steps)

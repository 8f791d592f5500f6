"""What a step with contact costs: convex_step beside mjx.step and semi_implicit_step, of quadrupeds on four feet.

    python tests/benchmarks/contact.py [--write]

Robots of example-robot-data, float32, dropped from up to 2 cm and held by a controller, at 5 ms a step. All cases of a
robot run in one process, on one core, alternately, after warm-up; ratios are taken round by round. MJX has the same
bodies, feet and controller, and its own law of contact: pyramidal cones, at most 8 iterations of Newton's method with
at most 8 of line search. Asserts the claims below; exit status 1 if one does not hold. `--write` renews contact.md
beside this file.
"""

import os

# One core, before XLA counts them.
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import argparse  # noqa: E402
import functools  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
import warnings  # noqa: E402
from importlib.metadata import version  # noqa: E402
from typing import NamedTuple  # noqa: E402

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from dynamics_compiling import made  # noqa: E402
from lxml import etree  # noqa: E402
from mujoco import mjx  # noqa: E402

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

import jaxspatial as js  # noqa: E402
from jaxspatial import measure  # noqa: E402
from tests.helpers import pinocchio_models as models  # noqa: E402

CONVEX, PLAIN, WITHOUT, MJX = "convex_step", "semi_implicit_step", "convex_step without contacts", "mjx.step"
ONE, CALL = "convex_step, one state, 500 steps a call", "convex_step, one state, a call"
GRADIENT, ROLLOUT = "gradient of 60 steps, one state", "60 steps, one state"
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


class Claim(NamedTuple):
    """`slower` takes at least `least`, or at most `most`, times as long as `faster`."""

    slower: str
    faster: str
    least: float = 0.0
    most: float = float("inf")
    robots: tuple[str, ...] = tuple(ROBOTS)


class Bound(NamedTuple):
    """A case takes at most so many us per state and step; or so many seconds to trace and compile."""

    case: str
    most: float
    robots: tuple[str, ...] = tuple(ROBOTS)
    of_compiling: bool = False


CLAIMS = (
    Claim(MJX, CONVEX, least=5.0, robots=("solo12",)),
    Claim(GRADIENT, ROLLOUT, most=4.5),
    Bound(CONVEX, 6, ("solo12",)),
    Bound(CONVEX, 9, ("go1", "go2")),
    Bound(ONE, 35),
    Bound(CONVEX, 8, of_compiling=True),
    Bound(GRADIENT, 15, of_compiling=True),
)


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


def model(name):
    """MuJoCo's: the same file, with a free joint, spheres for feet, and a floor."""
    robot = ROBOTS[name]
    spec = mujoco.MjSpec.from_string(text(name))
    spec.compiler.fusestatic = True
    base = spec.worldbody.first_body()
    base.add_freejoint()
    for joint in spec.joints[1:]:
        joint.limited, joint.damping, joint.frictionloss = mujoco.mjtLimited.mjLIMITED_FALSE, np.zeros((3, 1)), 0
    ball, plane = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_PLANE
    for foot in robot.feet:
        own = {"type": ball, "size": [robot.radius, 0, 0], "contype": 1, "conaffinity": 0, "mass": 0}
        spec.body(foot).add_geom(**own, friction=[FRICTION, 0, 0], condim=3)
    floor = {"type": plane, "size": [5, 5, 1], "contype": 0, "conaffinity": 1}
    spec.worldbody.add_geom(**floor, friction=[FRICTION, 0, 0], condim=3)
    found = spec.compile()
    found.opt.timestep, found.opt.iterations, found.opt.ls_iterations = DT, 8, 8
    found.opt.cone, found.opt.solver = mujoco.mjtCone.mjCONE_PYRAMIDAL, mujoco.mjtSolver.mjSOL_NEWTON
    found.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    return found


def start(name, mech, n, seed=0):
    """(q, v, the angles that the controller holds) of n robots above the ground."""
    robot, rng = ROBOTS[name], np.random.default_rng(seed)
    hold = np.tile(np.float32(robot.stance), 4)
    q, v = np.zeros((n, mech.nq), np.float32), 0.3 * rng.standard_normal((n, mech.nv))
    q[:, 0], q[:, 7:] = 1, hold + 0.1 * rng.standard_normal((n, len(hold)))
    X = js.forward_kinematics(mech, jnp.asarray(q), robot.feet)
    q[:, 6] = robot.radius - np.asarray(X.translation)[..., 2].min(-1) + rng.uniform(-5e-3, 0.02, n)
    return jnp.asarray(q), jnp.asarray(v, np.float32), hold


def torques(robot, hold, q, v, gain):
    """Of the controller; q and v without the floating base's."""
    zero = jnp.zeros((*q.shape[:-1], 6), q.dtype)
    return jnp.concatenate([zero, gain * (hold - q) - np.float32(robot.damping) * v], -1)


def calls(name, n, steps, mech=None):
    """case -> (function, arguments), each a rollout of n states over so many steps; and of one state.

    mech: another form of `mechanism(name)`.
    """
    mech, robot = mechanism(name) if mech is None else mech, ROBOTS[name]
    q, v, hold = start(name, mech, n)
    hold, gain = jnp.asarray(hold), np.float32(robot.gain)
    contacts = js.PointContacts(
        robot.feet, None, np.float32(robot.radius),
        stiffness=STIFFNESS, relaxation_time=RELAXATION_TIME, friction=FRICTION,
    )  # fmt: skip

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

    on_device = mjx.put_model(model(name))
    data = mjx.make_data(on_device)

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
    return {
        CONVEX: (lambda q, v: rolled(convex, q, v), (q, v)),
        PLAIN: (lambda q, v: rolled(plain, q, v), (q, v)),
        WITHOUT: (lambda q, v: rolled(without, q, v), (q, v)),
        MJX: (jax.vmap(mjx_rolled), (qpos, qvel)),
        ONE: (lambda q, v: rolled(convex, q, v, 500), (q[0], v[0])),
        CALL: (once, (q[0], v[0])),
        ROLLOUT: (height, (gain, q[0], v[0])),
        GRADIENT: (jax.grad(height), (gain, q[0], v[0])),
    }


def cases(name, n, steps):
    """(case -> compiled call, case -> seconds to trace and to compile), after a look at the results."""
    compiled, seconds, programs, found = {}, {}, {}, calls(name, n, steps)
    before = np.asarray(found[CONVEX][1][0][:, 6])
    for case, (function, arguments) in found.items():
        lowered, program, seconds[case] = made(function, arguments)
        programs[case] = lowered.as_text()
        compiled[case] = functools.partial(repeated, program) if case == CALL else program
        compiled[case] = functools.partial(compiled[case], *arguments)
        if case in (CONVEX, MJX, ONE):
            after = np.asarray(compiled[case]()[0])
            check_standing(f"{name}, {case}", after[..., 2 if case == MJX else 6], before)
        elif not all(np.isfinite(x).all() for x in jax.tree.leaves(compiled[case]())):
            raise AssertionError(f"{name}, {case}: not all numbers are finite")
    # No clock tells so much.
    if programs[WITHOUT] != programs[PLAIN]:
        raise AssertionError(f"{name}: without contacts the program is not that of semi_implicit_step")
    return compiled, seconds


def repeated(program, *state):
    """Calls a step a hundred times. The first call after other programs finds cold caches."""
    for _ in range(100):
        state = jax.block_until_ready(program(*state))
    return state


def check_standing(what, heights, before):
    """Raises unless all trunks are at a height at which robots stand: a NaN costs no iterations."""
    stand = (heights > 0.6 * before.min()) & (heights < 1.1 * before.max())
    if not stand.all():
        raise AssertionError(f"{what}: {np.count_nonzero(~stand)} of {stand.size} do not stand after the rollout")


def per_step(case, n, steps):
    """How many steps of a state a call takes."""
    return {ONE: 500, CALL: 100, ROLLOUT: 60, GRADIENT: 60}.get(case, n * steps)


def values(found, n, steps):
    """(robot, what is claimed, the value, what is asked, whether it holds) of all claims."""
    for name, (seconds, compiling) in found.items():
        for claim in CLAIMS:
            if name not in claim.robots:
                continue
            if isinstance(claim, Claim):
                value = float(np.median(seconds[claim.slower] / seconds[claim.faster]))
                asked = f"at least {claim.least}" if claim.least else f"at most {claim.most}"
                holds = claim.least <= value <= claim.most
                yield name, f"{claim.slower} over {claim.faster}", value, asked, holds
            elif claim.of_compiling:
                value = sum(compiling[claim.case])
                yield name, f"{claim.case}, s to trace and compile", value, f"at most {claim.most}", value <= claim.most
            else:
                value = float(np.median(seconds[claim.case]) / per_step(claim.case, n, steps) * 1e6)
                yield name, f"{claim.case}, us", value, f"at most {claim.most}", value <= claim.most


def lines(found, n, steps):
    yield f"{n} states, float32, rollouts of {steps} steps of {DT * 1e3:.0f} ms: medians of us per state and step (10 %"
    yield "to 90 % of all rounds), and seconds to trace and to compile. A call of one step is one of 100 in a row."
    yield f"{measure.machine()}, mujoco {version('mujoco')}, mujoco-mjx {version('mujoco-mjx')}"
    for name, (seconds, compiling) in found.items():
        yield f"\n| {name} | us | 10 % | 90 % | trace, s | compile, s |"
        yield "|---|---|---|---|---|---|"
        for case, each in seconds.items():
            low, middle, high = np.quantile(each / per_step(case, n, steps), [0.1, 0.5, 0.9]) * 1e6
            traced, compiled = compiling[case]
            yield f"| {case} | {middle:.3g} | {low:.3g} | {high:.3g} | {traced:.2g} | {compiled:.2g} |"
    for name, what, value, asked, holds in values(found, n, steps):
        yield f"\n{name}, {what}: {value:.3f}, {asked}: {'holds' if holds else 'DOES NOT HOLD'}."
    yield "\nWithout contacts, convex_step is the program of semi_implicit_step."


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What a step with contact costs.")
    parser.add_argument("--n", type=int, default=4096, help="states")
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--write", action="store_true", help="write the table to contact.md beside this file")
    options = parser.parse_args(arguments)
    found = {}
    for name in options.robots:
        compiled, compiling = cases(name, options.n, options.steps)
        found[name] = measure.interleaved(compiled, options.rounds), compiling
    table = "\n".join(lines(found, options.n, options.steps))
    print(table)
    if options.write:
        (HERE / "contact.md").write_text(f"# What a step with contact costs\n\n{table}\n")
    return 0 if all(holds for *_, holds in values(found, options.n, options.steps)) else 1


if __name__ == "__main__":
    sys.exit(main())

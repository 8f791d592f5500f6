"""Random small models, written as text, against MuJoCo in float64: poses and every algorithm, relative error 1e-12.

Relative to the largest number of each result. Coordinates go to and from MuJoCo's by `interop.mujoco`. A constraint
between joints is soft in MuJoCo, and a mimic here: compared is what follows from M and forces without it.
"""

import functools
import re

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import mujoco as states
from tests.helpers import contact_oracle as oracle
from tests.helpers import marks
from tests.helpers.interpreted import interpreted

N = 4
ALLOWED = 1e-12
# Of each body, the one it hangs on, and its joints; a joint may follow another.
FIXED = [(-1, ["hinge"]), (0, ["slide", "hinge"]), (1, []), (2, ["hinge"])]
FLOATING = [(-1, ["free"]), (0, ["hinge"]), (0, ["slide", "ball"])]
MIMIC = [(-1, ["slide"]), (0, ["hinge"]), (1, ["slide"]), (0, ["hinge"])]
FOLLOWS = '<equality><joint joint1="j2" joint2="j3" polycoef=".3 -1.5"/><joint joint1="j1" joint2="j3"/></equality>'
CHAIN = FOLLOWS.replace('joint2="j3"/>', 'joint2="j2" polycoef="-.2 .7"/>')
MODELS = {
    "fixed": (FIXED, "", True),
    "floating": (FLOATING, "", True),
    "mimics": (MIMIC, FOLLOWS, False),
    "chain": (MIMIC, CHAIN, False),
}
# The same as "fixed", without the attribute axis: MuJoCo's default then, or that of the file's classes, is the axis.
CLASSES = '<default><joint axis="1 2 2"/><default class="c"><joint type="slide" axis="-1 0 2"/></default></default>'
CUT = {"no axes": "", "axes of classes": CLASSES}
models = pytest.mark.parametrize("name", [*MODELS, *CUT])


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def text(bodies, rest, has_armature, seed=7):
    """MJCF of bodies with random placements, inertias, axes, anchors, references and armatures."""
    rng = np.random.default_rng(seed)
    numbers = lambda n: " ".join(map(repr, rng.standard_normal(n).tolist()))  # noqa: E731
    count = iter(range(100))

    def joint(kind):
        if kind == "free":
            return f'<joint name="j{next(count)}" type="free" armature="{rng.uniform(0.2, 0.5)}"/>'
        ref = "" if kind == "ball" else f' ref="{rng.standard_normal()}"'
        axis = "" if kind == "ball" else f' axis="{numbers(3)}"'
        armature = f' armature="{rng.uniform(0, 0.2)}"' if has_armature else ""
        return f'<joint name="j{next(count)}" type="{kind}" pos="{numbers(3)}"{axis}{ref}{armature}/>'

    def body(i):
        lengths, d = rng.uniform(0.1, 0.4, 3) ** 2, rng.uniform(0.5, 2)
        moments = " ".join(repr(float(d * (lengths.sum() - x))) for x in lengths)
        own = "".join(map(joint, bodies[i][1]))
        mass = f'<inertial mass="{d}" pos="{numbers(3)}" quat="{numbers(4)}" diaginertia="{moments}"/>'
        rest = "".join(body(k) for k, (parent, _) in enumerate(bodies) if parent == i)
        return f'<body name="b{i}" pos="{numbers(3)}" quat="{numbers(4)}">{own}{mass}{rest}</body>'

    roots = "".join(body(i) for i, (parent, _) in enumerate(bodies) if parent < 0)
    options = f'<compiler angle="radian"/><option gravity="{numbers(3)}"><flag equality="disable"/></option>'
    return f"<mujoco>{options}<worldbody>{roots}</worldbody>{rest}</mujoco>"


def source_of(name):
    if name not in CUT:
        return text(*MODELS[name])
    cut = re.sub(' axis="[^"]*"', "", text(*MODELS["fixed"]))
    in_classes = cut.replace('type="slide"', 'class="c"').replace("<worldbody>", CUT[name] + "<worldbody>")
    return in_classes if CUT[name] else cut


def both(source):
    """MuJoCo's model, and ours: the constraints are for us alone."""
    ours = js.Mechanism.from_mjcf(source.replace('equality="disable"', ""), dtype=np.float64)
    return mujoco.MjModel.from_xml_string(source), ours


@functools.cache
def case(name):
    """(the model, our mechanism, q, v, vdot), N states."""
    with jax.enable_x64(True):
        model, mech = both(source_of(name))
        q = js.random_configuration(mech, jax.random.key(1), N, np.float64)
    v, a = np.random.default_rng(2).standard_normal((2, N, mech.nv))
    return model, mech, q, jnp.asarray(v), jnp.asarray(a)


@functools.cache
def ours(name):
    _, mech, *state = case(name)

    def all_of_them(q, v, a):
        X, M = js.forward_kinematics(mech, q), js.mass_matrix(mech, q)
        tau = js.inverse_dynamics(mech, q, v, a)
        # MuJoCo's bias is at rest of its own rates.
        still = states.from_qacc(mech, q, v, jnp.zeros(len(states.to_qvel(mech, q, v))))
        to_qvel = jax.vmap(functools.partial(states.to_qvel, mech, q), out_axes=1)(jnp.eye(mech.nv))
        return {
            "positions": X.translation,
            "rotations": X.rotation.to_matrix(),
            "forces": tau,
            "mass": M,
            "bias": js.bias_forces(mech, q, v) + jnp.einsum("ij,j->i", M, still, precision="highest"),
            "accelerations": js.forward_dynamics(mech, q, v, tau),
            "qpos": states.to_qpos(mech, q),
            "qvel": states.to_qvel(mech, q, v),
            "qacc": states.to_qacc(mech, q, v, a),
            "qfrc": states.to_qfrc(mech, q, tau),
            "to_qvel": to_qvel,
        }

    return interpreted(jax.vmap(all_of_them))(*state)


@functools.cache
def theirs(name):
    model, mech, *_ = case(name)
    found = [_of_state(model, mech, {what: x[i] for what, x in ours(name).items()}) for i in range(N)]
    return {what: np.stack([state[what] for state in found]) for what in found[0]}


def whole_mass_matrix(model, data):
    columns = np.zeros((model.nv, model.nv))
    for column, unit in zip(columns, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    return columns


def _of_state(model, mech, state):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = state["qpos"], state["qvel"], state["qacc"]
    mujoco.mj_inverse(model, data)
    bodies = [data.body(name) for name in mech.body_names if "/" not in name]
    found = {
        "positions": np.stack([body.xpos for body in bodies]),
        "rotations": np.stack([body.xmat.reshape(3, 3) for body in bodies]),
        "forces": np.array(data.qfrc_inverse),
        "mass": whole_mass_matrix(model, data),
        "bias": np.array(data.qfrc_bias),
    }
    data.qfrc_applied[:] = state["qfrc"]
    mujoco.mj_forward(model, data)
    return found | {"accelerations": np.array(data.qacc)}


def error(name, what, found, expected):
    assert found.shape == expected.shape
    size = abs(found - expected).max() / abs(expected).max()
    assert size <= ALLOWED, (name, what, size)


@models
def test_poses(name):
    is_named = ["/" not in body for body in case(name)[1].body_names]
    for what in ("positions", "rotations"):
        error(name, what, ours(name)[what][:, is_named], theirs(name)[what])


@models
@pytest.mark.parametrize("what", ["forces", "bias"])
def test_forces(name, what):
    _, mech, q, *_ = case(name)
    error(name, what, ours(name)[what], np.asarray(states.from_qfrc(mech, q, jnp.asarray(theirs(name)[what]))))


@models
def test_mass_matrix(name):
    T = ours(name)["to_qvel"]
    error(name, "mass", ours(name)["mass"], np.einsum("bik,bij,bjl->bkl", T, theirs(name)["mass"], T))


@pytest.mark.parametrize("com", [0.0, 0.1])
def test_slides_of_one_body_along_the_same_axis(com):
    """They are coupled by m. MuJoCo leaves that out of a body that has its centre of mass at its origin."""
    slides = '<joint type="slide"/><joint type="slide" axis="1 0 0"/><joint type="slide"/>'
    body = f'<body>{slides}<inertial pos="{com} 0 0" mass="2" diaginertia="1 1 1"/></body>'
    model, mech = both(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    np.testing.assert_array_equal(mech.axes, np.eye(3)[[2, 0, 2]])
    exact = np.array([[2.0, 0, 2], [0, 2, 0], [2, 0, 2]])
    np.testing.assert_array_equal(interpreted(lambda q: js.mass_matrix(mech, q))(np.zeros(3)), exact)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    assert (model.body_simple[1] == 2) == (com == 0)
    np.testing.assert_array_equal(whole_mass_matrix(model, data), exact if com else np.diag(np.diag(exact)))


def test_centres_of_mass_that_are_nearly_origins():
    """MuJoCo takes a frame of inertia that is nearly that of the body for the same: meshes have such."""
    body = '<body name="b"><freejoint/><inertial pos="2e-9 0 1e-9" mass="180" diaginertia="1 2 2.5"/></body>'
    model, mech = both(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    q, v, data = state_of(model, mech, 1)
    M, T = interpreted(lambda q: js.mass_matrix(mech, q))(q), rates_of(mech, q)
    error("free", "mass", M, T.T @ whole_mass_matrix(model, data) @ T)


def test_armature_of_mimics():
    model, mech = both(text(MIMIC, FOLLOWS, True))
    data, q = mujoco.MjData(model), np.array([0.25, 0.5])
    data.qpos[:] = states.to_qpos(mech, q)
    mujoco.mj_forward(model, data)
    M, T = interpreted(lambda q: (js.mass_matrix(mech, q), jax.vmap(lambda v: states.to_qvel(mech, q, v))(np.eye(2))))(
        q
    )
    T = T.T
    error("mimics", "mass", M, T.T @ whole_mass_matrix(model, data) @ T)


def test_contact_of_mimics():
    """`convex_step` at the optimum of the convex problem that MuJoCo's mass matrix, bias and Jacobians make, along the
    coordinates that mimics leave."""
    model, mech, q, v, tau = case("mimics")
    frames, p, dt, k, tau_d, mu = ("b1", "b2", "b3"), np.full((3, 3), [0.1, -0.2, 0.3]), 5e-3, 1e4, 0.01, 0.5
    heights = interpreted(lambda q: (js.forward_kinematics(mech, q, frames) @ p)[..., 2])(q)
    offset, law = np.sort(heights)[:, 1], {"stiffness": k, "relaxation_time": tau_d, "friction": mu}

    def step(q, v, tau, offset):
        ground, contacts = js.HalfSpace(offset=offset), js.PointContacts(frames, p, 0.02, **law)
        return js.convex_step(mech, q, v, tau, dt, contacts=contacts, ground=ground)

    found = interpreted(step)(q, v, tau, offset)
    for i in range(N):
        data, T = mujoco.MjData(model), ours("mimics")["to_qvel"][i]
        data.qpos[:], data.qvel[:] = ours("mimics")["qpos"][i], ours("mimics")["qvel"][i]
        mujoco.mj_forward(model, data)
        M, spheres = T.T @ whole_mass_matrix(model, data) @ T, []
        for name, centre in zip(frames, p, strict=True):
            body, J = data.body(name), np.zeros((3, model.nv))
            centre = body.xpos + body.xmat.reshape(3, 3) @ centre
            distance = centre[2] - offset[i]
            mujoco.mj_jac(model, data, J, None, centre - [0, 0, distance], model.body(name).id)
            spheres.append(oracle.Contact(J @ T, distance - 0.02, k, tau_d, mu))
        free = np.asarray(v[i] + dt * np.linalg.solve(M, tau[i] - T.T @ data.qfrc_bias))
        problem = oracle.Problem(M, free, oracle.terms_of(M, free, np.asarray(v[i]), dt, spheres))
        after = problem.optimum(np.asarray(v[i])).v
        assert len(problem.terms) == 2 and abs(after - free).max() > 1e-3
        np.testing.assert_allclose(found.v[i], after, rtol=0, atol=1e-8 * abs(after).max())


SPRUNG = """<mujoco><compiler angle="radian"/><worldbody>
  <body pos="1 2 3" quat=".8 0 .6 0"><joint type="free" stiffness="3" damping="2"/><geom size="1"/>
    <body><joint stiffness="5" springref=".3" ref=".1" damping=".5"/>
      <joint type="slide" stiffness="7" springref="-.4"/><geom size="1"/>
      <body><joint type="ball" stiffness="11" damping="4"/><geom size="1"/></body></body></body>
</worldbody></mujoco>"""


@pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")
def test_springs_and_damping():
    """Of every joint, a ball and a free one too: the generalized forces, which have the power of ours."""
    model, mech = both(SPRUNG)
    q = js.random_configuration(mech, jax.random.key(4), N, np.float64)
    v = jnp.asarray(np.random.default_rng(5).standard_normal((N, mech.nv)))
    found = interpreted(lambda q, v: js.passive_forces(mech, q, v))(q, v)
    data, expected = mujoco.MjData(model), []
    for qpos, qvel in zip(states.to_qpos(mech, q), states.to_qvel(mech, q, v), strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        expected.append(data.qfrc_spring + data.qfrc_damper)
    error(
        "sprung", "passive", np.asarray(found), np.asarray(states.from_qfrc(mech, q, jnp.asarray(np.array(expected))))
    )


HAND = """<mujoco><compiler angle="radian"/><option timestep="0.002" gravity="1 2 -9"/><worldbody>
  <body name="a" gravcomp=".7" pos="0 0 1" quat=".8 0 .6 0"><joint name="j0" axis="0 1 0" ref=".1"/>
    <inertial pos=".1 .2 .3" mass="2" diaginertia=".1 .12 .15"/>
    <body name="b" pos=".3 0 .1"><joint name="j1" axis="1 2 0" damping=".3"/>
      <inertial pos="0 .1 .1" mass="1" diaginertia=".02 .03 .02"/>
      <body name="welded" gravcomp="1" pos=".1 0 0"><inertial pos=".1 0 0" mass=".5" diaginertia=".1 .1 .1"/></body>
      <body name="c" gravcomp="1.2" pos="0 .2 .1" quat=".6 .8 0 0"><joint name="j2" type="slide" axis="0 1 1"/>
        <inertial pos=".1 .1 0" mass=".7" diaginertia=".02 .03 .02"/>
        <body name="d" pos="0 .1 .1"><joint name="ball" type="ball" range="0 .4" damping=".2"/>
          <inertial pos=".1 0 .05" mass=".5" diaginertia=".01 .02 .015"/></body></body></body></body>
</worldbody><tendon>
  <fixed name="band" stiffness="30" damping="2" springlength=".1 .4"><joint joint="j0" coef="1"/>
    <joint joint="j1" coef="-2"/><joint joint="j2" coef=".5"/></fixed>
  <fixed name="spring" stiffness="7"><joint joint="j1" coef="1"/><joint joint="j2" coef="3"/></fixed>
  <fixed name="stop" range="-.2 .3"><joint joint="j0" coef="1.5"/><joint joint="j2" coef="-1"/></fixed>
</tendon></mujoco>"""
# A tendon over a joint that follows another, by a chain.
FOLLOWING = '<joint joint1="j2" joint2="j1" polycoef=".1 .5"/><joint joint1="j1" joint2="j0" polycoef="-.2 .7"/>'
TIED = HAND.replace("</mujoco>", f"<equality>{FOLLOWING}</equality></mujoco>").replace(' range="-.2 .3"', "")
HELD = TIED.replace("<equality>", '<option><flag equality="disable"/></option><equality>')


def state_of(model, mech, k):
    q = js.random_configuration(mech, jax.random.key(k), (), np.float64)
    v = jnp.asarray(np.random.default_rng(k).standard_normal(mech.nv))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = states.to_qpos(mech, q), states.to_qvel(mech, q, v)
    mujoco.mj_forward(model, data)
    return q, v, data


def rates_of(mech, q):
    """MuJoCo's rates of our unit velocities."""
    return np.asarray(jax.vmap(lambda v: states.to_qvel(mech, q, v), out_axes=1)(jnp.eye(mech.nv)))


@pytest.mark.parametrize("source", [HAND, TIED], ids=["hand", "followers"])
def test_tendons_and_lifts(source):
    """Springs with a range of rest, damping, and gravity that is compensated, of welded bodies and by more than all."""
    mech = js.Mechanism.from_mjcf(source, dtype=np.float64)
    model = mujoco.MjModel.from_xml_string(HAND if source is HAND else HELD)
    assert [x.name for x in mech.tendons] == ["band", "spring", *["stop"] * (source is HAND)]
    passive, lengths = interpreted(lambda q, v: js.passive_forces(mech, q, v)), set()
    for k in range(12):
        q, v, data = state_of(model, mech, k)
        expected = rates_of(mech, q).T @ (data.qfrc_spring + data.qfrc_damper + data.qfrc_gravcomp)
        np.testing.assert_allclose(passive(q, v), expected, rtol=0, atol=1e-13 * abs(expected).max())
        lengths.add(np.sign(data.ten_length[0] - 0.1) + np.sign(data.ten_length[0] - 0.4))
    assert {-2, 2} <= lengths


def test_limits_of_tendons_and_balls():
    """Depths and directions are those of MuJoCo's constraints, which are soft otherwise."""
    mech = js.Mechanism.from_mjcf(HAND, dtype=np.float64)
    model, k, c, seen = mujoco.MjModel.from_xml_string(HAND), 50.0, 3.0, set()
    of_tendon = mech.velocities({"j0": 1.0})  # its first joint
    soft = js.Compliance(limit_stiffness=k * (1 + of_tendon), limit_damping=c / (1 + of_tendon))
    forces = interpreted(lambda q, v: (js.passive_forces(mech, q, v, soft), js.passive_forces(mech, q, v)))
    kinds = [int(x) for x in (mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON, mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT)]
    for i in range(20):
        q, v, data = state_of(model, mech, i)
        J, expected = data.efc_J.reshape(data.nefc, model.nv), np.zeros(mech.nv)
        for row, depth, kind in zip(J, -data.efc_pos, data.efc_type, strict=True):
            stiffness, damping = (2 * k, c / 2) if int(kind) == kinds[0] else (k, c)
            push = max(0.0, stiffness * depth - damping * (row @ data.qvel))
            expected += push * row
            seen.add((int(kind), push > 0))
        found, without = forces(q, v)
        np.testing.assert_allclose(found - without, expected, rtol=0, atol=1e-11)
    assert {(kind, True) for kind in kinds} <= seen


@pytest.mark.parametrize("source", [HAND, TIED], ids=["hand", "followers"])
def test_many_steps_with_tendons_and_lifts(source):
    """500 of mj_step, by Euler's method: damping of tendons is explicit there, too. For followers MuJoCo has soft
    constraints: its mass matrix and forces are taken along our coordinates."""
    mech = js.Mechanism.from_mjcf(source, dtype=np.float64)
    free = HAND.replace(' range="-.2 .3"', "").replace(' range="0 .4"', "") if source is HAND else HELD
    model = mujoco.MjModel.from_xml_string(free)
    q, v, data = state_of(model, mech, 3)
    q = q.at[: mech.nq - 4].multiply(0.2)
    Q, V = stepped(mech, q, v, 0.002, 500)
    Qs, Vs = np.asarray(states.to_qpos(mech, Q)), np.asarray(states.to_qvel(mech, Q, V))
    if source is HAND:
        assert compared_steps(model, Qs, Vs) <= 1e-9
        return
    worst, damping = 0.0, np.diag(mech.damping)
    for k in range(500):
        data.qpos[:], data.qvel[:] = Qs[k], Vs[k]
        mujoco.mj_forward(model, data)
        T = rates_of(mech, Q[k])
        M, push = T.T @ whole_mass_matrix(model, data) @ T, T.T @ (data.qfrc_passive - data.qfrc_bias)
        after = np.asarray(V[k]) + 0.002 * np.linalg.solve(M + 0.002 * damping, push)
        worst = max(worst, abs(after - np.asarray(V[k + 1])).max())
    assert worst <= 1e-9


@pytest.mark.parametrize("name", ["fixed", "floating", *CUT])
def test_accelerations(name):
    _, mech, q, v, _ = case(name)
    found = states.from_qacc(mech, q, v, jnp.asarray(theirs(name)["accelerations"]))
    error(name, "accelerations", ours(name)["accelerations"], np.asarray(found))


@models
def test_states_there_and_back(name):
    model, mech, q, v, a = case(name)
    there = ours(name)
    assert [there[x].shape[-1] for x in ("qpos", "qvel")] == [model.nq, model.nv]
    np.testing.assert_array_equal(states.from_qpos(mech, there["qpos"]), q)
    np.testing.assert_allclose(states.from_qvel(mech, q, there["qvel"]), v, rtol=0, atol=1e-14)
    np.testing.assert_allclose(states.from_qacc(mech, q, v, there["qacc"]), a, rtol=0, atol=4e-14)
    power = np.einsum("bi,bi->b", there["forces"], v)
    np.testing.assert_allclose(np.einsum("bi,bi->b", there["qfrc"], there["qvel"]), power, rtol=0, atol=1e-12)


FLYING = """<mujoco><compiler angle="radian"/><option timestep="0.002" gravity="0 0.5 -9.81"/><worldbody>
  <body pos="0 0 1"><joint type="free" damping="DAMPING" armature="ARMATURE"/>
    <inertial pos=".01 .02 .03" mass="2" diaginertia=".1 .12 .15"/>
    <body pos=".2 0 .3"><joint axis="0 1 0" damping="DAMPING"/>
      <inertial pos=".1 0 .05" mass="1" diaginertia=".02 .03 .02"/>
      <body pos="0 .1 .4"><joint type="ball" damping="DAMPING"/>
        <inertial pos=".05 .02 .1" mass=".5" diaginertia=".01 .02 .015"/></body></body></body>
</worldbody></mujoco>"""


def stepped(mech, q, v, dt, n=100):
    """(q, v) at the start and after each of n steps."""

    def step(x, _):
        x = js.semi_implicit_step(mech, *x, jnp.zeros(mech.nv), dt)
        return x, x

    with js.default_precision("fast"):
        after = jax.jit(lambda q, v: jax.lax.scan(step, (q, v), length=n)[1])(q, v)
    return [jnp.concatenate([start[None], x]) for start, x in zip((q, v), after, strict=True)]


def compared_steps(model, qpos, qvel):
    """Of mj_step, from the first of these states to the others."""
    data, worst = mujoco.MjData(model), 0.0
    data.qpos[:], data.qvel[:] = qpos[0], qvel[0]
    for position, rates in zip(qpos[1:], qvel[1:], strict=True):
        mujoco.mj_step(model, data)
        worst = max(worst, abs(data.qpos - position).max(), abs(data.qvel - rates).max())
    return worst


@pytest.mark.parametrize("damping", [marks.slow("0"), "0.7"])
@pytest.mark.parametrize("armature", [marks.slow("0"), "0.3"])
def test_steps_of_what_floats(damping, armature):
    """A free base with a hinge and a ball: as mj_step, by Euler's method, implicit damping too; 500 steps."""
    model, mech = both(FLYING.replace("DAMPING", damping).replace("ARMATURE", armature))
    np.testing.assert_array_equal(mech.armature[:6], float(armature))
    q = js.random_configuration(mech, jax.random.key(1), (), np.float64)
    v = jnp.asarray(2 * np.random.default_rng(0).standard_normal(mech.nv))
    Q, V = stepped(mech, q, v, 0.002, 500)
    worst = compared_steps(model, np.asarray(states.to_qpos(mech, Q)), np.asarray(states.to_qvel(mech, Q, V)))
    assert worst <= 1e-11, worst


CARRIED = """<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody>
  <body pos="0 0 1"><joint axis="0 .6 .8"/><inertial pos=".1 .2 0" mass="1" diaginertia=".1 .12 .15"/>
    <body pos=".2 .1 0" quat=".8 .6 0 0">JOINTS
      <inertial pos=".3 -.1 .2" mass="1.5" diaginertia=".02 .03 .02"/></body></body>
</worldbody></mujoco>"""
HELD_BACK = 'damping=".4" armature=".2"'
SLIDES = [f'<joint type="slide" axis="{axis}" {HELD_BACK}/>' for axis in ("1 0 0", "0 1 0", "0 0 1")]
CARRIERS = {
    "planar": [*SLIDES[:2], f'<joint axis="0 0 1" {HELD_BACK}/>'],
    "free": [*SLIDES, f'<joint type="ball" {HELD_BACK}/>'],
}


@pytest.mark.parametrize("kind", CARRIERS)
def test_steps_of_planar_and_free_joints_on_a_body(kind):
    """Which turns: as MuJoCo's slides with a hinge, or a ball, behind them."""
    model = mujoco.MjModel.from_xml_string(CARRIED.replace("JOINTS", "".join(CARRIERS[kind])))
    inertias = (([0.1, 0.2, 0], 1.0, [0.1, 0.12, 0.15]), ([0.3, -0.1, 0.2], 1.5, [0.02, 0.03, 0.02]))
    bodies = [
        js.Body(name, js.SpatialInertia(mass, np.array(com), np.diag(central)))
        for name, (com, mass, central) in zip("ab", inertias, strict=True)
    ]
    turned = js.Rotation.from_quaternion(np.array([0.8, 0.6, 0.0, 0.0]))
    identity = js.Rotation.identity(dtype=np.float64)
    joints = [
        js.Joint(
            "hinge", "revolute", "world", "a", js.RigidTransform(identity, np.array([0.0, 0, 1])), axis=(0, 0.6, 0.8)
        ),
        js.Joint(
            "joint", kind, "a", "b", js.RigidTransform(turned, np.array([0.2, 0.1, 0])), damping=0.4, armature=0.2
        ),
    ]
    mech = js.Mechanism.build(bodies, joints, dtype=np.float64)
    q = js.random_configuration(mech, jax.random.key(1), (), np.float64)
    v = jnp.asarray(3 * np.random.default_rng(0).standard_normal(mech.nv))
    Q, V = stepped(mech, q, v, 0.002)
    rates = np.asarray(js.configuration_rates(mech, Q, V))
    Q, V = np.asarray(Q), np.asarray(V)
    if kind == "free":
        # The position first, and its rates along the axes of the parent.
        qpos = np.concatenate([Q[:, :1], Q[:, 5:], Q[:, 1:5]], 1)
        qvel = np.concatenate([V[:, :1], rates[:, 5:], V[:, 1:4]], 1)
    else:
        qpos, qvel = Q, rates
    assert compared_steps(model, qpos, qvel) <= 1e-11

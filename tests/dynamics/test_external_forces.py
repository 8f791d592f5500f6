"""Forces at points of frames: against Jacobians, in every transformation, and what they cost; reactions of joints."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.dynamics.test_loads import arm, pose, state
from tests.helpers.counting import asked_for, done
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

# Two wrenches on one frame, one on a frame of the same body, one on the other body, one on the world.
FRAMES = ("tip", "tool", "tip", "elbow", "world")
AXES = pytest.mark.parametrize("axes", ["world", "frame"])


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def forces(axes="world", *batch, frames=FRAMES):
    tau, f, p = np.random.default_rng(2).standard_normal((3, *batch, len(frames), 3))
    return js.AppliedForces(frames, js.SpatialForce(jnp.asarray(tau), jnp.asarray(f)), jnp.asarray(p), axes)


def about_origins(q, F):
    """The wrenches about the origins of their frames, in world axes."""
    R_WF = js.forward_kinematics(arm(), q, F.frames).rotation
    in_world = js.rotate(R_WF, F.wrenches) if F.axes == "frame" else F.wrenches
    return js.shift(in_world, -(R_WF @ F.points))


def pulled(q, F):
    """J^T F."""
    return jnp.einsum("nij,ni->j", js.jacobian(arm(), q, F.frames), about_origins(q, F).to_array(), precision="highest")


@AXES
def test_wrenches_act_where_they_are_said_to(axes):
    (q, v, a), F = state(), forces(axes)
    expected = interpreted(lambda q: js.inverse_dynamics(arm(), q, v, a) - pulled(q, F))(q)
    found = interpreted(lambda q, F: js.inverse_dynamics(arm(), q, v, a, F))(q, F)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * abs(expected).max())
    back = interpreted(lambda q, F: js.forward_dynamics(arm(), q, v, found, F))(q, F)
    np.testing.assert_allclose(back, a, rtol=0, atol=1e-12)


@AXES
def test_sums_on_bodies_are_the_same_forces(axes):
    (q, v, _), F = state(), forces(axes)

    def applied(q, F):
        found = js.applied_wrenches(arm(), q, F)
        assert list(found) == ["world", "upper", "lower"]
        return found

    def on_elbow(q):
        """That on the frame "elbow", about the origin of its body."""
        p_W = js.forward_kinematics(arm(), q, ["elbow", "upper"]).translation
        about = about_origins(q, F)
        return js.shift(js.SpatialForce(about.tau[3], about.f[3]), p_W[1] - p_W[0]).to_array()

    sums = interpreted(applied)(q, F)
    found, expected = (interpreted(lambda q, F: js.bias_forces(arm(), q, v, F))(q, x) for x in (sums, F))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * abs(expected).max())
    of_dict = interpreted(lambda q, F: js.applied_wrenches(arm(), q, F))(q, sums)
    for name, F_Bo_W in sums.items():
        np.testing.assert_array_equal(of_dict[name].to_array(), F_Bo_W.to_array())
    np.testing.assert_allclose(sums["upper"].to_array(), interpreted(on_elbow)(q), rtol=0, atol=1e-13)
    assert js.applied_wrenches(arm(), q, None) == {} == js.applied_wrenches(arm(), q, {})


def test_several_sources_in_a_list_add_up():
    """As generalized forces, as sums on bodies, and in a step, whatever frames and axes each has."""
    (q, v, a), more = state(), forces(frames=("lower", "tip"))
    parts = [forces("frame"), more, None, {"tip": js.SpatialForce(*(x[0] for x in more.wrenches._vectors))}]
    of = interpreted(lambda *x: js.bias_forces(arm(), q, v, *x))
    alone = of(None)
    found, expected = of(parts) - alone, sum(of(x) - alone for x in parts)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * abs(expected).max())
    np.testing.assert_array_equal(of(tuple(parts)), of(parts))
    np.testing.assert_array_equal(of([]), alone)
    sums, each = js.applied_wrenches(arm(), q, parts), [js.applied_wrenches(arm(), q, x) for x in parts]
    assert list(sums) == ["world", "upper", "lower"]
    for name, F in sums.items():
        whole = sum(np.asarray(x[name].to_array()) for x in each if name in x)
        np.testing.assert_allclose(F.to_array(), whole, rtol=0, atol=1e-13 * abs(whole).max())
    steps = [js.semi_implicit_step(arm(), q, v, a, 1e-3, x)[1] for x in (parts, sums)]
    np.testing.assert_allclose(*steps, rtol=0, atol=1e-13)


@AXES
def test_closed_form_derivatives(axes):
    """One derivative at a time goes through the recursion, not through the closed form."""
    (q, v, a), F = state(), forces(axes)

    def along(step):
        return js.inverse_dynamics(arm(), js.integrate(arm(), q, step), v, a, F)

    closed = interpreted(lambda q: js.inverse_dynamics_derivatives(arm(), q, v, a, F).dtau_dq)(q)
    for k, unit in enumerate(np.eye(arm().nv)):
        one = interpreted(lambda t: jax.jvp(along, (jnp.zeros(arm().nv),), (t,))[1])(unit)
        np.testing.assert_allclose(closed[:, k], one, rtol=0, atol=1e-12 * abs(closed).max())


WAYS = {
    "leading axes": jax.jit,
    "vmap": lambda of: jax.jit(jax.vmap(of)),
    "scan": lambda of: lambda F: jax.lax.scan(lambda _, x: (None, of(x)), None, F)[1],
}


@pytest.mark.parametrize("way", [slow("leading axes"), "vmap", slow("scan")])
def test_the_same_bits_however_they_are_given(way):
    (q, v, _), F = state(), forces("frame", 4)
    of = functools.partial(js.bias_forces, arm(), q, v)
    np.testing.assert_array_equal(WAYS[way](of)(F), interpreted(of)(F))


def test_derivatives_are_linear_in_the_wrenches():
    (q, v, _), F = state(), forces("frame", 4)
    of = functools.partial(js.bias_forces, arm(), q, v)
    one = jax.tree.map(lambda x: x[0], F)
    by = interpreted(jax.grad(lambda F: jnp.sum(of(F) * v)))(one)
    assert jax.tree.structure(by) == jax.tree.structure(one)
    # Power -V . J^T F is linear in the wrenches: its gradient by them is minus the velocity of their points.
    power, step = np.sum(by.wrenches.to_array() * one.wrenches.to_array()), 1e-6
    alone = interpreted(lambda: js.bias_forces(arm(), q, v))()
    np.testing.assert_allclose(power, np.sum((interpreted(of)(one) - alone) * v), rtol=1e-12)
    points = np.stack([one.points + step, one.points - step])
    at = interpreted(jax.vmap(lambda points: of(js.AppliedForces(FRAMES, one.wrenches, points, "frame"))))(points)
    np.testing.assert_allclose(np.sum(by.points), np.sum((at[0] - at[1]) * v) / (2 * step), rtol=1e-7)


@pytest.mark.parametrize("name", ["semi_implicit_step", "rk4_step", "symplectic_step"])
def test_in_steps(name):
    """A batch of forces on a batch of states, with damping that differs from item to item."""
    q, v, a = state()
    mech, step = arm().replace(friction_loss=0.1 * np.ones(arm().nv)), getattr(js, name)
    # About origins of bodies: at other points, a wrench about the origin would change within a step.
    F = forces("world", 3, frames=("upper", "lower", "lower"))
    F = js.AppliedForces(F.frames, F.wrenches, 0 * F.points)
    batch = [jnp.stack([x, x, x]) for x in (q, v, a)]
    found = interpreted(lambda q, v, a, F: step(mech, q, v, a, 1e-3, F))(*batch, F)
    alone = interpreted(lambda q, v, a, F: step(mech, q, v, a, 1e-3, js.applied_wrenches(mech, q, F)))(*batch, F)
    for x, y in zip(found, alone, strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-11 if name == "symplectic_step" else 1e-13)
    assert abs(found[1][0] - found[1][1]).max() > 1e-5


# -- what they cost ---------------------------------------------------------------------------------------------------


@pytest.fixture(params=[asked_for, done], ids=["on arrays", "on numbers"])
def count(request):
    return request.param


@pytest.fixture
def counted(count):
    (q, v, _), run = state(), functools.partial(js.bias_forces, arm(), precision="fast")
    return lambda F, *arguments: count(lambda q, v, *x: run(q, v, F(*x)), q, v, *arguments)


def test_origins_in_world_axes_cost_what_a_dict_costs(counted, count):
    frames = "upper", "tip", "elbow"
    x = jnp.ones((3, 3)), jnp.ones((3, 3))
    stacked = counted(lambda tau, f: js.AppliedForces(frames, js.SpatialForce(tau, f)), *x)
    by_name = counted(lambda tau, f: {name: js.SpatialForce(tau[i], f[i]) for i, name in enumerate(frames)}, *x)
    # A frame at the origin of its body is not told apart among several.
    most = 1 if count is asked_for else 1.05
    assert all(stacked[x] <= most * by_name[x] for x in ("multiply", "add"))
    one = counted(lambda tau, f: js.AppliedForces(["tip"], js.SpatialForce(tau[:1], f[:1])), *x)
    assert one == counted(lambda tau, f: {"tip": js.SpatialForce(tau[0], f[0])}, *x)


def test_what_is_absent_leaves_nothing_behind(counted):
    nothing, f = counted(lambda: None), jnp.ones((1, 3))
    assert counted(lambda: js.AppliedForces([], js.SpatialForce.zero((0,)))) == nothing
    assert counted(lambda: js.AppliedForces(["tip"], js.SpatialForce(np.zeros((1, 3)), np.zeros((1, 3))))) == nothing

    def on(frame, points, axes="world"):
        return counted(lambda f: js.AppliedForces([frame], js.SpatialForce(f=f), points, axes), f)["multiply"]

    above, beside = np.array([[0.0, 0.0, 0.3]]), np.ones((1, 3))
    assert on("upper", None) == on("upper", np.zeros((1, 3))) < on("upper", above) < on("upper", beside)
    assert on("tip", None) == on("tip", above) == on("tip", beside)  # known points are part of known placements
    # In the axes of the frame no pose of the body is needed.
    assert on("tip", None, "frame") < on("tip", None)


# -- messages ---------------------------------------------------------------------------------------------------------


def test_errors_say_what_is_expected():
    (q, v, _), F = state(), js.SpatialForce.zero((2,), np.float64)
    for arguments, error, message in [
        (("tip", F), TypeError, "AppliedForces: frames: expected a sequence of names, got 'tip'"),
        ((["tip"], F), ValueError, r"AppliedForces: wrenches: expected one for each of 1 frames.*got shape \(2,\)"),
        ((["tip", "tip"], jnp.zeros((2, 6))), TypeError, "AppliedForces: wrenches: expected a SpatialForce"),
        ((["tip", "tip"], F, np.zeros((3, 3))), ValueError, r"AppliedForces: points: expected shape \(\*batch, 2, 3\)"),
        ((["tip", "tip"], F, np.zeros(3)), ValueError, r"AppliedForces: points: expected shape \(\*batch, 2, 3\)"),
        ((["tip", "tip"], F, None, "body"), ValueError, "AppliedForces: axes: expected 'world' or 'frame', got 'body'"),
    ]:
        with pytest.raises(error, match=message):
            js.AppliedForces(*arguments)
    for forces, error, message in [
        (js.AppliedForces(["tip", "tipp"], F), KeyError, "bias_forces: external_forces: frames: .*did you mean 'tip'"),
        (F, TypeError, "external_forces: expected SpatialForces in a dict by name of a frame, .*got SpatialForce"),
        (
            [{}, F],
            TypeError,
            r"external_forces\[1\]: expected SpatialForces in a dict .*or a list of these, got Spatial",
        ),
        ([[F]], TypeError, r"external_forces\[0\]: expected .*, got list"),
        ([None, {"tipp": F}], KeyError, r"external_forces\[1\]: .*did you mean 'tip'"),
        ([{"tip": F}, {"tip": F.astype(np.float32)}], TypeError, r"external_forces\[1\]\['tip'\]"),
        ({"tip": 1.0}, TypeError, r"external_forces\['tip'\]: expected a SpatialForce, got float"),
    ]:
        with pytest.raises(error, match=message):
            js.bias_forces(arm(), q, v, forces)


def test_stacked_feet_under_one_name():
    """What does not fit as a batch was meant as several frames."""
    q, v, _ = (jnp.stack([x, x, x]) for x in state())
    feet = js.SpatialForce.zero((4,), np.float64)
    with pytest.raises(ValueError, match=r"under one name .* are AppliedForces\(frames, wrenches\)"):
        js.bias_forces(arm(), q, v, {"tip": feet})
    with pytest.raises(ValueError, match="external_forces") as caught:
        js.bias_forces(arm(), q, v, js.AppliedForces(["tip"] * 4, js.SpatialForce.zero((2, 4), np.float64)))
    assert "under one name" not in str(caught.value)


# -- frames after loading ---------------------------------------------------------------------------------------------


def test_frames_are_added():
    """As if the mechanism had been built with them: on bodies, on welded ones, on frames, on the world."""
    X, Y, q = pose(np.random.default_rng(5)), pose(np.random.default_rng(6)), state()[0]
    new = [js.Frame("sensor", "tool", X), js.Frame("finger", "sensor", Y), js.Frame("lamp", "world", X)]
    mech = js.add_frames(arm(), [*new, js.Frame("same", "elbow")])
    assert mech.frame_names == (*arm().frame_names, "sensor", "finger", "lamp", "same")
    assert [mech.frame_body(x) for x in ("sensor", "finger", "lamp", "same")] == ["lower", "lower", "world", "upper"]

    def poses(q):
        X_WT = js.forward_kinematics(arm(), q, "tool")
        return js.stack([X_WT @ X, X_WT @ X @ Y, js.forward_kinematics(arm(), q, "elbow")], 0).to_matrix()

    own = interpreted(lambda q: js.forward_kinematics(mech, q, ["sensor", "finger", "same"]).to_matrix())(q)
    expected = interpreted(poses)(q)
    np.testing.assert_allclose(own, expected, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(own[2], expected[2])
    n = len(arm().frame_names)
    np.testing.assert_array_equal(mech.frame_placements.translation[:n], arm().frame_placements.translation)
    assert js.add_frames(arm(), []).topology == arm().topology
    static = js.add_frames(arm().as_static(), new)
    assert not isinstance(static, js.StaticMechanism) and static.frame_names == mech.frame_names[:-1]
    assert arm().parents == (-1, 0) and arm().joint_names == ("shoulder", "elbow joint")


def test_frames_that_cannot_be_added():
    for frames, error, message in [
        ([js.Frame("tip", "lower")], ValueError, "add_frames: frames: there is a frame 'tip' already"),
        ([js.Frame("x", "lover")], KeyError, "add_frames: Frame 'x': body: .*did you mean 'lower'"),
        (["x"], TypeError, "add_frames: frames: expected a sequence of Frame objects, got \\['x'\\]"),
    ]:
        with pytest.raises(error, match=message):
            js.add_frames(arm(), frames)
    with pytest.raises(TypeError, match="known numbers"):
        js.add_frames(arm().as_data(), [js.Frame("x", "lower")])


# -- reactions --------------------------------------------------------------------------------------------------------


@AXES
def test_reactions_along_joints_are_inverse_dynamics_bit_by_bit(axes):
    """Joints along the axes of their bodies: torque or force about that axis, and armature."""
    rng = np.random.default_rng(0)
    joints, bodies = [], []
    for i, (kind, axis) in enumerate([("revolute", 2), ("prismatic", 1), ("revolute", 0), ("revolute", 2)]):
        central = np.diag([0.3, 0.4, 0.5])
        bodies.append(js.Body(f"b{i}", js.SpatialInertia(1.0 + i, rng.standard_normal(3), central)))
        parent = f"b{i - 1}" if i else "world"
        joints.append(
            js.Joint(f"j{i}", kind, parent, f"b{i}", pose(rng), axis=np.eye(3)[axis], armature=0.1 * (i == 1))
        )
    mech = js.Mechanism.build(bodies, joints, dtype=np.float64)
    q, v, a = (jnp.asarray(x) for x in rng.standard_normal((3, mech.nv)))
    F = forces(axes, frames=("b3", "b1", "b3"))
    of = functools.partial(js.joint_reactions, mech)
    reactions = interpreted(of)(q, v, a, F)
    tau = interpreted(lambda *x: js.inverse_dynamics(mech, *x))(q, v, a, F)
    along = np.stack([reactions.tau[0, 2], reactions.f[1, 1], reactions.tau[2, 0], reactions.tau[3, 2]])
    np.testing.assert_array_equal(along + mech.armature * np.asarray(a), tau)
    if axes == "frame":
        compiled = jax.jit(lambda *x: of(*x).to_array())(q, v, a, F)
        np.testing.assert_array_equal(compiled, reactions.to_array())


def test_a_chain_at_rest_hangs_on_its_joints():
    """The weight of all that a joint holds, at their centre of mass, less the external forces."""
    (q, _, _), mech = state(), arm()
    zero = jnp.zeros(mech.nv)

    def in_world_axes(q):
        X = js.forward_kinematics(mech, q)
        F = js.joint_reactions(mech, q, zero, zero)
        # The centre of mass of each body, from the world.
        return js.rotate(X.rotation, F), X.translation, js.act(X, mech.inertias).com

    in_world, p, com = interpreted(in_world_axes)(q)
    mass = mech.inertias.mass
    weight = -mass[:, None] * mech.gravity
    held = [weight[0] + weight[1], weight[1]]
    moment = [sum(np.cross(com[k] - p[i], weight[k]) for k in range(i, 2)) for i in range(2)]
    np.testing.assert_allclose(in_world.f, np.stack(held), rtol=0, atol=1e-12)
    np.testing.assert_allclose(in_world.tau, np.stack(moment), rtol=0, atol=1e-12)

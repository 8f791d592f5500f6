"""What a scene does not have leaves no operation behind: multiplications that algorithms ask for, counted.

They are counted twice: operations on arrays, which XLA is asked for, and on single numbers, which our own machine code
does. A planar arm next to a general one, both of 6 revolute joints, at most 0.35, or 0.4; whatever is absent, exactly
the operations of the scene without it. (`pytest -s` prints the table.)
"""

import functools

import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.counting import asked_for, done, flops
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but

N = 6
STATE = tuple(jnp.ones(N, jnp.float32) for _ in range(3))
ALGORITHMS = {
    "inverse dynamics": (js.inverse_dynamics, 3),
    "forward dynamics": (js.forward_dynamics, 3),
    "bias forces": (js.bias_forces, 2),
    "gravity forces": (js.gravity_forces, 1),
    "mass matrix": (js.mass_matrix, 1),
    "kinetic energy": (js.kinetic_energy, 2),
}
algorithms = pytest.mark.parametrize("name", ALGORITHMS)
# Bias forces are inverse dynamics without acceleration.
KEPT = "inverse dynamics", "forward dynamics", "gravity forces", "mass matrix"
most_algorithms = pytest.mark.parametrize("name", slow_but(KEPT, ALGORITHMS))


def body(rng, name, is_planar=False, is_point=False):
    a = rng.standard_normal((3, 3)) * 0.2
    central, com = a @ a.T + np.eye(3) * 0.1, rng.standard_normal(3) * 0.2
    if is_planar:
        central, com = np.diag(np.diag(central)), com * [1, 1, 0]
    central = central * 0 if is_point else central
    return js.Body(
        name, js.SpatialInertia(np.float32(1 + rng.random()), com.astype(np.float32), central.astype(np.float32))
    )


def pose(rng, is_planar=False):
    p, q = rng.standard_normal(3).astype(np.float32), rng.standard_normal(4).astype(np.float32)
    if is_planar:
        return js.RigidTransform(js.Rotation.identity(dtype=np.float32), p * np.float32([1, 0, 0]))
    return js.RigidTransform(js.Rotation.from_quaternion(q / np.linalg.norm(q)), p)


def arm(is_planar=False, is_point=False, gravity=(0.0, -9.81, 0.0), n=N):
    """Its links hang on each other, each by a revolute joint; planar: about z, that all of it is normal to."""
    rng = np.random.default_rng(0)
    names = ["world", *(f"link{i}" for i in range(n))]
    bodies = [body(rng, name, is_planar, is_point) for name in names[1:]]
    joints = [
        js.Joint(
            f"joint{i}",
            "revolute",
            names[i],
            names[i + 1],
            placement=pose(rng, is_planar),
            axis=(0, 0, 1) if is_planar else rng.standard_normal(3),
        )
        for i in range(n)
    ]
    return js.Mechanism.build(bodies, joints, gravity=gravity)


@pytest.fixture(params=[asked_for, done], ids=["on arrays", "on numbers"])
def count(request):
    return request.param


@pytest.fixture
def counted(count):
    return functools.partial(_of_scene, count)


def _of_scene(count, mech, name, **more):
    """Equal mechanisms are counted once."""
    return _counted(count, mech, name, **more) if more else _counted_once(count, mech.as_static(), name)


@functools.cache
def _counted_once(count, static, name):
    return _counted(count, static._as_known(), name)


def _counted(count, mech, name, **more):
    function, n = ALGORITHMS[name]
    state = tuple(x[: mech.nv] for x in STATE[:n])
    return count(functools.partial(function, mech, precision="fast", **more), *state)


@most_algorithms
def test_a_planar_arm(name, counted, count):
    general, planar = (counted(arm(is_planar=is_planar), name) for is_planar in (False, True))
    print(f"{name}: {general['multiply']} -> {planar['multiply']} multiplications, {flops(general)} -> {flops(planar)}")
    # Both have the sines and cosines of 6 angles: one each of arrays, six of numbers.
    most = 0.35 if count is asked_for else 0.4
    assert planar["multiply"] <= most * general["multiply"]
    assert flops(planar) <= most * flops(general)
    if name == "forward dynamics" and count is asked_for:  # as the pages say
        assert (planar["multiply"], general["multiply"]) == (112, 705)


def test_quarter_turns_written_with_few_digits(counted):
    """In float32 they cost what quarter turns cost; in float64 they are what the file says."""
    counts = []
    for cosine in (4.9e-12, 0.0):
        mech = arm(n=3)
        turn = np.array([1, 0, 0, 0, cosine, -1, 0, 1, cosine], mech.dtype)
        placements = js.RigidTransform(js.Rotation(np.tile(turn, (3, 1))), mech.placements.translation)
        counts.append(counted(mech.replace(placements=placements), "inverse dynamics"))
    assert counts[0] == counts[1]


def test_without_gravity(counted):
    weightless = arm(gravity=(0.0, 0.0, 0.0))
    assert not counted(weightless, "gravity forces")
    assert not counted(arm(is_planar=True, gravity=(0.0, 0.0, -9.81)), "gravity forces")  # all of it in the axes
    for name in ("inverse dynamics", "forward dynamics", "bias forces"):
        assert counted(weightless, name)["multiply"] < counted(arm(), name)["multiply"]


def test_at_rest_is_less_than_in_motion(counted):
    """Gravity forces are inverse dynamics at rest, bias forces those without acceleration."""
    counts = [counted(arm(), name)["multiply"] for name in ("gravity forces", "bias forces", "inverse dynamics")]
    assert counts[0] < 0.7 * counts[1] < counts[1] < counts[2]


@algorithms
def test_without_external_forces(name, counted):
    if name in ("inverse dynamics", "forward dynamics", "bias forces"):
        assert counted(arm(), name, external_forces={}) == counted(arm(), name)
        load = {"link2": js.SpatialForce(np.ones(3, np.float32), np.ones(3, np.float32))}
        assert counted(arm(), name, external_forces=load)["multiply"] > counted(arm(), name)["multiply"]


@most_algorithms
def test_welded_bodies(name, counted):
    """A body welded to another costs nothing: what is left is an arm with one joint less."""
    rng = np.random.default_rng(0)
    bodies = [body(rng, f"link{i}") for i in range(3)]
    held = [("world", "link0", "revolute"), ("link0", "link1", "fixed"), ("link1", "link2", "revolute")]
    axes, poses = rng.standard_normal((3, 3)), [pose(rng) for _ in held]
    joints = [
        js.Joint(child, kind, parent, child, placement=X, axis=axis)
        for (parent, child, kind), X, axis in zip(held, poses, axes, strict=True)
    ]
    assert counted(js.Mechanism.build(bodies, joints), name) == counted(arm(n=2, gravity=(0.0, 0.0, -9.81)), name)


@most_algorithms
def test_locked_joints(name, counted):
    """The operations of the scene built without them."""
    locked = js.lock_joints(arm(), {f"joint{i}": 0.3 for i in (2, 3, 4, 5)})
    assert counted(locked, name) == counted(arm(n=2), name)
    if name == "gravity forces":
        forces = lambda mech, q: interpreted(functools.partial(js.gravity_forces, mech))(q)  # noqa: E731
        neutral = forces(js.lock_joints(arm(), {"joint5": 0.0}), STATE[0][:5])
        np.testing.assert_allclose(neutral, forces(arm(), STATE[0].at[5].set(0.0))[:5], rtol=1e-5)


@most_algorithms
def test_point_masses(name, counted):
    """Articulated bodies have inertias about their joints, in which a moment of inertia costs nothing to begin with;
    composite ones are no points, and have additions less."""
    point, general = (counted(arm(is_point=x), name) for x in (True, False))
    point, general = (flops(x) if name == "mass matrix" else x["multiply"] for x in (point, general))
    assert point == general if name in ("gravity forces", "forward dynamics") else point < general


@most_algorithms
def test_numbers_passed_as_arguments_stay_general(name, counted, count):
    """And cost at most a third more than known ones of which nothing is special."""
    function, n = ALGORITHMS[name]
    general = count(lambda mech, *x: function(mech, *x, precision="fast"), arm().as_data(), *STATE[:n])
    assert counted(arm(), name)["multiply"] <= general["multiply"] <= 4 / 3 * counted(arm(), name)["multiply"]


def hand(n_fingers):
    """An arm of two links, on whose end hang fingers of three; the first finger is always the same."""
    rng = np.random.default_rng(0)
    names, parents = ["arm0", "arm1"], ["world", "arm0"]
    for i in range(n_fingers):
        finger = [f"finger{i}_{k}" for k in range(3)]
        names, parents = [*names, *finger], [*parents, "arm1", *finger[:2]]
    joints = [
        js.Joint(name, "revolute", parent, name, placement=pose(rng), axis=rng.standard_normal(3))
        for name, parent in zip(names, parents, strict=True)
    ]
    return js.Mechanism.build([body(rng, name) for name in names], joints)


OF_FRAMES = {
    "pose": lambda mech, q, v, frame: js.forward_kinematics(mech, q, frame, precision="fast").translation,
    "velocity": lambda mech, q, v, frame: js.body_velocities(mech, q, v, frame, precision="fast").v,
    "acceleration": lambda mech, q, v, frame: js.body_accelerations(mech, q, v, v, frame, precision="fast").a,
    "Jacobian": lambda mech, q, v, frame: js.jacobian(mech, q, frame, precision="fast"),
    "rate of the Jacobian": lambda mech, q, v, frame: js.jacobian_rate(mech, q, v, frame, precision="fast"),
}


@pytest.mark.parametrize("frame", ["finger0_2", slow("arm1"), "world"])
@pytest.mark.parametrize("name", OF_FRAMES)
def test_bodies_that_do_not_carry_a_frame_are_not_computed(name, frame, count):
    """One finger of four costs what it costs alone; columns of the others are zero."""
    alone, four = hand(1), hand(4)
    q = jnp.asarray(np.random.default_rng(1).standard_normal(four.nv).astype(np.float32))
    function = OF_FRAMES[name]
    costs = [count(lambda q, v, m=m: function(m, q, v, frame), q[: m.nv], q[: m.nv]) for m in (alone, four)]
    assert costs[0] == costs[1]
    of = lambda mech, q: interpreted(lambda q: function(mech, q, q, frame))(q)  # noqa: E731
    ours, expected = of(four, q), of(alone, q[: alone.nv])
    np.testing.assert_array_equal(ours[..., : expected.shape[-1]], expected)
    np.testing.assert_array_equal(ours[..., expected.shape[-1] :], 0)

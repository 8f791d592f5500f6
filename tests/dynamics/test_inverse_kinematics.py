"""Inverse kinematics against forward kinematics in NumPy: what is solved is at its target, what is not is told."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.soon import compiled_soon

RIGHT = np.pi / 2
# (position of the joint, m, its turn about x, rad; limits, rad) of an arm of seven joints, like a Panda.
LINKS = [
    ((0, 0, 0.333), 0.0, 2.9),
    ((0, 0, 0), -RIGHT, 1.8),
    ((0, -0.316, 0), RIGHT, 2.9),
    ((0.0825, 0, 0), RIGHT, 3.0),
    ((-0.0825, 0.384, 0), -RIGHT, 2.9),
    ((0, 0, 0), RIGHT, 3.0),
    ((0.088, 0, 0), RIGHT, 2.9),
]
KEY = jax.random.key(3)


@pytest.fixture(autouse=True)
def _soon():
    with compiled_soon(), js.default_precision("fast"):
        yield


def pose(p, angle=0.0, scale=1.0):
    return js.RigidTransform(js.Rotation.about_x(np.float32(angle)), np.float32(scale) * np.float32(p))


def arm(scale=1.0, n=7):
    names = ["world", *(f"link{i}" for i in range(n))]
    joints = [
        js.Joint(f"joint{i}", "revolute", names[i], names[i + 1], pose(p, turn, scale), lower=-limit, upper=limit)
        for i, (p, turn, limit) in enumerate(LINKS[:n])
    ]
    bodies = [js.Body(name, js.SpatialInertia.solid_sphere(0.1, mass=1.0)) for name in names[1:]]
    return js.Mechanism.build(bodies, joints, [js.Frame("hand", names[-1], pose((0, 0, 0.21), 0.0, scale))])


def in_numpy(q):
    """The rotations and positions of the hand, in float64."""
    R, p = np.eye(3), np.zeros(3)
    for (place, turn, _), angle in zip(LINKS, np.asarray(q, float), strict=True):
        p = p + R @ place
        c, s = np.cos(turn), np.sin(turn)
        R = R @ [[1, 0, 0], [0, c, -s], [0, s, c]]
        c, s = np.cos(angle), np.sin(angle)
        R = R @ [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    return R, p + R @ [0, 0, 0.21]


@functools.cache
def solved(n=40):
    """(the arm, targets, starts, what was found): the last ten targets are 1.7 m further away."""
    mech = arm()
    reachable, start = (js.random_configuration(mech, jax.random.key(k), n) for k in (0, 1))
    X_WT = js.forward_kinematics(mech, reachable, "hand")
    p = np.array(X_WT.translation)
    p[-10:] *= 1 + 1.7 / np.linalg.norm(p[-10:], axis=-1, keepdims=True)
    X_WT = X_WT._with_vectors((X_WT.rotation.entries, p))
    find = jax.jit(lambda q, X: js.inverse_kinematics(mech, q, "hand", X, key=KEY, starts=25))
    return mech, X_WT, start, jax.tree.map(np.asarray, find(start, X_WT))


def errors_in_numpy(q, X_WT):
    """(angles, distances) from the hand to its targets, and the way there in the axes of the hand."""
    found = []
    for q_k, R_T, p_T in zip(q, np.asarray(X_WT.rotation.to_matrix()), np.asarray(X_WT.translation), strict=True):
        R, p = in_numpy(q_k)
        sine = np.linalg.norm(R - R_T) / np.sqrt(8)
        found.append((2 * np.arcsin(np.minimum(sine, 1.0)), np.linalg.norm(p_T - p)))
    return np.transpose(found)


def test_what_can_be_reached_is_reached_within_the_limits():
    mech, X_WT, _, found = solved()
    assert found.is_solved[:-10].all() and found.iterations[:-10].max() < 500
    assert (found.q >= mech.lower).all() and (found.q <= mech.upper).all()
    angles, distances = errors_in_numpy(found.q, X_WT)
    assert angles[:-10].max() < 1.02e-4 and distances[:-10].max() < 1.02e-4


def test_what_cannot_be_reached_is_told():
    """With an error that is that of the q that is returned."""
    _, X_WT, _, found = solved()
    assert not found.is_solved[-10:].any() and (found.iterations[-10:] == 500).all()
    angles, distances = errors_in_numpy(found.q, X_WT)
    assert distances[-10:].min() > 0.5
    np.testing.assert_allclose(np.linalg.norm(found.error.w, axis=-1), angles, rtol=0, atol=3e-6)
    # The linear part of a logarithm is the distance along a screw: longer, by at most pi / 2.
    v = np.linalg.norm(found.error.v, axis=-1)
    assert (v > distances - 1e-5).all() and (v < np.pi / 2 * distances + 1e-5).all()


def test_a_solution_is_left_as_it_is():
    """In no step, and with all bits; from beyond a limit the start is at the limit."""
    mech, X_WT, _, found = solved()
    once = jax.jit(lambda q, X: js.inverse_kinematics(mech, q, "hand", X))
    again = once(found.q[:5], X_WT.at_batch(slice(0, 5)))
    assert again.is_solved.all() and (again.iterations == 0).all() and (again.q == found.q[:5]).all()
    beyond = once(jnp.full((5, 7), 10.0), X_WT.at_batch(slice(0, 5)))
    beyond = jax.tree.map(np.asarray, beyond)
    assert (beyond.q <= mech.upper).all() and (beyond.q >= mech.lower).all()
    lost = once(found.q[:5], jax.tree.map(lambda x: x * np.float32(np.nan), X_WT.at_batch(slice(0, 5))))
    assert not lost.is_solved.any() and jnp.isfinite(lost.q).all() and jnp.isnan(lost.error.v).all()


def test_each_state_of_a_batch_ends_by_itself():
    """With the bits of a call of its own; and what is solved stays as it is while others begin anew."""
    mech, X_WT, start, _ = solved()
    find = jax.jit(
        lambda q, X, starts: js.inverse_kinematics(mech, q, "hand", X, key=KEY, starts=starts), static_argnums=2
    )
    once, more = (jax.tree.map(np.asarray, find(start, X_WT, starts)) for starts in (1, 3))
    is_solved = once.is_solved
    assert 5 < is_solved.sum() < more.is_solved.sum() and len(np.unique(once.iterations)) > 5
    for k in (0, 7, 20, 39):
        alone = find(start[k], X_WT.at_batch(k), 1)
        assert (alone.q == once.q[k]).all() and alone.iterations == once.iterations[k]
    assert (more.q[is_solved] == once.q[is_solved]).all()
    assert (more.iterations[is_solved] == once.iterations[is_solved]).all() and (more.iterations[~is_solved] > 20).all()


def test_starts_are_split_over_a_mesh_and_targets_are_not():
    """Explicit axes, and no mesh in the context."""
    mesh = jax.make_mesh((1,), ("batch",), axis_types=(jax.sharding.AxisType.Explicit,))
    split, whole = (jax.NamedSharding(mesh, spec) for spec in (jax.P("batch"), jax.P()))
    q, p = jax.device_put(np.zeros((2, 2), np.float32), split), jax.device_put(np.ones((2, 3), np.float32), whole)
    find = functools.partial(js.inverse_kinematics, arm(n=2))
    found = jax.eval_shape(lambda q, p: find(q, "hand", p).q, q, p)
    assert found.shape == (2, 2) and found.sharding.spec[0] == "batch"


def test_each_key_has_starts_of_its_own():
    """Mapped over keys, with one start and target for all: after one step from each, where the best is depends on where
    its key began. The same key finds the same."""
    mech, q = arm(n=5), jnp.zeros(5, np.float32)
    keys = jnp.stack([KEY, jax.random.key(4), KEY])

    def find(key):
        return js.inverse_kinematics(mech, q, "hand", jnp.array([0.3, 0.3, 0.5]), key=key, starts=8, iterations=1)

    found = jax.tree.map(np.asarray, jax.jit(jax.vmap(find))(keys))
    assert abs(found.q[0] - found.q[1]).max() > 0.1 and (found.q[0] == found.q[2]).all()
    assert (found.iterations == 8).all() and not found.is_solved.any()


@pytest.mark.slow
def test_the_size_of_a_robot_does_not_matter():
    """Scaled by a power of two, with its targets and the tolerance, it takes the same steps."""
    _, X_WT, start, _ = solved()
    X_WT, start = X_WT.at_batch(slice(0, 10)), start[:10]
    found = []
    for scale in (1.0, 1024.0):
        mech, X = arm(scale), X_WT._with_vectors((X_WT.rotation.entries, np.float32(scale) * X_WT.translation))
        found.append(js.inverse_kinematics(mech, start, "hand", X, distance=1e-4 * scale))
    assert (found[0].iterations == found[1].iterations).all() and 0 < found[0].is_solved.sum() < 10
    np.testing.assert_allclose(found[0].q, found[1].q, rtol=0, atol=1e-4)


def biped():
    """A free base with two arms of three hinges and a slide each: 14 velocities, 15 coordinates."""
    bodies, joints = [js.Body("base", js.SpatialInertia.solid_sphere(0.2, mass=5.0))], []
    joints.append(js.Joint("root", "free", "world", "base"))
    for side, y in (("left", 0.2), ("right", -0.2)):
        parent = "base"
        for k, axis in enumerate([(1, 0, 0), (0, 1, 0), (0, 0, 1)]):
            name = f"{side}{k}"
            bodies.append(js.Body(name, js.SpatialInertia.solid_sphere(0.1, mass=1.0)))
            at = pose((0, y, 0)) if k == 0 else pose((0.1, 0, -0.3))
            joints.append(js.Joint(name, "revolute", parent, name, at, axis=axis, lower=-2.0, upper=2.0))
            parent = name
        bodies.append(js.Body(f"{side}foot", js.SpatialInertia.solid_sphere(0.1, mass=1.0)))
        joints.append(js.Joint(f"{side}slide", "prismatic", parent, f"{side}foot", lower=-0.1, upper=0.3))
    return js.Mechanism.build(bodies, joints)


@pytest.mark.slow
def test_a_robot_that_floats_puts_several_frames_at_several_positions():
    mech, frames = biped(), ["leftfoot", "rightfoot", "base"]
    reachable = js.random_configuration(mech, jax.random.key(0), 4)
    targets = np.asarray(js.forward_kinematics(mech, reachable, frames).translation)
    find = jax.jit(lambda p: js.inverse_kinematics(mech, mech.neutral(), frames, p, key=KEY, starts=5))
    found = find(targets)
    found = jax.tree.map(np.asarray, found)
    assert found.is_solved.all() and found.q.shape == (4, 15) and found.error.batch_shape == (4, 3)
    X_WF = js.forward_kinematics(mech, found.q, frames)
    assert np.linalg.norm(X_WF.translation - targets, axis=-1).max() < 1.01e-4
    np.testing.assert_allclose(np.linalg.norm(found.q[:, :4], axis=-1), 1, atol=1e-6)
    assert (found.q[:, 7:] >= mech.lower[7:]).all() and (found.q[:, 7:] <= mech.upper[7:]).all()


def test_derivatives_follow_targets_and_lengths():
    """J dq/dp moves the hand with its target, and takes back what a longer link adds; forward and backward."""
    mech, q = arm(n=5), jnp.array([0.3, -0.5, 0.2, -1.5, 0.4])
    at, p_WT = mech.placements, js.forward_kinematics(mech, q, "hand").translation

    def longer(length):
        """The arm with another distance from joint 3 to joint 4."""
        return mech.replace(
            placements=at._with_vectors((at.rotation.entries, jnp.asarray(at.translation).at[3, 0].add(length)))
        )

    def configuration(p, length):
        return js.inverse_kinematics(longer(length), q, "hand", p_WT + p).q

    def hand(length):
        return js.forward_kinematics(longer(length), q, "hand").translation

    zero, weights = (jnp.zeros(3), jnp.zeros(())), jnp.arange(5.0)

    @jax.jit
    def slopes(*x):
        forward = jax.jacfwd(configuration, (0, 1))(*x)
        return forward, jax.grad(lambda *x: weights @ configuration(*x), (0, 1))(*x), jax.jacfwd(hand)(x[1])

    (by_p, by_length), backward, of_hand = jax.tree.map(np.asarray, slopes(*zero))
    J = np.asarray(js.jacobian(mech, q, "hand"))[3:]
    np.testing.assert_allclose(J @ by_p, np.eye(3), rtol=0, atol=1e-3)
    assert np.linalg.norm(of_hand) > 0.9
    np.testing.assert_allclose(J @ by_length, -of_hand, rtol=0, atol=1e-3)
    np.testing.assert_allclose(backward[0], np.arange(5) @ by_p, rtol=0, atol=1e-4)
    np.testing.assert_allclose(backward[1], np.arange(5) @ by_length, rtol=0, atol=1e-4)


def test_wrong_arguments_are_told():
    mech, X_WT, start, _ = solved()
    call = js.inverse_kinematics
    for error, message, arguments, named in (
        (ValueError, "starts: expected an integer >= 1, got 0", (start, "hand", X_WT), {"starts": 0}),
        (ValueError, "iterations: expected an integer >= 1, got 2.5", (start, "hand", X_WT), {"iterations": 2.5}),
        (ValueError, "angle: expected a number above 0, known while", (start, "hand", X_WT), {"angle": 0.0}),
        (ValueError, "key: expected one of jax.random for 3 starts", (start, "hand", X_WT), {"starts": 3}),
        (ValueError, "targets: expected a batch", (start, ["hand", "link1"], X_WT), {}),
        (TypeError, "dtype", (start, "hand", jnp.zeros(3, np.float16)), {}),
        (KeyError, "nobody", (start, "nobody", X_WT), {}),
    ):
        with pytest.raises(error, match=message):
            call(mech, *arguments, **named)
    body = js.Body("rock", js.SpatialInertia.solid_sphere(np.float32(1), mass=np.float32(1)))
    rock = js.Mechanism.build([body], [js.Joint("weld", "fixed", "world", "rock")], dtype=np.float32)
    with pytest.raises(ValueError, match="joints that move, got nv = 0"):
        call(rock, jnp.zeros(0, np.float32), "rock", X_WT)

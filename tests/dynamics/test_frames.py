"""Where frames are and how they move: of one by its name, of several, of all bodies."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.counting import asked_for, done, flops
from tests.helpers.interpreted import interpreted

OF_FRAMES = {
    "forward_kinematics": lambda mech, q, v, a, frames: js.forward_kinematics(mech, q, frames),
    "body_velocities": lambda mech, q, v, a, frames: js.body_velocities(mech, q, v, frames),
    "body_accelerations": lambda mech, q, v, a, frames: js.body_accelerations(mech, q, v, a, frames),
    "jacobian": lambda mech, q, v, a, frames: js.jacobian(mech, q, frames),
    "jacobian_rate": lambda mech, q, v, a, frames: js.jacobian_rate(mech, q, v, frames),
}
of_frames = pytest.mark.parametrize("name", OF_FRAMES)
SEVERAL = "tip", "world", "upper"


@functools.cache
def arm():
    """A body that turns, one that slides on it, and a frame out of its way."""
    rod = js.SpatialInertia.thin_rod(1.0, (0.0, 0.0, 1.0), mass=2.0)
    out = js.RigidTransform(js.Rotation.about_x(np.float32(0.4)), np.float32([0.1, 0.2, -0.7]))
    joints = [
        js.Joint("shoulder", "revolute", "world", "upper", axis=(0, 0.6, 0.8)),
        js.Joint("elbow", "prismatic", "upper", "lower", axis=(1, 0, 0), placement=out),
    ]
    return js.Mechanism.build([js.Body("upper", rod), js.Body("lower", rod)], joints, [js.Frame("tip", "lower", out)])


def state(*batch):
    return tuple(jnp.asarray(np.random.default_rng(0).standard_normal((3, *batch, 2)), np.float32))


def leaves(x):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(x)]


@of_frames
def test_one_name_adds_no_axis_and_several_add_one(name):
    """The same bits, however many there are; batches by leading axes and by vmap; of one algorithm compiled, too."""
    of, batch = functools.partial(OF_FRAMES[name], arm()), state(3)
    run = jax.jit if name == "jacobian" else interpreted
    several = run(functools.partial(of, frames=SEVERAL))(*batch)
    for k, frame in enumerate(SEVERAL[:2]):
        one = functools.partial(of, frames=frame)
        for x, y, whole in zip(*map(leaves, (run(one)(*batch), run(jax.vmap(one))(*batch), several)), strict=True):
            assert whole.shape[:2] == (3, 3) and whole.dtype == np.float32
            np.testing.assert_array_equal(x, whole[:, k])
            np.testing.assert_array_equal(x, y)
    for x, y in zip(*(leaves(run(functools.partial(of, frames=f))(*state())) for f in ("tip", ["tip"])), strict=True):
        np.testing.assert_array_equal(x[None], y)


def test_without_names_it_is_all_bodies():
    mech, x = arm(), state()
    for name in ("forward_kinematics", "body_velocities", "body_accelerations"):
        of = [interpreted(functools.partial(OF_FRAMES[name], mech, frames=f)) for f in (None, mech.body_names)]
        for found, expected in zip(*(leaves(f(*x)) for f in of), strict=True):
            np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", ["forward_kinematics", "jacobian"])
def test_gradients_of_one_are_those_among_several(name):
    def of_entries(q, frames, pick):
        found = jax.tree.leaves(OF_FRAMES[name](arm(), q, v, a, frames))[-1]
        return jnp.sum(jnp.sin(found if pick is None else found[pick]))

    q, v, a = state()
    of = ((SEVERAL, 0), ("tip", None))
    one, other = (interpreted(jax.grad(functools.partial(of_entries, frames=f, pick=k)))(q) for f, k in of)
    np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)
    assert np.any(np.asarray(one) != 0)


@pytest.mark.parametrize("count", [asked_for, done], ids=["on arrays", "on numbers"])
@pytest.mark.parametrize("name", ["jacobian", "jacobian_rate"])
def test_one_recursion_for_several(name, count):
    """Poses and velocities are found once: a frame more asks for its own columns alone."""
    mech = js.testing.random_mechanism(1, 6, ["ball"])
    x = jnp.asarray(mech.neutral()), jnp.ones(mech.nv), jnp.ones(mech.nv)
    of, last = functools.partial(OF_FRAMES[name], mech), mech.body_names[-2:]
    one, both = (flops(count(functools.partial(of, frames=frames), *x)) for frames in (last[0], last))
    poses = flops(count(lambda q: js.forward_kinematics(mech, q, last[0]), x[0]))
    assert both <= 2 * one - poses / 2


ERRORS = {
    "unknown": ("nobody", KeyError, "frames: .*'nobody'"),
    "one unknown": (["tip", "nobody"], KeyError, "frames: .*'nobody'"),
    "number": (3, TypeError, "frames: expected the name of a frame, or a sequence of names, got 3"),
    "none": ([], ValueError, "frames: expected at least one name, got none"),
}


@pytest.mark.parametrize(("frames", "error", "message"), ERRORS.values(), ids=ERRORS)
@of_frames
def test_what_is_no_name_is_refused(name, frames, error, message):
    with pytest.raises(error, match=f"{name}: {message}"):
        OF_FRAMES[name](arm(), *state(), frames)


@pytest.mark.parametrize("name", ["jacobian", "jacobian_rate"])
def test_a_jacobian_is_of_something(name):
    with pytest.raises(TypeError, match=f"{name}: frames: expected the name of a frame, .* got None"):
        OF_FRAMES[name](arm(), *state(), None)

"""Gradients through many steps: against differences, and finite wherever a rollout begins."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import contact_scenes as scenes


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def through(step, q, v, n):
    """The gradient, and the difference, of the squared speed after n steps of 1 ms along a random direction."""
    rng = np.random.default_rng(1)
    along = rng.standard_normal((2, len(v)))

    def last(h):
        state = q[: len(v)] + h * along[0], v + h * along[1]
        q_n, v_n = jax.lax.scan(lambda x, _: (step(*x), None), state, None, n)[0]
        return (v_n**2).sum() + q_n.sum()

    compiled, h = jax.jit(last), 1e-6
    ahead, behind, farther, back = (float(compiled(s * h)) for s in (1, -1, 2, -2))
    return float(jax.jit(jax.grad(last))(0.0)), (8 * (ahead - behind) - (farther - back)) / (12 * h)


def test_five_hundred_steps_without_contact():
    rng = np.random.default_rng(2)
    mech = js.testing.random_mechanism(3, 2, ["revolute", "prismatic"], is_chain=True, dtype=np.float64)
    q, v, tau = rng.standard_normal((3, mech.nv))
    found, difference = through(lambda q, v: js.semi_implicit_step(mech, q, v, tau, 1e-3), q, v, 500)
    np.testing.assert_allclose(found, difference, rtol=1e-6)


@pytest.mark.slow
def test_two_hundred_steps_with_contact():
    """An arm that falls onto the ground, and against its limits."""
    scene = scenes.arm()
    mech, contacts = scene.mechanism, scene.contacts
    q, v, tau = (np.array(x) for x in scenes.states(scene, 1, 0)[0])

    def step(q, v):
        return js.convex_step(mech, q, v, tau, 1e-3, contacts=contacts)[:2]

    found, difference = through(step, q, v, 200)
    np.testing.assert_allclose(found, difference, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "arm"])
def test_ten_thousand_starts(name):
    """Random ones, at rest, and with all joints at zero, where the arm is stretched."""
    scene, n = {"box": scenes.box, "arm": scenes.arm}[name](), 10_000
    mech, contacts = scene.mechanism, scene.contacts
    q, v, tau = (np.array(x) for x in zip(*scenes.states(scene, n, 3), strict=True))
    v[: n // 10], tau[: n // 10] = 0, 0
    q[: n // 100] = mech.neutral()

    def last(q, v, tau):
        def step(state, _):
            return js.convex_step(mech, *state, tau, 5e-3, contacts=contacts)[:2], None

        q_n, v_n = jax.lax.scan(step, (q, v), None, 20)[0]
        return (v_n**2).sum() + q_n.sum()

    found = jax.jit(jax.vmap(jax.grad(last, (0, 1, 2))))(*map(jnp.asarray, (q, v, tau)))
    assert all(np.isfinite(x).all() for x in found)

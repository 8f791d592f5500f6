"""Shapes and height fields under a step: the same as functions of one's own, learned, batched, and of 16 bits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

LAW = {"stiffness": np.float64(1e4), "relaxation_time": np.float64(0.02)}
# Two bodies of one joint each would do; a free body with points about it tips, too.
CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])


def brick():
    M = js.SpatialInertia.solid_box(np.array([0.4, 0.2, 0.2]), mass=np.float64(2))
    return js.Mechanism.build([js.Body("brick", M)], [js.Joint("root", "free", "world", "brick")])


def touching(friction=0.6):
    return js.PointContacts(["brick"] * 8, CORNERS, np.float64(0.0), **LAW, friction=friction)


def states(n=4):
    rng = np.random.default_rng(0)
    q = np.tile([1.0, 0, 0, 0, 0, 0, 0], (n, 1))
    q[:, 1:4], q[:, 4:6], q[:, 6] = 0.1 * rng.normal(size=(n, 3)), rng.normal(size=(n, 2)) / 3, rng.uniform(0, 0.1, n)
    return q, 0.5 * rng.normal(size=(n, 6))


def step(q, v, ground, contacts=None):
    after = js.convex_step(brick(), q, v, np.zeros(6), 5e-3, contacts=contacts or touching(), ground=ground)
    return after.v, after.contact_forces.f


HEIGHTS = 0.03 * np.random.default_rng(1).normal(size=(6, 7))
SIZE = np.array([4.0, 5.0])


def bilinear(heights):
    """The height field as one writes it oneself."""

    def ground(p):
        u = (p[:2] / SIZE + 0.5) * (np.array(heights.shape) - 1.0)
        k = jnp.clip(jnp.floor(u), 0, np.array(heights.shape) - 2.0)
        (i, j), (t, s) = k.astype(int), u - k
        h = heights[i, j] * (1 - t) * (1 - s) + heights[i + 1, j] * t * (1 - s)
        return p[2] - (h + heights[i, j + 1] * (1 - t) * s + heights[i + 1, j + 1] * t * s)

    return ground


def box_function(p):
    """The distance from the box below, inside it and above."""
    return jnp.maximum(jnp.maximum(abs(p[0]) - 2, abs(p[1]) - 2), abs(p[2] + 0.5) - 0.5)


@pytest.mark.parametrize("name", ["field", "box"])
def test_a_shape_is_the_function_that_one_writes(name):
    with jax.enable_x64(True):
        X = js.RigidTransform(js.Rotation.identity((), np.float64), np.array([0, 0, -0.5]))
        shape, function = {
            "field": (js.HeightField(HEIGHTS, SIZE), bilinear(jnp.asarray(HEIGHTS))),
            "box": (js.Box(np.array([4.0, 4.0, 1.0]), X), box_function),
        }[name]
        found, expected = (
            interpreted(jax.vmap(lambda q, v, ground=ground: step(q, v, ground)))(*states())
            for ground in (shape, function)
        )
        assert (found[1][..., 2] > 1).any(-1).all()
        for own, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(own, other, rtol=0, atol=1e-9 * abs(other).max())
        explicit = [
            interpreted(
                jax.vmap(lambda q, v, g=g: js.contact_forces(brick(), q, v, touching(), g, dissipation=0.1).wrenches.f)
            )(*states())
            for g in (shape, function)
        ]
        np.testing.assert_allclose(*explicit, rtol=0, atol=1e-9 * abs(explicit[0]).max())


def test_derivatives_by_heights_and_friction():
    """Through the step, against differences; and each environment has heights of its own."""
    with jax.enable_x64(True):
        q, v = states()
        rng = np.random.default_rng(3)
        along, h = rng.normal(size=(4, *HEIGHTS.shape)) * 1e-2, 1e-4

        def of(s, along, q, v):
            return step(q, v, js.HeightField(HEIGHTS + s * along, SIZE), touching(0.6 + s))

        def slope(along, q, v):
            return jax.jvp(lambda s: of(s, along, q, v), (0.0,), (1.0,))[1]

        found = interpreted(jax.vmap(slope))(along, q, v)
        ahead, behind = (interpreted(jax.vmap(lambda a, q, v, s=s: of(s, a, q, v)))(along, q, v) for s in (h, -h))
        for own, a, b in zip(found, ahead, behind, strict=True):
            assert abs(own).max() > 1e-2
            np.testing.assert_allclose(own, (a - b) / (2 * h), rtol=0, atol=1e-4 * abs(own).max())


def test_sixteen_bits_and_other_dtypes():
    with jax.enable_x64(True):
        expected = interpreted(step)(*(x[0] for x in states()), js.HeightField(HEIGHTS, SIZE))
        mech = brick().astype(np.float16)
    q, v = (x[0].astype(np.float16) for x in states())
    field, contacts = js.HeightField(HEIGHTS, SIZE).astype(np.float16), touching().astype(np.float16)
    nothing, dt = np.zeros(6, np.float16), np.float16(5e-3)
    v_after = interpreted(lambda q, v: js.convex_step(mech, q, v, nothing, dt, contacts=contacts, ground=field).v)(q, v)
    assert v_after.dtype == np.float16
    np.testing.assert_allclose(v_after, expected[0], rtol=0, atol=0.05)
    with pytest.raises(TypeError, match="q and ground: expected one dtype"):
        js.convex_step(mech, q, v, nothing, dt, contacts=contacts, ground=field.astype(np.float32))

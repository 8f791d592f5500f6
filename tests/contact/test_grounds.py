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


RUN, RISE, MASS, K = 0.5, 0.2, 8.0, 2e4  # m, m, kg, N/m


def strutter():
    """A trunk on four struts, which stand 0.3 m before and behind its centre; their damping is that of the joints."""
    trunk = js.SpatialInertia.solid_box(np.array([0.6, 0.3, 0.1]), mass=np.float64(MASS - 1))
    foot = js.SpatialInertia.solid_sphere(np.float64(0.02), mass=np.float64(0.25))
    bodies, joints = [js.Body("trunk", trunk)], [js.Joint("root", "free", "world", "trunk")]
    for i, (x, y) in enumerate([(0.3, 0.15), (0.3, -0.15), (-0.3, 0.15), (-0.3, -0.15)]):
        X = js.RigidTransform(js.Rotation.identity((), np.float64), np.array([x, y, 0.0]))
        bodies.append(js.Body(f"foot {i}", foot))
        joints.append(js.Joint(f"strut {i}", "prismatic", "trunk", f"foot {i}", X, axis=(0, 0, -1), damping=100.0))
    return js.Mechanism.build(bodies, joints)


def test_a_robot_astride_a_riser_comes_to_rest_on_two_treads():
    """Its feet are f / k deep in the treads, and carry its weight. Of a state that turns by more than 1 / u rad in a
    step there is none, as `convex_step` says; its neighbour in the batch does not mind."""
    with jax.enable_x64(True):
        mech, stairs = strutter(), js.Stairs(2, np.float64(RUN), np.float64(RISE))
        law = {"stiffness": np.float64(K), "relaxation_time": np.float64(0.02), "friction": np.float64(0.8)}
        feet = js.PointContacts([f"foot {i}" for i in range(4)], None, np.float64(0.02), **law)
        hold = 0.3 + np.array([-RISE, -RISE, RISE, RISE]) / 2  # the front struts are shorter

        @jax.jit
        @jax.vmap
        def settled(q, v):
            def one(state, _):
                tau = jnp.append(jnp.zeros(6), 2e3 * (hold - state[0][7:]))
                after = js.convex_step(mech, *state, tau, 1e-2, contacts=feet, ground=stairs)
                return (after.q, after.v), after.contact_forces.f

            (q, v), f = jax.lax.scan(one, (q, v), length=200)
            return q, v, f[-1], js.forward_kinematics(mech, q, feet.frames).translation

        q = np.array([1, 0, 0, 0, RUN, 0, 0.35 + 1.5 * RISE, *hold])
        v = np.zeros((2, mech.nv))
        v[1, 0] = 1e18 / 1e-2
        q, v, f, p = map(np.asarray, settled(np.stack([q, q]), v))
        assert np.isnan(q[1, :7]).any()
        q, v, f, p = q[0], v[0], f[0], p[0]
        assert abs(v).max() < 1e-4 and abs(q[1:4]).max() < 1e-3
        np.testing.assert_allclose(f.sum(0), [0, 0, 9.81 * MASS], rtol=0, atol=1e-4 * 9.81 * MASS)
        treads = RISE * np.array([2, 2, 1, 1])
        np.testing.assert_allclose(p[:, 2], treads + 0.02 - f[:, 2] / K, rtol=0, atol=1e-6)
        assert f[:, 2].min() > 0.2 * 9.81 * MASS  # each carries about a quarter

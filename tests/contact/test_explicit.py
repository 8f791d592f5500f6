"""The explicit law of contact: against its formula in NumPy, in every transformation, its derivatives and messages."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but

FRAMES = ("body0", "body2", "body2", "tool0", "world")
STIFFNESS, FRICTION, DISSIPATION, STICTION = np.array([1e3, 2e3, 5e2, 1e3, 1e3]), 0.7, 0.4, 0.3
NORMAL, OFFSET = np.array([0.2, -0.3, 1.5]), -0.1


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@functools.cache
def mechanism():
    mech = js.testing.random_mechanism(0, 3, ["free", "revolute", "ball"], dtype=np.float64)
    X = js.RigidTransform(js.Rotation.exp(np.array([0.3, 0.2, -0.5])), np.array([0.1, 0.4, -0.2]))
    return js.add_frames(mech, [js.Frame("tool0", "body1", X)])


@functools.cache
def states():
    q = js.random_configuration(mechanism(), jax.random.key(0), 8, np.float64)
    return q, jnp.asarray(np.random.default_rng(1).standard_normal((8, mechanism().nv)))


def state(n):
    """The first n."""
    return [x[:n] for x in states()]


def contacts(**changes):
    p = np.random.default_rng(2).normal(size=(len(FRAMES), 3))
    law = {"radius": 0.1, "stiffness": STIFFNESS, "relaxation_time": 0.1, "friction": FRICTION}
    return js.PointContacts(FRAMES, **{"positions": p} | law | changes)


def plane():
    return js.HalfSpace(NORMAL, OFFSET)


def forces(q, v, given=None, ground=None):
    given, ground = given or contacts(), ground or plane()
    F = js.contact_forces(mechanism(), q, v, given, ground, dissipation=DISSIPATION, stiction_speed=STICTION)
    return F.wrenches.to_array()


def of(q, v, **given):
    """The same in NumPy."""
    return interpreted(lambda q, v: forces(q, v, **given))(q, v)


def kinematics(q):
    """Rotations, origins and Jacobians of the frames."""
    X = js.forward_kinematics(mechanism(), q, FRAMES)
    return X.rotation.to_matrix(), X.translation, js.jacobian(mechanism(), q, FRAMES)


def law(v, R, p, J):
    """As its docstring has it, on the velocities of bodies at contact points, by Jacobians."""
    given, n, result = contacts(), NORMAL / np.linalg.norm(NORMAL), []
    for i in range(len(FRAMES)):
        turned = R[i] @ given.positions[i]
        distance = n @ (p[i] + turned) - OFFSET
        offset, (w, at_origin) = -distance * n, (J[i] @ np.asarray(v)).reshape(2, 3)
        at_C = at_origin + np.cross(w, turned + offset)
        depth, speed = 0.1 - distance, n @ at_C
        pressed = max(STIFFNESS[i] * depth * (1 - DISSIPATION * speed), 0) if depth > 0 else 0
        along = at_C - speed * n
        r = np.linalg.norm(along) / STICTION
        step = r**3 * (10 - 15 * r + 6 * r**2) if r < 1 else 1
        f = pressed * (n - FRICTION * step * along / max(np.linalg.norm(along), 1e-300))
        result.append(np.concatenate([np.cross(offset, f), f]))
    return np.array(result)


@pytest.mark.parametrize("scale", [1.0, 0.1, 1e-3, 0.0])
def test_the_law(scale):
    q, v = state(8)
    found = interpreted(lambda q, v: forces(q, scale * v))(q, v)
    expected = np.array([law(*x) for x in zip(scale * v, *interpreted(kinematics)(q), strict=True)])
    assert abs(found - expected).max() <= 1e-13 * abs(expected).max()
    touching = (expected != 0).any(-1)
    np.testing.assert_array_equal((found != 0).any(-1), touching)  # exactly zero at a distance
    assert touching.any(0).any() and (~touching).any()


def test_forces_act_where_they_are_said_to():
    """In forward dynamics, as J^T f."""
    q, v = (x[0] for x in state(1))
    mech = mechanism()

    def both(q, v):
        F = js.contact_forces(mech, q, v, contacts(stiffness=1e3), plane())
        assert F.frames == FRAMES and F.axes == "world" and F.batch_shape == ()
        X = js.forward_kinematics(mech, q, FRAMES)
        at_origins = js.shift(F.wrenches, -(X.rotation @ F.points)).to_array()
        pulled = jnp.einsum("nij,ni->j", js.jacobian(mech, q, FRAMES), at_origins, precision="highest")
        return js.forward_dynamics(mech, q, v, 0 * pulled, F), js.forward_dynamics(mech, q, v, pulled)

    found, expected = interpreted(both)(q, v)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


CALLS = {
    "eager": forces,
    "jit of vmap": jax.jit(jax.vmap(forces)),
    "scan": lambda *x: jax.lax.scan(lambda _, item: (None, forces(*item)), None, x)[1],
}


@pytest.mark.parametrize("how", slow_but(["scan"], CALLS))
def test_the_same_bits_however_it_is_called(how):
    x = state(3)
    np.testing.assert_array_equal(CALLS[how](*x), interpreted(forces)(*x))


def curved(p):
    """Distance from the surface of a ball of radius 5, centre at (0.5, 0, -5)."""
    return jnp.sqrt(((p - jnp.array([0.5, 0.0, -5.0], p.dtype)) ** 2).sum()) - 5


def test_any_ground():
    x = state(3)
    for slope in (lambda p: plane()(p), lambda p: p @ NORMAL - OFFSET * np.linalg.norm(NORMAL)):
        np.testing.assert_allclose(of(*x, ground=slope), of(*x), rtol=0, atol=1e-10)

    def on(ground, **changes):
        return js.contact_forces(mechanism(), *x, contacts(**changes), ground).wrenches

    found = [interpreted(lambda ground=ground: on(ground).to_array())() for ground in (js.HalfSpace(), lambda p: p[2])]
    np.testing.assert_array_equal(found[0], interpreted(lambda: on(None).to_array())())
    np.testing.assert_array_equal(found[1], found[0])
    # On a ball all normals meet in its centre.
    F = interpreted(lambda: on(curved, friction=0.0))()
    R, p, _ = interpreted(kinematics)(x[0])
    arm = p + np.einsum("...ij,...j->...i", R, contacts().positions) - [0.5, 0.0, -5.0]
    assert abs(F.f).max() > 100
    np.testing.assert_allclose(np.cross(arm, F.f), 0 * arm, rtol=0, atol=1e-10)
    np.testing.assert_allclose(F.tau, 0 * arm, rtol=0, atol=1e-10)


def test_the_derivative_on_a_ground_function_of_any_slope():
    """By coordinates, as differences: the distance f / |grad f| and the normal turn with the point."""
    (q, v), rng = (np.repeat(x[:1], 3, 0) for x in states()), np.random.default_rng(5)
    along, h = rng.standard_normal(q.shape[1]), np.array([0, 1e-6, -1e-6])

    def height(p):
        return 3 * (p[2] - jnp.sin(2 * p[0]) - 0.5 * p[1] ** 2 - 0.5)

    def of_q(q, v):
        return jax.jvp(lambda q: forces(q, v, ground=height), (q,), (along,))

    values, tangents = interpreted(jax.vmap(of_q))(q + h[:, None] * along, v)
    assert (values[0] != 0).any(-1).sum() >= 2
    difference = (values[1] - values[2]) / 2e-6
    np.testing.assert_allclose(tangents[0], difference, rtol=0, atol=1e-6 * abs(difference).max())


@pytest.mark.parametrize("scale", [1.0, 1e-2, 0.0])
def test_derivatives_are_differences(scale):
    """By the state, by all numbers of contacts and ground; forward, reverse. Also at rest, where friction begins."""
    q, v = (x[0] for x in state(1))
    x = jax.tree.map(jnp.asarray, (q, scale * v, contacts(), plane()))

    rng = np.random.default_rng(3)
    t = jax.tree.map(lambda leaf: jnp.asarray(rng.standard_normal(leaf.shape)), x)
    value, tangent = interpreted(lambda x, t: jax.jvp(lambda x: forces(*x), (x,), (t,)))(x, t)
    assert (value != 0).any(-1).sum() >= 2
    cotangent = rng.standard_normal(value.shape)
    (pulled,) = interpreted(lambda x, c: jax.vjp(lambda x: forces(*x), x)[1](c))(x, cotangent)
    inner = sum(jnp.sum(a * b) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(t), strict=True))
    size = sum(jnp.sum(abs(a * b)) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(t), strict=True))
    assert abs(inner - jnp.sum(cotangent * tangent)) <= 1e-12 * size
    step = 1e-6
    both = jax.tree.map(lambda a, b: np.stack([a + step * b, a - step * b]), x, t)
    ahead, behind = interpreted(jax.vmap(lambda x: forces(*x)))(both)
    assert abs((ahead - behind) / (2 * step) - tangent).max() <= 1e-6 * abs(tangent).max()


def test_at_a_distance_derivatives_are_zero():
    q, v = (x[0] for x in state(1))
    high = js.HalfSpace(offset=-100.0)
    gradient = interpreted(jax.grad(lambda q, v, c: (forces(q, v, c, high) ** 2).sum(), (0, 1, 2)))(
        q, v, jax.tree.map(jnp.asarray, contacts())
    )
    assert all((leaf == 0).all() for leaf in jax.tree.leaves(gradient))


def test_what_is_no_number_is_none_in_the_result():
    q, v = (x[0] for x in state(1))
    assert np.isnan(of(q * jnp.nan, v)).all(-1)[:-1].all()  # the last is on the world

    def own(positions, radius, k, mu, d, v_s, normal, offset):
        given = contacts(radius=radius, stiffness=k, friction=mu, positions=positions)
        limits = {"dissipation": d, "stiction_speed": v_s}
        F = js.contact_forces(mechanism(), q, v, given, js.HalfSpace(normal, offset), **limits)
        return F.wrenches.to_array()

    given = contacts()
    numbers = (given.positions, 0.1, STIFFNESS, FRICTION, DISSIPATION, STICTION, NORMAL, OFFSET)
    numbers = [np.repeat(np.asarray(x, float)[None], 8, 0) for x in numbers]
    for i, x in enumerate(numbers):
        x[(i, *[0] * (x.ndim - 1))] = np.nan
    found = interpreted(jax.vmap(own))(*numbers)
    assert np.isnan(found).any((1, 2)).all()


@pytest.mark.parametrize("of_zero", [lambda x: 0 * x, jnp.sqrt, lambda x: jnp.sqrt(x * x)])
def test_a_ground_without_a_normal_is_none_in_the_result(of_zero):
    """A gradient that is zero, infinite or NaN where the value is finite; other contacts have their forces."""
    q, v = (x[0] for x in state(1))
    expected = of(q, v, ground=lambda p: p[2] - 1)

    def ground(p):
        x = jnp.where(p[2] < 0, p[2], 0)
        return jnp.where(p[2] < 0, -1 + of_zero(x - jax.lax.stop_gradient(x)), p[2] - 1)

    found = of(q, v, ground=ground)
    is_none = np.isnan(found).all(-1)
    assert is_none.any() and not is_none.all()
    np.testing.assert_array_equal(found[~is_none], expected[~is_none])


def test_a_batch_of_contacts_and_of_grounds():
    q, v = (x[0] for x in state(1))
    friction = np.linspace(0.0, 1.0, 4)
    found = of(q, v, given=contacts(friction=np.broadcast_to(friction[:, None], (4, 5))))
    each = [of(q, v, given=contacts(friction=mu)) for mu in friction]
    np.testing.assert_array_equal(found, each)
    grounds = js.HalfSpace(np.broadcast_to(NORMAL, (4, 3)), np.linspace(-0.5, 0.5, 4))
    each = [of(q, v, ground=js.HalfSpace(NORMAL, offset)) for offset in grounds.offset]
    np.testing.assert_allclose(of(q, v, ground=grounds), each, rtol=0, atol=1e-10)


def test_in_float32():
    """Also while 64-bit types are on."""
    mech, x = mechanism().astype(np.float32), [y.astype(np.float32) for y in state(3)]
    given, ground = contacts().astype(np.float32), plane().astype(np.float32)
    limits = {"dissipation": DISSIPATION, "stiction_speed": STICTION}
    found = interpreted(lambda *x: js.contact_forces(mech, *x, given, ground, **limits).wrenches.to_array())(*x)
    assert found.dtype == np.float32
    expected = of(*state(3))
    # Forces are as accurate as depths: k times a position's rounding.
    assert abs(found - expected).max() <= 64 * 2.0**-24 * 2e3 * 4
    assert jax.eval_shape(lambda *x: js.contact_forces(mech, *x, given), *x).dtype == np.float32


def test_no_contacts():
    q, v = state(3)
    none = js.PointContacts([], stiffness=1.0, relaxation_time=0.0, friction=0.0)

    def fall(q, v):
        F = js.contact_forces(mechanism(), q, v, none)
        assert F.wrenches.batch_shape == (3, 0)
        return js.forward_dynamics(mechanism(), q, v, 0 * v, F), js.forward_dynamics(mechanism(), q, v, 0 * v)

    np.testing.assert_array_equal(*interpreted(fall)(q, v))
    with pytest.raises(TypeError, match="contact_forces: ground: expected a HalfSpace"):
        js.contact_forces(mechanism(), q, v, none, 3)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"contacts": None}, TypeError, "contact_forces: contacts: expected PointContacts, got NoneType"),
        ({"ground": 3}, TypeError, "contact_forces: ground: expected a HalfSpace, or a function .*, got int"),
        ({"ground": lambda p: p}, ValueError, r"ground: expected a number, float64\[\], .* got float64\[3\]"),
        ({"ground": js.HalfSpace().astype(np.float32)}, TypeError, "q and ground: expected one dtype"),
        ({"stiction_speed": 0.0}, ValueError, "stiction_speed: expected numbers above 0, got 0.0"),
        ({"stiction_speed": np.nan}, ValueError, "stiction_speed: expected numbers above 0, got nan"),
        ({"dissipation": -0.5}, ValueError, "contact_forces: dissipation: expected numbers of at least 0, got -0.5"),
        ({"dissipation": np.zeros(3)}, ValueError, r"dissipation: expected a number, or shape \(\*batch, 5\)"),
        ({"dissipation": np.zeros((3, 5))}, ValueError, "expected batch shapes that broadcast"),
    ],
)
def test_what_is_refused(changes, error, message):
    arguments = {"contacts": contacts(), "ground": None} | changes
    with pytest.raises(error, match=message):
        jax.eval_shape(lambda *x: js.contact_forces(mechanism(), *x, **arguments), *state(2))


def test_more_that_is_refused():
    q, v = state(2)
    with pytest.raises(KeyError, match="contact_forces: frames: .*did you mean 'tool0'"):
        js.contact_forces(
            mechanism(), q, v, js.PointContacts(["tool"], stiffness=1.0, relaxation_time=0.0, friction=0.0)
        )
    with pytest.raises(ValueError, match="q and v and contacts: expected batch shapes that broadcast"):
        js.contact_forces(mechanism(), q, v, contacts(friction=np.zeros((3, 5))))
    with pytest.raises(TypeError, match="q and contacts: expected one dtype"):
        js.contact_forces(mechanism(), q, v, contacts().astype(np.float32))

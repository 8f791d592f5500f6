"""The report of contacts: of points, speeds and sticking, by definitions and by balances of momentum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.contact.test_grounds import brick, states, touching
from tests.helpers.interpreted import interpreted

GROUND = js.HalfSpace(np.array([0.1, -0.2, 1.0]), np.float64(0.05))
DT = 5e-3


def reported(q, v, friction=0.6):
    """(the report, the step) of states."""

    def of(q, v):
        contacts = touching(friction)
        after = js.convex_step(brick(), q, v, np.zeros(6), DT, contacts=contacts, ground=GROUND)
        return js.contact_report(brick(), q, after.v, contacts, GROUND, forces=after.contact_forces, dt=DT), after

    with jax.enable_x64(True):
        return interpreted(jax.vmap(of))(q, v)


def test_forces_about_the_points_balance_the_momentum():
    """Of bodies let go at rest inside the ground: the angular momentum about the world's origin, too."""
    q, _ = states()
    report, after = reported(q, np.zeros((4, 6)))
    f, g = after.contact_forces.f, np.array([0, 0, -9.81])
    with jax.enable_x64(True):
        R, turned = (np.asarray(js.Rotation.from_quaternion(x[:, :4]).to_matrix()) for x in (q, after.q))
    inertia = 2 / 12 * np.diag([0.2**2 + 0.2**2, 0.4**2 + 0.2**2, 0.4**2 + 0.2**2])
    w, v = (np.einsum("nij,nj->ni", turned, x) for x in (after.v[:, :3], after.v[:, 3:]))
    spin = np.einsum("nij,jk,nlk,nl->ni", R, inertia, R, w)
    momentum = spin + 2 * np.cross(q[:, 4:], v)
    expected = DT * (np.cross(report.points, f).sum(1) + 2 * np.cross(q[:, 4:], g))
    assert (f[..., 2] > 1).any(1).all()
    np.testing.assert_allclose(momentum, expected, rtol=0, atol=1e-11)
    # About the corners, or the origin of the body, it is off.
    assert abs(expected - DT * (np.cross(q[:, None, 4:], f).sum(1) + 2 * np.cross(q[:, 4:], g))).max() > 1e-4


def test_numbers_are_those_of_the_definitions():
    q, v = states()
    report, after = reported(q, v)
    n = np.array([0.1, -0.2, 1.0]) / np.sqrt(1.05)
    with jax.enable_x64(True):
        R, turned = (np.asarray(js.Rotation.from_quaternion(x[:, :4]).to_matrix()) for x in (q, after.q))
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
    p = q[:, None, 4:] + np.einsum("nij,kj->nki", R, corners)
    depths = 0.05 - p @ n
    np.testing.assert_allclose(report.depths, depths, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(report.touches, report.depths >= 0)
    np.testing.assert_allclose(report.points, p + depths[..., None] * n, rtol=0, atol=1e-14)
    np.testing.assert_allclose(report.normals, np.broadcast_to(n, (4, 8, 3)), rtol=0, atol=1e-15)
    w, origin = (np.einsum("nij,nj->ni", turned, x)[:, None] for x in (after.v[:, :3], after.v[:, 3:]))
    at = origin + np.cross(w, report.points - q[:, None, 4:])
    np.testing.assert_allclose(report.approach, -(at @ n), rtol=0, atol=1e-12)
    np.testing.assert_allclose(report.slip, at - (at @ n)[..., None] * n, rtol=0, atol=1e-12)
    assert not report.sticks[report.depths < 0].any() and report.touches.any() and not report.touches.all()


def test_what_sticks_is_slow_and_inside_the_cone():
    """A box that is pushed along the ground, by less than friction holds, and by more."""
    with jax.enable_x64(True):
        mech = brick()
        q = np.array([1.0, 0, 0, 0, 0, 0, 0.1 - 1e-3])
        contacts, ground = touching(0.5), js.HalfSpace().astype(np.float64)
        f = np.array([0.3, 0.7])[:, None] * 2 * 9.81 * np.array([0, 0, 0, 1.0, 0, 0])

        def pushed(tau):
            def one(state, _):
                after = js.convex_step(mech, *state, tau, DT, contacts=contacts, ground=ground)
                report = js.contact_report(
                    mech, state[0], after.v, contacts, ground, forces=after.contact_forces, dt=DT
                )
                return (after.q, after.v), report

            return jax.tree.map(lambda x: x[-1], jax.lax.scan(one, (q, np.zeros(6)), None, 40)[1])

        report = interpreted(jax.vmap(pushed))(f)
    low = np.array([True, False] * 4)
    np.testing.assert_array_equal(report.touches[0], low)
    np.testing.assert_array_equal(report.sticks[0], low)
    # It tips as it slides.
    assert report.touches[1].any() and not report.sticks[1].any()
    slip = np.linalg.norm(report.slip, axis=-1)[:, low]
    assert slip[0].max() < 1e-3 < 0.2 < slip[1].min()


def test_between_two_bodies_and_beside_the_ground():
    """Those of pairs come last: C midway between surfaces, speeds of b for an observer on a."""
    M = js.SpatialInertia.solid_sphere(np.float32(0.1), mass=np.float32(1))
    joints = [js.Joint(f"to {x}", "free", "world", x) for x in "ab"]
    mech = js.Mechanism.build([js.Body("a", M), js.Body("b", M)], joints)
    law = {"stiffness": np.float32(1e4), "relaxation_time": np.float32(0.01)}
    balls = [
        js.PointContacts([x], radius=np.float32(r), **law, friction=np.float32(0.5))
        for x, r in (("a", 0.1), ("b", 0.2))
    ]
    q = np.float32([1, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0.25, 0, 1])
    v = np.float32([0, 0, 2, 0.5, 0, 0, 0, 0, 0, -1, 3, 0])

    def of(q, v):
        after = js.convex_step(
            mech, q, v, np.zeros(12, np.float32), np.float32(1e-3), contacts=balls[0], pairs=tuple(balls)
        )
        return js.contact_report(mech, q, v, balls[0], pairs=tuple(balls), forces=after.contact_forces)

    report = interpreted(of)(q, v)
    np.testing.assert_allclose(report.depths, [-0.9, 0.05], rtol=1e-6)
    np.testing.assert_allclose(report.points, [[0, 0, 0], [0.075, 0, 1]], rtol=0, atol=1e-7)
    np.testing.assert_allclose(report.normals, [[0, 0, 1], [1, 0, 0]], rtol=0, atol=1e-7)
    np.testing.assert_allclose(report.approach, [0, 1.5], rtol=0, atol=1e-6)
    np.testing.assert_allclose(report.slip[1], [0, 3 - 2 * 0.075, 0], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(report.sticks, [False, False])


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"contacts": None}, ValueError, "contact_report: expected contacts or pairs, got neither"),
        ({"contacts": 3}, TypeError, "contact_report: contacts: expected PointContacts, got int"),
        ({"pairs": 3}, TypeError, r"contact_report: pairs: expected \(a, b\), two PointContacts"),
        ({"forces": np.zeros((8, 3))}, TypeError, "contact_report: forces: expected a SpatialForce"),
        (
            {"forces": js.SpatialForce(jnp.zeros((3, 3)), jnp.zeros((3, 3)))},
            ValueError,
            r"contact_report: forces: expected one for each of 8 contacts, got \(3,\)",
        ),
    ],
)
def test_what_is_refused(changes, error, message):
    with jax.enable_x64(True):
        arguments = {"contacts": touching()} | changes
        with pytest.raises(error, match=message):
            interpreted(lambda q, v: js.contact_report(brick(), q, v, **arguments))(states()[0][0], states()[1][0])


@pytest.mark.parametrize("a, b, message", [("a", "b b", "as many of one as of the other"), ("a", "a", "of two bodies")])
def test_pairs_are_checked_as_those_of_a_step(a, b, message):
    M = js.SpatialInertia.solid_sphere(np.float32(0.1), mass=np.float32(1))
    joints = [js.Joint(f"to {x}", "free", "world", x) for x in "ab"]
    mech = js.Mechanism.build([js.Body("a", M), js.Body("b", M)], joints)
    pairs = tuple(js.PointContacts(x.split(), stiffness=1e4, relaxation_time=0.01, friction=0.5) for x in (a, b))
    q, v = np.ones(14, np.float32), np.zeros(12, np.float32)
    with pytest.raises(ValueError, match=f"contact_report: pairs: .*{message}"):
        js.contact_report(mech, q, v, pairs=pairs)
    with pytest.raises(ValueError, match=f"convex_step: pairs: .*{message}"):
        js.convex_step(mech, q, v, v, np.float32(1e-3), pairs=pairs)

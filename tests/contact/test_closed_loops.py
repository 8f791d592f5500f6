"""Closed loops: closures of every kind, redundant ones, singular configurations, derivatives, and how loops are closed.

Accelerations are compared with those of other engines in `peers`.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import closed_loops
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


KINDS = {"weld": 6, "hinge": 5, "universal": 4, "ball": 3, "distance": 1}
U = 2.0**-53


def closure(kind, a="A", b="B"):
    return js.LoopClosure(a, b, kind, 0.8 if kind == "distance" else None)


def placed(p, w=(0, 0, 0)):
    return js.RigidTransform(js.Rotation.exp(np.float64(w)), np.float64(p))


@functools.cache
def two_bodies():
    """One floats, the other hangs on it by two joints with quaternions. "A" and "B" are on them."""
    mech = js.testing.random_mechanism(3, 4, ["free", "ball", "free", "revolute"], dtype=np.float64)
    frames = [("A", "body0", 1), ("B", "body2", 2), ("C", "world", 3)]
    rngs = [(name, body, np.random.default_rng(seed)) for name, body, seed in frames]
    return js.add_frames(mech, [js.Frame(x, b, placed(r.standard_normal(3), r.standard_normal(3))) for x, b, r in rngs])


def state(mech, seed=0):
    q = np.asarray(js.random_configuration(mech, jax.random.key(seed), (), np.float64))
    return q, *np.random.default_rng(seed).standard_normal((2, mech.nv))


def error(mech, q, loops):
    return interpreted(lambda q: js.constraint_error(mech, q, loops))(q)


def rows(mech, q, loops):
    return interpreted(lambda q: js.constraint_jacobian(mech, q, loops))(q)


def rows_at(mech, qs, loops):
    """Of configurations one after another, in one program."""
    return interpreted(jax.vmap(lambda q: js.constraint_jacobian(mech, q, loops)))(np.stack(qs))


def along(mech, q, v, h):
    """Configurations that h ahead of q and h behind it are on the way along v."""
    return interpreted(jax.vmap(lambda t: js.integrate(mech, q, v, t)))(np.float64([h, -h]))


def dynamics(mech, q, v, tau, loops, **options):
    return interpreted(lambda *x: js.constrained_forward_dynamics(mech, *x, loops, **options))(q, v, tau)


# -- what a closure is ------------------------------------------------------------------------------------------------

HINGE_ANGLE, UNIVERSAL_ANGLES, BALL = 0.7, (0.4, -0.9), (0.3, -0.8, 0.5)
FREE = {  # the rotations that a kind leaves free, from no rotation
    "weld": js.Rotation.identity(dtype=np.float32),
    "hinge": js.Rotation.about_z(np.float32(HINGE_ANGLE)),
    "universal": js.Rotation.about_z(np.float32(UNIVERSAL_ANGLES[0])) @ js.Rotation.about_x(np.float32(-0.9)),
    "ball": js.Rotation.exp(np.float32(BALL)),
}


@pytest.mark.parametrize("kind", FREE)
def test_what_a_kind_leaves_free(kind):
    """A body that floats, held at the world: its error is zero in those poses, and in no others of small rotations."""
    mech = js.Mechanism.build([js.Body("b")], [js.Joint("j", "free", "world", "b")], dtype=np.float64)
    quaternion = np.float64(FREE[kind].to_quaternion())
    quaternion /= np.linalg.norm(quaternion)
    loops = [js.LoopClosure("world", "b", kind)]
    assert abs(error(mech, np.float64([*quaternion, 0, 0, 0]), loops)).max() <= 1e-7  # angles are of float32
    J = rows(mech, np.float64([*quaternion, 0, 0, 0]), loops)
    assert J.shape == (KINDS[kind], 6) and np.linalg.matrix_rank(J, tol=0.1) == KINDS[kind]
    assert abs(error(mech, np.float64([*quaternion, 0, 0.25, 0]), loops)[-3:] - [0, 0.25, 0]).max() <= 1e-15


@pytest.mark.parametrize("kind", ["weld", "hinge"])
def test_angles_are_whole(kind):
    """A body that is turned over is not closed: by half a turn the error is pi."""
    mech = js.Mechanism.build([js.Body("b")], [js.Joint("j", "free", "world", "b")], dtype=np.float64)
    for angle in (1e-9, 0.5, 3.0, np.pi):
        q = np.float64([np.cos(angle / 2), np.sin(angle / 2), 0, 0, 0, 0, 0])
        found = error(mech, q, [js.LoopClosure("world", "b", kind)])
        np.testing.assert_allclose(np.linalg.norm(found), angle, rtol=4e-16)


def rates(loops, q, v):
    """J v, by differences of the error and by the Jacobian."""
    mech, h = two_bodies(), 1e-5
    ahead, behind = interpreted(jax.vmap(lambda q: js.constraint_error(mech, q, loops)))(along(mech, q, v, h))
    return (ahead - behind) / (2 * h), rows(mech, q, loops) @ v


@pytest.mark.parametrize("kind", slow_but(["weld", "hinge"], KINDS))
def test_jacobian_is_the_rate_of_the_error_where_it_is_closed(kind):
    mech, loops = two_bodies(), [closure(kind)]
    q, v, _ = state(mech)
    at_closed = interpreted(lambda q: js.close_loops(mech, q, loops, iterations=40))(q)
    assert at_closed.residual <= 1e-14
    expected, rate = rates(loops, at_closed.q, v)
    assert abs(expected - rate).max() <= 1e-8 * abs(rate).max()


def test_jacobian_is_the_rate_of_the_error_anywhere():
    """Of kinds whose error is no rotation vector."""
    q, v, _ = state(two_bodies())
    expected, rate = rates([closure(kind) for kind in ("universal", "ball", "distance")], q, v)
    np.testing.assert_allclose(rate, expected, rtol=0, atol=1e-8 * abs(rate).min())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("a", ["A", slow("C")])
def test_constraint_acceleration_is_zero(kind, a):
    """J vdot + dJ/dt v, with dJ/dt by differences; at states that are not closed, too."""
    mech, loops = two_bodies(), [closure(kind, a)]
    q, v, tau = state(mech, 1)
    found, h = dynamics(mech, q, v, tau, loops), 1e-5
    J, ahead, behind = rows_at(mech, [q, *along(mech, q, v, h)], loops)
    bias = (ahead - behind) @ v / (2 * h)
    assert abs(J @ found.vdot + bias).max() <= 1e-8 * abs(bias).max()


@pytest.mark.parametrize("kind", KINDS)
def test_wrenches_are_those_of_the_closures(kind):
    """On B, and their opposites on A about the same point, beside tau they cause vdot. Those of a kind have no power in
    motions that it leaves free."""
    mech, loops = two_bodies(), [closure(kind)]
    q, v, tau = state(mech, 2)
    found = dynamics(mech, q, v, tau, loops)
    F = js.SpatialForce.from_array(found.loop_wrenches.to_array())

    def needed(vdot, F):
        """With the wrenches, and without."""
        poses = js.forward_kinematics(mech, q, ["A", "B"])
        p_AB = (poses.translation[1] - poses.translation[0])[None]
        both = {"B": F.at_batch(0), "A": -js.shift(F, -p_AB).at_batch(0)}
        return js.inverse_dynamics(mech, q, v, vdot, both), js.inverse_dynamics(mech, q, v, vdot)

    forces, alone = interpreted(needed)(found.vdot, F)
    assert abs(forces - tau).max() <= 1e-12 * abs(forces - alone).max()


def test_without_closures():
    mech = two_bodies()
    q, v, tau = state(mech)
    found = dynamics(mech, q, v, tau, [])
    np.testing.assert_array_equal(found.vdot, interpreted(functools.partial(js.forward_dynamics, mech))(q, v, tau))
    assert found.loop_wrenches.f.shape == (0, 3)
    assert error(mech, q, ()).shape == (0,) and rows(mech, q, ()).shape == (0, mech.nv)
    assert interpreted(lambda q: js.close_loops(mech, q, ()))(np.stack([q, q])).residual.shape == (2,)


# -- redundant, singular, without mass, not a number ------------------------------------------------------------------


def hinge_at_two_points(s):
    """The closure of "hinges" by two points of its axis: five rows of six say all."""
    mech = js.add_frames(s.mech, [js.Frame(f"{x}2", x, placed([0, 0, 0.3])) for x in "AB"])
    return mech, (js.LoopClosure("A", "B", "ball"), js.LoopClosure("A2", "B2", "ball"))


REDUNDANT = {
    "twice": ("arms", lambda s: (s.mech, s.loops * 2)),
    "three times": ("four-bar", lambda s: (s.mech, s.loops * 3)),
    "a weld and a ball": ("arms", lambda s: (s.mech, (*s.loops, closure("ball")))),
    "two points": ("hinges", hinge_at_two_points),
    "the world": ("four-bar", lambda s: (s.mech, (*s.loops, js.LoopClosure("world", "world", "weld")))),
}


# Of the arms, whose twelve or nine rows are those of a weld, others tell the same in less time.
LONG = "twice", "three times", "a weld and a ball"
OF_ARMS = [pytest.param(*x, id=k, marks=[pytest.mark.slow] if k in LONG else []) for k, x in REDUNDANT.items()]


@pytest.mark.parametrize(("name", "more"), OF_ARMS)
def test_redundant_closures_change_nothing(name, more):
    s = closed_loops.closed(name)
    mech, loops = more(s)
    found = dynamics(mech, s.q, s.v, s.tau, loops).vdot
    expected = closed_loops.constrained(name).vdot
    assert abs(found - expected).max() <= 1e-11 * abs(expected).max()


@pytest.mark.parametrize("name", [closed_loops.PLANAR[0], *map(slow, closed_loops.PLANAR[1:])])
def test_a_plane_of_any_direction(name):
    """Across it rows are rounding errors where they were zeros."""
    s, R = closed_loops.closed(name), js.Rotation.exp(np.float64([0.3, -0.5, 0.7]))
    R = jax.tree.map(np.asarray, R)
    X, is_root = s.mech.placements, np.array(s.mech.parents) < 0
    entries = np.where(is_root[:, None], (R.to_matrix() @ X.rotation.to_matrix()).reshape(-1, 9), X.rotation.entries)
    p = np.where(is_root[:, None], X.translation @ R.to_matrix().T, X.translation)
    turned = js.RigidTransform(js.Rotation(np.asarray(entries)), np.asarray(p))
    mech = s.mech.replace(placements=turned, gravity=R.to_matrix() @ s.mech.gravity)
    found, expected = dynamics(mech, s.q, s.v, s.tau, s.loops).vdot, closed_loops.constrained(name).vdot
    assert abs(found - expected).max() <= 1e-11 * abs(expected).max()
    off = s.q + 0.05
    residual = interpreted(lambda q: js.close_loops(mech, q, s.loops))(off).residual
    assert residual.max() <= 1e-14


def test_a_folded_linkage():
    """A parallelogram flat on a line: there alone rows are dependent. All is finite, and the rows are held."""
    bars, one = [("a", "world", 0.0), ("b", "a", 1.0), ("c", "world", 2.0)], np.float64(1)
    bodies = [js.Body(name, js.SpatialInertia.thin_rod(one, np.eye(3)[0], mass=one)) for name, *_ in bars]
    joints = [js.Joint(f"j{name}", "revolute", on, name, placed([x, 0, 0]), axis=(0, 1, 0)) for name, on, x in bars]
    frames = [js.Frame("A", "c", placed([1, 0, 0])), js.Frame("B", "b", placed([2, 0, 0]))]
    mech = js.Mechanism.build(bodies, joints, frames, dtype=np.float64)
    loops, v = (closure("ball"),), np.float64([1, -1, 1])
    q, still = np.zeros(3), np.zeros(3)
    J = rows(mech, q, loops)
    assert np.linalg.matrix_rank(J) == 1 and abs(J @ v).max() == 0
    found = dynamics(mech, q, v, still, loops)
    assert np.isfinite(found.vdot).all()
    # From rest it falls as a parallelogram would: the acceleration is along v or along the other branch.
    at_rest = dynamics(mech, q, still, still, loops).vdot
    assert abs(J @ at_rest).max() <= 1e-12 * abs(at_rest).max() and abs(at_rest).max() > 1
    # Near by it is that of a linkage which moves in one way.
    near = interpreted(lambda q: js.close_loops(mech, q, loops))(np.float64([0.1, -0.1, 0.1]))
    assert near.residual <= 1e-15
    vdot = dynamics(mech, near.q, still, still, loops).vdot
    np.testing.assert_allclose(vdot, vdot[0] * v, rtol=1e-9)


def test_parts_without_mass():
    """A rod of no mass: its own accelerations follow, and forces through it are along it."""
    s = closed_loops.closed("four-bar")
    mass = np.array(s.mech.inertias.mass) * [1, 0, 1]
    empty = js.SpatialInertia(mass, s.mech.inertias.com, s.mech.inertias.central * (mass > 0)[:, None])
    mech = s.mech.replace(inertias=empty, armature=np.float64([0, 1e-6, 0]))
    found = dynamics(mech, s.q, s.v, 0 * s.tau, s.loops)
    J = rows(mech, s.q, s.loops)
    vdot = closed_loops.constrained("four-bar").vdot
    assert np.isfinite(found.vdot).all() and abs(found.vdot - vdot).max() > 1e-3
    p = interpreted(lambda q: js.forward_kinematics(mech, q, ["B", "b"]).translation)(s.q)
    rod, f = p[:, 0] - p[:, 1], found.loop_wrenches.f[:, 0]
    assert abs(np.cross(rod, f)).max() <= 1e-4 * abs(f).max() and J.shape[-1] == 3
    # Without armature either, the rod does not accelerate on its own; all stays finite.
    bare = dynamics(mech.replace(armature=np.zeros(3)), s.q, s.v, 0 * s.tau, s.loops)
    assert np.isfinite(bare.vdot).all()


def test_nan_gives_nan():
    s = closed_loops.closed("four-bar")
    for k in range(3):
        arguments = [x.copy() for x in (s.q, s.v, s.tau)]
        arguments[k][1, 0] = np.nan
        found = dynamics(s.mech, *arguments, s.loops)
        for x in (found.vdot, found.loop_wrenches.f.reshape(4, -1)):
            np.testing.assert_array_equal(np.isnan(x).any(1), [False, True, False, False])
    q, residual = interpreted(lambda q: js.close_loops(s.mech, q, s.loops))(
        np.where(np.isnan(arguments[2]), np.nan, s.q)
    )
    np.testing.assert_array_equal(np.isnan(residual), [False, True, False, False])


# -- transformations and derivatives ----------------------------------------------------------------------------------


def test_compiled_mapped_and_batched():
    """The numbers of the formula op by op, to a few u; and of float32."""
    s, expected = closed_loops.closed("four-bar"), closed_loops.constrained("four-bar")
    own = functools.partial(js.constrained_forward_dynamics, s.mech, loops=s.loops)
    found = jax.jit(jax.vmap(own))(s.q, s.v, s.tau)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * abs(b).max())
    one = [np.float32(x[0]) for x in (s.q, s.v, s.tau)]
    with jax.enable_x64(False):
        narrow = interpreted(own)(*one)
    assert narrow.vdot.dtype == np.float32
    assert abs(narrow.vdot - expected.vdot[0]).max() <= 1e-4 * abs(expected.vdot[0]).max()


@pytest.mark.parametrize("precision", js.Precision)
def test_precisions(precision):
    s, expected = closed_loops.closed("four-bar"), closed_loops.constrained("four-bar").vdot
    found = dynamics(s.mech, s.q, s.v, s.tau, s.loops, precision=precision).vdot
    assert abs(found - expected).max() <= 1e-12 * abs(expected).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four-bar", "hinges"])
def test_derivatives_of_dynamics(name):
    """Forward and reverse ones agree, and are differences: of the state, of tau, of masses and of where bodies are. Of
    the planar linkage, which is held three times over, in its plane: rows depend on others there."""
    is_planar = name in closed_loops.PLANAR
    s = closed_loops.closed(name)
    loops = s.loops * (3 if is_planar else 1)
    mech, rng = s.mech.as_data(), np.random.default_rng(5)
    plane = np.float64([1, not is_planar, 1])

    def of(mass, placements, q, v, tau):
        inertias = js.SpatialInertia(mass, mech.inertias.com, mech.inertias.central)
        changed = mech.replace(inertias=inertias, placements=placements)
        return js.constrained_forward_dynamics(changed, q, v, tau, loops).vdot

    x = mech.inertias.mass, mech.placements, *(jnp.asarray(y[0]) for y in (s.q, s.v, s.tau))
    t = jax.tree.map(lambda leaf: jnp.asarray(rng.standard_normal(leaf.shape)), x)
    # A rotation has nine entries and three ways to move.
    spin = np.cross(np.eye(3), rng.standard_normal(3) * (1 - plane if is_planar else 1))
    entries = (mech.placements.rotation.to_matrix() @ spin).reshape(-1, 9)
    t = (t[0], js.RigidTransform(js.Rotation(entries), t[1].translation * plane[None]), *t[2:])
    cotangent, h = rng.standard_normal(s.mech.nv), 1e-5

    def derivatives(*x):
        return *jax.jvp(of, x, t), jax.vjp(of, *x)[1](cotangent)

    near = jax.tree.map(lambda a, b: np.stack([a, a + h * b, a - h * b]), x, t)
    values, tangents, pulled = interpreted(jax.vmap(derivatives))(*near)
    tangent, pulled = tangents[0], jax.tree.map(lambda y: y[0], pulled)
    products = [jnp.sum(a * b) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(t), strict=True)]
    assert abs(sum(products) - cotangent @ tangent) <= 1e-11 * sum(map(abs, products))
    assert abs((values[1] - values[2]) / (2 * h) - tangent).max() <= 1e-6 * abs(tangent).max()


def test_derivatives_of_closed_configurations():
    """Where q is closed: P, the projection on motions that stay closed; by a distance: how it is closed again."""
    s = closed_loops.closed("five-bar")
    q, J = s.q[0], rows(s.mech, s.q[0], s.loops)
    P = np.eye(4) - np.linalg.pinv(J) @ J
    close = lambda q: js.close_loops(s.mech, q, s.loops).q  # noqa: E731
    for derivative in (jax.jacfwd, jax.jacrev):
        assert abs(interpreted(derivative(close))(q) - P).max() <= 1e-9

    def at(distance):
        return js.close_loops(s.mech, q, [js.LoopClosure("a", "B", "distance", distance)]).q

    ends = interpreted(lambda q: js.forward_kinematics(s.mech, q, ["a", "B"]).translation)(q)
    apart, h = np.linalg.norm(np.subtract(*ends)), 1e-5
    found = interpreted(jax.jacfwd(at))(apart)
    ahead, behind = interpreted(jax.vmap(at))(apart + np.float64([h, -h]))
    np.testing.assert_allclose(found, (ahead - behind) / (2 * h), rtol=0, atol=1e-7)


# -- closing loops ----------------------------------------------------------------------------------------------------


def test_each_state_ends_by_itself():
    """From 0.1 rad off some four steps are enough; no more are taken, nor by a state whose batch holds one that is far
    away, or NaN, and takes all."""
    s, rng = closed_loops.closed("hinges"), np.random.default_rng(0)
    near, far = (np.concatenate([s.q] * 5) + size * rng.standard_normal((20, 6)) for size in (0.1, 2.0))
    far[0] = np.nan
    close = jax.jit(lambda q, n: js.close_loops(s.mech, q, s.loops, iterations=n).q, static_argnums=1)
    alone = np.asarray(close(near, 30))
    np.testing.assert_array_equal(alone, close(near, 8))
    assert (alone != close(near, 2)).any(-1).all()
    both = np.asarray(close(np.concatenate([near, far]), 30))
    np.testing.assert_array_equal(both[:20], alone)
    assert np.isnan(both[20]).all() and (both[21:] != close(far, 8)[1:]).any()


def test_a_mesh_that_only_an_argument_has():
    """Explicit axes, and no mesh in the context: what is no array of the caller's is of the mesh, too."""
    mesh = jax.make_mesh((1,), ("batch",), axis_types=(jax.sharding.AxisType.Explicit,))
    mech = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=np.float64)
    q, loops = np.array([[0.1, 0.2], [0.3, -0.4]]), [closure("distance", "world", "body1")]
    q_on_mesh = jax.device_put(q, jax.NamedSharding(mesh, jax.P("batch")))
    found = js.close_loops(mech, q_on_mesh, loops, iterations=2)
    assert found.q.sharding.spec[0] == "batch"
    np.testing.assert_array_equal(found.q, js.close_loops(mech, q, loops, iterations=2).q)


@pytest.mark.parametrize("name", slow_but(["four-bar", "five-bar", "hinges"], closed_loops.BODIES))
def test_loops_close_quadratically(name):
    """From 0.1 rad off. The residual is told at every number of iterations, and is that of the error."""
    s = closed_loops.closed(name)
    off = s.q[0] + 0.1 * np.sign(np.random.default_rng(0).standard_normal(s.mech.nv))
    runs = [interpreted(lambda q, n=n: js.close_loops(s.mech, q, s.loops, iterations=n))(off) for n in range(5)]
    residuals = [float(x.residual) for x in runs]
    assert residuals[-1] <= 1e-14
    for x in runs[:2]:
        np.testing.assert_allclose(abs(error(s.mech, x.q, s.loops)).max(), x.residual, rtol=1e-9)
    for before, after in zip(residuals, residuals[1:], strict=False):
        assert after <= 20 * before**2 + 1e-14
    # By a motion that is not much longer than the smallest.
    J = rows(s.mech, runs[-1].q, s.loops)
    moved = interpreted(functools.partial(js.difference, s.mech))(off, runs[-1].q)
    assert np.linalg.norm(moved - np.linalg.pinv(J) @ J @ moved) <= 0.5 * np.linalg.norm(moved)


def test_quaternions_stay_of_unit_length():
    mech = two_bodies()
    q, _, _ = state(mech)
    found = interpreted(lambda q: js.close_loops(mech, q, [closure("weld")], iterations=40))(3 * q)
    assert found.residual <= 1e-14
    starts = [i for i, kind in enumerate(mech.topology.kinds) if kind in ("free", "ball")]
    for i in starts:
        x = found.q[mech.topology.q_slice(i)][:4]
        assert abs(np.linalg.norm(x) - 1) <= 4 * U


def test_what_cannot_close_is_told():
    mech = js.Mechanism.build(
        [js.Body("a")], [js.Joint("j", "revolute", "world", "a")], [js.Frame("A", "a", placed([1, 0, 0])),
        js.Frame("B", "world", placed([3, 0, 0]))], dtype=np.float64,
    )  # fmt: skip
    found = interpreted(lambda q: js.close_loops(mech, q, [closure("ball")]))(np.float64([0.3]))
    assert found.residual >= 2 / 3**0.5 and np.isfinite(found.q).all()


def test_drift_and_stabilisation():
    """A four-bar linkage in Runge-Kutta steps: errors that are there stay or grow, with stabilization they decay."""
    s = closed_loops.closed("four-bar")
    q, v, dt = s.q[0] + 1e-3, s.v[0], 2e-3

    @jax.jit
    def after(k):
        def step(x, _):
            vdot = js.constrained_forward_dynamics(s.mech, *x, 0 * s.tau[0], s.loops, stabilization=k).vdot
            v = x[1] + dt * vdot
            return (js.integrate(s.mech, x[0], v, dt), v), None

        return jax.lax.scan(step, (q, v), None, 100)[0][0]

    start, free, held = abs(error(s.mech, np.stack([q, after(0.0), after(50.0)]), s.loops)).max(1)
    assert free > 0.3 * start and held < 0.02 * start


def test_the_distance_of_points_that_coincide():
    """It is along z of A, in which direction it is closed: of a free body, and by the convex step too."""
    M = js.SpatialInertia.solid_sphere(np.float64(0.1), mass=np.float64(1))
    mech = js.Mechanism.build([js.Body("b", M)], [js.Joint("j", "free", "world", "b")], dtype=np.float64)
    mech = js.add_frames(mech, [js.Frame("A", "world", placed((1, 2, 3), (0.5, -0.3, 0.2)))])
    q, v = np.float64([1, 0, 0, 0, 1, 2, 3]), np.zeros(6)
    loops, z = [closure("distance", "A", "b")], js.Rotation.exp(np.float64((0.5, -0.3, 0.2))).to_matrix()[:, 2]

    def found(q, v):
        step = js.convex_step(mech.replace(gravity=np.zeros(3)), q, v, v, 1e-2, loops=loops)
        by_q = jax.jacfwd(lambda q: js.constraint_error(mech, q, loops))(q)
        close = js.close_loops(mech, q, loops)
        return js.constraint_error(mech, q, loops), js.constraint_jacobian(mech, q, loops), by_q, close, step.v

    error, J, by_q, (closed, residual), after = interpreted(found)(q, v)
    np.testing.assert_array_equal(error, [-0.8])
    for x in (J[0, 3:], by_q[0, 4:], (closed[4:] - q[4:]) / 0.8, after[3:] / (0.8 / 1e-2)):
        np.testing.assert_allclose(x, z, rtol=0, atol=1e-3)
    assert residual < 1e-12


def test_distances_of_all_sizes():
    """Squares of coordinates neither over- nor underflow."""
    sizes = np.array([1e-200, 1e-160, 1.0, 1e160, 1e300])
    ends = [js.Frame(f"{k}", "world", placed(x * np.array([2, -3, 6]))) for k, x in enumerate(sizes)]
    mech = js.add_frames(js.testing.random_mechanism(0, 1, ["revolute"], dtype=np.float64), ends)
    loops = [js.LoopClosure("world", f"{k}", "distance", 1e-300) for k in range(len(sizes))]
    open_by = error(mech, np.zeros(1), loops)
    np.testing.assert_allclose(open_by, 7 * sizes, rtol=8 * U)


# -- between parts that do not move -----------------------------------------------------------------------------------


@functools.cache
def hanging():
    """Two pendulums, one below the other, and a body that is welded to the second."""
    rod = js.SpatialInertia.solid_ellipsoid(np.float64([0.1, 0.05, 0.3]), mass=np.float64(1)).shift(
        np.float64([0, 0, 1])
    )
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("k", "revolute", "a", "b", placed([0, 0, -1]), axis=(0, 1, 0)),
        js.Joint("w", "fixed", "b", "c", placed([0.2, 0, 0])),
    ]
    frames = [("on b", "b", [0.2, 0, 0]), ("on a", "a", [0.3, 0, 0.4]), ("aside", "world", [0.1, 0, 0])]
    frames = [js.Frame(name, on, placed(p)) for name, on, p in frames]
    return js.Mechanism.build([js.Body(x, rod) for x in "abc"], joints, frames, dtype=np.float64)


# The frames of closures that are closed, whatever moves: of the world twice, of one body, of two bodies welded.
STILL = [("world", "world"), ("aside", "aside"), ("a", "a"), ("c", "on b")]
OPEN = [("world", "aside", "ball", 0.1), ("a", "on a", "weld", 0.4), ("c", "b", "ball", 0.2)]


def stepped(mech, q, v, tau, loops):
    return interpreted(lambda *x: js.convex_step(mech, *x, 1e-2, loops=loops))(q, v, tau)


def test_closures_between_parts_that_do_not_move_do_nothing():
    """All of them at once, alone and beside one that acts."""
    mech, n = hanging(), len(STILL)
    q, v, tau = np.float64([0.3, 0.2]), np.float64([1, -2]), np.float64([0.5, 0.1])
    still = [closure(kind, *frames) for frames, kind in zip(STILL, ("weld", "hinge", "universal", "ball"), strict=True)]
    still.append(js.LoopClosure("a", "on a", "distance", 0.5))
    n_rows = sum(x.rows for x in still)
    np.testing.assert_allclose(error(mech, q, still), np.zeros(n_rows), rtol=0, atol=4 * U)
    np.testing.assert_array_equal(rows(mech, q, still), np.zeros((n_rows, mech.nv)))
    closed = interpreted(lambda q: js.close_loops(mech, q, still))(q)
    np.testing.assert_allclose(closed.q, q, rtol=0, atol=4 * U)

    acting = closure("distance", "world", "c")
    for more in ([], [acting]):
        # What acts is last but one.
        both, acts = [*still[:-1], *more, still[-1]], np.arange(n + 1 + len(more)) == (n if more else -1)
        for found, expected in (
            (dynamics(mech, q, v, tau, both), dynamics(mech, q, v, tau, more)),
            (stepped(mech, q, v, tau, both), stepped(mech, q, v, tau, more)),
        ):
            np.testing.assert_allclose(found[0], expected[0], rtol=1e-12)
            wrenches = found.loop_wrenches.to_array()
            np.testing.assert_array_equal(wrenches[~acts], np.zeros((n + 1, 6)))
            if more:
                np.testing.assert_allclose(wrenches[acts], expected.loop_wrenches.to_array(), rtol=1e-9, atol=1e-9)
                assert abs(wrenches).max() > 1


@pytest.mark.parametrize(("a", "b", "kind", "gap"), OPEN)
def test_what_can_never_close_is_refused(a, b, kind, gap):
    """Where its numbers are known. Else errors tell, and nothing else changes."""
    mech, loops = hanging(), [js.LoopClosure(a, b, kind)]
    q, v, tau = np.float64([0.3, 0.2]), np.float64([1, -2]), np.float64([0.5, 0.1])
    calls = {
        "convex_step": lambda mech: js.convex_step(mech, q, v, tau, 1e-2, loops=loops).v,
        "constrained_forward_dynamics": lambda mech: js.constrained_forward_dynamics(mech, q, v, tau, loops).vdot,
        "close_loops": lambda mech: js.close_loops(mech, q, loops).residual,
    }
    for name, call in calls.items():
        message = f"{name}: loops: expected closures that can close, got .*{a!r}, {b!r}.* stays open by {gap}"
        with pytest.raises(ValueError, match=message):
            call(mech)
        with pytest.raises(ValueError, match=message):
            jax.eval_shape(lambda _, call=call: call(mech), q)
    np.testing.assert_allclose(abs(error(mech, q, loops)).max(), gap, rtol=1e-12)
    found = interpreted(lambda mech: [call(mech) for call in calls.values()])(mech)
    plain = interpreted(
        lambda: (js.semi_implicit_step(mech, q, v, tau, 1e-2)[1], js.forward_dynamics(mech, q, v, tau))
    )()
    for a, b in zip(found, (*plain, gap), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


# -- refusals ---------------------------------------------------------------------------------------------------------

REFUSED = {
    "kind": (lambda: js.LoopClosure("A", "B", "hing"), ValueError, "LoopClosure: kind: .*did you mean 'hinge'"),
    "name": (lambda: js.LoopClosure("A", 3, "weld"), TypeError, "LoopClosure: frame_b: expected the name of a frame"),
    "no distance": (lambda: js.LoopClosure("A", "B", "distance"), ValueError, "distance: expected a number above 0"),
    "zero": (lambda: js.LoopClosure("A", "B", "distance", 0.0), ValueError, "distance: .* above 0, got 0.0"),
    "distance of a ball": (lambda: js.LoopClosure("A", "B", "ball", 1.0), ValueError, "expected none for 'ball'"),
    "frame": (
        lambda: js.constraint_error(two_bodies(), two_bodies().neutral(), [js.LoopClosure("A", "b", "ball")]),
        KeyError, "constraint_error: loops: expected one of .* got 'b'; did you mean 'B'",
    ),
    "no closures": (
        lambda: js.close_loops(two_bodies(), two_bodies().neutral(), ["A"]), TypeError, "close_loops: loops: expected",
    ),
    "a bad count": (
        lambda: js.close_loops(two_bodies(), two_bodies().neutral(), [], iterations=-1), ValueError,
        "close_loops: iterations: expected an integer >= 0, got -1",
    ),
    "built": (
        lambda: js.Mechanism.build([], [], loops=[js.LoopClosure("A", "world", "ball")]), KeyError,
        "Mechanism.build: loops: .*'A'",
    ),
    "replaced": (lambda: two_bodies().replace(loops=(closure("ball", "D"),)), KeyError, "Mechanism.replace: loops"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "kind", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(call, kind, message):
    with pytest.raises(kind, match=message):
        call()

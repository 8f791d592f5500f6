"""Spheres on a body against a shape on another: the optimum, laws of mechanics, cases that one works out by hand."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import contact_oracle as oracle
from tests.helpers import contact_pairs as scenes
from tests.helpers.contact_pairs import BOXES, HANDS, LOWER, SQUEEZES, G, Numbers, in_series, mean_friction
from tests.helpers.interpreted import interpreted

# -- random states, and cases of theory, in one program ---------------------------------------------------------------

# Masses that lie up to six decades apart, and surfaces.
ANY = [
    {},
    {"masses": (1.0, 1e3), "stiffness": (1e6, 3e5), "friction": (0.2, 1.5)},
    {"masses": (1e3, 1e-3), "friction": (0.0, 0.7), "relaxation_time": (0.0, 0.1)},
    {"masses": (1e-3, 1.0), "stiffness": (1e3, 1e5), "size": (0.05, 0.4, 0.1)},
]


def any_cases(make, base, n, shape="box", seed=0):
    """n random states of each of ANY, the second half without gravity."""
    found = []
    for k, numbers in enumerate(ANY):
        changes = {x: np.asarray(y, float) for x, y in numbers.items() if make is not scenes.hand or x != "size"}
        own = base._replace(**changes, gravity=base.gravity * (k < len(ANY) // 2))
        states = scenes.states(make, own, n, shape, seed + k)
        found += [scenes.Case(own, scenes.State(*x), np.float64(5e-3)) for x in zip(*states, strict=True)]
    return found


def in_groups(make, cases, shape="box"):
    """(the scene, numbers of cases) of cases with the same Numbers."""
    for _, group in itertools.groupby(range(len(cases)), key=lambda i: id(cases[i].numbers)):
        places = list(group)
        with jax.enable_x64(True):
            yield make(cases[places[0]].numbers, shape), places


@functools.cache
def of_boxes():
    """(cases, ConvexSteps (n, 500)): those of BOXES, and random ones."""
    cases = [*BOXES.values(), *any_cases(scenes.two_bodies, Numbers.of(), 6)]
    return cases, scenes.rolled_out(scenes.two_bodies, cases, 500)


def rolled(name):
    """(the Case, its q and v after each step, forces on contacts with the ground and on the upper box)."""
    i = list(BOXES).index(name)
    found = of_boxes()[1]
    f = found.contact_forces.f[i]
    return BOXES[name], found.q[i], found.v[i], f[:, :4], f[:, 4:]


def against_the_oracle(make, cases, found, shape="box"):
    """Velocities to 1e-8 of the largest, or of what gravity adds; forces to 1e-6. How many pairs push."""
    pushing = 0
    for scene, places in in_groups(make, cases, shape):
        with jax.enable_x64(True):
            mech, dt = scene.mechanism, float(cases[places[0]].dt)
            states = (np.stack(x) for x in zip(*(cases[i].state for i in places), strict=True))
            steps = oracle.steps_of(mech, *states, dt, scene.contacts, oracle.on_plane, scene.pairs)
        for i, expected in zip(places, steps, strict=True):
            q, v, f = found.q[i, 0], found.v[i, 0], found.contact_forces.f[i, 0]
            size = max(abs(expected.v).max(), abs(cases[i].state.v).max(), G * dt)
            after = oracle.in_world(mech, q) @ v
            np.testing.assert_allclose(after, expected.v, rtol=0, atol=1e-8 * size, err_msg=f"{i}")
            largest = max(abs(expected.forces).max(), 1e-3 * cases[i].numbers.masses.min())
            np.testing.assert_allclose(f, expected.forces, rtol=0, atol=1e-6 * largest, err_msg=f"{i}")
            pushing += np.count_nonzero(f[len(scene.contacts.frames) :].any(1))
    return pushing


def test_boxes_are_at_the_optimum():
    """Of masses up to six decades apart; the surfaces give way each by its share."""
    cases, found = of_boxes()
    first = jax.tree.map(lambda x: x[len(BOXES) :], found)
    assert against_the_oracle(scenes.two_bodies, cases[len(BOXES) :], first) > 15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "base", "shape"),
    [
        *((scenes.two_bodies, Numbers.of(), x) for x in scenes.SHAPES),
        (scenes.hand, scenes.HELD, "cylinder"),
        (scenes.hand, scenes.HELD, "box"),
        (scenes.arm, Numbers.of(), "box"),
    ],
)
def test_two_hundred_states_are_at_the_optimum(make, base, shape):
    cases = any_cases(make, base, 50, shape, seed=10)
    assert against_the_oracle(make, cases, scenes.rolled_out(make, cases, 1, shape), shape) > 100


def test_impulses_are_what_momenta_change_by():
    """The third law: of each body by the forces about the points of the report, on a pair the same with both signs."""
    cases, found = of_boxes()
    cases, found = cases[len(BOXES) :], jax.tree.map(lambda x: x[len(BOXES) :, 0], found)
    points = []
    for scene, places in in_groups(scenes.two_bodies, cases):
        q, v = (np.stack([getattr(cases[i].state, x) for i in places]) for x in "qv")
        with jax.enable_x64(True):
            points += list(_reported(scene, q, v).points)
    turned = 0.0
    for i, (numbers, (q, v, _), dt) in enumerate(cases):
        f = found.contact_forces.f[i]
        # On the lower box, on the upper one.
        on_bodies = [np.concatenate([f[:4], -f[4:]]), f[4:]]
        at = [points[i], points[i][4:]]
        for k, size in enumerate((LOWER, numbers.size)):
            m, rows, places = numbers.masses[k], slice(6 * k, 6 * k + 6), slice(7 * k, 7 * k + 7)
            R, R_after = (oracle._rotation(x[places][:4]) for x in (q, found.q[i]))
            inertia = R @ np.diag((size**2).sum() - size**2) @ R.T * m / 12
            w, p_rate = (R @ x for x in v[rows].reshape(2, 3))
            w_after, rate_after = (R_after @ x for x in found.v[i][rows].reshape(2, 3))
            impulse = dt * (on_bodies[k].sum(0) + m * numbers.gravity)
            of_turning = dt * (np.cross(at[k] - q[places][4:], on_bodies[k]).sum(0) - np.cross(w, inertia @ w))
            size_of = max(abs(dt * f).max(), m * G * dt)
            np.testing.assert_allclose(m * (rate_after - p_rate), impulse, rtol=0, atol=1e-9 * size_of)
            np.testing.assert_allclose(inertia @ (w_after - w), of_turning, rtol=0, atol=1e-9 * size_of)
            turned = max(turned, abs(of_turning).max() / size_of)
    assert turned > 0.01


def _reported(scene, q, v):
    """The ContactReport of states."""
    mech = scene.mechanism
    report = functools.partial(js.contact_report, mech, contacts=scene.contacts, pairs=scene.pairs)
    return interpreted(jax.vmap(report))(q, v)


def hostile(n, dtype):
    """Numbers of n scenes: of sizes from a micrometre to a kilometre, with masses six decades apart; spheres far inside
    shapes, and with the same centre; at rest, fast, and far from the origin."""
    rng = np.random.default_rng(11)
    scale = np.where(np.arange(n) % 2, 10.0 ** rng.uniform(-6, 3, n), 10.0 ** rng.uniform(-2, 0, n))[:, None]
    q = np.zeros((n, 14))
    q[:, :4], q[:, 7:11] = rng.normal(size=(2, n, 4))
    q[::3, :4] = q[::3, 7:11] = 1, 0, 0, 0
    q[:, :4], q[:, 7:11] = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (q[:, :4], q[:, 7:11]))
    q[:, 4:7] = scale * rng.normal(size=(n, 3)) * rng.choice([0, 1, 100.0], (n, 1))
    q[:, 11:] = q[:, 4:7] + 0.4 * scale * rng.normal(size=(n, 3)) * rng.choice([0, 1e-6, 1.0, 1.0], (n, 1))
    v = rng.normal(size=(n, 12)) * rng.choice([0, 1e-3, 1.0], (n, 1)) * np.where(np.arange(12) % 6 < 3, 1, scale)
    masses = 10.0 ** rng.uniform(-3, 3, (n, 2))
    sides = scale[:, None] * rng.uniform(0.2, 1, (n, 2, 3))
    positions = 0.3 * scale[:, None, None] * rng.normal(size=(n, 2, 2, 3)) * (rng.random((n, 2, 2, 1)) < 0.7)
    numbers = {
        "q": q, "v": v, "dt": rng.choice([1e-4, 5e-3, 2e-2], n), "masses": masses, "sides": sides,
        "size": scale * rng.uniform(0.2, 1, (n, 3)), "turned": rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.7),
        "positions": positions, "radius": scale[:, None] * rng.choice([0, 0.1, 0.5], (n, 2, 2)),
        "stiffness": 10.0 ** rng.uniform(1, 6, (n, 2)), "friction": rng.choice([0, 0.3, 1, 3.0], (n, 2)),
        "relaxation_time": 10.0 ** rng.uniform(-4, -1, (n, 2)) * (rng.random((n, 2)) < 0.8),
    }  # fmt: skip
    return {k: x.astype(dtype) for k, x in numbers.items()}


HOSTILE = {
    "box": lambda s, X: js.Box(s, X),
    "sphere": lambda s, X: js.Sphere(s[0], X),
    "capsule": lambda s, X: js.Capsule(s[0], s[1], X),
    "cylinder": lambda s, X: js.Cylinder(s[0], s[1], X),
    "half space": lambda s, X: js.HalfSpace(X.rotation.to_matrix()[2], 0 * s[0]),
    "own": lambda s, X: js.SignedDistance(
        lambda p: jnp.maximum(jnp.maximum(abs(p[0]), abs(p[1])), abs(p[2])) - s[0], X
    ),
    "points": None,
}


@pytest.mark.parametrize(
    ("kind", "dtype"),
    [
        pytest.param(kind, dtype, marks=[] if (kind, dtype) == ("own", np.float32) else pytest.mark.slow)
        for kind, dtype in itertools.product(HOSTILE, (np.float32, np.float64))
    ],
)
def test_hostile_numbers_leave_all_finite(kind, dtype):
    """Nothing is NaN; momentum is kept, forces push, within the cone of friction, along normals of unit length. In
    float64 each step is at its optimum: the momenta of a body change by the forces."""
    n, make = 200 if kind != "own" else 60, HOSTILE[kind]
    numbers = hostile(n, dtype)
    zero = np.zeros(12, dtype)

    def step(x):
        mech = MECH.astype(dtype).replace(gravity=zero[:3])
        M = jax.vmap(lambda size, mass: js.SpatialInertia.solid_box(size, mass=mass))(x["sides"], x["masses"])
        X = js.RigidTransform(js.Rotation.exp(x["turned"]), 0.1 * x["size"])
        law = [{k: x[k][i] for k in ("stiffness", "relaxation_time", "friction")} for i in range(2)]
        a, b = (
            js.PointContacts([k] * 2, x["positions"][i], x["radius"][i], **law[i])
            for i, k in enumerate(("lower", "upper"))
        )
        pairs = (a if make is None else js.ShapeContacts(["lower"] * 2, make(x["size"], X), **law[0])), b
        mech = mech.replace(inertias=M)
        after = js.convex_step(mech, x["q"], x["v"], zero, x["dt"], pairs=pairs)
        speeds = [
            jnp.stack([js.Rotation.from_quaternion(q[7 * k : 7 * k + 4]) @ v[6 * k + 3 : 6 * k + 6] for k in range(2)])
            for q, v in ((x["q"], x["v"]), after[:2])
        ]
        return after, js.contact_report(mech, x["q"], x["v"], pairs=pairs), *speeds

    with jax.enable_x64(True):
        after, report, before, then = interpreted(jax.vmap(step))(numbers)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves((after, report)))
    u = np.finfo(dtype).eps / 2
    m, f = numbers["masses"].astype(float)[..., None], after.contact_forces.f.astype(float)
    impulse = numbers["dt"].astype(float)[:, None, None] * f
    change, size = (
        m * (then.astype(float) - before),
        (m * (abs(then) + abs(before))).sum((1, 2)) + abs(impulse).sum((1, 2)),
    )
    size = np.maximum(size, np.finfo(dtype).tiny)[:, None]
    assert (abs(change.sum(1)) < 256 * u * size).all()
    along = (f * report.normals).sum(-1)
    mu = mean_friction(Numbers.of()._replace(friction=numbers["friction"].astype(float).T + 1e-300))
    across, largest = np.linalg.norm(f - along[..., None] * report.normals, axis=-1), abs(f).max((1, 2), initial=1e-300)
    assert (along >= 0).all() and (across - mu[:, None] * along < 4096 * u * largest[:, None]).all()
    assert abs(np.linalg.norm(report.normals, axis=-1) - 1).max() < 8 * u
    assert (abs(f).max(-1) > 0).sum() > n / 4
    if dtype == np.float64:
        assert (abs(change[:, 1] - impulse.sum(1)) < 1e-7 * size).all() and after.residual.max() < 1e-6


# -- what one works out -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rests", "heavy on light", "light on heavy"])
def test_a_stack_rests(name):
    """Forces carry the weights, and contacts give way by as much: of two surfaces in series."""
    (numbers, _, _), q, v, on_ground, on_upper = rolled(name)
    weights = G * numbers.masses
    # The light one takes its time.
    assert abs(v[-1]).max() < 1e-7
    np.testing.assert_allclose(on_ground[-1].sum(0), [0, 0, weights.sum()], rtol=1e-6, atol=1e-6 * weights.sum())
    np.testing.assert_allclose(on_upper[-1].sum(0), [0, 0, weights[1]], rtol=1e-6, atol=1e-6 * weights[1])
    sunk = LOWER[2] / 2 - q[-1, 6], (LOWER[2] + numbers.size[2]) / 2 - (q[-1, 13] - q[-1, 6])
    expected = weights.sum() / (4 * numbers.stiffness[0]), weights[1] / (4 * in_series(numbers))
    np.testing.assert_allclose(sunk, expected, rtol=1e-5)


def test_a_box_slides_as_far_as_friction_lets_it():
    """v^2 / (2 mu g), with the friction of both surfaces; what it slides on stays."""
    (numbers, state, _), q, v, _, _ = rolled("slides")
    expected = state.v[9] ** 2 / (2 * mean_friction(numbers) * G)
    np.testing.assert_allclose(q[-1, 11] - state.q[11], expected, rtol=0.02)
    assert abs(v[-1]).max() < 1e-4 and abs(q[-1, 4:6]).max() < 1e-3


def test_a_box_slips_on_a_slope_beyond_the_angle_of_friction():
    """And before it creeps: with g (sin - mu cos) it slides down."""
    (numbers, _, dt), _, v, _, _ = rolled("sticks")
    assert 0 <= v[-1, 9] < 2e-3 * dt * G
    (numbers, _, dt), _, v, _, _ = rolled("slips")
    g, n = numbers.gravity, 300
    friction = (g[0] - v[n - 1, 9] / (n * dt)) / -g[2]
    np.testing.assert_allclose(friction, mean_friction(numbers), rtol=0.02)


def test_a_box_tips_where_its_weight_leaves_its_foot():
    """On a slope of tan = width / height, by 4 % more and less."""
    for name, tips in (("stands", False), ("tips", True)):
        _, q, _, _, _ = rolled(name)
        tilt = 2 * np.arccos(np.minimum(1, abs(q[:, 7])))
        assert (tilt.max() > 0.5) == tips, name
        assert tilt.max() > 0.5 or tilt[-1] < 1e-3


def test_a_box_that_falls_on_another_loses_energy():
    """Kinetic, potential and elastic: in a step it rises by what is newly found inside, at most; else it never does."""
    (numbers, state, _), q, v, _, _ = rolled("falls")
    with jax.enable_x64(True):
        scene = scenes.two_bodies(numbers)
        mech = scene.mechanism
        q, v = np.concatenate([state.q[None], q]), np.concatenate([state.v[None], v])
        depth = _reported(scene, q, v).depths
        energy = interpreted(jax.vmap(lambda q, v: js.kinetic_energy(mech, q, v) + js.potential_energy(mech, q)))(q, v)
    k = np.repeat([numbers.stiffness[0], in_series(numbers)], 4)
    elastic = k * np.maximum(depth, 0) ** 2 / 2
    is_new = (depth[:-1] < 0) & (depth[1:] >= 0)
    rise = np.diff(energy + elastic.sum(1)) - (elastic[1:] * is_new).sum(1)
    # It falls by 0.1 m, and turns.
    assert is_new[:, 4:].sum() >= 4 and energy[0] - energy[-1] > numbers.masses[1] * G * 0.1
    # Normals turn with the box below.
    assert rise.max() < 1e-6 * energy[0]


# -- hands ------------------------------------------------------------------------------------------------------------


@functools.cache
def of_hands():
    return scenes.rolled_out(scenes.hand, list(HANDS.values()), 200, "cylinder")


@pytest.mark.parametrize("name", HANDS)
def test_a_hand_holds_what_friction_carries(name):
    """A cylinder between two fingers: mu N of each against half of its weight, and of what lifts it."""
    i, (numbers, state, dt) = list(HANDS).index(name), HANDS[name]
    found = jax.tree.map(lambda x: x[i], of_hands())
    squeeze, lift = SQUEEZES.get(name, (1.05, 0.0))
    mass, N, n = numbers.masses[1], state.tau[1], len(found.q)
    f = found.contact_forces.f[:, 3:]
    slip = found.v[-1, 0] - found.v[-1, 8]
    if squeeze > 1:
        assert abs(slip) < 1e-3 * max(1, numbers.masses[1] / numbers.masses[0]) * dt * (G + lift)
        # The damping of the lift is some of it.
        np.testing.assert_allclose(-f[-1].sum(0), [0, 0, mass * (G + lift)], rtol=0, atol=0.05 * mass * (G + lift))
        np.testing.assert_allclose(f[-1, :2, 1].sum(), -N, rtol=1e-3)
        assert lift == 0 or found.q[-1, 9] - state.q[9] > 0.9 * lift * (n * dt) ** 2 / 2
    else:
        friction = mass * (G + found.v[-1, 8] / (n * dt)) / (2 * N)
        np.testing.assert_allclose(friction, mean_friction(numbers), rtol=0.03)
        assert slip > 0.8 * 0.1 * (G + lift) * n * dt


# -- a robot that touches itself --------------------------------------------------------------------------------------

FOLDED = """<robot name="folded">
  <link name="base"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.4 0.4 0.2"/></geometry></collision></link>
  <link name="upper"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="lower"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><capsule radius="0.03" length="0.2"/></geometry></collision></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.22"/><axis xyz="0 1 0"/></joint>
</robot>"""


def folded():
    """(the mechanism, pairs: the ends of the capsule on its last link against the box of its base, a state)."""
    with jax.enable_x64(True):
        mech = js.Mechanism.from_urdf(FOLDED, floating_base=True, dtype=np.float64)
        law = {"stiffness": np.float64(1e4), "relaxation_time": np.float64(0.01)}
        ends = js.PointContacts.from_urdf(mech, FOLDED, bodies=["lower"], friction=np.float64(0.8), **law)
        base = js.ShapeContacts(["base"] * 2, js.Box(np.array([0.4, 0.4, 0.2])), friction=np.float64(0.4), **law)
    q = np.array([0.9, 0.1, -0.2, 0.3, 0, 0, 5.0, 0.0, np.pi - 0.3])
    q[:4] /= np.linalg.norm(q[:4])
    v = np.array([0.1, -0.2, 0.3, 0.1, 0.2, -0.1, 1.0, -0.5])
    return mech, (base, ends), q, v


def test_a_robot_that_touches_itself():
    """By the names of links and the shapes of its file: at the optimum, and without a force on the whole robot."""
    mech, pairs, q, v = folded()
    tau, dt = np.zeros(8), 5e-3
    ends = pairs[1]
    with jax.enable_x64(True):
        touching, free = (
            interpreted(lambda q, v, given=given: js.convex_step(mech, q, v, tau, dt, contacts=ends, **given))(q, v)
            for given in ({"pairs": pairs}, {})
        )
        (expected,) = oracle.steps_of(mech, q[None], v[None], tau[None], dt, ends, pairs=pairs)
        momenta = []
        for after in (touching, free):
            # Along the axes at the old q, where momentum is what impulses change.
            along = oracle.in_world(mech, q).T @ oracle.in_world(mech, after.q) @ after.v
            momenta.append(interpreted(lambda v: js.centroidal_momentum(mech, q, v).to_array())(along))
    np.testing.assert_allclose(oracle.in_world(mech, touching.q) @ touching.v, expected.v, rtol=0, atol=1e-9)
    np.testing.assert_allclose(touching.contact_forces.f, expected.forces, rtol=0, atol=1e-6)
    f = touching.contact_forces.f
    assert not f[:3].any() and np.linalg.norm(f[3]) > 1 and abs(touching.v - free.v).max() > 0.01
    np.testing.assert_allclose(*momenta, rtol=0, atol=1e-10)
    # It slides: with the friction of both surfaces.
    n = np.asarray(oracle._rotation(q[:4]))[:, 2]
    across = f[3] - (f[3] @ n) * n
    np.testing.assert_allclose(np.linalg.norm(across) / (f[3] @ n), 2 * 0.8 * 0.4 / 1.2, rtol=1e-6)


def test_a_report_of_one_state_is_that_of_the_definitions():
    """Compiled, of a single state: depth, point and speeds of the ends of the capsule over the box."""
    mech, pairs, q, v = folded()
    with jax.enable_x64(True):

        def report(q, v):
            return js.contact_report(mech, q, v, pairs=pairs)

        found, same = jax.tree.map(np.asarray, (jax.jit(report)(q, v), interpreted(report)(q, v)))
        X = interpreted(lambda q: js.forward_kinematics(mech, q, ["base", "lower"]))(q)
        V = interpreted(lambda q, v: js.body_velocities(mech, q, v).to_array())(q, v)
        R, p = np.asarray(X.rotation.to_matrix()), X.translation
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(same), strict=True):
        np.testing.assert_array_equal(a, b)
    names = list(mech.body_names)
    of_base, of_lower = V[names.index("base")], V[names.index("lower")]
    touching = 0
    for i, end in enumerate(pairs[1].positions):
        center = p[1] + R[1] @ end
        local = R[0].T @ (center - p[0])
        n, distance = oracle.surface(js.Box(np.array([0.4, 0.4, 0.2])), local)
        n, depth = R[0] @ n, 0.03 - distance
        # Both surfaces are as stiff.
        C = center - (0.03 - depth / 2) * n
        speed = of_lower[3:] + np.cross(of_lower[:3], C - p[1]) - of_base[3:] - np.cross(of_base[:3], C - p[0])
        np.testing.assert_allclose(found.depths[i], depth, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.points[i], C, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.normals[i], n, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.approach[i], -n @ speed, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.slip[i], speed - (n @ speed) * n, rtol=0, atol=1e-13)
        assert found.touches[i] == (depth >= 0)
        touching += depth >= 0
    assert touching == 1


# -- shapes and spheres -----------------------------------------------------------------------------------------------

LAW = {"stiffness": np.float64(2e4), "relaxation_time": np.float64(0.01), "friction": np.float64(0.5)}
PAIR = js.ShapeContacts(["lower"] * 8, js.Box(LOWER), **LAW), js.PointContacts(["upper"] * 8, radius=0.1, **LAW)
Q = np.array([1.0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0.245])
with jax.enable_x64(True):
    MECH = scenes.two_bodies(Numbers.of()).mechanism


@pytest.mark.slow
def test_a_ball_on_a_body_is_the_sphere_that_it_is():
    """By both ways, velocities and forces, and points, of surfaces that are not as stiff."""
    rng = np.random.default_rng(0)
    q = np.tile(Q, (3, 1)) + 0.02 * rng.normal(size=(3, 14))
    v, at = 0.3 * rng.normal(size=(3, 12)), np.array([0.02, 0.01, 0.03])
    q[:, :4], q[:, 7:11] = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (q[:, :4], q[:, 7:11]))
    with jax.enable_x64(True):
        X = js.RigidTransform(js.Rotation.identity((), np.float64), at)
        shape = js.ShapeContacts(["lower"], js.Sphere(np.float64(0.15), X), **LAW)
        sphere = js.PointContacts(["lower"], at[None], np.float64(0.15), **LAW)
        b = js.PointContacts(["upper"], None, np.float64(0.12), **LAW | {"stiffness": np.float64(1e5)})

        def of(a):
            def step(q, v):
                after = js.convex_step(MECH, q, v, np.zeros(12), 5e-3, pairs=(a, b))
                return after.v, after.contact_forces.f, js.contact_report(MECH, q, v, pairs=(a, b)).points

            return interpreted(jax.vmap(step))(q, v)

        found, expected = of(shape), of(sphere)
    assert (np.linalg.norm(found[1], axis=-1) > 1).all()
    for x, y in zip(found, expected, strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-8 * max(1, abs(y).max()))


def test_a_distance_of_ones_own_is_the_shape_that_it_is():
    """A function in the frame of a body, alone and in a union, placed in that frame, and derivatives by what it closes
    over; as the ground, too."""
    X, v = scenes._placed([0.3, 0.2, 0.1], [0.02, 0.01, 0.03]), 0.3 * np.random.default_rng(0).normal(size=12)

    def own(radius):
        return js.SignedDistance(lambda p: jnp.sqrt((p**2).sum()) - radius, X)

    def ours(radius):
        return js.Sphere(radius, X)

    def union(radius):
        return js.Union([ours(0.5 * radius), own(radius)])

    b = js.PointContacts(["upper"] * 2, np.array([[0.02, 0, 0], [0, 0.03, -0.01]]), 0.12, **LAW)

    def pairs(radius, shape):
        return js.ShapeContacts(["lower"] * 2, shape(radius), **LAW), b

    def step(v, shape):
        after = js.convex_step(MECH, Q, v, np.zeros(12), 5e-3, pairs=pairs(0.15, shape))
        return after.v, after.contact_forces.f

    def reported(radius, shape):
        return js.contact_report(MECH, Q, v, b, shape(radius), pairs=pairs(radius, shape))[:5]

    with jax.enable_x64(True):
        steps = [interpreted(functools.partial(step, shape=shape))(v) for shape in (ours, own)]
        reports = [
            interpreted(lambda r, f=f: jax.jvp(lambda r: reported(r, f), (r,), (1.0,)))(0.15)
            for f in (ours, own, union)
        ]
        assert repr(own(1.0)).startswith("SignedDistance(<function") and own(1.0).dtype == np.float64
        assert js.SignedDistance(lambda p: p[2]).astype(np.float32).dtype == np.float32
        np.testing.assert_array_equal(jax.jit(lambda shape: shape(np.ones(3)))(js.SignedDistance(lambda p: p[2])), 1)
    assert (np.linalg.norm(steps[0][1], axis=-1) > 1).all() and (reports[0][1][2] == 1).all()
    for expected, *others in (steps, reports):
        for found in others:
            for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
                np.testing.assert_allclose(x, y, rtol=0, atol=1e-9 * max(1, abs(y).max()))


def test_frames_of_the_world_take_part():
    """A shape on the world as the ground that it is; spheres on the world in a shape that falls on them; and in one
    step with a pair of two bodies, whose order differs: the optimum, and forces on the bodies of b."""
    rng = np.random.default_rng(3)
    q, v = np.tile(Q, (4, 1)), 0.3 * rng.normal(size=(4, 12))
    q[:, 1:4], q[:, 8:11] = 0.05 * rng.normal(size=(2, 4, 3))
    q[:, :4], q[:, 7:11] = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (q[:, :4], q[:, 7:11]))
    floor, box = js.Box(np.array([1.0, 1.0, 0.2])), js.Box(np.array(LOWER))
    with jax.enable_x64(True):
        X = js.RigidTransform(js.Rotation.identity((), np.float64), np.array([0.0, 0.0, -0.12]))
        low = np.array([[0.05, 0.03, -0.06], [-0.05, 0.02, -0.05]])

        def step(**given):
            return interpreted(jax.vmap(lambda q, v: js.convex_step(MECH, q, v, np.zeros(12), 5e-3, **given)))(q, v)

        # Of two surfaces one that does not give way.
        law = {"relaxation_time": np.float64(0), "friction": 0.7}
        soft = js.PointContacts(["lower"] * 2, low, 0.01, **law | {"stiffness": 1e4, "relaxation_time": 0.02})
        ground = step(contacts=soft, ground=js.Box(floor.size, X))
        table = js.ShapeContacts(["world"] * 2, js.Box(floor.size, X), stiffness=1e30, **law)
        found = step(pairs=(table, soft))
        np.testing.assert_allclose(found.v, ground.v, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.contact_forces.f, ground.contact_forces.f, rtol=0, atol=1e-7)
        assert (found.contact_forces.f[..., 2] > 1).any()

        frames = ["upper", "world", "world"], ["lower", "lower", "upper"]
        spheres = js.PointContacts(frames[0], np.array([[0, 0, -0.1], [0.1, 0, -0.09], [0, 0.05, 0.13]]), 0.05, **LAW)
        pairs = js.ShapeContacts(frames[1], box, **LAW), spheres
        found = step(pairs=pairs)
        report = interpreted(jax.vmap(lambda q, v: js.contact_report(MECH, q, v, pairs=pairs)))(q, v)
        expected = oracle.steps_of(MECH, q, v, np.zeros((4, 12)), 5e-3, spheres, lambda p: p[2] + 9, pairs)
        f = found.contact_forces.f
        for i, own in enumerate(expected):
            after = oracle.in_world(MECH, found.q[i]) @ found.v[i]
            np.testing.assert_allclose(after, own.v, rtol=0, atol=1e-8 * abs(own.v).max())
            np.testing.assert_allclose(f[i], own.forces[3:], rtol=0, atol=1e-6 * abs(own.forces).max())
        np.testing.assert_array_equal(report.touches, np.linalg.norm(f, axis=-1) > 0)
        assert (report.touches.sum(0) > 0).all()
        # Balls are alike: their order turns the force about, and nothing else.
        a, b = (js.PointContacts([x], k * low[:1], 0.15, **LAW) for x, k in (("lower", 1), ("world", -1)))
        one, other = step(pairs=(a, b)), step(pairs=(b, a))
        np.testing.assert_allclose(one.v, other.v, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.contact_forces.f, -other.contact_forces.f, rtol=0, atol=1e-9)
        assert (np.linalg.norm(one.contact_forces.f, axis=-1) > 1).all()


def on_tables(n):
    """(a state of n environments, the places of their tables and how these are turned, pairs from both)."""
    rng = np.random.default_rng(4)
    q, v, w = np.tile(Q, (n, 1)), 0.3 * rng.normal(size=(n, 12)), 0.1 * rng.normal(size=(n, 3))
    q[:, 1:4] = 0.1 * rng.normal(size=(n, 3))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    p = np.array([0, 0, -0.16]) + 0.01 * rng.normal(size=(n, 3))
    at = np.array([[0.05, 0.03, -0.06], [-0.05, 0.02, -0.05], [0.0, 0.0, 0.0]])

    def pairs(p, w):
        X = js.RigidTransform(js.Rotation.exp(w), p)
        table = js.ShapeContacts(["world"] * 3, js.Box(np.array([1.0, 1.0, 0.2]), X), **LAW)
        return table, js.PointContacts(["lower", "lower", "upper"], at, 0.02, **LAW)

    return (q, v), (p, w), pairs


def test_each_environment_has_a_table_of_its_own():
    """By vmap over its placement: what it has alone, and gradients by it, against differences."""
    n, h = 3, 1e-6
    state, table, pairs = on_tables(n)
    weights, along = np.random.default_rng(5).normal(size=(2, 12))
    with jax.enable_x64(True):

        def value(table, q, v):
            return weights @ js.convex_step(MECH, q, v, np.zeros(12), 5e-3, pairs=pairs(*table)).v

        found, slopes = interpreted(jax.vmap(jax.value_and_grad(value)))(table, *state)
        moved = [x + s * d for s in (h, -h) for x, d in zip(table, (along[:3], along[3:6]), strict=True)]
        both = [np.concatenate(x) for x in ((table[0], *moved[::2]), (table[1], *moved[1::2]))]
        values = interpreted(jax.vmap(value))(both, *(np.tile(x, (3, 1)) for x in state)).reshape((3, n))
        alone = interpreted(value)(*(jax.tree.map(lambda x: x[1], x) for x in ((table), *state)))
    np.testing.assert_allclose(found, values[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[1], alone, rtol=0, atol=1e-12)
    own = slopes[0] @ along[:3] + slopes[1] @ along[3:6]
    assert abs(own).min() > 0.1
    np.testing.assert_allclose(own, (values[1] - values[2]) / (2 * h), rtol=0, atol=1e-6 * abs(own).max())


def test_a_report_of_many_environments_is_that_of_each():
    """All that is reported of spheres on the ground, beside pairs with a table of each environment, and of balls."""
    n = 4
    state, table, on_table = on_tables(n)
    rng = np.random.default_rng(6)
    f = rng.normal(size=(n, 6, 3)) + np.array([0, 0, 2.0])
    feet = js.PointContacts(["lower", "upper", "upper"], 0.1 * rng.normal(size=(3, 3)), 0.05, **LAW)
    balls = [js.PointContacts([x] * 3, 0.05 * rng.normal(size=(3, 3)), 0.12, **LAW) for x in ("lower", "upper")]
    with jax.enable_x64(True):
        for pairs in (on_table, lambda *_: tuple(balls)):

            def report(q, v, f, table, pairs=pairs):
                forces = js.SpatialForce(0 * f, f)
                return js.contact_report(MECH, q, v, feet, pairs=pairs(*table), forces=forces, dt=5e-3)

            given = *state, f, table
            found = interpreted(jax.vmap(report))(*given)
            each = [interpreted(report)(*(jax.tree.map(lambda x, i=i: x[i], x) for x in given)) for i in range(n)]
            for name, own, expected in zip(found._fields, found, zip(*each, strict=True), strict=True):
                np.testing.assert_array_equal(own, np.stack(expected), err_msg=name)
            assert 0 < found.touches[:, 3:].sum() < 3 * n and 0 < found.sticks.sum() < 6 * n


@pytest.mark.slow
def test_contacts_are_as_hard_whatever_is_known():
    """Numbers of a mechanism may be arguments: the axes of a floating root count, which is free of damping or not."""
    q, v = Q.copy(), np.zeros(12)
    q[:4], q[7:11], v[9:] = [0.8, 0.3, -0.4, 0.33], [0.9, -0.1, 0.3, 0.3], [0.3, 0.2, -0.2]
    q[:4], q[7:11] = (x / np.linalg.norm(x) for x in (q[:4], q[7:11]))
    pair = [js.PointContacts([x], radius=np.float64(0.13), **LAW) for x in ("lower", "upper")]
    with jax.enable_x64(True):

        def step(mech):
            return js.convex_step(mech, q, v, np.zeros(12), 5e-3, pairs=tuple(pair)).v

        known = interpreted(lambda v: step(MECH) + 0 * v)(v)
        found = interpreted(step)(MECH)
    np.testing.assert_allclose(found, known, rtol=0, atol=1e-11)
    assert abs(known - v).max() > 0.1


def test_derivatives_are_differences():
    """By the state, and all numbers of the shape, of the spheres and of both surfaces."""
    rng = np.random.default_rng(1)
    along = (
        rng.normal(size=24),
        0.3 * np.array([1.0, -0.7, 0.8]),
        rng.normal(size=(1, 3)) * 0.1,
        *rng.normal(size=(3, 2)),
    )
    corners = scenes.corners(np.array([0.3, 0.2, 0.2]), (-1,))[:1]
    q = Q.copy()
    q[8:11], q[13] = [0.02, 0.01, 0.05], 0.197
    with jax.enable_x64(True):
        q[7:11] /= np.linalg.norm(q[7:11])

        def of(s, v):
            x, size, p, *surfaces = (s * y for y in along)
            k = np.array([2e4, 5e4]) * (1 + surfaces[0])
            tau_d = np.array([0.01, 0.02]) * (1 + surfaces[1])
            mu = np.array([0.4, 0.7]) * (1 + surfaces[2])
            law = [{"stiffness": k[i], "relaxation_time": tau_d[i], "friction": mu[i]} for i in range(2)]
            pairs = (
                js.ShapeContacts(["lower"], js.Box(LOWER + size), **law[0]),
                js.PointContacts(["upper"], corners + p, 0.01 + p[:, 0], **law[1]),
            )
            after = js.convex_step(
                MECH, js.integrate(MECH, q, x[:12], 1.0), v + x[12:], np.zeros(12), 5e-3, pairs=pairs
            )
            return after.v, after.contact_forces.f

        # It sticks, and it slides.
        v = np.zeros((2, 12))
        v[1, 9:] = 0.5, 0.3, -0.2
        h = 1e-6
        # In one program: values behind and ahead, and the derivative in between.
        both = jax.vmap(lambda s, v: jax.jvp(lambda s: of(s, v), (s,), (1.0,)))
        values, slopes = interpreted(both)(np.repeat([-h, 0, h], 2), np.tile(v, (3, 1)))
    for x, own in zip(values, slopes, strict=True):
        own = own[2:4]
        assert (np.linalg.norm(own.reshape((2, -1)), axis=1) > 0.1).all()
        np.testing.assert_allclose(own, (x[4:] - x[:2]) / (2 * h), rtol=0, atol=1e-5 * abs(own).max())
    assert (np.linalg.norm(values[1], axis=-1) > 1).all()


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: js.ShapeContacts("a", js.Sphere(1.0), **LAW), TypeError, "ShapeContacts: frames: expected a sequence"),
        (lambda: js.SignedDistance(3), TypeError, "SignedDistance: function: expected a function from a point"),
        (lambda: js.SignedDistance(abs, np.eye(4)), TypeError, "SignedDistance: placement: expected a RigidTransform"),
        (
            lambda: js.SignedDistance(lambda p: p)(np.zeros(3)),
            ValueError,
            r"SignedDistance: function: expected a number, float64\[\], of a point float64\[3\], got",
        ),
        (lambda: js.ShapeContacts(["a"], 3, **LAW), TypeError, "ShapeContacts: shape: expected a shape, such as"),
        (
            lambda: js.ShapeContacts(["a"] * 2, js.Sphere(np.ones(3)), **LAW),
            ValueError,
            r"ShapeContacts: shape: expected one, or a batch \(\*batch, 2\), got \(3,\)",
        ),
        (
            lambda: js.ShapeContacts(["a"], js.Sphere(np.float64(1)), **LAW | {"friction": -1.0}),
            ValueError,
            "ShapeContacts: friction: expected numbers of at least 0, got -1.0",
        ),
        (
            lambda: js.convex_step(MECH, Q, np.zeros(12), np.zeros(12), 5e-3, pairs=PAIR[::-1]),
            TypeError,
            "convex_step: pairs: expected PointContacts, got ShapeContacts",
        ),
        (
            lambda: js.convex_step(
                MECH, Q, np.zeros(12), np.zeros(12), 5e-3,
                pairs=(js.ShapeContacts(["upper"] * 8, js.Box(LOWER), **LAW), PAIR[1]),
            ),
            ValueError,
            "pairs: expected frames of two bodies, got 'upper' and 'upper', of one",
        ),
        (
            lambda: js.convex_step(
                MECH, Q, np.zeros(12), np.zeros(12), 5e-3, pairs=[js.PointContacts(["world"], **LAW)] * 2
            ),
            TypeError,
            r"pairs: expected \(a, b\)",
        ),
        (
            lambda: js.convex_step(
                MECH, Q, np.zeros(12), np.zeros(12), 5e-3, pairs=(js.PointContacts(["world"], **LAW),) * 2
            ),
            ValueError,
            "pairs: expected frames of two bodies, got 'world' and 'world', of the world",
        ),
    ],
)  # fmt: skip
def test_what_is_refused(make, error, message):
    with jax.enable_x64(True), pytest.raises(error, match=message):
        make()

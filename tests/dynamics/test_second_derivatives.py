"""Second derivatives, against differences of first ones: of every function of a mechanism, and of the convex step with
each kind of term, by each of its arguments."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.dynamics import test_fields as fields
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def along(function):
    """(x, d, t) -> the first and the second derivative of s -> function(x + s d) at t, for trees x and d."""

    def of_line(x, d, t):
        return function(jax.tree.map(lambda a, b: a + t * b, x, d))

    def both(x, d, t):
        return jax.jvp(lambda t: jax.jvp(lambda s: of_line(x, d, s), (t,), (1.0,))[1], (t,), (1.0,))

    return both


# -- every function of a mechanism ------------------------------------------------------------------------------------

STEP = 1e-4
# `fields.test_all_are_drawn` holds that these are all. What takes longest to trace is made of others.
LONG = "rk4_step", "symplectic_step", "forward_dynamics_derivatives", "inverse_dynamics_derivatives"
MECHANISMS = {"turning": ["planar on -1"], "planar": fields.MECHANISMS["planar"]}


@functools.cache
def mechanism(name):
    """With bodies, joints and frames as those of `fields`."""
    rng, parts = np.random.default_rng(0), [text.split() for text in MECHANISMS[name]]
    bodies = [js.Body(f"body{i}", fields.inertia(rng)) for i in range(len(parts))]
    joints = [fields.joint(rng, i, *words) for i, words in enumerate(parts)]
    frames_ = [js.Frame(f"tool{i}", f"body{i}", fields.pose(rng)) for i in range(len(parts))]
    mech = js.Mechanism.build(bodies, joints, [*frames_, fields.POST], rng.standard_normal(3), np.float64)
    return mech.replace(lower=np.full(mech.nq, 0.3), upper=np.full(mech.nq, -0.2))


def from_elsewhere(m, q, v, a):
    return js.difference(m, q, js.integrate(m, m.neutral(), a))


ALGORITHMS = {name: f for name, (f, _) in fields.ALGORITHMS.items()} | {"difference": from_elsewhere}


@pytest.mark.parametrize(("mech", "names"), [
    ("turning", [x for x in ALGORITHMS if x not in LONG]),
    slow("planar", list(ALGORITHMS)),
], ids=["turning", "planar"])  # fmt: skip
def test_second_derivatives(mech, names):
    """With the state, accelerations or forces, and masses all moving at once, on joints whose axes turn."""
    mech, rng = mechanism(mech), np.random.default_rng(4)
    q = js.integrate(mech, mech.neutral(), rng.standard_normal(mech.nv))
    x = {"state": [np.asarray(q), *rng.standard_normal((2, mech.nv))], "masses": np.zeros(len(mech.topology))}
    d = jax.tree.map(lambda y: rng.standard_normal(y.shape), x)

    def function(x):
        M, more = mech.inertias, jnp.exp(x["masses"])
        moved = mech.replace(inertias=js.SpatialInertia(M.mass * more, M.com, M.central * more[:, None]))
        return {name: jax.tree.leaves(ALGORITHMS[name](moved, *x["state"])) for name in names}

    run = interpreted(jax.vmap(along(function), (None, None, 0)))
    first, second = run(x, d, STEP * np.array([0.0, 1, -1]))
    for name in names:
        for one, two in zip(first[name], second[name], strict=True):
            difference, size = (one[1] - one[2]) / (2 * STEP), abs(one).max() + abs(two).max()
            np.testing.assert_allclose(two[0], difference, rtol=0, atol=1e-6 * size, err_msg=name)
        assert max(abs(y).max() for y in second[name]) > 1e-3, name


# -- the convex step --------------------------------------------------------------------------------------------------


def scene(kind):
    """(arguments of a step by name, the step of them) with terms of one kind, or of "all": a body whose axes turn, and
    a link, which a limit and dry friction act on; a sphere that sticks, one that slides, and a rod."""
    M = js.SpatialInertia(np.float64(2), np.array([0.05, 0.02, -0.03]), np.diag([0.1, 0.2, 0.25]))
    upright, out = (
        js.RigidTransform(js.Rotation.exp(np.array(w)), np.array(p))
        for w, p in (([1.5, 0.1, 0], [0.0, 0, 0]), ([0.3, 0.2, 0], [0.2, 0, 0.1]))
    )
    joints = [
        js.Joint("root", "planar", "world", "a", upright),
        js.Joint("hinge", "revolute", "a", "b", out, axis=(1, 0.3, 0)),
    ]
    mech = js.Mechanism.build([js.Body(x, M) for x in "ab"], joints, dtype=np.float64)
    has = {x: kind in (x, "all") for x in ("contacts", "limits", "friction", "loops")}
    x = {
        "q": np.array([0.03, -0.02, 0.13, 0.31]),
        "v": np.array([0.8, -0.6, 0.5, 1.1]),
        "tau": np.array([0.3, -0.4, 0.2, 0.1]),
        "dt": np.float64(5e-3),
        "F": np.array([0.5, -0.3, 0.2, 1.0, -2.0, 0.7]),
        "masses": np.zeros(2),
        "damping": np.array([0.0, 0, 0, 0.2]),
    }
    if has["limits"]:
        x |= {"upper": np.float64(0.3)}
    if has["friction"]:
        x |= {"friction_loss": np.array([0.3, 0.0, 0.2, 0.4])}
    if has["contacts"]:
        x |= {"positions": np.array([[0.1, 0, -0.2], [0, 0.1, -0.15]]), "radius": np.full(2, 0.05)}
        x |= {"stiffness": np.full(2, 3e3), "relaxation_time": np.full(2, 0.01), "friction": np.array([0.5, 0.05])}
        x |= {"normal": np.array([0.0, 0, 1]), "offset": np.float64(0.1)}
    if has["loops"]:
        x |= {"distance": np.float64(0.3)}

    def step(x):
        M, more, terms = mech.inertias, jnp.exp(x["masses"]), {}
        own = {"inertias": js.SpatialInertia(M.mass * more, M.com, M.central * more[:, None]), "damping": x["damping"]}
        if has["limits"]:
            own["upper"] = jnp.where(np.arange(4) == 3, x["upper"], np.inf)
        if has["friction"]:
            own["friction_loss"] = x["friction_loss"]
        if has["contacts"]:
            law = {k: x[k] for k in ("stiffness", "relaxation_time", "friction")}
            terms["contacts"] = js.PointContacts(["a", "b"], x["positions"], x["radius"], **law)
            terms["ground"] = js.HalfSpace(x["normal"], x["offset"])
        if has["loops"]:
            terms["loops"] = [js.LoopClosure("world", "b", "distance", x["distance"])]
        F = js.AppliedForces(["b"], js.SpatialForce.from_array(x["F"][None]))
        found = js.convex_step(mech.replace(**own), x["q"], x["v"], x["tau"], x["dt"], F, **terms)
        wrenches = {k: y.f for k, y in (("f", found.contact_forces), ("loop", found.loop_wrenches)) if y is not None}
        return {"q": found.q, "v": found.v} | wrenches

    return x, step


def directions(x, names):
    """One along each of the arguments alone, and last along all of them at once."""
    rng = np.random.default_rng(5)
    d = {k: 0.1 * rng.standard_normal(np.shape(y)) * (abs(y).max() or 1) for k, y in x.items()}
    return {k: np.stack([y * (name in (k, "all")) for name in (*names, "all")]) for k, y in d.items()}


@pytest.mark.parametrize("kind", ["all", *map(slow, ("contacts", "limits", "friction", "loops"))])
def test_second_derivatives_of_the_convex_step(kind):
    """By each argument alone, and by all at once."""
    x, step = scene(kind)
    d = directions(x, list(x))
    run = jax.vmap(jax.vmap(along(step), (None, 0, None)), (None, None, 0))
    first, second = interpreted(run)(x, d, 10 * STEP * np.array([0.0, 1, -1]))
    for part in first:
        # Forces are differences of velocities, times large numbers.
        near = 1e-5 if part in "qv" else 1e-3
        for i, name in enumerate([*x, "all"]):
            one, two = first[part][:, i], second[part][:, i]
            difference, size = (one[1] - one[2]) / (20 * STEP), abs(two).max() + 1e-2 * abs(one).max()
            np.testing.assert_allclose(two[0], difference, rtol=0, atol=near * size + 1e-12, err_msg=f"{part} {name}")
        # The last is by all at once: it is far larger than what it may be off by.
        assert abs(two[0]).max() > 100 * near * size, part


# -- closed loops -----------------------------------------------------------------------------------------------------


# Kinds of joints, and how the last body is held by the world: a planar chain, by more rows than it needs; one whose
# axes turn.
LINKAGES = {"planar": (["revolute"] * 3, "ball"), "turning": (["ball", "revolute"], "distance")}


def chain(kinds):
    """Bodies b0, b1 ... one behind the other, and a frame "tip" on the last."""
    M = js.SpatialInertia(np.float64(2), np.zeros(3), np.diag([0.1, 0.2, 0.25]))
    out = js.RigidTransform(js.Rotation.exp(np.array([0.0, 0.3, 0])), np.array([0.4, 0.0, 0.1]))
    axes = [{} if kind == "ball" else {"axis": (0, 1, 0)} for kind in kinds]
    parents = ["world", *(f"b{i}" for i in range(len(kinds)))]
    joints = [js.Joint(f"j{i}", x, parents[i], f"b{i}", out, **axes[i]) for i, x in enumerate(kinds)]
    frames = [js.Frame("tip", parents[-1], out)]
    return js.Mechanism.build([js.Body(x, M) for x in parents[1:]], joints, frames, dtype=np.float64)


@pytest.mark.parametrize(
    ("name", "ways"), [("planar", []), slow("planar", ["jvp of vjp", "vjp of jvp", "vjp of vjp"]), slow("turning", [])]
)
def test_second_derivatives_of_close_loops(name, ways):
    """By q, lengths of links and distances, where loops are closed: against second differences of what closes them."""
    (kinds, kind), rng = LINKAGES[name], np.random.default_rng(7)
    mech = chain(kinds)

    def closed(x):
        X = mech.placements
        longer = X.translation + jnp.outer(x["lengths"], np.array([1.0, 0, 0]))
        own = mech.replace(placements=js.RigidTransform(X.rotation, longer))
        loop = js.LoopClosure("world", "tip", kind, *([x["distance"]] if kind == "distance" else []))
        return js.close_loops(own, js.integrate(own, x["q"], x["change"]), [loop]).q

    start = js.integrate(mech, mech.neutral(), 0.5 * rng.standard_normal(mech.nv))
    x = {"change": np.zeros(mech.nv), "distance": np.float64(0.7), "lengths": np.zeros(len(kinds)), "q": start}
    x["q"] = interpreted(closed)(x)
    d = {k: 0.3 * rng.standard_normal(np.shape(y)) for k, y in x.items()} | {"q": np.zeros(mech.nq)}
    weights = np.arange(1.0, mech.nq + 1)

    def in_all_ways(x, d):
        products = (WAYS[way](lambda x: closed(x) @ weights, x, d) for way in ways)
        return along(closed)(x, d, 0.0)[1], [sum(jnp.vdot(y[k], d[k]) for k in d) for y in products]

    second, twice = interpreted(in_all_ways)(x, d)
    h = 1e-3
    values = interpreted(jax.vmap(closed))(jax.tree.map(lambda y, b: np.stack([y - h * b, y, y + h * b]), x, d))
    difference = (values[0] - 2 * values[1] + values[2]) / h**2
    assert abs(second).max() > 0.05
    np.testing.assert_allclose(second, difference, rtol=0, atol=1e-4 * abs(second).max())
    np.testing.assert_allclose(twice, len(ways) * [second @ weights], rtol=1e-7)


WAYS = {
    "jvp of vjp": lambda f, x, d: jax.jvp(jax.grad(f), (x,), (d,))[1],
    "vjp of jvp": lambda f, x, d: jax.grad(lambda x: jax.jvp(f, (x,), (d,))[1])(x),
    "vjp of vjp": lambda f, x, d: jax.vjp(jax.grad(f), x)[1](d)[0],
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_in_all_ways(way):
    """The product of the Hessian with a direction, as forward and reverse mode find it: along another direction it is
    the second derivative that forward mode of forward mode finds."""
    x, step = scene("all")
    d = jax.tree.map(lambda y: y[-1], directions(x, []))

    def cost(x):
        found = step(x)
        return (found["q"] * np.arange(1.0, 5)).sum() + (found["v"] * np.array([1.0, -2, 3, 0.5])).sum()

    def both(x, d):
        product = WAYS[way](cost, x, d)
        return sum(jnp.vdot(a, b) for a, b in zip(map(product.get, d), d.values(), strict=True)), along(cost)(x, d, 0.0)

    twice, (_, expected) = interpreted(both)(x, d)
    np.testing.assert_allclose(twice, expected, rtol=1e-7)

"""A robot in modules of equinox, flax linen and flax nnx: what is trained, what folds, and what is compiled again.

The recipes themselves are in notebooks/learning.md, which `test_readme` runs. Here each way to hold a robot is tried in
each library, on one task: a policy learns what torques hold up a robot whose last link is heavier than it believes.
"""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but
from tests.helpers.optional import needs

eqx = needs("equinox")
nn = needs("flax.linen")
nnx = needs("flax.nnx")
optax = needs("optax")
ocp = needs("orbax.checkpoint")


@pytest.fixture(autouse=True)
def rules_of_learners():
    """Optax counts in integers, and multiplies floats by them. In the precision that compiles soonest."""
    with jax.numpy_dtype_promotion("standard"), js.default_precision("fast"):
        yield


def link(mass):
    ball = js.SpatialInertia.solid_ellipsoid(np.float32([0.1, 0.2, 0.5]), mass=np.float32(mass))
    return js.shift(ball, np.float32([0, 0, 0.5]))


def pendulum(mass=1.0):
    below = js.RigidTransform(js.Rotation.identity(), np.float32([0, 0, -1]))
    joints = [
        js.Joint("shoulder", "revolute", "world", "upper", axis=(0, 1, 0)),
        js.Joint("elbow", "revolute", "upper", "lower", axis=(0, 1, 0), placement=below),
    ]
    return js.Mechanism.build([js.Body("upper", link(1.0)), js.Body("lower", link(mass))], joints)


MECH = pendulum()
Q = np.random.default_rng(0).uniform(-1, 1, (8, 2)).astype(np.float32)
TAU = js.gravity_forces(pendulum(2.0), Q)
THETA = MECH.inertias.at_batch(1).to_log_cholesky()


def loss(found):
    return jnp.mean((found - TAU) ** 2)


def torques(mech, offset, theta):
    """Of a robot whose last link has log-Cholesky parameters theta, if not None."""
    if theta is not None:
        last = js.SpatialInertia.from_log_cholesky(theta)
        both = jax.tree.map(lambda x, y: jnp.asarray(x).at[1].set(y), mech.inertias, last)
        mech = mech.replace(inertias=both)
    SEEN.append(type(mech.gravity))
    return js.gravity_forces(mech, jnp.asarray(Q)) + offset[None]


# What the traced functions saw of gravity: NumPy folds.
SEEN = []


# -- each library: (mechanism, theta, whether it is data) -> (losses, mechanism after, theta after) --------------------


def in_equinox(mech, theta, is_data):
    class Policy(eqx.Module):
        offset: jax.Array
        theta: jax.Array | None
        mech: js.Mechanism

    policy = Policy(jnp.zeros(2), theta, mech)
    learned = jax.tree.map(eqx.is_inexact_array, policy)
    learned = eqx.tree_at(lambda p: p.mech, learned, jax.tree.map(lambda _: False, mech)) if is_data else learned
    optimizer = optax.adam(0.05)
    state = optimizer.init(eqx.filter(policy, learned))

    @eqx.filter_jit
    def step(policy, state):
        def value(moving, rest):
            p = eqx.combine(moving, rest)
            return loss(torques(p.mech, p.offset, p.theta))

        value, slope = eqx.filter_value_and_grad(value)(*eqx.partition(policy, learned))
        updates, state = optimizer.update(slope, state)
        return eqx.apply_updates(policy, updates), state, value

    losses = []
    for _ in range(30):
        policy, state, value = step(policy, state)
        losses.append(value)
    return losses, policy.mech, policy.theta


def in_linen(mech, theta, is_data):
    class Policy(nn.Module):
        mech: js.Mechanism | None

        @nn.compact
        def __call__(self):
            own = self.mech
            if is_data:
                own = self.variable("robot", "mech", lambda: mech).value
            offset = self.param("offset", lambda _: jnp.zeros(2))
            return torques(own, offset, None if theta is None else self.param("theta", lambda _: theta))

    policy = Policy(None if is_data else mech)
    variables = dict(policy.init(jax.random.key(0)))
    params, rest = variables.pop("params"), variables
    optimizer = optax.adam(0.05)

    @jax.jit
    def step(params, rest, state):
        value, slope = jax.value_and_grad(lambda p: loss(policy.apply({"params": p, **rest})))(params)
        updates, state = optimizer.update(slope, state)
        return optax.apply_updates(params, updates), state, value

    losses, state = [], optimizer.init(params)
    for _ in range(30):
        params, state, value = step(params, rest, state)
        losses.append(value)
    return losses, rest["robot"]["mech"] if is_data else policy.mech, params.get("theta")


def in_nnx(mech, theta, is_data):
    class Policy(nnx.Module):
        def __init__(self):
            self.mech = nnx.data(mech) if is_data else mech
            self.offset = nnx.Param(jnp.zeros(2))
            self.theta = None if theta is None else nnx.Param(theta)

        def __call__(self):
            return torques(self.mech, self.offset[...], None if self.theta is None else self.theta[...])

    policy = Policy()
    optimizer = nnx.Optimizer(policy, optax.adam(0.05), wrt=nnx.Param)

    @nnx.jit
    def step(policy, optimizer):
        value, slope = nnx.value_and_grad(lambda p: loss(p()))(policy)
        optimizer.update(policy, slope)
        return value

    losses = [step(policy, optimizer) for _ in range(30)]
    return losses, policy.mech, None if policy.theta is None else policy.theta[...]


LIBRARIES = [in_equinox, in_linen, in_nnx]


# Every library and every form, each library with what it does not share with others.
LEARNED = [(form, learn) for form in ("static", "data", "parameters") for learn in LIBRARIES]
KEPT = [("static", in_equinox), ("static", in_linen), ("static", in_nnx), ("data", in_nnx), ("parameters", in_equinox)]


@pytest.mark.parametrize(("form", "learn"), slow_but(KEPT, LEARNED), ids=lambda x: getattr(x, "__name__", x))
def test_what_is_learned_and_what_stays(form, learn):
    SEEN.clear()
    mech = MECH.as_data() if form == "data" else MECH.as_static()
    losses, after, theta = learn(mech, THETA if form == "parameters" else None, form == "data")
    assert np.isfinite(losses).all() and losses[-1] < (0.5 if form == "parameters" else 0.95) * losses[0]
    chex.assert_trees_all_equal_structs(after, mech)
    chex.assert_trees_all_equal(after._as_known(), MECH)
    assert all((kind is np.ndarray) == (form != "data") for kind in SEEN[1:] or SEEN)
    if form == "parameters":
        last = js.SpatialInertia.from_log_cholesky(theta)
        assert last.is_physically_valid() and abs(last.mass - 1) > 0.3


def test_numpy_leaves_are_taken_for_parameters():
    """What `as_static` is for: the same module with a Mechanism as it is moves gravity and axes."""

    class Policy(eqx.Module):
        offset: jax.Array
        mech: js.Mechanism

    def updated(mech):
        policy = Policy(jnp.zeros(2), mech)
        slope = eqx.filter_grad(lambda p: js.potential_energy(p.mech, jnp.asarray(Q[0])) + p.offset.sum())
        slope = interpreted(slope)(policy)
        return eqx.apply_updates(policy, jax.tree.map(lambda x: -0.1 * x, slope)).mech

    assert (updated(MECH).gravity != MECH.gravity).any() and (updated(MECH).axes != MECH.axes).any()
    assert updated(MECH.as_static()) is MECH.as_static()


def test_equal_modules_are_not_compiled_again():
    traced = []

    class Policy(eqx.Module):
        offset: jax.Array
        mech: js.Mechanism

    class LinenPolicy(nn.Module):
        mech: js.Mechanism

        def __call__(self, q):
            traced.append("linen")
            return js.gravity_forces(self.mech, q)

    class NnxPolicy(nnx.Module):
        def __init__(self, mech):
            self.mech = mech

    def seen(policy, q):
        traced.append("module")
        return js.gravity_forces(policy.mech, q)

    in_equinox, in_nnx = eqx.filter_jit(seen), nnx.jit(seen)
    in_linen = jax.jit(lambda policy, q: policy.apply({}, q), static_argnums=0)
    calls = {
        "equinox": lambda mech, q: in_equinox(Policy(jnp.zeros(2), mech), q),
        "linen": lambda mech, q: in_linen(LinenPolicy(mech), q),
        "nnx": lambda mech, q: in_nnx(NnxPolicy(mech), q),
    }
    for name, call in calls.items():
        traced.clear()
        for _ in range(2):
            found = call(pendulum().as_static(), jnp.asarray(Q[0]))
            np.testing.assert_allclose(found, js.gravity_forces(MECH, Q[0]), rtol=1e-5)
        assert len(traced) == 1, name
        call(pendulum(2.0).as_static(), jnp.asarray(Q[0]))
        assert len(traced) == 2, name


def test_nnx_refuses_leaves_in_a_plain_attribute():
    """As the page says."""

    class Policy(nnx.Module):
        def __init__(self, mech):
            self.mech = mech

    with pytest.raises(ValueError, match="(?s)static attribute 'mech'.*ndarray"):
        Policy(MECH)
    graph, state = nnx.split(Policy(MECH.as_static()))
    assert jax.tree.leaves(state) == [] and nnx.merge(graph, state).mech is MECH.as_static()


def test_optax_sees_nothing_of_it():
    params = {"w": jnp.ones(2), "mech": MECH.as_static()}
    for optimizer in (optax.adamw(0.1), optax.chain(optax.clip_by_global_norm(1.0), optax.sgd(0.1, 0.9))):
        state = optimizer.init(params)
        slope = jax.grad(lambda p: loss(js.gravity_forces(p["mech"], Q) * p["w"][None]))(params)
        updates, state = optimizer.update(slope, state, params)
        after = optax.apply_updates(params, updates)
        assert after["mech"] is params["mech"] and (after["w"] != 1).all()
        assert all(np.shape(x) in ((), (2,)) for x in jax.tree.leaves(state))


@pytest.mark.parametrize("form", ["as_static", "as_data"])
def test_checkpoints(form, tmp_path):
    """A static robot is that of the target; one with leaves is saved."""
    mech = getattr(MECH, form)()
    like = pendulum() if form == "as_static" else MECH.replace(gravity=np.ones(3, np.float32))
    with ocp.StandardCheckpointer() as checkpointer:
        checkpointer.save(tmp_path / "x", {"w": jnp.arange(3.0), "mech": mech})
        checkpointer.wait_until_finished()
        found = checkpointer.restore(tmp_path / "x", {"w": jnp.zeros(3), "mech": getattr(like, form)()})
    np.testing.assert_array_equal(found["w"], [0, 1, 2])
    chex.assert_trees_all_equal(found["mech"]._as_known(), MECH)
    assert type(found["mech"]) is type(mech)
    text = b"".join(p.read_bytes() for p in (tmp_path / "x").rglob("_METADATA"))
    assert (b"gravity" in text) == (form == "as_data")


def test_leaves_of_equinox_go_to_a_file(tmp_path):
    tree = {"w": jnp.arange(3.0), "mech": MECH.as_static()}
    eqx.tree_serialise_leaves(tmp_path / "x.eqx", tree)
    found = eqx.tree_deserialise_leaves(tmp_path / "x.eqx", {"w": jnp.zeros(3), "mech": pendulum().as_static()})
    np.testing.assert_array_equal(found["w"], [0, 1, 2])
    assert found["mech"] is MECH.as_static()

"""Algorithms under JAX's transformations, also with respect to the numbers of the mechanism."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import marks
from tests.helpers.interpreted import interpreted

N = 3
KINDS = ["prismatic", "ball"]
HELD = [js.LoopClosure("world", "body1", "ball")]


@functools.cache
def mechanism():
    return js.testing.random_mechanism(0, 2, KINDS, is_chain=True, dtype=np.float64)


@functools.cache
def state():
    mech, rng = mechanism(), np.random.default_rng(1)
    q = js.random_configuration(mech, jax.random.key(0), N, np.float64)
    return q, *(jnp.asarray(x) for x in rng.standard_normal((2, N, mech.nv)))


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def observed(mech, q, v, tau):
    """The residual of an observer after one sample, from half the velocity."""
    return js.MomentumObserver.start(mech, q, 0.5 * v).update(mech, q, v, tau, 0.01, 10.0).residual


ALGORITHMS = {
    "inverse dynamics": js.inverse_dynamics,
    "forward dynamics": js.forward_dynamics,
    "mass matrix": lambda mech, q, v, a: js.mass_matrix(mech, q),
    "kinetic energy": lambda mech, q, v, a: js.kinetic_energy(mech, q, v),
    "jacobian": lambda mech, q, v, a: js.jacobian(mech, q, "body1"),
    "accelerations": lambda mech, q, v, a: js.body_accelerations(mech, q, v, a).to_array(),
    "jacobian rate": lambda mech, q, v, a: js.jacobian_rate(mech, q, v, "body1"),
    "momentum": lambda mech, q, v, a: js.centroidal_momentum(mech, q, v).to_array(),
    "momentum matrix": lambda mech, q, v, a: js.centroidal_momentum_matrix(mech, q),
    "regressor": js.regressors.joint_torque_regressor,
    "derivatives": lambda mech, q, v, a: js.inverse_dynamics_derivatives(mech, q, v, a).dtau_dq,
    "factor": lambda mech, q, v, a: js.mass_matrix_factor(mech, q).solve(a),
    "semi-implicit step": lambda mech, q, v, a: js.semi_implicit_step(mech, q, v, a, 0.01)[0],
    "symplectic step": lambda mech, q, v, a: js.symplectic_step(mech, q, v, a, 0.01)[1],
    "closed loop": lambda mech, q, v, a: js.constrained_forward_dynamics(mech, q, v, a, HELD).vdot,
    "constraint error": lambda mech, q, v, a: js.constraint_error(mech, q, HELD),
    "momentum observer": observed,
    "Runge-Kutta step": lambda mech, q, v, a: js.rk4_step(mech, q, v, a, 0.01)[1],
}
# Factors and products of matrices are libraries', whose order of sums is not ours; so are those of closures.
SOLVED = "factor", "symplectic step", "closed loop", "constraint error"
DEFAULT = "inverse dynamics", "forward dynamics"
of_some = marks.slow_but(DEFAULT[1:], ALGORITHMS)


WAYS = "jit of vmap", "scan", "checkpoint", "cond", "as data"
# How programs are called is decided in one place, for all algorithms: of one most ways are tried, of the other two.
CASES = [("inverse dynamics", WAYS[:3]), ("forward dynamics", WAYS[:1]), marks.slow("inverse dynamics", WAYS)]
CASES += [marks.slow(name, WAYS) for name in ALGORITHMS if name != "inverse dynamics"]


@pytest.mark.parametrize(("name", "ways"), CASES)
def test_the_same_bits_however_it_is_called(name, ways):
    """As the formula in NumPy: batched by leading axes, by vmap, in a scan, recomputed, with the mechanism closed over;
    as data within a few u."""
    f, mech, x = ALGORITHMS[name], mechanism(), state()
    own = functools.partial(f, mech)
    expected = interpreted(own)(*x)
    calls = {
        "jit of vmap": jax.jit(jax.vmap(own)),
        "scan": lambda *x: jax.lax.scan(lambda _, item: (None, own(*item)), None, x)[1],
        "checkpoint": jax.jit(jax.vmap(jax.checkpoint(own))),
        "cond": jax.jit(lambda *x: jax.lax.cond(x[0][0, 0] > -9, own, lambda *x: jnp.zeros(expected.shape), *x)),
    }
    found = {"eager": own(*x)} | {how: call(*x) for how, call in calls.items() if how in ways}
    allowed = 256 * 2.0**-53 * abs(expected).max() if name in SOLVED else 0.0
    for how, y in found.items():
        np.testing.assert_allclose(np.asarray(y), expected, rtol=0, atol=allowed, err_msg=how)
    as_data = np.asarray((jax.jit if "as data" in ways else interpreted)(f)(mech.as_data(), *x))
    assert abs(as_data - expected).max() <= 256 * 2.0**-53 * abs(expected).max()


def test_compiled_in_one_program():
    """All other algorithms that are no steps: the bits of the formulas in NumPy. Closed loops, see there."""
    others = [name for name in ALGORITHMS if name not in (*DEFAULT, "closed loop") and "step" not in name]

    def all_of_them(*x):
        return {name: ALGORITHMS[name](mechanism(), *x) for name in others}

    compiled, expected = jax.jit(jax.vmap(all_of_them))(*state()), interpreted(jax.vmap(all_of_them))(*state())
    for name, y in expected.items():
        allowed = 256 * 2.0**-53 * abs(y).max() if name in SOLVED else 0.0
        np.testing.assert_allclose(compiled[name], y, rtol=0, atol=allowed, err_msg=name)


@pytest.mark.parametrize("name", of_some)
def test_derivatives_with_respect_to_everything(name):
    """Forward and reverse ones agree, and are the differences that they stand for: of the state, and of all numbers of
    the mechanism, passed as arguments."""
    mech, x = mechanism().as_data(), [y[0] for y in state()]

    def of(inertias, placements, axes, q, v, a):
        return ALGORITHMS[name](mech.replace(inertias=inertias, placements=placements, axes=axes), q, v, a)

    arguments = mech.inertias, mech.placements, mech.axes, *x
    rng = np.random.default_rng(2)
    t = jax.tree.map(lambda leaf: jnp.asarray(rng.standard_normal(leaf.shape)), arguments)
    value, tangent = interpreted(lambda x, t: jax.jvp(of, x, t))(arguments, t)
    cotangent = rng.standard_normal(value.shape)
    pulled = interpreted(lambda x, c: jax.vjp(of, *x)[1](c))(arguments, cotangent)
    inner = sum(jnp.sum(a * b) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(t), strict=True))
    size = sum(jnp.sum(abs(a * b)) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(t), strict=True))
    assert abs(inner - jnp.sum(cotangent * tangent)) <= 1e-13 * size
    step = 1e-5
    run = interpreted(lambda x: of(*x))
    ahead, behind = (run(jax.tree.map(lambda a, b, s=s: a + s * b, arguments, t)) for s in (step, -step))
    assert abs((ahead - behind) / (2 * step) - tangent).max() <= 1e-6 * abs(tangent).max()


def test_a_batch_of_mechanisms():
    """Masses of many, one state."""
    mech, (q, v, a) = mechanism(), [y[0] for y in state()]
    factors = jnp.asarray([0.5, 1.0, 2.0])

    def torques(factor):
        M = mech.inertias
        inertias = js.SpatialInertia(
            *(jnp.asarray(x) * y for x, y in zip(jax.tree.leaves(M), (factor, 1.0, factor), strict=True))
        )
        return js.inverse_dynamics(mech.replace(inertias=inertias, armature=0 * mech.armature), q, v, a)

    found = jax.vmap(torques)(factors)
    np.testing.assert_allclose(found, np.asarray(factors)[:, None] * np.asarray(found)[1], rtol=1e-12, atol=1e-12)


def test_a_rebuilt_mechanism_is_not_traced_again():
    @jax.jit
    @chex.assert_max_traces(n=1)
    def f(mech, q):
        return js.gravity_forces(mech, q)

    q = state()[0][0]
    for _ in range(2):
        f(js.testing.random_mechanism(0, 2, KINDS, is_chain=True, dtype=np.float64), q)
    f(mechanism().as_data().replace(gravity=jnp.asarray([0.0, 0.0, -1.0])), q)


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float32"])
@pytest.mark.parametrize("precision", js.Precision)
def test_dtypes_and_precisions(dtype, precision):
    """The dtype of q, and an error of a few u of the largest number, whether 64-bit types are on or not."""
    x = [np.asarray(y[0], jnp.dtype(dtype)) for y in state()]
    expected = interpreted(functools.partial(js.inverse_dynamics, mechanism()))(*(y.astype(np.float64) for y in x))
    with jax.enable_x64(False):
        run = jax.jit if dtype == "float32" else interpreted
        tau = run(functools.partial(js.inverse_dynamics, mechanism(), precision=precision))(*x)
    u = float(jnp.finfo(dtype).eps) / 2
    assert tau.dtype == dtype
    assert (
        abs(np.asarray(tau, float) - expected).max()
        <= (1.01 if precision.sees_whole_sums else 64) * u * abs(expected).max()
    )


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_known_numbers_take_the_dtype_of_q(precision):
    """Those of a mechanism in float32 are what they are, in float64."""
    q, narrow = np.array([0.3]), js.testing.random_mechanism(0, 1, ["revolute"], dtype=np.float32)
    of = lambda m: interpreted(functools.partial(js.gravity_forces, m, precision=precision))(q)  # noqa: E731
    found, expected = of(narrow), of(narrow.astype(np.float64))
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, expected)


def test_errors_name_what_came():
    mech, (q, v, a) = mechanism(), state()
    for arguments, error, message in (
        ((1, q, v, a), TypeError, "inverse_dynamics: expected a Mechanism first, got int"),
        ((mech, q[:, :2], v, a), ValueError, r"inverse_dynamics: q: expected shape \(\*batch, 5\), got \(3, 2\)"),
        ((mech, q, v.astype(np.float32), a), TypeError, "expected one dtype, got q: float64, v: float32"),
        ((mech, q, v, a[:2]), ValueError, "expected batch shapes that broadcast"),
        ((mech, q, v, a, {"nobody": 1}), KeyError, "external_forces: expected one of 'world', 'body0'"),
        ((mech, q, v, a, {"body1": 1}), TypeError, "expected a SpatialForce, got int"),
        (
            (mech, q, v, a, [1]),
            TypeError,
            r"external_forces\[0\]: expected SpatialForces in a dict by name of a frame, .*, got int",
        ),
    ):
        with pytest.raises(error, match=message):
            js.inverse_dynamics(*arguments)


def test_errors_name_the_operation_and_the_argument():
    mech, (q, v, _), short = mechanism(), state(), np.ones(2)
    size = r"expected shape \(\*batch, [45]\), got \(2,\)"
    for call, error, message in (
        (lambda: js.bias_forces(mech, short, v), ValueError, f"bias_forces: q: {size}"),
        (lambda: js.gravity_forces(mech, short), ValueError, f"gravity_forces: q: {size}"),
        (lambda: js.difference(mech, short, q), ValueError, f"difference: q0: {size}"),
        (lambda: js.difference(mech, q, short), ValueError, f"difference: q1: {size}"),
        (lambda: js.inverse_dynamics_derivatives(mech, q, v, short), ValueError, f"dynamics_derivatives: vdot: {size}"),
        (lambda: js.rk4_step(mech, q, v, short, 0.1), ValueError, f"rk4_step: tau: {size}"),
        (lambda: js.integrate(mech, q, v, short), ValueError, r"batch shapes that broadcast, got .*dt: \(2,\)"),
        (lambda: js.integrate(mech, q, v, np.float32(1)), TypeError, "got q: float64, v: float64, dt: float32"),
        (lambda: js.jacobian(mech, q, "nobody"), KeyError, "jacobian: frames: expected one of 'world', 'body0'"),
    ):
        with pytest.raises(error, match=message):
            call()

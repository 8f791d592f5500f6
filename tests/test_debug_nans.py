"""Under JAX's options `jax_debug_nans` and `jax_debug_infs` what is finite comes as without them, and what is NaN by
definition raises JAX's own error."""

import contextlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import interpreted as interpreter
from tests.helpers.algorithms import ALGORITHMS, mechanism, state
from tests.helpers.marks import slow_but
from tests.helpers.operations import DISTINCT, OPERATIONS, OTHER_REPRESENTATIVES, REPRESENTATIVES

ZERO = jnp.zeros(3, jnp.float32)
ONE = jnp.ones(3, jnp.float32)


@pytest.fixture
def _debugging():
    """JAX does not ask again of programs that were compiled without these options."""
    jax.clear_caches()
    with jax.debug_nans(True), jax.debug_infs(True):
        yield


NONE = {
    "axis of no wrench": lambda: js.central_axis(js.SpatialForce(ZERO, ZERO)),
    "axis of no wrench, traced": lambda: jax.jit(js.central_axis)(js.SpatialForce(ZERO, ZERO)),
    "pressure of nothing": lambda: js.center_of_pressure(js.SpatialForce(ZERO, ZERO)),
    "direction of nothing": lambda: js.Rotation.from_one_vector(ZERO),
    "quotient of zeros": lambda: js.SpatialForce(ZERO, ZERO) / jnp.float32(0),
}


@pytest.mark.parametrize("name", NONE)
def test_what_is_nan_by_definition_raises_an_error_of_jax(name, _debugging):
    with pytest.raises(FloatingPointError, match="invalid value .* encountered in"):
        NONE[name]()


@pytest.mark.parametrize("surrounding", [contextlib.nullcontext, jax.ensure_compile_time_eval])
def test_what_is_finite_is_computed(surrounding, _debugging):
    """Also where JAX runs operation by operation, and a choice that is not made is an array of its own."""
    with surrounding():
        for angle in (0.0, 1e-30, 3.0):
            R = js.Rotation.about_z(jnp.float32(angle))
            assert np.isfinite(R.log()).all() and np.isfinite(js.Rotation.exp(angle * ONE).to_quaternion()).all()
        assert np.isfinite(js.Rotation.from_quaternion(jnp.ones(4, jnp.float32)).entries).all()


def test_a_mechanism_is_built(_debugging):
    """Whose joints have no limits."""
    mech = js.Mechanism.build([js.Body("b", inertia=js.SpatialInertia.solid_sphere(0.1, mass=1.0))],
                              [js.Joint("j", "revolute", "world", "b")], dtype=np.float32)  # fmt: skip
    assert np.isinf(mech.lower).all()
    assert np.isfinite(js.inverse_dynamics(mech, *np.ones((3, 1), np.float32))).all()


# -- no NaN on the way ------------------------------------------------------------------------------------------------


@pytest.fixture
def made(monkeypatch):
    """The operations that made a NaN or an infinity of finite numbers, by name, of all that is interpreted."""
    found, run = [], interpreter._result

    def result(primitive, arrays, parameters):
        results = run(primitive, arrays, parameters)
        is_program = primitive.name in ("jit", "scan", "while", "cond") or primitive.name in (
            "closed_call", "custom_jvp_call", "checkpoint", "remat2", "jaxspatial_sums", "jaxspatial_program",
            "custom_linear_solve",
        )  # fmt: skip
        if not is_program and not any(map(_is_special, arrays)):
            each = results if primitive.multiple_results else [results]
            found.extend([primitive.name] * any(map(_is_special, each)))
        return results

    monkeypatch.setattr(interpreter, "_result", result)
    return found


def _is_special(x):
    x = np.asarray(x)
    return x.dtype.kind == "f" and not np.isfinite(x).all()


def _pulled(function):
    def pulled(*x):
        y, pull = jax.vjp(function, *x)
        return pull(jax.tree.map(lambda leaf: np.ones(leaf.shape, leaf.dtype), y))

    return pulled


def _hold(made, function, arrays):
    with np.errstate(all="ignore"):
        results = jax.tree.leaves(interpreter.interpreted(function)(*arrays))
    assert not made or any(map(_is_special, results)), made


@pytest.mark.parametrize("name", slow_but((*REPRESENTATIVES, *OTHER_REPRESENTATIVES), DISTINCT))
def test_no_operation_makes_a_nan_on_the_way(name, made):
    """To a finite result or derivative: of ordinary numbers, of zeros, of vectors along an axis, of two that are equal
    or opposite."""
    operation = OPERATIONS[name]
    ordinary = operation.arrays((), np.float32)
    zero = [np.zeros_like(x) for x in ordinary]
    along = [x * (np.arange(x.shape[-1]) == 0).astype(x.dtype) if x.ndim else x for x in ordinary]
    cases = [
        ordinary,
        zero,
        along,
        *([zero[k] if k == i else x for k, x in enumerate(ordinary)] for i in range(len(zero))),
    ]
    if len({x.shape for x in ordinary}) == 1:
        cases += [[ordinary[0]] * len(zero), [ordinary[0], *[-ordinary[0]] * (len(zero) - 1)]]
    for arrays in cases:
        for function in (operation.on_arrays(), *[_pulled(operation.on_arrays())] * operation.differentiable):
            made.clear()
            _hold(made, function, arrays)


@pytest.mark.parametrize("name", slow_but(("inverse_dynamics", "integrate"), ALGORITHMS))
def test_no_algorithm_makes_a_nan_on_the_way(name, made):
    """At rest in the neutral configuration, too."""
    mech = mechanism()
    q, v, a = state(())

    def own(*x):
        return [x for x in jax.tree.leaves(ALGORITHMS[name](mech, *x)) if x.dtype.kind == "f"]

    for x in ((q, v, a), (mech.neutral(), 0 * v, 0 * a)):
        for function in (own, _pulled(own)):
            made.clear()
            _hold(made, function, x)

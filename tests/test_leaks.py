"""`jax.checking_leaks` finds nothing in the library: users can check their own code with it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.algorithms import ALGORITHMS, mechanism, state
from tests.helpers.marks import slow_but

# Joints of one kind, one behind the other, are a loop over rows, with a number of the state known in it.
ARM = js.testing.random_mechanism(0, 3, ["revolute"], is_chain=True, dtype=np.float32)
X = np.array([0.1, 0.2, 0.3], np.float32)


def torques(q):
    return js.inverse_dynamics(ARM, q, X, X)


# Functions of (3,).
CASES = {
    "about z": lambda x: js.Rotation.about_z(x[0]),
    "exponential": lambda x: js.Rotation.exp(x).log(),
    "shift": lambda x: js.shift(js.SpatialForce(x, x), x, precision="compensated"),
    "inverse dynamics": torques,
    "of a batch": lambda x: jax.vmap(torques)(jnp.stack([x] * 600)),
    "gradient": jax.grad(lambda x: torques(x).sum()),
    "forward dynamics": lambda x: js.forward_dynamics(ARM, x, X, X),
    "step in a loop": lambda x: jax.lax.scan(
        lambda x, _: (js.semi_implicit_step(ARM, x, X, X, 0.01)[0], None), x, None, 2
    )[0],
}
SMALL = "about z", "shift"


def _lowered(function, *x):
    with jax.checking_leaks():
        jax.jit(function).lower(*x)


@pytest.mark.parametrize("name", CASES)
def test_no_tracer_is_leaked(name):
    _lowered(CASES[name], jnp.asarray(X))


@pytest.mark.parametrize("name", SMALL)
def test_no_tracer_is_leaked_by_a_call(name):
    with jax.checking_leaks():
        CASES[name](jnp.asarray(X))


@pytest.mark.parametrize("name", slow_but(["convex_step"], ALGORITHMS))
def test_no_algorithm_leaks_a_tracer(name):
    """Nor its pull-back, nor a batch of it."""

    def own(*x):
        return ALGORITHMS[name](mechanism(), *x)

    def pulled(*x):
        y, pull = jax.vjp(own, *x)
        return pull(jax.tree.map(lambda leaf: np.ones(leaf.shape, leaf.dtype), y))

    floating = name not in ("close_loops", "convex_step")  # These count iterations, too.
    for function in (own, jax.vmap(own), *[pulled] * floating):
        _lowered(function, *state((3,)))


def test_a_leak_of_the_caller_is_found():
    """Which is what the check is for."""
    kept = []

    def leaking(x):
        kept.append(x + 1)
        return js.Rotation.about_z(x[0])

    with pytest.raises(Exception, match="Leaked"):
        _lowered(leaking, jnp.asarray(X))

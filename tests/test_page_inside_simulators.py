"""What the page on thruster, wind and spring in MJX and Brax shows, holds: notebooks/05_inside_simulators.ipynb."""

import warnings

import jax
import jax.numpy as jnp
import pytest

import jaxspatial as js
from tests.helpers.notebooks import as_a_reader, begun, last_numbers, soon
from tests.helpers.optional import needs

needs("papermill")
needs("mujoco.mjx")
needs("brax.generalized.pipeline")

# Steps of 5 ms bend a frequency of 15 rad/s by 2e-4 and an energy by 2e-3; positions after a fall of 80 m are float32.
LIMITS = {
    "momentum": 5e-4,
    "terminal velocity": 5e-4,
    "stretch": 2e-3,
    "frequency": 5e-4,
    "kinetic energy": 4e-3,
    "momentum of the pair": 1e-3,
}


def _holds(numbers, simulators):
    assert numbers.keys() == {f"{name}: {what}" for name in simulators for what in LIMITS} | {"gradient"}
    for name in simulators:
        for what, limit in LIMITS.items():
            assert numbers[f"{name}: {what}"] < limit, (name, what)
    assert numbers["gradient"] < 1e-7


def test_the_steps_of_both():
    """They are traced, with all forces: what follows is made of them."""
    _, names = begun("05_inside_simulators", "## The thruster", environments=2)
    setting = jax.tree.map(lambda x: x[0], names["settings"](1.0, (1.0, 0.0, 0.0), 1.0, 20.0))
    at = jnp.asarray(names["on_host"].qpos0, jnp.float32), jnp.zeros(names["n"], jnp.float32)

    def both(qpos, qvel):
        state = names["brax_step"](names["pipeline"].init(names["sys"], qpos, qvel), setting)
        return names["mjx_step"]((qpos, qvel), setting), (state.q, state.qd)

    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"), js.default_precision("fast"):
        with warnings.catch_warnings(action="ignore"):
            found = jax.eval_shape(both, *at)
    assert all(x.shape == y.shape for one in found for x, y in zip(one, at, strict=True))


@pytest.mark.slow
def test_a_few_environments_of_mjx():
    _holds(last_numbers(soon("05_inside_simulators", environments=8, simulators=["MJX"])), ["MJX"])


@pytest.mark.slow
def test_as_in_the_file():
    _holds(last_numbers(as_a_reader("05_inside_simulators")), ["MJX", "Brax"])

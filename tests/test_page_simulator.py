"""What the page on a simulator of one's own shows, holds: notebooks/04_a_simulator.ipynb."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.notebooks import as_a_reader, begun, last_numbers, soon
from tests.helpers.optional import needs

needs("papermill")


def _holds(numbers):
    assert numbers["all_finite"]
    assert numbers["share_of_weakly_pushed_that_fell"] == 0
    assert numbers["share_of_strongly_pushed_that_fell"] > 0.9  # where friction is low, some slide
    # Newton's method stays where it is: a derivative that is off by a percent leaves a percent of what is left.
    assert all(abs(x - 45) < 0.01 for x in numbers["last_tilts"][-2:]), numbers["last_tilts"]
    assert abs(numbers["tilt"] - 45) < 1e-4
    assert numbers["cosine_of_push_and_gradient"] > 1 - 1e-6
    assert numbers["tilt_by_99_percent"] < 10 and numbers["tilt_by_101_percent"] > 80
    assert 25 < numbers["push"] < 28
    assert numbers["error_of_gradient"] < 1e-4
    assert 0.05 < numbers["rise_that_tips"] < 0.09
    assert max(numbers["tilts_of_the_level"]) < 3
    assert 0.4 < numbers["share_on_front_paws"] < 0.5


@pytest.mark.slow
def test_fifteen_lines_and_the_step():
    """A dog stands on hills; the step of the page is traced, for what follows is made of it."""
    printed, names = begun("04_a_simulator", "## Many environments", environments=2)
    height, *down = map(float, re.findall(r"\d+\.\d*", printed.split("height of the trunk")[1].splitlines()[0]))
    assert 0.25 < height < 0.35 and len(down) == 4 and min(down) > 0.5
    assert (0.05 < names["air_time"]).all() and (names["air_time"] < 0.3).all()  # it falls for 0.1 m
    assert (0 < names["slip"]).all() and (names["slip"] < 0.1).all()
    _explicit_damping_is_as_told(names["dog"], names["stand"])
    env = names["Environment"](jnp.ones(13, np.float32), jnp.full(4, 0.5, np.float32))
    state = names["State"](jnp.zeros(19, np.float32), jnp.zeros(18, np.float32))
    after = jax.eval_shape(names["step"], env, state, jnp.zeros(3, np.float32))
    assert jax.tree.map(lambda x: x.shape, after) == names["State"]((19,), (18,))


def _explicit_damping_is_as_told(dog, stand):
    """What a step makes of the speed of the lightest leg, with damping in tau: times 1 - dt c / inertia."""
    M = np.float64(js.mass_matrix(dog, np.float32([1, 0, 0, 0, 0, 0, 0.4, *stand])))
    mobility = np.linalg.eigvalsh(np.linalg.inv(M)[6:, 6:]).max()  # of the joints, with the trunk in the air
    assert abs(2 / (5e-3 * mobility) - 1.3) < 0.05  # N m s at which it turns around
    assert abs(5e-3 * 2.0 * mobility - 1 - 2.2) < 0.05


@pytest.mark.slow
def test_a_few_robots_without_mjx():
    numbers = last_numbers(soon("04_a_simulator", environments=16, timings=3, peers=0))
    assert numbers["environments"] == 16
    _holds(numbers)


@pytest.mark.slow
def test_as_in_the_file():
    needs("mujoco.mjx")
    _holds(last_numbers(as_a_reader("04_a_simulator")))

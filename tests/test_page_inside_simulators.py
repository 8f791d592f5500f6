"""What the page on thruster, wind and spring in MJX and Brax shows, holds: notebooks/05_inside_simulators.ipynb."""

import pytest

from tests.helpers.notebooks import as_a_reader, last_numbers, soon
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


def test_a_few_environments_of_mjx():
    _holds(last_numbers(soon("05_inside_simulators", environments=8, simulators=["MJX"])), ["MJX"])


@pytest.mark.slow
def test_as_in_the_file():
    _holds(last_numbers(as_a_reader("05_inside_simulators")), ["MJX", "Brax"])

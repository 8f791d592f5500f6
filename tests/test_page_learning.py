"""The notebook on learning, with small sizes and with its own: each part ends with a number that its gradients made."""

import pytest

from tests.helpers.notebooks import as_a_reader, last_numbers, soon

SMALL = {"FRICTION_UPDATES": 120, "JUMP_UPDATES": 60, "ENVIRONMENTS": 64, "POLICY_UPDATES": 200}


# By default `test_notebooks` looks at its code.
@pytest.mark.slow
@pytest.mark.parametrize("sizes", [SMALL, {}], ids=["small", "full"])
@pytest.mark.filterwarnings("ignore")
def test_the_page_learns(sizes):
    found = last_numbers(soon("06_learning", runs_long=True, **sizes) if sizes else as_a_reader("06_learning"))

    # Seven hinges: 7 parameters of each link but the first, of which there is one.
    assert (found["rank"], found["rank_of_unknown"]) == (43, 30)
    assert found["links_with_known_mass"] == [5, 7]
    assert found["mass_error_believed"] > 0.25
    assert found["mass_error_least_squares"] < 0.015 and found["mass_error_learned"] < 0.015
    assert found["bodies_learned"] == 4 > found["bodies_of_least_squares"]

    assert found["angle_error_after"] < (0.1 if sizes else 0.05) * found["angle_error_before"]

    assert max(found["friction_slope_errors"]) < 1e-7

    assert found["jump_miss_before"] > 0.4
    assert found["jump_miss_after"] < (0.02 if sizes else 0.01)
    assert found["jump_gradient_error"] < 1e-5

    assert found["standing_before"] < 0.05
    assert found["standing_after"] > (0.7 if sizes else 0.9)
    assert found["cost_after"] < (0.3 if sizes else 0.25)
    assert max(found["policy_slope_errors"]) < 1e-7

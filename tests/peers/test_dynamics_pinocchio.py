"""Every algorithm on every robot of example-robot-data, against Pinocchio in float64: relative error 1e-12 in float64,
2e-5 in float32.

Relative to the largest number of each result. What differs by choice, and is converted: see `pinocchio_models`. Robots
are evaluated op by op in NumPy, with the bits of the compiled program: that is tested with the large ones. All errors
are in `robots.md`, beside this file.
"""

import functools
import itertools

import jax
import numpy as np
import pytest

from tests.helpers.optional import needs

needs("pinocchio")
from tests.helpers import pinocchio_models as models  # noqa: E402

# With sliding joints and a mimic; with continuous ones and a base that floats.
FAST = [("panda", False, "float64"), ("double_pendulum_continuous", True, "float32")]
LARGE = [("anymal_b_simple-anymal", True), ("g1_29dof_rev_1_0", True), ("icub", True), ("talos_full_v2", False)]
# What `from_urdf` refuses, and why; and a root link "world", which cannot float.
REFUSED = {"alex_psyonic_hands": "mimic: there is no joint 'index_q1'", "ur3": "got no link at all"}
FIXED_TO_WORLD = 'the root link is "world", which cannot float'


def case(name, floating_base, *dtype):
    base = "floating" if floating_base else "fixed"
    marks = () if (name, floating_base, *dtype) in FAST else pytest.mark.slow
    return pytest.param(name, floating_base, *dtype, id="-".join([name, base, *dtype]), marks=marks)


@pytest.fixture(autouse=True)
def forget_what_was_traced(request):
    """Of a hundred robots it would take a hundred gigabytes."""
    yield
    if request.node.get_closest_marker("slow"):
        states.cache_clear()
        jax.clear_caches()


@functools.cache
def states(name, floating_base, dtype):
    try:
        if not models.load(name, floating_base)[1].nv:
            pytest.skip("nothing moves")
    except ValueError as error:
        pytest.skip(str(error))
    return models.States(name, floating_base, dtype)


@pytest.mark.parametrize(
    ("name", "floating_base", "dtype"),
    [case(*x) for x in itertools.product(models.ROBOTS, (False, True), models.ALLOWED)],
)
def test_all_algorithms(name, floating_base, dtype):
    s = states(name, floating_base, dtype)
    errors = {what: (s.error(what, is_compiled=False), s.allowed(what)) for what in s.compared()}
    wrong = {what: both for what, both in errors.items() if not both[0] <= both[1]}
    assert not {what: both for what, both in wrong.items() if not s.is_noise_of_theirs(what)}


@pytest.mark.parametrize("dtype", models.ALLOWED)
@pytest.mark.parametrize("what", models.ALGORITHMS)
@pytest.mark.parametrize(("name", "floating_base"), [case(*x) for x in LARGE])
def test_compiled(name, floating_base, what, dtype):
    """The same bits, but for what LAPACK solves."""
    s = states(name, floating_base, dtype)
    if what not in s.compared():
        pytest.skip("singular up to rounding")
    compiled = s.ours(what)
    if models.BY_INVERSE.get(what, 0) > 1 or s.mech.topology.has_mimics:
        assert s.error_of(what, compiled) <= s.allowed(what)
    else:
        np.testing.assert_array_equal(compiled, s.ours(what, is_compiled=False))


@pytest.mark.slow
def test_nothing_else_is_refused():
    for name in models.ROBOTS:
        for floating_base in (False, True):
            try:
                models.load(name, floating_base)
            except ValueError as error:
                expected = REFUSED.get(name, FIXED_TO_WORLD if floating_base else "nothing")
                assert expected in str(error), (name, error)

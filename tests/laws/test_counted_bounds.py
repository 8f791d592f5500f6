"""The number in a bound is what counting the roundings proves, for any inputs: not less, and not twice as much.

Inputs that break a bound that is too small may be hard to find: all roundings have to be as large as they can, and of
one sign. So besides the inputs of `test_error_bounds` each number is held to the count of `helpers.counted`. Halved, it
is less than the count. An operation that is new in the table is counted as all others.
"""

import functools

import pytest

from jaxspatial.inertia import articulated
from jaxspatial.numerics.promise import EXACT
from jaxspatial.rotation.rotation import ROTATED
from jaxspatial.spatial import operations, transform, vectors
from tests.helpers import counted
from tests.helpers.operations import BOUNDED, OPERATIONS

# What adds up the errors of sums and of products has errors itself, of u^2. That each of them is as large as it can be,
# and all have one sign, takes more than there is: of a shift the largest is 4, and not 6, see `sums.compensated`. No
# input is known that takes more than a fifth of any of these; halved they stand below the count all the more.
SHARPER = (
    operations.SHIFT, operations.DOT, operations.CROSS_TWO, ROTATED, transform.POINT, vectors.COMPOSED,
    vectors.COMPOSED_ACCELERATION, articulated.TIMES,
)  # fmt: skip
# In "compensated" they are no one sum of products: sums over items; formulas in double words; of `central_axis` the
# powers of two that it is scaled by take comparisons. Their numbers of u^2 are held by inputs alone.
NOT_COUNTED_TWICE = {
    "wrench_from_point_forces", "sum", "central_axis", "newton_euler", "rotate_articulated", "act_articulated",
    "act_inverse_articulated",
}  # fmt: skip


@functools.cache
def _counted(name, is_twice):
    """[(bound, count)] of the arrays of a result that are not exact; none of what is not counted."""
    found = (counted.twice if is_twice else counted.plain)(OPERATIONS[name])
    return [x for x in zip(OPERATIONS[name].bounds, found or [], strict=bool(found)) if x[0] != EXACT]


def _is_enough(u, of_result, count):
    """Of a quotient the part of what it was divided by counts on its own where it is stated on its own."""
    return u >= count.of_mag and of_result >= count.of_result if of_result else u >= count.of_both


@pytest.mark.parametrize("name", BOUNDED)
def test_a_bound_is_at_least_what_counting_proves(name):
    once, twice = _counted(name, False), _counted(name, True)
    assert all(_is_enough(bound.u, bound.u_of_result, count) for bound, count in once), once
    assert bool(twice) == (name not in NOT_COUNTED_TWICE)
    for bound, count in twice:
        assert any(bound is x for x in SHARPER) or _is_enough(bound.u2, bound.u2_of_result, count), (bound, count)


@pytest.mark.parametrize(("number", "is_twice"), [("u", False), ("u2", True)])
def test_no_number_is_twice_what_counting_proves(number, is_twice):
    """Of all operations that have the bound."""
    counts = {}
    for name in BOUNDED:
        for bound, count in _counted(name, is_twice):
            counts.setdefault(id(bound), (bound, []))[1].append((count.of_mag, count.of_result, count.of_both))
    for bound, found in counts.values():
        of_mag, of_result, of_both = map(max, zip(*found, strict=True))
        u, of_quotient = getattr(bound, number), getattr(bound, f"{number}_of_result")
        assert not u or u < 2 * (of_mag if of_quotient else of_both), (bound, found)
        assert not of_quotient or of_quotient < 2 * of_result, (bound, found)

"""What is measured is what is meant: operations against their exact references, errors, promises. Never times."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.command import trade
from jaxspatial.measure import error, timing
from jaxspatial.measure.operation import OPERATIONS, Wrenches, rotating_body
from jaxspatial.numerics.precision import Precision
from tests.helpers.marks import slow_but

OFFSET = np.array([0.3, -0.2, 0.5])
WRENCHES = rotating_body(50)


@pytest.mark.parametrize("name", OPERATIONS)
def test_record_of_an_operation_is_consistent(name):
    """The function computes the formulas, in as many numbers as the record says."""
    operation = OPERATIONS[name]
    arrays = operation.drawn(WRENCHES, OFFSET, 50, "float32")
    computed, exactly = operation.batched("reproducible")(*arrays), operation.exactly(*arrays)
    assert len(operation.bounds) == len(operation.formulas) == len(computed)
    assert sum(x.size for x in computed) == 50 * operation.size and operation.words == 3 * len(arrays) + operation.size
    assert operation.of_promise("reproducible", computed, exactly)[0] <= 1
    flipped = [-x if i in operation.flipped else x for i, x in enumerate(arrays)]
    for there, back, (value, mag) in zip(computed, operation.batched("fast")(*flipped), exactly, strict=True):
        if operation.in_place is None:
            assert error.in_units_of(mag * 2**-20, -back, value).max() <= 1
        else:
            assert error.in_units_of(mag * 2**-20, there + back, 2 * value * 0 + _twice(arrays, operation)).max() <= 2


def _twice(arrays, operation):
    """What shifts there and back add up to: twice what was to be shifted."""
    return 2 * error.rationals(arrays[operation.in_place])


@pytest.mark.parametrize("precision", Precision)
def test_promises_are_those_of_the_docstrings(precision):
    value, mag = np.array([error.rationals(1.0).item()]), np.array([error.rationals(3.0).item()])
    u = 2.0**-24
    bound = float(OPERATIONS["dot"].allowed(precision, 0, value, mag, "float32")[0])
    assert bound == {"compensated": u + 24 * u**2, "faithful": 2 * u}.get(precision, 12 * u)


def test_an_error_beyond_the_promise_is_seen():
    operation = OPERATIONS["shift_force"]
    arrays = operation.drawn(WRENCHES, OFFSET, 50, "float32")
    (computed,), exactly = operation.batched("faithful")(*arrays), operation.exactly(*arrays)
    off = np.nextafter(np.nextafter(computed, np.float32(np.inf)), np.float32(np.inf))
    assert operation.of_promise("faithful", [computed], exactly)[0] <= 0.51
    ratio, ulps = operation.of_promise("faithful", [off], exactly)
    assert 1 < ratio <= 2.5 and ulps.max() <= 2.5
    assert operation.of_promise("fast", [np.full_like(computed, np.nan)], exactly)[0] == np.inf


@pytest.mark.parametrize("dtype", slow_but(["float32"], trade.DTYPES))
def test_rows(dtype):
    lines = trade.cases(("shift_velocity", "dot"), (dtype,))
    advanced = []
    rows = trade.measure(WRENCHES, OFFSET, lines, 1_000, lambda: advanced.append(1))
    assert [row.case for row in rows] == lines and len(advanced) == trade.steps(lines)
    for row in rows:
        assert row.holds and row.ulps.size == (3 if "shift" in row.case.operation else 1) * 500
        assert np.isfinite(row.ulps).all() and (row.streamed is None) == (dtype not in trade.STREAMED)
        assert row.worst_ulps <= 1 or row.case.precision in ("fast", "reproducible")


def test_a_step_of_the_timed_loop_is_the_operation(x64):
    """And two are there and back: what is fed back in is what came out."""
    operation = OPERATIONS["shift_force"]
    arrays = operation.drawn(WRENCHES, OFFSET, 50, "float32")
    loop = trade._Loop(operation, Precision.REPRODUCIBLE, arrays, lambda: None)
    once, there_and_back = (loop(count)[0] for count in (1, 2))
    np.testing.assert_array_equal(once, operation.batched("reproducible")(*arrays)[0])
    np.testing.assert_allclose(there_and_back, arrays[0], atol=1e-4)


def test_what_overflows_in_a_narrow_format_is_left_out():
    wrenches = Wrenches(*(np.where(np.arange(50)[:, None] < 25, x, x * 1e4) for x in WRENCHES if x is not None))
    rows = trade.measure(wrenches, OFFSET, trade.cases(("dot",), ("float16",)), 1_000)
    assert all(row.holds and 0 < row.ulps.size < 500 for row in rows)
    rows = trade.measure(
        Wrenches(*(x * 1e30 for x in WRENCHES if x is not None)),
        OFFSET,
        trade.cases(("dot",), ("float16",)),
        1_000,
    )
    assert all(row.holds and np.isnan(row.worst_ulps) for row in rows)


def test_sizes_and_cases():
    assert trade.sizes() == (trade.IN_CACHE, trade.LARGEST) and trade.sizes(1_000) == (1_000, 1_000)
    assert len(trade.cases()) == len(set(trade.cases())) == len(OPERATIONS) * 4 * 4


def test_slow_cases_get_fewer_rounds():
    calls = []
    times = timing.interleaved({"a": lambda: calls.append(1)}, rounds=20, limit=0.0)
    assert len(times["a"]) == 3 and len(calls) == 5


@pytest.fixture(scope="module")
def curves():
    return trade.curves(trade.curved(("dot",)))


def test_conditions_reach_from_one_to_beyond_all_digits(curves):
    for curve in curves:
        found = [point.condition for point in curve.points]
        u = float(error.unit_roundoff(curve.dtype))
        assert found == sorted(found) and found[0] < 10 and found[-2] > 0.1 / u**2 and found[-1] == np.inf
        assert curve.holds and sum(point.results for point in curve.points) > 1000
        finite = np.array(found[:-1])
        ulps = np.array([point.worst_ulps for point in curve.points[:-1]])
        assert (ulps <= trade.promised_ulps(curve, 10**0.5 * finite)).all()


def test_precisions_lose_their_digits_in_order(curves):
    ends = {(c.dtype, c.precision): c.points[-2].worst_ulps for c in curves}
    for dtype in trade.STREAMED:
        assert ends[dtype, "faithful"] <= 1 < ends[dtype, "compensated"] < 1e-5 * ends[dtype, "reproducible"]


def test_formats_are_those_asked_for():
    for dtype in trade.DTYPES:
        with jax.enable_x64(dtype == "float64"):
            arrays = OPERATIONS["dot"].drawn(WRENCHES, OFFSET, 120, dtype)
            assert all(x.dtype == jnp.dtype(dtype) and x.shape == (120, 3) for x in arrays)

"""Against pydrake, as far as it binds its spatial vectors: construction, sums, multiples, shift and dot, in float64.

Either side errs by at most k u mag, u = 2^-53 and mag the sum of the absolute values of a component's terms, hence the
two differ by at most 2 k u mag: k = 3 for a shift, 7 for that of an acceleration, 4 for dot. What takes one rounded
operation, or none, has to be equal.
"""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.drake_oracle import every_kind, shift_magnitudes
from tests.helpers.optional import needs
from tests.helpers.peer_inputs import inputs

drake = needs("pydrake.multibody.math")

U = 2.0**-53


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def drakes(kind):
    """Drake's class of the same name."""
    return getattr(drake, kind.__name__)


def coefficients(vectors):
    return np.array([x.get_coeffs() for x in vectors])


@every_kind
def test_six_coefficients_are_in_drakes_order(kind):
    (six,) = inputs(6)
    theirs = [drakes(kind)(row) for row in six]
    for ours in (kind.from_array(six), kind(six[:, :3], six[:, 3:])):
        np.testing.assert_array_equal(ours.to_array(), coefficients(theirs))
        np.testing.assert_array_equal(ours.rotational, [x.rotational() for x in theirs])
        np.testing.assert_array_equal(ours.translational, [x.translational() for x in theirs])


@every_kind
def test_parts_have_drakes_names(kind):
    parts = dict(zip(kind.__dataclass_fields__, ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]), strict=True))
    np.testing.assert_array_equal(kind(**parts).to_array(), drakes(kind)(**parts).get_coeffs())


@every_kind
def test_zero_is_drakes_zero_and_nan_drakes_default(kind):
    np.testing.assert_array_equal(kind.zero().to_array(), drakes(kind).Zero().get_coeffs())
    np.testing.assert_array_equal(kind.nan().to_array(), drakes(kind)().get_coeffs())


_ARITHMETIC = {
    "-x": lambda x, y, s: -x,
    "x + y": lambda x, y, s: x + y,
    "x - y": lambda x, y, s: x - y,
    "s * x": lambda x, y, s: s * x,
    "x * s": lambda x, y, s: x * s,
}


@every_kind
@pytest.mark.parametrize("operation", _ARITHMETIC.values(), ids=_ARITHMETIC.keys())
def test_sums_and_multiples_equal_drakes(kind, operation):
    six, other, scalars = inputs(6, 6, 3)
    rows = zip(six, other, scalars[:, 0], strict=True)
    theirs = [operation(drakes(kind)(a), drakes(kind)(b), s) for a, b, s in rows]
    ours = operation(kind.from_array(six), kind.from_array(other), scalars[:, 0])
    np.testing.assert_array_equal(ours.to_array(), coefficients(theirs))


@every_kind
@pytest.mark.parametrize("of_the_batch", [lambda shift: shift, jax.vmap], ids=["broadcast", "vmap"])
def test_shift_agrees_with_drake(kind, of_the_batch):
    six, p, w = inputs(6, 3, 3)
    offsets = (p, w) if kind is js.SpatialAcceleration else (p,)
    theirs = [drakes(kind)(row).Shift(*o) for row, *o in zip(six, *offsets, strict=True)]
    assert_shifted_alike(of_the_batch(js.shift)(kind.from_array(six), *offsets), theirs, six, offsets)


def test_acceleration_of_a_body_that_does_not_turn_agrees_with_drake():
    six, p = inputs(6, 3)
    not_turning = np.zeros_like(p)
    theirs = [drake.SpatialAcceleration(row).ShiftWithZeroAngularVelocity(o) for row, o in zip(six, p, strict=True)]
    ours = js.shift(js.SpatialAcceleration.from_array(six), p, not_turning)
    assert_shifted_alike(ours, theirs, six, (p, not_turning))


def assert_shifted_alike(ours, theirs, six, offsets):
    magnitudes = np.hstack(shift_magnitudes(type(ours), six[:, :3], six[:, 3:], *offsets))
    k = 7 if isinstance(ours, js.SpatialAcceleration) else 3
    assert (abs(np.asarray(ours.to_array()) - coefficients(theirs)) <= 2 * k * U * magnitudes).all()


@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
def test_dot_agrees_with_drake_both_ways_round(kind):
    six, motion = inputs(6, 6)
    x, V = kind.from_array(six), js.SpatialVelocity.from_array(motion)
    theirs = [(drakes(kind)(a), drake.SpatialVelocity(b)) for a, b in zip(six, motion, strict=True)]
    bound = 2 * 4 * U * abs(six * motion).sum(-1)
    assert (abs(np.asarray(js.dot(x, V)) - [a.dot(b) for a, b in theirs]) <= bound).all()
    assert (abs(np.asarray(js.dot(V, x)) - [b.dot(a) for a, b in theirs]) <= bound).all()

"""Against Pinocchio's Force and Motion, which hold the linear part first: shift, dot, cross products, in float64.

Moving a point by o is to look from a frame placed at o with the same axes, SE3(1, o).actInv. Either side errs by at
most k u mag, u = 2^-53 and mag the sum of the absolute values of a component's terms, hence the two differ by at most
2 k u mag: k = 3 for a shift and for a sum of two cross products, 2 for one cross product, 4 for dot, 7 for the
classical acceleration. Pinocchio's products with the ones and zeros of a rotation are exact.
"""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.drake_oracle import cross_magnitudes, shift_magnitudes
from tests.helpers.optional import needs
from tests.helpers.peer_inputs import inputs

pin = needs("pinocchio")

U = 2.0**-53
FORCES = (js.SpatialForce, js.SpatialMomentum)
MOTIONS = (js.SpatialVelocity, js.SpatialAcceleration)
named = {"ids": lambda kind: kind.__name__}


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def pinocchios(kind, six):
    """Pinocchio's counterpart of each row, rotational first, of `six`."""
    counterpart = pin.Force if kind in FORCES else pin.Motion
    return [counterpart(row[3:], row[:3]) for row in six]


def coefficients(vectors):
    """Rotational first."""
    return np.array([(*x.angular, *x.linear) for x in vectors])


def parts(six):
    return six[:, :3], six[:, 3:]


def seen_from(o):
    return pin.SE3(np.eye(3), o)


@pytest.mark.parametrize("kind", FORCES + MOTIONS, **named)
def test_parts_change_places(kind):
    (six,) = inputs(6)
    ours = kind.from_array(six)
    np.testing.assert_array_equal(ours.to_array(), coefficients(pinocchios(kind, six)))
    linear_first = np.hstack([ours.translational, ours.rotational])
    np.testing.assert_array_equal(linear_first, [x.vector for x in pinocchios(kind, six)])


_SEEN = {
    "actInv, at o": lambda x, o: seen_from(o).actInv(x),
    "act, at -o": lambda x, o: seen_from(-o).act(x),
}


@pytest.mark.parametrize("seen", _SEEN.values(), ids=_SEEN.keys())
@pytest.mark.parametrize("kind", (*FORCES, js.SpatialVelocity), **named)
def test_shift_is_the_action_of_a_placement(kind, seen):
    six, p = inputs(6, 3)
    theirs = coefficients(seen(x, o) for x, o in zip(pinocchios(kind, six), p, strict=True))
    ours = js.shift(kind.from_array(six), p).to_array()
    assert (abs(np.asarray(ours) - theirs) <= 2 * 3 * U * np.hstack(shift_magnitudes(kind, *parts(six), p))).all()


def test_shifted_acceleration_is_the_classical_one_of_the_other_point():
    """About a point at rest, whose spatial and classical accelerations are the same: V = (w, 0)."""
    six, p, w = inputs(6, 3, 3)
    at_rest = np.hstack([w, np.zeros_like(w)])
    motions = zip(pinocchios(js.SpatialVelocity, at_rest), pinocchios(js.SpatialAcceleration, six), p, strict=True)
    theirs = np.array([pin.classicAcceleration(V, A, seen_from(o)) for V, A, o in motions])
    ours = js.shift(js.SpatialAcceleration.from_array(six), p, w)
    _, magnitude = shift_magnitudes(js.SpatialAcceleration, *parts(six), p, w)
    assert (abs(np.asarray(ours.translational) - theirs) <= 2 * 7 * U * magnitude).all()
    np.testing.assert_array_equal(ours.rotational, six[:, :3])


@pytest.mark.parametrize("kind", FORCES + MOTIONS, **named)
def test_cross_product_of_a_motion_with(kind):
    motion, six = inputs(6, 6)
    pairs = zip(pinocchios(js.SpatialVelocity, motion), pinocchios(kind, six), strict=True)
    theirs = coefficients(V.cross(x) for V, x in pairs)
    ours = js.cross(js.SpatialVelocity.from_array(motion), kind.from_array(six)).to_array()
    assert (abs(np.asarray(ours) - theirs) <= U * np.hstack(cross_bounds(kind, *parts(motion), *parts(six)))).all()


def cross_bounds(kind, w, v, rotational, translational):
    """2 k mag: one cross product where w meets the part that all points share, a sum of two elsewhere."""
    if kind in MOTIONS:
        both = cross_magnitudes(w, translational) + cross_magnitudes(v, rotational)
        return 2 * 2 * cross_magnitudes(w, rotational), 2 * 3 * both
    both = cross_magnitudes(w, rotational) + cross_magnitudes(v, translational)
    return 2 * 3 * both, 2 * 2 * cross_magnitudes(w, translational)


@pytest.mark.parametrize("kind", FORCES, **named)
def test_dot_both_ways_round(kind):
    six, motion = inputs(6, 6)
    x, V = kind.from_array(six), js.SpatialVelocity.from_array(motion)
    pairs = list(zip(pinocchios(kind, six), pinocchios(js.SpatialVelocity, motion), strict=True))
    bound = 2 * 4 * U * abs(six * motion).sum(-1)
    assert (abs(np.asarray(js.dot(x, V)) - [F.dot(W) for F, W in pairs]) <= bound).all()
    assert (abs(np.asarray(js.dot(V, x)) - [W.dot(F) for F, W in pairs]) <= bound).all()

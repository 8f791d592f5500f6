"""Which precision a function needs: the errors it tells are those of the numbers, and the choice follows from them."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.measure import recommend
from jaxspatial.measure.timing import Measured, Recommendation


def cancelling():
    """A shift whose torque is a small rest of large terms, by an offset along the force but for rounding."""
    f, p = jnp.asarray([[1.0, 1.1, 3.0]], np.float32), jnp.asarray([[1e3, 1.1e3, 3e3]], np.float32)
    return js.SpatialForce(jnp.zeros((1, 3), np.float32), f), p


def test_the_errors_are_those_of_exact_numbers():
    F, p = cancelling()
    found = {row.precision: row.error for row in recommend(lambda F, p: js.shift(F, p).tau, F, p, tolerance=1).rows}
    f, r = ([Fraction(float(x)) for x in np.asarray(y)[0]] for y in (F.f, p))
    exact = [-(r[i] * f[j] - r[j] * f[i]) for i, j in ((1, 2), (2, 0), (0, 1))]
    for name, error in found.items():
        tau = np.asarray(js.shift(F, p, precision=name).tau)[0]
        true = float(max(abs(Fraction(float(x)) - y) for x, y in zip(tau, exact, strict=True)) / max(map(abs, exact)))
        assert error == pytest.approx(true, rel=1e-6, abs=1e-15)
    assert found["compensated"] <= 2.0**-24 < 1e-5 < found["reproducible"]


def test_what_holds_is_recommended():
    F, p = cancelling()
    strict = recommend(lambda F, p: js.shift(F, p).tau, F, p, tolerance=1e-6)
    assert strict.precision in ("compensated", "faithful")
    assert not {row.precision for row in strict.rows if row.holds} & {"fast", "reproducible"}
    assert f'use "{strict.precision}"' in repr(strict)
    hopeless = recommend(lambda F, p: js.shift(F, p).tau, F, p * np.float32([[0.1, 0.3, 0.7]]), tolerance=1e-12)
    assert hopeless.precision is None and "no precision holds 1e-12" in repr(hopeless)


def test_the_fastest_that_holds():
    rows = [
        Measured("fast", 1e-3, 1.0, False),
        Measured("reproducible", 1e-7, 3.0, True),
        Measured("b", 0.0, 2.0, True),
    ]
    assert Recommendation(rows, 1e-6).precision == "b"
    assert repr(Recommendation(rows, 1e-6)).splitlines()[1].split() == ["fast", "1.00e-03", "1e+06", "us", "1.00", "no"]


def test_whole_algorithms_and_trees():
    """Of a float32 mechanism; integers pass."""
    mech = js.testing.random_mechanism(0, 1, ["revolute"], dtype=np.float32)
    q = np.asarray([0.1], np.float32)

    def energies(q, n):
        return {"tau": js.inverse_dynamics(mech, q, q, q), "n": n}

    found = recommend(energies, q, jnp.int32(3), tolerance=1e-5, rounds=1)
    assert all(row.error < 1e-5 for row in found.rows)


def test_infinite_where_a_result_is_not_finite():
    with jax.enable_x64(False):
        found = recommend(lambda x: x * x, jnp.float32(1e30), tolerance=1.0, rounds=1)
    assert found.precision is None and all(row.error == np.inf for row in found.rows)


def test_errors():
    with pytest.raises(ValueError, match="tolerance: expected a number above 0, known while tracing, got 0"):
        recommend(lambda x: x, jnp.ones(3), tolerance=0)
    with pytest.raises(ValueError, match="arguments: expected arrays of floating point numbers"):
        recommend(lambda x: x, 3, tolerance=1)

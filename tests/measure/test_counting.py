"""Operations that a function asks for, counted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

F = js.SpatialForce(jnp.ones(3), jnp.ones(3))


def count(function, *arguments, **how):
    return dict(js.measure.count_operations(function, *arguments, **how))


def test_a_shift_takes_six_products_and_what_is_known_fewer():
    """tau - p x f: two products for each component of p that is not zero."""
    assert count(js.shift, F, jnp.ones(3))["multiply"] == 6
    assert count(lambda F: js.shift(F, np.float32([0, 2, 3])), F)["multiply"] == 4
    assert count(lambda F: js.shift(F, np.float32([0, 0, 3])), F)["multiply"] == 2
    assert count(lambda F: js.shift(F, np.zeros(3, np.float32)), F) == {}


def test_every_state_of_a_batch_counts_and_what_nobody_reads_does_not():
    x = jnp.ones(5)
    assert count(lambda x: x * x + 1.0, x) == {"multiply": 5, "add": 5}
    assert count(lambda x: ((x * x)[0], (x / 3.0)[1:1]), x) == {"multiply": 1}


def test_loops_count_as_often_as_they_turn():
    """Long ones; short loops are written out in either case."""

    def powers(x):
        return jax.lax.fori_loop(0, 100_000, lambda _, y: y * x, x)

    assert count(powers, jnp.float32(1.5))["multiply"] == 100_000
    assert count(powers, jnp.float32(1.5), in_all_turns=False)["multiply"] < 100_000


def test_programs_of_robots_are_looked_into():
    """Two hinges: inverse dynamics of a plane, whose gravity is in it or not."""
    rod = js.shift(js.SpatialInertia.thin_rod(1.0, mass=2.0), jnp.array([0.0, 0.0, 0.5]))
    joint = js.Joint("hinge", "revolute", "world", "rod", axis=(0, 1, 0))
    pendulum = js.Mechanism.build([js.Body("rod", rod)], [joint])
    q = jnp.ones(1)
    data, known, weightless = (
        sum(js.measure.count_operations(lambda q, m=m: js.inverse_dynamics(m, q, q, q), q).values())
        for m in (pendulum.as_data(), pendulum, pendulum.replace(gravity=np.zeros(3, np.float32)))
    )
    assert data > known > weightless > 0
    batch = count(jax.vmap(lambda q: js.gravity_forces(pendulum, q)), jnp.ones((7, 1)))
    assert batch == {name: 7 * n for name, n in count(lambda q: js.gravity_forces(pendulum, q), q).items()}


def test_what_cannot_be_counted_is_refused():
    with pytest.raises(NotImplementedError, match="count_operations: cannot count"):
        count(jnp.sort, jnp.ones(3))

"""`jax.jacfwd` and `jax.jacrev` of dynamics: by the closed forms, whatever they are nested in, and the same numbers.

What is traced decides it, and is evaluated in NumPy; columns of tangents are compiled too.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import tangents
from tests.helpers.interpreted import interpreted

N = 3


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@functools.cache
def mechanism():
    """Joints of a quaternion and in the plane, whose rates are not those of coordinates."""
    return js.testing.random_mechanism(0, 2, ["free", "planar"], is_chain=True, dtype=np.float64)


@functools.cache
def state():
    mech, rng = mechanism(), np.random.default_rng(3)
    q = js.random_configuration(mech, jax.random.key(4), N, np.float64)
    return q, *(jnp.asarray(rng.standard_normal((N, mech.nv))) for _ in range(2))


def inverse(q, v, a):
    return js.inverse_dynamics(mechanism(), q, v, a)


def forward(q, v, tau):
    return js.forward_dynamics(mechanism(), q, v, tau)


@functools.cache
def expected(function):
    return interpreted(jax.vmap(tangents.jacobians(function, (0, 1, 2))))(*state())


def require_near(found, wanted, allowed=256.0):
    for x, y in zip(found, wanted, strict=True):
        assert x.shape == y.shape
        assert abs(np.asarray(x - y)).max() <= allowed * 2.0**-53 * abs(np.asarray(y)).max()


@pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev])
def test_of_inverse_dynamics(jacobian):
    require_near(interpreted(jax.vmap(jacobian(inverse, (0, 1, 2))))(*state()), expected(inverse))


@pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev])
def test_of_forward_dynamics(jacobian):
    """More columns than rates, and for tau as many: M^-1 once, and column by column."""
    condition = max(np.linalg.cond(M) for M in interpreted(functools.partial(js.mass_matrix, mechanism()))(state()[0]))
    found = interpreted(jax.vmap(jacobian(forward, (0, 1, 2))))(*state())
    require_near(found, expected(forward), 64 * condition)


def test_of_many_states_go_through_the_columns_of_their_factors():
    """As those of a few, whose columns are side by side."""
    n = 70
    many = [jnp.concatenate([x, jnp.repeat(x[:1], n - N, 0)]) for x in state()]
    by_tau = interpreted(jax.vmap(jax.jacfwd(forward, 2)))
    require_near([by_tau(*many)[:N]], [by_tau(*state())], 1e4)


def test_by_a_part_of_the_arguments_and_of_one_batch():
    """By q and by v alone; of a function over a batch, whose Jacobian is one for all; rows of one state."""
    q, v, a = (x[0] for x in state())
    by_q, by_v, _ = (x[0] for x in expected(inverse))
    found = interpreted(lambda *x: [jax.jacfwd(inverse)(*x), jax.jacrev(inverse, 1)(*x)])(q, v, a)
    require_near(found, [by_q, by_v])
    whole = interpreted(jax.jacrev(inverse, 1))(*state())
    for i in range(N):
        for j in range(N):
            wanted = expected(inverse)[1][i] if i == j else jnp.zeros_like(by_v)
            require_near([whole[i, :, j]], [wanted], 256.0 if i == j else 0.0)


def test_without_rates_or_accelerations():
    q, v, _ = (x[0] for x in state())
    zero = jnp.zeros(mechanism().nv)
    bias = interpreted(jax.jacfwd(lambda q, v: js.bias_forces(mechanism(), q, v), (0, 1)))
    gravity = interpreted(jax.jacrev(lambda q: js.gravity_forces(mechanism(), q)))
    wanted = interpreted(tangents.jacobians(inverse, (0, 1)))
    require_near(bias(q, v), wanted(q, v, zero))
    require_near([gravity(q)], wanted(q, zero, zero)[:1])


def test_cotangents_of_what_states_share_are_added_up():
    """One configuration under many rates, broadcast by the caller or here: the rows of each result, by it."""
    q, v, a = state()
    one_by_one = interpreted(jax.vmap(tangents.jacobians(inverse, (0,))))(jnp.broadcast_to(q[0], q.shape), v, a)[0]
    for shared in (lambda q: jnp.broadcast_to(q, (N, *q.shape)), lambda q: q):
        found = interpreted(jax.jacrev(lambda q, shared=shared: jnp.sum(inverse(shared(q), v, a), 0)))(q[0])
        require_near([found], [one_by_one.sum(0)], 1e3)


def test_cotangents_of_what_some_states_share_are_added_up():
    """Two rates at each configuration."""
    q, v, a = state()
    slope = interpreted(jax.grad(lambda q, v: inverse(q, v, a).sum()))
    require_near([slope(q, jnp.stack([v, a]))], [slope(q, v) + slope(q, a)], 1e3)


def test_second_derivatives():
    """Hessians of an energy of forces, along two rates, against nested tangents."""
    q, v, a = (x[0] for x in state())
    hessian = interpreted(jax.jacfwd(jax.jacrev(lambda v: (inverse(q, v, a) ** 2).sum())))(v)
    gradient = jax.grad(lambda v: (inverse(q, v, a) ** 2).sum())
    require_near([hessian], interpreted(tangents.jacobians(gradient, (0,)))(v), 1e3)


@pytest.mark.parametrize("columns", [1, 5])
def test_fewer_columns_than_rates_are_tangents(columns):
    """The bits of each tangent on its own."""
    (q, v, a), rng = (x[0] for x in state()), np.random.default_rng(0)
    assert columns < mechanism().nv
    along = jnp.asarray(rng.standard_normal((columns, mechanism().nv)))
    tangent = lambda dv: jax.jvp(lambda v: inverse(q, v, a), (v,), (dv,))[1]  # noqa: E731
    one_by_one = np.stack([interpreted(tangent)(x) for x in along])
    np.testing.assert_array_equal(jax.jit(jax.vmap(tangent))(along), one_by_one)


def test_they_are_the_closed_forms():
    """One program of Jacobians at the states, in place of one of tangents at as many as there are columns."""
    mech = mechanism()

    def sizes(function):
        found = jax.make_jaxpr(jax.vmap(function))(*state())
        return [
            equation.outvars[0].aval.shape
            for equation in found.jaxpr.eqns
            if equation.primitive.name == "jaxspatial_program"
        ]

    assert (N, mech.nv, mech.nq) in sizes(jax.jacfwd(inverse))
    assert (N, mech.nv, mech.nv) in sizes(jax.jacrev(inverse, 1))
    assert (mech.nv, N, mech.nv) not in sizes(jax.jacfwd(inverse, 1))


# -- J^T F ------------------------------------------------------------------------------------------------------------


@functools.cache
def tree():
    """Branches, and joints of several velocities: some joints carry a frame, others do not."""
    return js.testing.random_mechanism(1, 6, ["free", "revolute", "universal", "planar", "ball", "prismatic"])


def forces_of_wrench(mech, frame, q, v, F):
    """J^T F as a user has it: the velocity of a frame, pulled back to v."""
    return jax.vjp(lambda v: js.body_velocities(mech, q, v, frame).to_array(), v)[1](F)[0]


def with_matrix(mech, frame, q, F):
    return jnp.einsum("...ij,...i->...j", js.jacobian(mech, q, frame), F)


def wrench_state(dtype):
    mech, rng = tree(), np.random.default_rng(5)
    q = js.random_configuration(mech, jax.random.key(6), N, dtype)
    return q, *(jnp.asarray(rng.standard_normal((N, n)), dtype) for n in (mech.nv, 6))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_pulled_back_wrench_is_the_transposed_jacobian_times_it(dtype):
    mech, (q, v, F) = tree(), wrench_state(dtype)
    for frame in mech.frame_names if dtype == np.float64 else mech.body_names[-2:]:
        found = interpreted(functools.partial(forces_of_wrench, mech, frame))(q, v, F)
        wanted = interpreted(functools.partial(with_matrix, mech, frame))(q, F)
        assert found.dtype == dtype and found.shape == (N, mech.nv)
        largest = abs(np.asarray(wanted)).max()
        assert abs(np.asarray(found - wanted)).max() <= 32 * np.finfo(dtype).eps * largest, frame


@pytest.mark.parametrize("maps", [0, 1, 2])
def test_a_pulled_back_wrench_has_the_same_bits_however_it_is_called(maps):
    mech, state = tree(), wrench_state(np.float64)
    pulled = functools.partial(forces_of_wrench, mech, mech.body_names[-1])
    wanted, mapped = interpreted(pulled)(*state), pulled
    for _ in range(maps):
        mapped = jax.vmap(mapped)
    each = [x[:, None] for x in state] if maps == 2 else state
    np.testing.assert_array_equal(np.asarray(jax.jit(mapped)(*each)).reshape(wanted.shape), wanted)


def test_a_velocity_that_states_share_gets_the_sum_of_their_forces():
    mech, (q, v, F) = tree(), wrench_state(np.float64)
    frame = mech.body_names[-1]
    found = interpreted(functools.partial(forces_of_wrench, mech, frame))(q, v[0], F)
    wanted = np.asarray(with_matrix(mech, frame, q, F)).sum(0)
    assert abs(found - wanted).max() <= 1e-14 * abs(wanted).max()


def test_derivatives_of_a_pulled_back_wrench():
    """By coordinates and by the wrench, which the matrix has, too."""
    mech, (q, v, F) = tree(), wrench_state(np.float64)
    frame = mech.body_names[-1]

    def squares(function):
        return interpreted(jax.grad(lambda q, F: (function(q, F) ** 2).sum(), (0, 1)))(q, F)

    found = squares(lambda q, F: forces_of_wrench(mech, frame, q, v, F))
    wanted = squares(functools.partial(with_matrix, mech, frame))
    for x, y in zip(found, wanted, strict=True):
        assert abs(x - y).max() <= 1e-13 * abs(y).max()


@pytest.mark.parametrize("part", [0, 1])
def test_a_torque_or_a_force_alone_is_pulled_back(part):
    """What reads only the angular, or only the linear velocity."""
    mech, (q, v, F) = tree(), wrench_state(np.float64)
    frame, F = mech.body_names[-1], F[:, 3 * part : 3 * part + 3]

    def pulled(q, v, F):
        return jax.vjp(lambda v: jax.tree.leaves(js.body_velocities(mech, q, v, frame))[part], v)[1](F)[0]

    whole = np.zeros((N, 6))
    whole[:, 3 * part : 3 * part + 3] = F
    found, wanted = interpreted(pulled)(q, v, F), np.asarray(with_matrix(mech, frame, q, whole))
    assert abs(found - wanted).max() <= 1e-14 * abs(wanted).max()


def test_a_cotangent_of_which_others_are_not_read_is_transposed():
    """JAX leaves them out of a trace before it transposes it."""
    q, v, a = (x[0] for x in state())
    of_q = jax.jit(lambda tau: jax.vjp(lambda q, v: inverse(q, v, a), q, v)[1](tau)[0])
    dq = jnp.ones(mechanism().nq)
    found = interpreted(lambda dq: jax.linear_transpose(of_q, jnp.ones(mechanism().nv))(dq)[0])(dq)
    wanted = interpreted(lambda dq: jax.jvp(lambda q: inverse(q, v, a), (q,), (dq,))[1])(dq)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * abs(np.asarray(wanted)).max())

"""Calls run as kernels: the same bits as the plain trace, one reduction for each call, and no call left."""

import functools
import re
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from jaxspatial.engine import kernels, matrices
from jaxspatial.numerics.numbers import Rounded, noinline, where
from jaxspatial.numerics.numbers.layout import unstack
from jaxspatial.numerics.precision import Precision
from tests.helpers.marks import slow

N = 37  # states: no multiple of what a processor computes at once


def number(x):
    return Rounded(Precision.REPRODUCIBLE, x)


@noinline
def step(a, b, c):
    """Three results that share all of their work: sums of products, a quotient, a choice."""
    x = a * b - c * a
    y = x * x + b / (1 + x * x)
    return x + y, y * c - x, where(a.value > 0, x * y, -y)


@noinline
def differences(a, b, c):
    return a - b * c, b - c * a, c - a * b


def summed(x):
    return number(x.value.sum(1, keepdims=True) / N)


def inner(a, b, c):
    """A call in a call."""
    x, y, z = step(a, b, c)
    return step(y, x * z, a + z)


def traced(function, *arrays):
    return jax.make_jaxpr(lambda *x: [y.value for y in function(*map(number, x))])(*arrays)


def compiled(function, *arrays):
    """The text of the program with kernels."""
    program = functools.partial(kernels.run, traced(function, *arrays), kernels.Loops(2))
    return jax.jit(program).lower(*arrays).compile().as_text()


def compared(function, *arrays):
    """The results with kernels, and of the plain trace, both compiled; and the text of the first."""
    closed = traced(function, *arrays)
    program = jax.jit(functools.partial(kernels.run, closed, kernels.Loops(2)))
    text = program.lower(*arrays).as_text()
    plain = jax.jit(jax.extend.core.jaxpr_as_fun(closed))
    return list(map(np.asarray, program(*arrays))), list(map(np.asarray, plain(*arrays))), text


def arrays(*shapes, dtype=np.float32, seed=0):
    rng = np.random.default_rng(seed)
    return [jnp.asarray(rng.standard_normal(s) * 10.0 ** rng.integers(-3, 3, s), dtype) for s in shapes]


def reductions(text):
    return len(re.findall(r"stablehlo\.reduce\b", text))


def same(found, expected):
    for x, y in zip(found, expected, strict=True):
        assert x.dtype == y.dtype and x.shape == y.shape
        np.testing.assert_array_equal(x.view(np.uint8), y.view(np.uint8))


@pytest.mark.parametrize("function", [step, noinline(inner)])
@pytest.mark.parametrize("shapes", [[(2, N)] * 3, [(2, N), (1, N), (2, 1)], [(2, N), (2, N), ()]])
def test_a_call_is_one_kernel_with_the_same_bits(function, shapes):
    found, expected, text = compared(function, *arrays(*shapes))
    same(found, expected)
    assert reductions(text) == 1


@pytest.mark.parametrize("is_of_few", [False, True])
def test_calls_that_read_each_other_are_one_kernel_of_few_states(is_of_few, monkeypatch):
    # Here the first axis has 2 items. Programs begin with their states.
    monkeypatch.setattr(kernels, "MOST_MERGED", 2 if is_of_few else 1)
    found, expected, text = compared(lambda *x: differences(*step(*x)), *arrays(*[(2, N)] * 3))
    same(found, expected)
    assert reductions(text) == (1 if is_of_few else 2)


@pytest.mark.parametrize("is_of_few", [False, True])
def test_calls_in_a_loop_are_merged_too(is_of_few, monkeypatch):
    """In a loop over rows, some of them known, and that loop in a loop of the caller."""
    monkeypatch.setattr(kernels, "MOST_MERGED", 2 if is_of_few else 1)
    start = arrays(*[(2, N)] * 3)
    known, given = np.linspace(0.5, 2, 10).reshape(5, 2, 1).astype(np.float32), arrays((5, 2, N), seed=1)[0]

    @noinline
    def last(a, b, c, k, x):
        # Bounded, however many rows there are.
        return tuple(y / (1 + y * y) for y in (a * k - b * c, b - c * a + x, c * k - a * b))

    def rows(*carry):
        def row(carry, of_row):
            k, x = map(number, of_row)
            a, b, c = last(*step(*map(number, carry)), k, x)
            return [y.value for y in (a, b, c)], a.value

        carry, stacked = lax.scan(row, [x.value for x in carry], (jnp.asarray(known), given))
        return *map(number, carry), number(stacked)

    closed = traced(rows, *start)

    def in_a_loop(program):
        def turn(carry, _):
            *carry, stacked = program(*carry)
            return carry, stacked

        return jax.jit(lambda *x: jax.tree.leaves(lax.scan(turn, list(x), length=3)))

    found = in_a_loop(functools.partial(kernels.run, closed, kernels.Loops(2)))
    expected = in_a_loop(jax.extend.core.jaxpr_as_fun(closed))
    assert reductions(found.lower(*start).as_text()) == (1 if is_of_few else 2)
    same(map(np.asarray, found(*start)), map(np.asarray, expected(*start)))


def test_merged_calls_write_what_is_read_alone():
    found, expected, text = compared(lambda *x: step(*step(*x))[:1], *arrays(*[(2, N)] * 3))
    same(found, expected)
    assert len(re.findall(r"stablehlo\.map\b", text)) == 1 and reductions(text) == 0


def test_merged_calls_have_no_more_operations_than_a_kernel_holds(monkeypatch):
    three = arrays(*[(2, N)] * 3)
    (call,) = traced(step, *three).eqns
    size = kernels._count(call.params["jaxpr"].jaxpr, (2, N))
    for most, n_kernels in ((size, 2), (2 * size, 1)):
        monkeypatch.setattr(kernels, "MOST_OPERATIONS", most)
        found, expected, text = compared(lambda *x: differences(*step(*x)), *three)
        same(found, expected)
        assert reductions(text) == n_kernels


def test_calls_that_do_not_read_each_other_have_a_kernel_each():
    found, expected, text = compared(lambda a, b, c: (*step(a, b, c), *step(c, a, b)), *arrays(*[(2, N)] * 3))
    same(found, expected)
    assert reductions(text) == 2


def test_what_lies_between_two_calls_keeps_them_apart():
    """The third call reads the first one's result, and what a sum made of it. The fourth reads only the third."""

    def function(a, b, c):
        x, y, z = step(a, b, c)
        total = summed(x)
        u, v, w = step(y, z, c)
        return *step(*step(x, y, total)), *step(u, v, summed(w))

    found, expected, text = compared(function, *arrays(*[(2, N)] * 3))
    same(found, expected)
    # Three kernels: of the first and the second call, of the third and the fourth, and of the last. And two sums.
    assert reductions(text) == 3 + 2


def test_units_that_wait_for_each_other_are_not_merged():
    """The second call of one pair reads a sum of the first of the other, and so would the other pair."""

    def function(a, b, c):
        first, other = step(a, b, c), step(b, c, a)
        total = summed(first[0])
        second = step(first[0], first[1], summed(other[0]))
        return *second, *step(other[0], other[1], total)

    found, expected, text = compared(function, *arrays(*[(2, N)] * 3))
    same(found, expected)
    # Three kernels: of the pair that is merged, and of each other call. And two sums.
    assert reductions(text) == 3 + 2


def test_calls_that_are_no_kernels_are_not_merged():
    @noinline
    def with_a_sum(a, b, c):
        return a - number(b.value.sum(1, keepdims=True) + b.value), b - c * a, c - a * b

    @noinline
    def of_more_axes(a, b, c):
        x = number(lax.squeeze(c.value, (0,)))
        return a - b * x, b - x * a, x - a * b

    def function(a, b, c):
        x, y, z = step(a, b, a)
        return *with_a_sum(x, y, z), *of_more_axes(x, y, c)

    found, expected, _ = compared(function, *arrays((2, N), (2, N), (1, 2, N)))
    same(found, expected)


def test_results_of_several_shapes_have_a_kernel_each():
    def two_shapes(a, b, c):
        return a * a + c * c, b * c - a * b, c * a + a * a, a * b + b * b

    found, expected, text = compared(noinline(two_shapes), *arrays((1, N), (3, N), (1, N)))
    same(found, expected)
    assert [x.shape for x in found] == [(1, N), (3, N), (1, N), (3, N)] and reductions(text) == 2


def test_one_result_is_a_map_which_writes_nothing_else():
    def one(a, b, c):
        return ((a * b - c * a) / (1 + b * b),)

    found, expected, text = compared(noinline(one), *arrays((2, N), (1, N), (2, 1)))
    same(found, expected)
    assert len(re.findall(r"stablehlo\.map\b", text)) == 1 and reductions(text) == 0


def test_sums_at_the_end_of_a_call_are_behind_its_kernel():
    def with_sums(a, b, c):
        x, y, z = step(a, b, c)
        total, least = (number(v.value.sum(1, keepdims=True)) for v in (x, y))
        return x * z, total * least, total

    found, expected, text = compared(noinline(with_sums), *arrays((2, N), (2, N), (2, N)))
    same(found, expected)
    # The kernel, for the product of two results and for what is added up; two sums, and nothing else.
    assert reductions(text) == 3


def test_more_operations_than_a_kernel_holds_are_the_calls_they_consist_of(monkeypatch):
    monkeypatch.setattr(kernels, "MOST_OPERATIONS", 30)
    found, expected, text = compared(noinline(inner), *arrays((2, N), (2, N), (2, N)))
    same(found, expected)
    assert reductions(text) == 2


def test_what_is_more_than_numbers_is_a_call_with_kernels_in_it():
    def with_a_sum(a, b, c):
        total = number(jnp.broadcast_to(a.value.sum(1, keepdims=True), a.value.shape))
        return step(a, b + total, c)

    found, expected, text = compared(noinline(with_a_sum), *arrays((2, N), (2, N), (2, N)))
    same(found, expected)
    assert reductions(text) >= 1


@pytest.mark.parametrize("move", [lambda x: x, lambda x: x[:, ::-1], lambda x: -jnp.swapaxes(x.reshape(2, 2, N), 0, 1)])
def test_what_is_pieced_together_is_computed_before_the_kernel(move):
    """A kernel with a concatenation in it, however it is moved since, would not be vectorised."""

    def function(*pieces):
        x = number(move(jnp.concatenate([p.value for p in pieces])))
        return step(x, x, x)

    found, expected, _ = compared(function, *arrays((2, N), (2, N)))
    same(found, expected)
    bodies = compiled(function, *arrays((2, N), (2, N))).split("\n\n")
    with_reduction = [body for body in bodies if " reduce(" in body]
    assert with_reduction and not any(" concatenate(" in body for body in with_reduction)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("width", [1, 3])
def test_known_numbers_of_rows_are_tables(width, reverse):
    """In a loop, numbers of the row and of the chain are no operands: their dtype is in no reduction but as data."""
    rng = np.random.default_rng(1)
    table = rng.standard_normal((5, width, 1)).astype(np.float32)
    of_chains = rng.standard_normal((width, 1)).astype(np.float32)

    def loop(a, b):
        def row(carry, of_row):
            x, y, _ = noinline(lambda x, y, c, d: step(x * c, y, d * c))(*map(number, (*carry, of_row, of_chains_)))
            return (x.value, y.value), x.value

        of_chains_ = jnp.asarray(of_chains)
        (x, y), stacked = lax.scan(row, (a.value, b.value), jnp.asarray(table), reverse=reverse)
        return number(x), number(y), number(stacked)

    found, expected, text = compared(loop, *arrays((width, N), (width, N)))
    same(found, expected)
    operands = re.search(r"stablehlo\.reduce\(.*? across", text).group().count("init:")
    assert operands == 4  # three results, and what no compiler foresees


def test_more_rows_than_a_table_holds_are_operands(monkeypatch):
    monkeypatch.setattr(kernels, "MOST_ROWS", 4)
    table = np.arange(12, dtype=np.float32).reshape((6, 2, 1)) / 7

    def loop(a, b):
        def row(carry, c):
            x, y, _ = step(*map(number, (*carry, c)))
            return (x.value, y.value), x.value

        (x, y), stacked = lax.scan(row, (a.value, b.value), jnp.asarray(table))
        return number(x), number(y), number(stacked)

    same(*compared(loop, *arrays((2, N), (2, N)))[:2])


def test_64_bits_in_a_program_of_32():
    with jax.enable_x64(True):
        doubles = arrays((2, N), (2, N), (2, N), dtype=np.float64)
    with jax.enable_x64(True):
        closed = jax.make_jaxpr(lambda *x: [y.value for y in step(*map(number, x))])(*doubles)
        expected = list(map(np.asarray, jax.jit(jax.extend.core.jaxpr_as_fun(closed))(*doubles)))
    with jax.enable_x64(False):
        found = list(map(np.asarray, jax.jit(functools.partial(kernels.run, closed, kernels.Loops(2)))(*doubles)))
    same(found, expected)


def arm(n=6):
    return js.testing.random_mechanism(3, n, ["revolute"], is_chain=True, dtype=np.float32)


@pytest.mark.parametrize("is_written_out", [False, True])
def test_recursions_are_a_kernel_for_each_step(is_written_out):
    """In place of some 40 kernels for each row of inverse dynamics, of which each computes again what they share."""
    mech = arm().written_out(is_written_out)
    x = np.ones((2, 4, 6), np.float32)
    text = jax.jit(lambda *a: lax.map(lambda b: js.inverse_dynamics(mech, *b), a)).lower(x, x, x).compile().as_text()
    # Cosines and sines, of angles that are pieces of several arrays, and a row of either loop.
    calls = [x for x in text.split("\n\n") if x.startswith("%jaxspatial_call")]
    assert len({re.match(r"[^ .]+", x).group() for x in calls}) == (1 if is_written_out else 3)
    assert all(len(re.findall(r" fusion\(", x)) == 1 for x in calls)
    assert text.count(" while(") == (1 if is_written_out else 3)


def test_linear_equations_are_a_kernel_for_each_unknown():
    """Operation by operation, forward dynamics of robots with mimics took ten times as long."""
    rng = np.random.default_rng(0)
    A, b = rng.standard_normal((N, 6, 6)), rng.standard_normal((N, 6, 1))
    M = A @ A.swapaxes(1, 2) + 10 * np.eye(6)
    sides = np.moveaxis(M, 0, 2).astype(np.float32), b[..., 0].T.astype(np.float32)
    found, expected, text = compared(lambda *x: [matrices.solved(*x)], *map(jnp.asarray, sides))
    same(found, expected)
    np.testing.assert_allclose(found[0].T, np.linalg.solve(M, b)[..., 0], rtol=0, atol=1e-6)
    assert text.count("stablehlo.while") == len(re.findall(r"stablehlo\.map\b", text)) == 1


def test_a_call_takes_its_parts_of_an_array_inside():
    """Outside, each part would be a copy, and a kernel to compile."""

    def function(*pieces):
        x = jnp.concatenate([p.value for p in pieces])
        return step(*(number(jnp.swapaxes(x[k : k + 2].reshape((2, 1, N)), 0, 1)[0]) for k in range(3)))

    both = arrays((2, N), (2, N))
    found, expected, _ = compared(function, *both)
    same(found, expected)
    (call,) = re.findall(r" call\((.*?)\)", compiled(function, *both))
    assert call.count("%") == 2  # the whole array, and what no compiler foresees


def test_a_call_takes_an_array_apart_once():
    """Three arguments are parts of one array, which is turned round before it is taken apart."""

    def function(*pieces):
        x = jnp.concatenate([p.value for p in pieces]).reshape((2, 3, 1))
        return step(*map(number, unstack(jnp.swapaxes(x, 1, 2))))

    found, expected, text = compared(function, *arrays((3, 1), (3, 1)))
    same(found, expected)
    assert text.count("stablehlo.transpose") == 1


def star(n_arms):
    """A floating body with so many arms of three links."""
    one = np.float32(1)
    bodies = [js.Body("base", js.SpatialInertia.solid_box(np.ones(3, np.float32), mass=one))]
    joints = [js.Joint("root", "free", "world", "base")]
    for i in range(n_arms):
        for k, parent in enumerate(["base", f"{i}0", f"{i}1"]):
            bodies.append(js.Body(f"{i}{k}", bodies[0].inertia))
            joints.append(js.Joint(f"joint {i}{k}", "revolute", parent, f"{i}{k}", axis=(0, 0, 1)))
    return js.Mechanism.build(bodies, joints)


def of_many_states(mech):
    q, v = np.tile(mech.neutral(), (1000, 1)).astype(np.float32), np.ones((1000, mech.nv), np.float32)
    return jax.jit(functools.partial(js.forward_dynamics, mech)).lower(q, v, v)


def test_arms_of_a_body_are_joined_in_one_call():
    two, five = (reductions(of_many_states(star(n)).as_text()) for n in (2, 5))
    assert two == five


def test_the_first_row_of_a_short_chain_is_the_kernel_of_the_others():
    """XLA compiles equal kernels once. A kernel that gets the hidden zero as its index, too, is not equal."""
    calls = re.findall(
        r"jaxspatial_call\S* = .*? call\((%[\w.-]+), (%[\w.-]+)", of_many_states(star(2)).compile().as_text()
    )
    assert len(calls) > 6 and all(zero != index for zero, index in calls)


@pytest.mark.parametrize("function", [js.inverse_dynamics, js.forward_dynamics])
def test_a_pullback_adds_up_each_number_of_a_robot_once(function):
    """Sums wherever a number is used, 267 for this arm, would leave no kernel whole."""
    mech, x = arm(), np.ones((4, 6), np.float32)
    pulled = jax.grad(lambda mech, *of: function(mech, *of).sum(), allow_int=True)
    assert reductions(jax.jit(pulled).lower(mech, x, x, x).as_text()) <= 90


def test_kernels_are_for_loops_and_for_many_states():
    """A call of a program pays for each operation in its kernels; in a loop they are paid for once."""
    mech = arm()

    def text_of(function, *shape):
        x = np.ones(shape, np.float32)
        return jax.jit(function).lower(x, x, x).as_text()

    def torque(*state):
        return js.inverse_dynamics(mech, *state)

    def repeated(q, v, vdot):
        # Another function: JAX keeps the trace of a jitted one, and in which place it was made first.
        call = jax.jit(lambda v: torque(q, v, vdot))
        return lax.scan(lambda v, _: (call(v), None), v, length=3)[0]

    assert not reductions(text_of(torque, 6))
    assert not reductions(text_of(torque, 64, 6))
    assert reductions(text_of(torque, 1000, 6)) >= 3
    assert reductions(text_of(repeated, 6)) >= 3
    assert reductions(text_of(lambda *x: jax.vjp(torque, *x)[1](x[0]), 6)) >= 3


def test_a_step_with_contact_is_called_without_kernels():
    """With them a call of one robot took 4 ms where it takes 0.2."""
    body = js.Body("box", js.SpatialInertia.solid_box(np.ones(3, np.float32), mass=np.float32(1)))
    mech = js.Mechanism.build([body], [js.Joint("root", "free", "world", "box")])
    feet = js.PointContacts(["box"], stiffness=1e4, relaxation_time=0.01, friction=0.5)

    def step(q, v):
        return js.convex_step(mech, q, v, jnp.zeros(6), 1e-3, contacts=feet)[:2]

    def maps(function):
        text = jax.jit(function).lower(jnp.asarray(mech.neutral()), jnp.zeros(6)).as_text()
        return len(re.findall(r"stablehlo\.map\b", text))

    assert maps(step) == 0 < maps(lambda q, v: lax.scan(lambda state, _: (step(*state), None), (q, v), length=2)[0])


@pytest.mark.parametrize("function", [js.inverse_dynamics, slow(js.forward_dynamics)])
def test_a_state_has_the_same_bits_alone_and_in_a_loop(function):
    mech = arm()
    states = np.random.default_rng(0).standard_normal((3, 5, 6)).astype(np.float32)
    alone = [function(mech, *x) for x in states.swapaxes(0, 1)]
    in_loop = jax.jit(lambda *x: lax.map(lambda state: function(mech, *state), x))(*states)
    many = jax.jit(functools.partial(function, mech))(*np.tile(states, (1, 200, 1)))
    same(list(in_loop), alone)
    same(list(many[:5]), alone)


@pytest.mark.parametrize("n", [kernels.MANY, kernels.MANY - 1])
@pytest.mark.parametrize(
    "loops", [kernels.Loops(2, large, split) for large in (False, True) for split in (False, True)]
)
@pytest.mark.parametrize("is_new", [False, True])
def test_loops_stay_loops(is_new, loops, n, monkeypatch):
    """With JAX 0.11 and later something is sorted in each of many states; of few in the caller's, in a large program.

    No number of one state is, if they are split over devices. The bits are the same, in loops over rows and until.
    """
    monkeypatch.setattr(kernels, "_HAS_LOOPS_AS_FUNCTIONS", is_new)
    is_many = n == kernels.MANY
    # The loop over rows has two parts: pairs of rows, and the row that is left.
    for function, shapes, of_rows in ((repeated, ((n, 2), (n, 2)), 0), (looped, ((n, 2), (n, 2), (n, 5, 2)), 2)):
        given = arrays(*shapes)
        program = jax.jit(functools.partial(kernels.run, jax.make_jaxpr(function)(*given), loops))
        of_states = (is_many or loops.is_large) + is_many * (not of_rows)
        expected = is_new * (is_many * of_rows + (not loops.is_split) * of_states)
        assert program.lower(*given).compile().as_text().count(" sort(") == expected
        same(list(map(np.asarray, program(*given))), list(map(np.asarray, jax.jit(function)(*given))))


def repeated(a, b):
    """A call, until a sum is large enough. Of states by rows, which kernels have last."""

    def turn(carry):
        count, x, y = carry
        return count + 1, step(number(x), number(y), number(x))[0].value * 0.1, y

    return list(lax.while_loop(lambda carry: carry[0].sum() < 99, turn, (jnp.zeros(len(a), a.dtype), a.T, b.T)))


def looped(a, b, rows):
    """A call for each row."""

    def turn(carry, row):
        x, y, _ = step(*map(number, carry), number(row))
        return (x.value * 0.1, y.value * 0.1), x.value

    return jax.tree.leaves(lax.scan(turn, (a.T, b.T), jnp.moveaxis(rows, 0, -1)))


def test_loops_are_read_as_every_version_of_jax_describes_them():
    """By numbers, and from JAX 0.11 on by trees of what is constant, carried and sliced."""
    eqn = next(e for e in jax.make_jaxpr(a_loop)(*arrays((3, N), (2, N))).eqns if e.primitive.name == "scan")
    later = types.SimpleNamespace(unpack=lambda: ((None,), (None, None), (None,)))
    assert kernels._constants_and_carried(eqn) == (1, 2)
    assert kernels._constants_and_carried(types.SimpleNamespace(params={"ft_in": later})) == (1, 2)


def a_loop(constant, rows):
    start = constant[0], constant[1]
    return lax.scan(lambda carry, row: ((carry[0] + constant[2], carry[1] * row), row), start, rows)

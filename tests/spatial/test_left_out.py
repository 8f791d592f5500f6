"""A part that is left out is a known zero: `SpatialForce(f=f)` a pure force, `SpatialForce(tau)` a couple."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from tests.helpers.counting import asked_for, flops
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operations import OPERATIONS

KINDS = (js.SpatialForce, js.SpatialMomentum, js.SpatialVelocity, js.SpatialAcceleration)
kinds = pytest.mark.parametrize("kind", KINDS)
kept = pytest.mark.parametrize("kept", [0, 1], ids=["rotational", "translational"])
ZERO = "Components(0.0, 0.0, 0.0)"
# Those that a spatial vector goes into, one of each formula.
TAKING = [
    name
    for name, operation in OPERATIONS.items()
    if {"F", "L", "V", "A", "forces"} & set(operation.arguments.split()) and not operation.twin
]
SOME = ["shift_acceleration", "cross_force", "act_velocity", "compose_velocity", "sum", "central_axis",
        "center_of_pressure", "add", "divide", "equal", "is_approx"]  # fmt: skip
EAGER = ["shift_acceleration", "add"]


def numbers(shape=(3,), dtype=np.float32, seed=0):
    return jnp.asarray(np.random.default_rng(seed).standard_normal(shape), dtype)


def without(X, kept):
    """(X with one part left out, X with zeros in its place)."""
    name = X.__match_args__[kept]
    part = getattr(X, name)
    parts = [part if i == kept else np.zeros_like(part) for i in (0, 1)]
    return type(X)(**{name: part}), type(X)(*parts)


def assert_same(found, expected, within=0):
    """Number for number, or within so many eps of the largest. -0 is 0; a part without data stands for zeros of any
    batch."""
    parts = [jax.tree.leaves(result, is_leaf=lambda x: isinstance(x, js.Components)) for result in (found, expected)]
    for x, y in zip(*parts, strict=True):
        y = np.asarray(y)
        x = np.broadcast_to(x, y.shape) if repr(x) == ZERO else x
        if within:
            x, y, eps = np.asarray(x, np.float64), y.astype(np.float64), float(jnp.finfo(y.dtype).eps)
            assert abs(x - y).max() <= within * eps * abs(y).max()
        else:
            np.testing.assert_array_equal(x, y, strict=True)


@kept
@kinds
def test_it_is_a_zero_of_the_other_parts_batch_and_dtype(kind, kept, x64):
    for part in (numbers(), numbers((4, 2, 3)), np.ones(3), np.ones((2, 3), np.float16), [1, 2, 3]):
        X = kind(**{kind.__match_args__[kept]: part})
        given, left_out = X._vectors[kept], X._vectors[1 - kept]
        assert repr(left_out) == ZERO and repr(X).count(ZERO) == 1 and jax.tree.leaves(X)[0] is given
        assert X.dtype == left_out.dtype == given.dtype and X.batch_shape == given.shape[:-1]
        six = X.to_array()
        assert six.shape == (*X.batch_shape, 6) and six.dtype == X.dtype
        np.testing.assert_array_equal(six[..., 3 * kept : 3 * kept + 3], given)
        assert not np.delete(six, np.s_[3 * kept : 3 * kept + 3], -1).any()


@kinds
def test_both_left_out_is_refused(kind):
    first, second = kind.__match_args__
    with pytest.raises(TypeError, match=f"{kind.__name__}: expected {first}, {second} or both, got neither"):
        kind()
    with pytest.raises(TypeError, match=f"{kind.__name__}: {first}: expected .*, got NoneType"):
        kind(None, numbers())
    with pytest.raises(ValueError, match=rf"{kind.__name__}: {second}: expected shape \(\*batch, 3\)"):
        kind(**{second: numbers((4,))})


@kept
@pytest.mark.parametrize("name", slow_but(SOME, TAKING))
def test_every_operation_takes_it_for_zeros(name, kept):
    operation = OPERATIONS[name]
    given = jax.tree.map(jnp.asarray, operation.inputs((3, 2), "float32"))
    is_vector = lambda X: isinstance(X, KINDS)  # noqa: E731
    pairs = [without(X, kept) if is_vector(X) else (X, X) for X in given]
    short, full = zip(*pairs, strict=True)
    expected = interpreted(operation.function)(*full)
    for run in (jax.jit(operation.function), operation.function) if name in EAGER else (jax.jit(operation.function),):
        assert_same(run(*short), expected)


@kept
@pytest.mark.parametrize(
    ("dtype", "x64", "precision"),
    slow_but(
        [
            ("float16", False, "reproducible"),
            ("bfloat16", True, "compensated"),
            ("float32", True, "compensated"),
            ("float64", True, "reproducible"),
        ],
        [
            (dtype, x64, precision)
            for dtype, x64 in (("float16", False), ("bfloat16", True), ("float32", True), ("float64", True))
            for precision in map(str, js.Precision)
        ],
    ),
)
def test_every_dtype(dtype, x64, precision, kept):
    shift, dot = (functools.partial(f, precision=precision) for f in (js.shift, js.dot))
    with jax.enable_x64(x64):
        F, V = (without(kind(*numbers((2, 5, 3), dtype)), kept) for kind in (js.SpatialForce, js.SpatialVelocity))
        p = numbers((3,), dtype, 1)
        # A compiler makes other fused operations of a formula with zeros in it than of one without.
        within = 4 if precision == "fast" else 0
        assert_same(jax.vmap(shift, (0, None))(F[0], p), jax.vmap(shift, (0, None))(F[1], p), within)
        assert_same(jax.vmap(dot)(F[0], V[0]), jax.vmap(dot)(F[1], V[1]), within)
        assert_same(F[0].astype(np.float16), F[1].astype(np.float16))


@kept
def test_the_zero_follows_where_leaves_are_cast(kept):
    F, full = without(js.SpatialForce(*numbers((2, 4, 3))), kept)
    cast, whole = (jax.tree.map(lambda x: x.astype(np.float16), X) for X in (F, full))
    assert cast.dtype == np.float16
    p = numbers((3,), np.float16)
    for function in (
        lambda X: X.to_array(),
        lambda X: js.shift(X, p),
        lambda X: js.stack([X, X]),
        lambda X: X + X * 2.0,
    ):
        assert_same(function(cast), function(whole))
    assert js.stack([cast, F.astype(np.float16)]).dtype == np.float16


# -- programs ---------------------------------------------------------------------------------------------------------


@kept
@kinds
def test_known_it_stays(kind, kept):
    X = kind(**{kind.__match_args__[kept]: numbers((4, 3))})
    s = numbers((4,))
    for same in (
        X, X + X, X - X, -X, X * 2.0, s * X, X / s, X.at_batch(1), X.sum(),
        js.stack([X, X]), X.astype(np.float16), js.rotate(js.Rotation.exp(numbers()), X), jax.jit(lambda X: X)(X),
        jax.vmap(lambda X: X * 2.0)(X), jax.tree.map(lambda x: x[0], X), jax.device_put(X),
        lax.scan(lambda c, _: (c * 0.5 + X, None), X, length=2)[0], jax.grad(lambda X: jnp.sum(X.to_array()))(X),
    ):  # fmt: skip
        assert repr(same._vectors[1 - kept]) == ZERO and isinstance(same._vectors[kept], jax.Array)


@kinds
def test_beside_arrays_results_are_arrays(kind):
    """A loop whose carry has both parts takes one that has not."""
    whole, pure = kind(*numbers((2, 3))), kind(**{kind.__match_args__[1]: numbers()})
    last, _ = lax.scan(lambda c, _: (c + pure - pure * 0.5, None), whole, length=3)
    assert all(isinstance(x, jax.Array) for x in last._vectors)
    F = js.shift(js.SpatialForce(f=numbers((4, 3))), numbers())
    assert all(isinstance(x, jax.Array) for x in F._vectors)
    assert isinstance(jax.jit(js.dot)(js.SpatialForce(numbers()), js.SpatialVelocity(v=numbers())), jax.Array)


def test_power_of_nothing_has_the_batch_of_its_arguments():
    F, V = js.SpatialForce(f=numbers((4, 3))), js.SpatialVelocity(numbers((4, 3)))
    for precision in js.Precision:
        assert js.dot(F, V, precision=precision).shape == (4,)
        assert jax.jit(functools.partial(js.dot, precision=precision))(F, V).shape == (4,)


@kinds
def test_additions_that_are_left(kind):
    """Counts of `shift`, `dot` and others of such vectors: tests/laws/test_structure.py."""
    whole, first, second = kind(*numbers((2, 3))), kind(numbers()), kind(**{kind.__match_args__[1]: numbers()})
    pairs = {(whole, whole): 2, (whole, first): 1, (second, whole): 1, (first, first): 1, (first, second): 0}
    for (x, y), additions in pairs.items():
        assert flops(asked_for(lambda x, y: x + y, x, y)) == additions
    assert_same(first + second, kind(first._vectors[0], second._vectors[1]))


@kept
def test_gradients_are_those_of_zeros(kept):
    p, V = numbers(seed=1), js.SpatialVelocity(*numbers((2, 3), seed=2))
    F, full = without(js.SpatialForce(*numbers((2, 3))), kept)

    def power(F, p):
        return js.dot(js.shift(F, p), js.shift(V, p)) + F.dot(V) ** 2

    for found, expected in zip(*(jax.grad(power, (0, 1))(X, p) for X in (F, full)), strict=True):
        x, y = (getattr(g, "_vectors", [g] * 2)[kept] for g in (found, expected))
        np.testing.assert_array_equal(x, y)


def test_a_couple_is_shifted_in_place_where_donated():
    F = js.SpatialForce(jnp.array(numbers((256, 3))))
    given = F.tau.unsafe_buffer_pointer()
    assert jax.jit(js.shift, donate_argnums=0)(F, numbers()).tau.unsafe_buffer_pointer() == given


def test_trees_of_axes_leave_out_the_same_part():
    F, p = js.SpatialForce(f=numbers((4, 3))), numbers()
    assert_same(jax.vmap(js.shift, in_axes=(js.SpatialForce(f=0), None))(F, p), js.shift(F, p))


# -- robots -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("algorithm", "kept"),
    [
        (js.inverse_dynamics, 0),
        slow(js.inverse_dynamics, 1),
        slow(js.forward_dynamics, 0),
        (js.forward_dynamics, 1),
    ],
)
def test_an_external_force_leaves_no_operation_for_the_part_left_out(algorithm, kept):
    rod = js.SpatialInertia.thin_rod(1.0, (0.0, 0.0, 1.0), mass=2.0)
    joints = [
        js.Joint(*names, axis=(0.6, 0, 0.8))
        for names in (("j", "revolute", "world", "a"), ("k", "prismatic", "a", "b"))
    ]
    mech = js.Mechanism.build([js.Body("a", rod), js.Body("b", rod)], joints)
    q, v = jnp.asarray(mech.neutral()), jnp.ones(mech.nv)
    F, full = without(js.SpatialForce(*numbers((2, 4, 3))), kept)

    def under(F):
        return algorithm(mech, q, v, v, {"b": F})

    assert_same(jax.vmap(under)(F), jax.vmap(under)(full))
    one, other = F.at_batch(0), full.at_batch(0)
    # As many as with NumPy's zeros, which are known where a force is made while tracing.
    as_numpy = lambda x: under(type(F)(*(x if i == kept else np.zeros(3, np.float32) for i in (0, 1))))  # noqa: E731
    counts = [flops(asked_for(under, one)), flops(asked_for(as_numpy, one._vectors[kept]))]
    assert counts[0] == counts[1] < flops(asked_for(under, other))

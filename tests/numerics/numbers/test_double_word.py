"""Double words hold their bounds against exact rationals, on inputs made to break them, in every surrounding."""

import functools
import math
import operator
from fractions import Fraction
from typing import Any

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.sharding import PartitionSpec

from jaxspatial.measure.error import rationals, unit_roundoff
from jaxspatial.numerics.numbers import pairs
from jaxspatial.numerics.numbers.double_word import DoubleWord, from_double_word, to_double_word
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but

DTYPES = ["float16", "bfloat16", "float32", "float64"]
N = 600


def value(x) -> Any:
    """The exact numbers of a DoubleWord or a pair, or of an array."""
    words = jax.tree.leaves(x)
    return sum(rationals(w) for w in words)


# -- inputs made to break bounds --------------------------------------------------------------------------------------


def hostile_words(dtype, rng, low, high):
    """N numbers of either sign in [2^low, 2^high): random, powers of two and their neighbours, integers, few bits."""
    eps = float(jnp.finfo(dtype).eps)
    mantissas = [
        rng.uniform(1, 2, N),
        1 + eps * rng.integers(0, 4, N),
        2 - eps * rng.integers(1, 4, N),
        rng.integers(64, 128, N) / 64.0,
        1 + 2.0 ** -rng.integers(1, 12, N),
    ]
    mantissa = np.choose(rng.integers(0, len(mantissas), N), mantissas)
    x = mantissa * 2.0 ** rng.integers(low, high, N) * rng.choice([-1, 1], N)
    return np.clip(x.astype(jnp.dtype(dtype)), -(2.0**high), 2.0**high).astype(jnp.dtype(dtype))


def hostile_pairs(dtype, rng, low, high):
    """Normalised pairs with low words of every size: none, random, half an ulp of the high word, nearly that, tiny."""
    hi = hostile_words(dtype, rng, low, high)
    half_ulp = np.spacing(np.abs(hi)) / np.asarray(2, hi.dtype)
    precision = jnp.finfo(dtype).nmant + 1
    # Not below what keeps the products of low words normal numbers.
    least = 2.0 ** -min(precision - 2, 30)
    parts = [
        np.zeros(N),
        np.maximum(rng.uniform(0, 1, N), least),
        np.ones(N),
        1 - least * rng.integers(1, 4, N),
        2.0 ** -rng.integers(1, min(precision - 2, 30), N),
    ]
    part = np.choose(rng.integers(0, len(parts), N), parts) * rng.choice([-1, 1], N)
    return normalised(hi, (part * half_ulp.astype(np.float64)).astype(hi.dtype))


def normalised(hi, lo):
    s = hi + lo
    return s, lo - (s - hi)


def cancelling(x, rng):
    """Pairs y with x + y small: high words equal but for a few ulps, low words equal, opposite, or others."""
    ulp = np.spacing(np.abs(x[0]))
    hi = -x[0] + ulp * rng.integers(-2, 3, N).astype(x[0].dtype)
    lo = np.choose(rng.integers(0, 4, N), [x[1], -x[1], np.zeros_like(x[1]), np.roll(x[1], 1)])
    return normalised(hi, np.where(np.abs(lo) <= ulp / np.asarray(2, lo.dtype), lo, np.zeros_like(lo)))


# Exponents between which an operation neither overflows nor drops error terms: (float16, where XLA keeps subnormals,
# bfloat16 and float32, float64).
RANGES = {
    "sum": [(2, 9), (-20, 20), (-150, 150)],
    "product": [(3, 7), (-20, 20), (-150, 150)],
    "quotient": [(9, 15), (-20, 20), (-150, 150)],
    "divisor": [(0, 4), (-20, 20), (-150, 150)],
    "root": [(8, 15), (-20, 20), (-150, 150)],
}


def between(kind, dtype):
    return RANGES[kind][{"float16": 0, "float64": 2}.get(dtype, 1)]


def pair_and_pair(first, second=None):
    def inputs(dtype, rng):
        return tuple(hostile_pairs(dtype, rng, *between(kind, dtype)) for kind in (first, second or first))

    return inputs


def pair_and_word(first, second=None):
    def inputs(dtype, rng):
        word = hostile_words(dtype, rng, *between(second or first, dtype))
        return hostile_pairs(dtype, rng, *between(first, dtype)), word

    return inputs


def sums_that_cancel(dtype, rng):
    """A third cancels, a third is of one size, a third of any."""
    x, y = pair_and_pair("sum")(dtype, rng)
    opposite, kind = cancelling(x, rng), rng.integers(0, 3, N)
    same = tuple(abs(word) * np.sign(x[0]) for word in x)
    return x, tuple(np.choose(kind, words) for words in zip(opposite, normalised(*same), y, strict=True))


def word_sums_that_cancel(dtype, rng):
    x, y = sums_that_cancel(dtype, rng)
    return x, y[0]


def roots(dtype, rng):
    x = hostile_pairs(dtype, rng, *between("root", dtype))
    return (tuple(np.where(x[0] < 0, -word, word) for word in x),)


def exact_root(x):
    """sqrt(x) to more than 300 bits."""
    scale = 1 << 2400
    return Fraction(math.isqrt(x.numerator * scale * scale // x.denominator), scale)


# name: (operation, the same on exact numbers, relative bound in terms of u, inputs)
OPERATIONS = {
    "add": (pairs.add, operator.add, lambda u: 3 * u**2 + 13 * u**3, sums_that_cancel),
    "add_word": (pairs.add_limb, operator.add, lambda u: 2 * u**2, word_sums_that_cancel),
    "subtract": (pairs.subtract, operator.sub, lambda u: 3 * u**2 + 13 * u**3, pair_and_pair("sum")),
    "subtract_word": (pairs.subtract_limb, operator.sub, lambda u: 2 * u**2, pair_and_word("sum")),
    "multiply": (pairs.multiply, operator.mul, lambda u: 5 * u**2, pair_and_pair("product")),
    "multiply_word": (
        pairs.multiply_limb,
        operator.mul,
        lambda u: Fraction(3, 2) * u**2 + 4 * u**3,
        pair_and_word("product"),
    ),
    "divide": (
        pairs.divide,
        operator.truediv,
        lambda u: 15 * u**2 + 56 * u**3,
        pair_and_pair("quotient", "divisor"),
    ),
    "divide_word": (
        pairs.divide_limb,
        operator.truediv,
        lambda u: 3 * u**2,
        pair_and_word("quotient", "divisor"),
    ),
    "square_root": (pairs.square_root, exact_root, lambda u: Fraction(25, 8) * u**2, roots),
}


def operands(name, dtype, seed=0):
    given = OPERATIONS[name][3](dtype, np.random.default_rng(seed))
    return jax.tree.map(jnp.asarray, given)


def exact_result(name, given):
    exact = [value(x) for x in given]
    return np.frompyfunc(OPERATIONS[name][1], len(exact), 1)(*exact)


# -- bounds -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", slow_but(["float32", "float64"], DTYPES))
@pytest.mark.parametrize("name", OPERATIONS)
def test_bound_and_normalisation(name, dtype):
    operation, _, bound, _ = OPERATIONS[name]
    with jax.enable_x64(dtype == "float64"):
        for seed in range(2):
            given = operands(name, dtype, seed)
            result = operation(*given)
            assert {np.dtype(word.dtype).name for word in result} == {dtype}
            hi, lo = map(np.asarray, result)
            np.testing.assert_array_equal(hi + lo, hi)
            exact = exact_result(name, given)
            assert (abs(value(result) - exact) <= bound(unit_roundoff(dtype)) * abs(exact)).all()


@pytest.mark.parametrize("dtype", [slow("bfloat16"), "float32", "float64"])
@pytest.mark.parametrize("name", OPERATIONS)
def test_error_near_underflow_is_ten_tiny_more(name, dtype):
    tiny = jnp.finfo(dtype).tiny
    with jax.enable_x64(dtype == "float64"):
        given = near_underflow(name, dtype)
        result, exact = value(OPERATIONS[name][0](*given)), exact_result(name, given)
    more = 10 * Fraction(float(tiny)) * flushing(name[:3], exact, *map(value, given))
    assert (abs(result - exact) <= OPERATIONS[name][2](unit_roundoff(dtype)) * abs(exact) + more).all()


def flushing(name, result, *given):
    """By how much parts of numbers that are flushed to zero are magnified."""
    x, y = given if len(given) == 2 else (result, result)
    quotient = name in ("div", "squ")
    return 1 + (1 + abs(result)) / abs(y) if quotient else 1 + abs(x) + abs(y) if name == "mul" else 1


def near_underflow(name, dtype):
    """Operands of which no word is subnormal, but many an error term, and the low words of results."""
    rng, tiny = np.random.default_rng(3), jnp.finfo(dtype).tiny
    exponent = jnp.finfo(dtype).minexp + 2 * jnp.finfo(dtype).nmant
    x, y = (hostile_pairs(dtype, rng, exponent - jnp.finfo(dtype).nmant, exponent) for _ in range(2))
    y = hostile_pairs(dtype, rng, -6, 6) if name.startswith(("multiply", "divide")) else y
    x = tuple(word * np.sign(x[0]) for word in x) if name == "square_root" else x
    x, y = (tuple(jnp.asarray(np.where(abs(w) < tiny, 0 * w, w)) for w in pair) for pair in (x, y))
    return (x,) if name == "square_root" else (x, y[0] if name.endswith("word") else y)


# -- surroundings -----------------------------------------------------------------------------------------------------


def all_operations(given, word=slice(None)):
    """The results, or one word of them, of all operations on their operands."""
    return {name: OPERATIONS[name][0](*each)[word] for name, each in given.items()}


def without_jit(given):
    with jax.disable_jit():
        return all_operations(given)


def scanned(given, word=slice(None)):
    return lax.scan(lambda _, each: (None, all_operations(each, word)), None, given)[1]


def one_word_alone(f):
    high, low = (jax.jit(functools.partial(f, word=i)) for i in (0, 1))
    return lambda given: jax.tree.map(lambda *words: words, high(given), low(given))


def with_constants(is_constant):
    """Some words closed over by the program: word j of operand i where is_constant(i, j)."""

    def call(given):
        words, tree = jax.tree.flatten(given)
        indexed = [(i, x) for name in sorted(given) for i, x in enumerate(given[name])]
        places = [(i, j) for i, x in indexed for j in range(len(jax.tree.leaves(x)))]
        data = {n: word for n, word in enumerate(words) if not is_constant(*places[n])}
        return jax.jit(lambda data: all_operations(tree.unflatten([data.get(n, w) for n, w in enumerate(words)])))(data)

    return call


SURROUNDINGS = {
    "without jit": without_jit,
    "vmap": jax.jit(jax.vmap(all_operations)),
    "scan": jax.jit(scanned),
    "one word alone": one_word_alone(all_operations),
    "one word alone, scan": one_word_alone(scanned),
    "first operand constant": with_constants(lambda i, j: i == 0),
    "other operand constant": with_constants(lambda i, j: i > 0),
    "high words constant": with_constants(lambda i, j: j == 0),
    "low words constant": with_constants(lambda i, j: j == 1),
    "all constant": with_constants(lambda i, j: True),
}
IN_ALL_DTYPES = ["vmap", "one word alone, scan"]
# Of constants a few: what is expected is computed op by op in NumPy.
USUAL_SURROUNDINGS = [
    *((s, "float32") for s in ("vmap", "one word alone", "first operand constant")),
    ("one word alone, scan", "float64"),
]


@pytest.mark.parametrize(
    "surrounding, dtype",
    [
        (s, d) if (s, d) in USUAL_SURROUNDINGS else slow(s, d)
        for s in SURROUNDINGS
        for d in DTYPES
        if s in IN_ALL_DTYPES or d in ("float32", "float64")
    ],
)
def test_bitwise_the_same_in_every_surrounding(surrounding, dtype):
    with jax.enable_x64(dtype == "float64"):
        given = {name: jax.tree.map(lambda word: word[:97], operands(name, dtype)) for name in OPERATIONS}
        expected = interpreted(all_operations)(given)
        require_bitwise(SURROUNDINGS[surrounding](given), expected)


def require_bitwise(computed, expected):
    for a, b in zip(jax.tree.leaves(computed), jax.tree.leaves(expected), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(
            np.asarray(a).view(f"u{a.dtype.itemsize}"), np.asarray(b).view(f"u{b.dtype.itemsize}")
        )


@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_one_constant_for_many(dtype):
    """A divisor that is one number is not replaced by its reciprocal, constants are not collected."""
    with jax.enable_x64(dtype == "float64"):
        x = DoubleWord(*operands("multiply", dtype)[0])
        c = to_double_word(0.7, dtype)
        for f in (lambda x, c: x + c, lambda x, c: c - x, lambda x, c: x * c, lambda x, c: x / c, lambda x, c: c / x,
                  lambda x, c: x / c.hi, lambda x, c: (x + c) - c, lambda x, c: (x * c) * c.hi):  # fmt: skip
            full = jax.tree.map(lambda word: np.full(x.shape, word), c)
            require_bitwise(jax.jit(lambda x, f=f: f(x, c))(x), interpreted(f)(x, full))


def test_a_chain_in_one_program_is_the_chain_of_its_steps():
    x, y = (DoubleWord(*pair) for pair in operands("multiply", "float32"))

    def chain(x, y):
        z = (x * y + 0.1) / (y - 1.7)
        return abs(z * z - x).sqrt() - 3

    def step(z, each):
        return z * 0.5 + chain(*each), None

    expected = interpreted(chain)(x, y)
    require_bitwise(jax.jit(chain)(x, y), expected)
    require_bitwise(jax.jit(jax.vmap(chain))(x, y), expected)
    few = [jax.tree.map(lambda word: np.asarray(word)[:8], each) for each in (x, y)]
    by_steps = start = to_double_word(np.zeros((), np.float32))
    for i in range(8):
        by_steps, _ = interpreted(step)(by_steps, jax.tree.map(lambda word: word[i], few))  # noqa: B023
    require_bitwise(lax.scan(step, start, few)[0], by_steps)


@pytest.mark.parametrize("dtype", DTYPES)
def test_sums_and_products_commute(dtype):
    with jax.enable_x64(dtype == "float64"):
        for name in ("add", "multiply"):
            x, y = operands(name, dtype)
            require_bitwise(OPERATIONS[name][0](x, y), OPERATIONS[name][0](y, x))


# -- zeros, infinities, NaN -------------------------------------------------------------------------------------------

SPECIAL = [0.0, -0.0, 1.0, -1.0, 3.0, math.inf, -math.inf, math.nan]


def four_operations(x, y):
    return [operation(x, y) for operation in (operator.add, operator.sub, operator.mul, operator.truediv)]


@pytest.mark.parametrize("dtype", slow_but(["float32"], DTYPES))
def test_special_values_are_those_of_the_words(dtype):
    # Each operation is a program of its own in some dtypes, all of them are one in the others.
    compiled = jax.jit if dtype in ("float32", "bfloat16") else lambda f: f
    with jax.enable_x64(dtype == "float64"):
        a, b = (jnp.asarray(x.ravel(), dtype) for x in np.meshgrid(SPECIAL, SPECIAL))
        for x, y in ((to_double_word(a), to_double_word(b)), (to_double_word(a), b), (a, to_double_word(b))):
            for result, expected in zip(compiled(four_operations)(x, y), four_operations(a, b), strict=True):
                require_special(result, expected)


def require_special(result, expected):
    hi, lo, expected = (np.asarray(x).astype(np.float64) for x in (result.hi, result.lo, expected))
    assert np.isfinite(lo).all() and (lo[~np.isfinite(hi) | (hi == 0)] == 0).all()
    np.testing.assert_array_equal(hi, expected)
    np.testing.assert_array_equal(np.signbit(hi)[hi == 0], np.signbit(expected)[expected == 0])


@pytest.mark.parametrize("dtype", slow_but(["float32"], DTYPES))
def test_special_values_of_functions_of_one(dtype):
    with jax.enable_x64(dtype == "float64"):
        x = jnp.asarray([*SPECIAL, 4.0], dtype)
        of_pair, of_word = (DoubleWord.sqrt, abs, operator.neg), (jnp.sqrt, jnp.abs, operator.neg)
        results = jax.jit(lambda x: [f(to_double_word(x)) for f in of_pair])(x)
        words = jax.jit(lambda x: [f(x) for f in of_word])(x)
        for function, result, expected in zip(of_pair, results, words, strict=True):
            keep = (np.asarray(x).astype(np.float64) != 3) | (function is not DoubleWord.sqrt)
            hi, lo, expected = (np.asarray(word)[keep] for word in (result.hi, result.lo, expected))
            require_special(DoubleWord(hi, lo), expected)


@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_low_words_beside_infinities_and_zeros(dtype):
    with jax.enable_x64(dtype == "float64"):

        @jax.jit
        def program(x):
            x = x / 3
            return (
                [x * math.inf, x + math.inf, math.inf - x, math.inf / x, x / 0.0, (x * math.inf).sqrt()],
                [x * 0.0, 0.0 / x, x - x, x / math.inf],
                [x * math.inf - x * math.inf, (-x).sqrt(), x * 0.0 / 0.0],
            )

        found = program(to_double_word(jnp.ones((3,), dtype)))
        for results, hi in zip(found, (math.inf, 0, math.nan), strict=True):
            for result in results:
                np.testing.assert_array_equal(result.hi, np.full(3, hi, dtype))
                np.testing.assert_array_equal(result.lo, np.zeros(3, dtype))


@pytest.mark.parametrize("dtype", slow_but(["float32"], DTYPES))
def test_near_the_largest_number_results_are_those_of_the_high_words(dtype):
    largest = float(jnp.finfo(dtype).max)
    with jax.enable_x64(dtype == "float64"):
        a, b = (np.asarray(x, dtype) for x in ([largest, -largest, largest / 1.0001], [[1], [0.7], [3]]))
        a = np.broadcast_to(a, (3, 3))
        both = jax.jit(lambda a, b: (four_operations(to_double_word(a), b), four_operations(a, b + 0 * a)))(a, b)
        for result, expected in zip(*both, strict=True):
            np.testing.assert_array_equal(np.asarray(result.hi), np.asarray(expected))
            assert np.isfinite(np.asarray(result.lo)).all()


# -- comparisons ------------------------------------------------------------------------------------------------------

COMPARISONS = [operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne]


@pytest.mark.parametrize("dtype", slow_but(["float32"], DTYPES))
@pytest.mark.parametrize("comparison", COMPARISONS)
def test_comparisons_are_exact(comparison, dtype):
    rng = np.random.default_rng(5)
    with jax.enable_x64(dtype == "float64"):
        x = hostile_pairs(dtype, rng, 4, 8)
        near = cancelling(tuple(-word for word in x), rng)
        y = tuple(np.choose(rng.integers(0, 4, N), words) for words in zip(x, near, x[::-1], near, strict=True))
        y = normalised(*y)
        a, b = DoubleWord(*x), DoubleWord(*y)
        np.testing.assert_array_equal(np.asarray(comparison(a, b)), comparison(value(x), value(y)).astype(bool))
        np.testing.assert_array_equal(np.asarray(comparison(a, b.hi)), comparison(value(x), value(y[0])).astype(bool))
        np.testing.assert_array_equal(np.asarray(comparison(b.hi, a)), comparison(value(y[0]), value(x)).astype(bool))
        for other in SPECIAL:
            expected = [comparison(float(v), other) for v in value(x)]
            np.testing.assert_array_equal(np.asarray(comparison(a, other)), expected)


@pytest.mark.parametrize("comparison", COMPARISONS)
def test_nan_and_infinities_compare_as_numbers_do(comparison):
    a, b = (np.ravel(x) for x in np.meshgrid(SPECIAL, SPECIAL))
    result = comparison(to_double_word(jnp.asarray(a, jnp.float32)), to_double_word(jnp.asarray(b, jnp.float32)))
    np.testing.assert_array_equal(np.asarray(result), comparison(a, b))


def test_comparison_with_anything_else_is_that_of_python():
    x = to_double_word(jnp.float32(1))
    assert x != "1" and not (x == None)  # noqa: E711
    with pytest.raises(TypeError, match="not supported between"):
        operator.lt(x, "1")
    with pytest.raises(TypeError, match="unhashable"):
        hash(x)


# -- operands ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
def test_python_numbers_are_split_into_two_words(dtype, x64):
    if dtype == "float64" and not x64:
        pytest.skip("no float64")
    u = unit_roundoff(dtype)
    x = to_double_word(jnp.zeros((), dtype))
    for number in (0.1, -1 / 3, math.pi, 257, 1023, 4.0, np.float64(0.3), True):
        assert abs(value(x + number) - Fraction(number)) <= u**2 * abs(Fraction(number)), number
    if dtype in ("float32", "float64"):
        for number in (2**30 + 1, 10**15 + 1, -(2**40) - 3):
            assert value(x + number) == number
    if dtype == "float64":
        assert value(x + (2**90 + 3 * 2**10)) == 2**90 + 3 * 2**10
        assert value(x + 0.1) == Fraction(0.1)


def test_numpy_float64_beside_float32_words_loses_nothing_while_64_bits_are_off():
    numbers = np.array([0.1, 1 / 3, -math.pi])
    result = to_double_word(np.zeros(3, np.float32)) + numbers
    assert (abs(value(result) - rationals(numbers)) <= unit_roundoff("float32") ** 2 * abs(rationals(numbers))).all()
    with jax.enable_x64(True), pytest.raises(TypeError, match="DoubleWord: float32, other: float64"):
        operator.add(to_double_word(np.zeros(3, np.float32)), numbers)


def test_operands_broadcast_on_both_sides():
    many = to_double_word(jnp.ones((4, 3), jnp.float32))
    one, three = to_double_word(jnp.float32(2)), np.full((3,), 2, np.float32)
    for x in (
        many * one,
        one * many,
        many * three,
        three * many,
        jnp.asarray(three) * many,
        np.float32(2) * many,
        2 * many,
    ):
        assert isinstance(x, DoubleWord) and x.shape == (4, 3) and x.dtype == np.float32
        assert (x == 2).all()
    for operation, expected in ((operator.sub, 1), (operator.truediv, 2)):
        for two in (2, 2.0, three, jnp.asarray(three), one):
            result = operation(two, many)
            assert isinstance(result, DoubleWord) and (result == expected).all()


def test_operators_know_what_they_cannot_take():
    x = to_double_word(jnp.ones((2,), jnp.float32))
    for other in ("1", [1.0, 2.0], None, 1j):
        with pytest.raises(TypeError, match="unsupported operand"):
            operator.add(x, other)
        with pytest.raises(TypeError, match="unsupported operand"):
            operator.sub(other, x)
    with pytest.raises(TypeError, match="other: expected floating point .* got int32"):
        operator.mul(x, jnp.arange(2))
    with pytest.raises(TypeError, match="expected one dtype, got DoubleWord: float32, other: float16"):
        operator.mul(x, jnp.ones((2,), jnp.float16))
    with pytest.raises(ValueError, match=r"broadcast, got DoubleWord: \(2,\), other: \(3,\)"):
        operator.add(x, jnp.ones((3,), jnp.float32))


def test_constructor_checks_what_a_caller_passes():
    word = jnp.ones((2,), jnp.float32)
    with pytest.raises(TypeError, match="DoubleWord: hi: float32, DoubleWord: lo: float16"):
        DoubleWord(word, word.astype(jnp.float16))
    with pytest.raises(ValueError, match=r"equal shapes, got DoubleWord: hi: \(2,\), DoubleWord: lo: \(\)"):
        DoubleWord(word, word[0])
    with pytest.raises(TypeError, match="DoubleWord: hi: expected floating point .* got int32"):
        DoubleWord(jnp.arange(2), word)
    with pytest.raises(TypeError, match="DoubleWord: lo: expected an array .* got NoneType None"):
        DoubleWord(word, None)


def test_constructor_copies_arrays_of_the_caller():
    own = np.ones((64,), np.float32)
    x = DoubleWord(own, np.zeros_like(own))
    own[:] = 5
    assert (x == 1).all()


def test_as_an_array():
    x = to_double_word(jnp.arange(6, dtype=jnp.float32)) / 7
    assert x.shape == (6,) and x.ndim == 1 and x.dtype == np.float32
    assert x.reshape(2, 3).shape == x.reshape((2, 3)).shape == (2, 3)
    assert value(x.reshape(2, -1)[1, 0]) == value(x[3]) and x[1:3].shape == (2,)
    assert [float(each) for each in x] == [float(h) + float(w) for h, w in zip(x.hi, x.lo, strict=True)]
    assert bool(x[1]) and not bool(x[0])
    assert repr(to_double_word(0.1, "float32")) == "DoubleWord(hi=0.1, lo=-1.4901161e-09)"
    assert repr(x[:2]) == "DoubleWord(hi=[0.0, 0.14285715], lo=[0.0, -6.386212e-09])"
    assert repr(x.reshape(2, 3)) == "DoubleWord(hi=float32[2,3], lo=float32[2,3])"
    with pytest.raises(TypeError):
        iter(x[0])


# -- conversions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
def test_to_and_from_are_exact_for_the_own_dtype(dtype):
    with jax.enable_x64(dtype == "float64"):
        x = jnp.asarray(hostile_words(dtype, np.random.default_rng(1), 0, 8))
        for given in (x, np.asarray(x)):
            pair = to_double_word(given)
            assert pair.dtype == x.dtype and (pair.lo == 0).all()
            require_bitwise(pair.hi, x)
            require_bitwise(from_double_word(pair), x)


SPLIT = [("eager", "float16"), ("eager", "float32"), ("jit", "float32")]


@pytest.mark.parametrize(
    ("compiled", "dtype"),
    [
        pytest.param(run, dtype, id=f"{how}-{dtype}", marks=[pytest.mark.slow] * ((how, dtype) not in SPLIT))
        for dtype in ("bfloat16", "float16", "float32")
        for how, run in (("eager", lambda f: f), ("jit", jax.jit))
    ],
)
def test_wider_arrays_are_split(compiled, dtype):
    u = unit_roundoff(dtype)
    for wide in ("float32", "float64"):
        x = hostile_words(wide, np.random.default_rng(2), 3, 15)
        with jax.enable_x64(True):
            for given in (x, jnp.asarray(x)):
                pair = compiled(functools.partial(to_double_word, dtype=dtype))(given)
                assert pair.dtype == jnp.dtype(dtype)
                assert (pair.hi + pair.lo == pair.hi).all()
                assert (abs(value(pair) - rationals(x)) <= u**2 * abs(rationals(x))).all()


def test_words_of_another_dtype(x64):
    x = to_double_word(jnp.asarray(hostile_words("float32", np.random.default_rng(3), -3, 3))) / 3
    half = jax.jit(lambda x: x.astype(jnp.bfloat16))(x)
    assert (abs(value(half) - value(x)) <= unit_roundoff("bfloat16") ** 2 * abs(value(x))).all()
    assert (value(half.astype("float32")) == value(half)).all()
    large = to_double_word(jnp.asarray([1e30, -1e30, math.nan], jnp.float32)).astype("float16")
    assert (
        large[:2] == DoubleWord(jnp.asarray([math.inf, -math.inf], jnp.float16), jnp.zeros((2,), jnp.float16))
    ).all()
    assert (large.lo == 0).all() and jnp.isnan(large.hi[2])
    if x64:
        assert (value(x.astype("float64")) == value(x)).all()
        assert x.astype("float64").dtype == np.float64


def test_wider_results_are_rounded_once():
    with jax.enable_x64(True):
        x = to_double_word(jnp.asarray(hostile_words("float32", np.random.default_rng(4), -3, 3))) / 3
        exact = value(x)
        wide = from_double_word(x, dtype="float64")
        assert wide.dtype == np.float64
        np.testing.assert_array_equal(np.asarray(wide), [float(v) for v in exact])
        with pytest.raises(ValueError, match="expected one that holds float64, got float32"):
            from_double_word(x.astype("float64"), dtype="float32")


def test_conversions_map_over_trees():
    key = jax.random.key(0)
    tree = {"a": jnp.ones((2,), jnp.float32), "b": (3, None, np.float64(0.1), 0.1), "n": np.arange(3), "key": key}
    there = to_double_word(tree)
    assert isinstance(there["a"], DoubleWord) and there["b"][:2] == (3, None) and there["n"] is tree["n"]
    assert there["key"] is key
    for split in there["b"][2:]:
        assert split.dtype == np.float32 and abs(value(split) - Fraction(0.1)) <= Fraction(0.1) / 2**48
    assert to_double_word(there)["a"] is there["a"]
    assert to_double_word(there, dtype="float16")["a"].dtype == np.float16
    back = from_double_word(there)
    assert jax.tree.structure(back) == jax.tree.structure(tree)
    np.testing.assert_array_equal(np.asarray(back["a"]), np.ones(2))


def test_dtypes_that_cannot_be():
    with pytest.raises(TypeError, match="dtype: expected float16, bfloat16, float32 or float64, got int32"):
        to_double_word(jnp.ones(()), dtype=jnp.int32)
    with pytest.raises(TypeError, match="got float64; see jax.enable_x64"):
        from_double_word(to_double_word(jnp.ones(())), dtype="float64")


# -- derivatives ------------------------------------------------------------------------------------------------------


def through_double_words(f):
    return lambda *given: from_double_word(f(*map(to_double_word, given)))


def root(x):
    return (DoubleWord.sqrt if isinstance(x, DoubleWord) else jnp.sqrt)(x)


FUNCTIONS = {
    "add": lambda x, y: x + y,
    "subtract": lambda x, y: y - x,
    "multiply": lambda x, y: x * x * y,
    "divide": lambda x, y: x * x / y,
    "square_root": lambda x, y: root(x),
    "words": lambda x, y: 3.0 / (x * 0.1 + 2.0) - x / 7.0,
    "all": lambda x, y: abs(-x * x * y / (x + y) - root(x * y)),
}


@pytest.mark.parametrize("name", slow_but(["divide", "words"], FUNCTIONS))
def test_derivatives_of_every_order_are_those_of_the_value(name, x64):
    dtype = jnp.float64 if x64 else jnp.float32
    v = jnp.asarray([[1.3, 0.7], [0.4, 5.1], [2.5, 1.1]], dtype)

    def derivatives(f):
        def of_vector(v):
            return f(v[0], v[1])

        return jax.jit(jax.vmap(lambda v: [order(of_vector)(v) for order in (jax.jacfwd, jax.jacrev, jax.hessian)]))(v)

    for computed, expected in zip(
        *map(derivatives, (through_double_words(FUNCTIONS[name]), FUNCTIONS[name])), strict=True
    ):
        assert computed.dtype == dtype
        np.testing.assert_allclose(computed, expected, rtol=40 * jnp.finfo(dtype).eps, atol=4 * jnp.finfo(dtype).eps)


def test_third_derivatives():
    f = through_double_words(lambda x, y: x * x * x / y)
    third = jax.jit(jax.jacfwd(jax.hessian(lambda v: f(v[0], v[1]))))(jnp.asarray([2.0, 0.5]))
    np.testing.assert_allclose(third, [[[12, -48], [-48, 192]], [[-48, 192], [192, -768]]], rtol=1e-5)


@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_gradients_are_exact_where_they_are_numbers(dtype):
    with jax.enable_x64(dtype == "float64"):
        x, y = (np.dtype(dtype).type(number) for number in (1.3, 0.7))

        @jax.jit
        def slopes(x, y, zero):
            return (
                jax.grad(lambda x: from_double_word(to_double_word(x) * y))(x),
                *jax.grad(through_double_words(operator.mul), (0, 1))(x, y),
                jax.grad(through_double_words(operator.truediv))(x, y),
                *jax.grad(through_double_words(operator.sub), (0, 1))(x, y),
                jax.grad(through_double_words(abs))(-x),
                jax.grad(through_double_words(DoubleWord.sqrt))(zero),
                jax.grad(lambda x: from_double_word(to_double_word(x) / 0.0))(x),
            )

        one = x.dtype.type(1)
        assert slopes(x, y, 0 * x) == (y, y, x, one / y, 1, -1, -1, math.inf, math.inf)


def test_gradients_of_quotients_with_infinities():
    """d(a / b) = (da - (a / b) db) / b, and no derivative of an error of rounding, which is NaN here."""
    gradient = jax.jit(jax.grad(through_double_words(operator.truediv), (0, 1)))
    assert gradient(np.float32(math.inf), np.float32(2)) == (0.5, -math.inf)
    assert gradient(np.float32(2), np.float32(math.inf)) == (0, 0)


def test_both_words_reach_the_high_word_of_a_result_and_nothing_comes_from_its_low_word():
    x, y = (to_double_word(jnp.float32(v)) / 3 for v in (2, 5))
    for f, expected in ((operator.add, 1), (operator.mul, y.hi), (operator.truediv, 1 / y.hi)):
        gradient = jax.grad(lambda x, f=f: f(x, y).hi)(x)
        assert gradient.hi == gradient.lo == pytest.approx(float(expected), rel=3e-7)
        gradient = jax.grad(lambda x, f=f: f(x, y).lo)(x)
        assert gradient.hi == gradient.lo == 0
    _, tangent = jax.jvp(operator.mul, (x, y), (y, x))
    assert tangent.lo == 0 and tangent.hi == pytest.approx(float(x * x + y * y), rel=3e-7)


def test_derivatives_of_conversions():
    f = jax.grad(lambda x: from_double_word(to_double_word(x, dtype="bfloat16").astype("float32") * 3))
    assert f(jnp.float32(0.1)) == 3
    with jax.enable_x64(True):
        assert (
            jax.grad(lambda x: from_double_word(to_double_word(x, dtype="float32"), dtype="float64"))(jnp.float64(0.1))
            == 1
        )


def test_a_scan_is_differentiated_both_ways():
    def powers(x, n):
        step = lambda z, _: (z * x + 1, None)  # noqa: E731
        return from_double_word(lax.scan(step, to_double_word(jnp.ones_like(x)), length=n)[0])

    # 1 + x + x^2 + x^3
    x = jnp.float32(1.5)
    assert jax.grad(powers)(x, 3) == jax.jvp(lambda x: powers(x, 3), (x,), (jnp.float32(1),))[1] == 1 + 3 + 6.75
    assert jax.grad(jax.grad(powers))(x, 3) == 2 + 9


def test_tangents_are_linear():
    x, y = (to_double_word(jnp.asarray([2.0, -3.0, 0.5], jnp.float32)) / n for n in (3, 7))
    _, tangent = jax.linearize(lambda x, y: (x * y, x / y, x + y, abs(x).sqrt()), x, y)
    transposed = jax.linear_transpose(tangent, x, y)
    results = tangent(x, y)
    assert jax.tree.structure(transposed(results)) == jax.tree.structure((x, y))
    doubled = tangent(*jax.tree.map(lambda word: 2 * word, (x, y)))
    require_bitwise(doubled, jax.tree.map(lambda word: 2 * word, results))


# -- as a pytree ------------------------------------------------------------------------------------------------------


def test_leaves_may_be_anything_and_have_names():
    x = to_double_word(jnp.ones((2,), jnp.float32))
    for leaf in ("text", None, 3, object(), (1, 2)):
        rebuilt = jax.tree.map(lambda _, leaf=leaf: leaf, x)
        assert isinstance(rebuilt, DoubleWord) and rebuilt.hi is rebuilt.lo is leaf
    assert [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(x)] == [".hi", ".lo"]
    assert repr(jax.tree.map(lambda _: None, x)) == "DoubleWord(hi=None, lo=None)"
    for mark in (0, None, PartitionSpec("batch")):
        assert DoubleWord(mark, mark).hi is mark


def test_vmap_with_axes_over_words():
    x = to_double_word(jnp.asarray(np.arange(6.0).reshape(2, 3), jnp.float32)) / 7
    for axes in (1, DoubleWord(1, 1)):
        result = jax.vmap(lambda x: x * 3, in_axes=(axes,), out_axes=DoubleWord(1, 1))(x)
        require_bitwise(result, x * 3)
    one = to_double_word(jnp.float32(0.3))
    require_bitwise(jax.vmap(operator.mul, in_axes=(0, None))(x, one), x * one)


def test_state_is_carried_donated_and_branched():
    def hundred_thirds(x):
        return lax.fori_loop(0, 100, lambda _, x: x + 1 / (to_double_word(jnp.float32(3))), x)

    x = jax.jit(hundred_thirds, donate_argnums=0)(to_double_word(jnp.float32(0)))
    assert abs(value(x) - Fraction(100, 3)) < 300 * Fraction(100, 3) / 2**48
    x = jax.jit(lambda x: lax.cond(x > 33, lambda x: x * 2, lambda x: x, x))(x)
    assert from_double_word(x) == np.float32(200 / 3)


def test_exported_programs_take_and_return_double_words():
    x = to_double_word(jnp.float32(2)) / 3
    exported = jax.export.export(jax.jit(lambda x: {"square": x * x}))(x)
    again = jax.export.deserialize(bytearray(exported.serialize()))
    require_bitwise(again.call(x)["square"], x * x)

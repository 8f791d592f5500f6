"""Vectors that are hard on arithmetic: by family, at the edges of the format, and with a condition number on request.

`FAMILIES` and `EXTREMES` map a name to function(rng, count, n, dtype) -> list of count arrays (n, 3). None of FAMILIES
over- or underflows in a product of three, so every error bound holds on them; each of EXTREMES breaks that assumption
in one way. `CONDITIONED` maps "dot" and the names of the shifts to function(rng, n, dtype, condition) -> arguments, at
that condition number:

>>> tau, f, p = CONDITIONED["shift_force"](rng, 1000, "float32", 1e6)
>>> value, mag = evaluate(lambda tau, f, p: tau - np.cross(p, f), tau, f, p)
>>> in_ulps(my_shift(tau, f, p), value)

The condition number of a component is mag / |exact value|, where mag is the sum of the absolute values of its terms.
"""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from jax.typing import DTypeLike

from jaxspatial.measure.error import evaluate, rationals, ulp
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.numerics import floats

# A number, or one per component.
Condition = float | np.ndarray


def benign(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """count arrays (n, 3) of normally distributed numbers."""
    return _rounded(rng.standard_normal((count, n, 3)), dtype)


def mixed_scales(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Components whose sizes differ by up to the fourth root of the range of the format."""
    exponents = _spread(dtype)
    normal = rng.standard_normal((count, n, 3))
    return _rounded(normal * 2.0 ** rng.integers(-exponents, exponents, (count, n, 3)), dtype)


def parallel(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Multiples of one direction by powers of two: their cross products are exactly 0."""
    direction = _rounded(rng.standard_normal((1, n, 3)), dtype)[0]
    return [direction * np.asarray(2.0 ** rng.integers(-2, 3, (n, 1)), dtype) for _ in range(count)]


def nearly_parallel(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """As `parallel`, but for a few units in the last place."""
    eps = floats.eps(dtype)
    wide = (x.astype(np.float64) for x in parallel(rng, count, n, dtype))
    return [(x * (1 + 4 * eps * rng.standard_normal((n, 3)))).astype(dtype) for x in wide]


def just_above_powers_of_two(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Significands of few units above 1, where a rounding error is largest relative to the number."""
    eps = floats.eps(dtype)
    return _rounded((1 + eps * rng.integers(0, 8, (count, n, 3))) * rng.choice([-1.0, 1.0], (count, n, 3)), dtype)


def small_integers_and_zeros(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Integers from -2 to 2, many of them zero."""
    return _rounded(rng.integers(-2, 3, (count, n, 3)), dtype)


def signed_zeros(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Integers from -2 to 2, many of them zero, and of the zeros half negative."""
    return _rounded(rng.integers(0, 3, (count, n, 3)) * rng.choice([-1.0, 1.0], (count, n, 3)), dtype)


def far_offsets(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """In item i array number i % count is far off, about 1e8, the others about 1e-3.

    Where the range of the format does not allow these: 2^(maxexp / 4) and 2^(-maxexp / 8) (float16: 16 and 1/4).
    """
    far, near = 2.0 ** min(27, 2 * _spread(dtype)), 2.0 ** -min(10, _spread(dtype))
    in_turn = np.arange(count)[:, None, None] == np.arange(n)[:, None] % count
    return _rounded(rng.standard_normal((count, n, 3)) * np.where(in_turn, far, near), dtype)


FAMILIES = {
    family.__name__: family
    for family in (
        benign, mixed_scales, parallel, nearly_parallel,
        just_above_powers_of_two, small_integers_and_zeros, signed_zeros, far_offsets,
    )
}  # fmt: skip


def near_overflow_of_products(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Every product of two components overflows, every cross product of two arrays is representable.

    In items of even number the arrays are exactly parallel, cross products exactly 0. In the others they are parallel
    but for one unit in the last place of each component, cross products at most an eighth of the largest number.
    """
    info = floats.finfo(dtype)
    directions = _signed(rng, np.full((n, 3), info.maxexp // 2), dtype)
    off = rng.integers(0, 2, (count, n, 3)) * (np.arange(n)[:, None] % 2)
    nearly = directions + np.copysign(off * np.ldexp(float(info.eps), info.maxexp // 2), directions)
    return _rounded(nearly * 2.0 ** rng.integers(0, 2, (count, n, 1)), dtype)


def near_overflow_of_splits(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """In each item one array is huge, from an eighth of the largest number to the largest, and one is small, its
    components from tiny to 8 tiny; the others are from 1/4 to 1/2.

    Products of the huge one with the small one are from 1/2 to 32, and no product or sum of two products overflows. But
    multiplying the huge one by 2^k + 1, as Veltkamp's splitting does, overflows. Each ordered pair of arrays takes its
    turn. Products of the small one with the others may underflow. With one array alone, all is huge.
    """
    info, item, number = floats.finfo(dtype), np.arange(n)[:, None], np.arange(count)[:, None, None]
    huge = item % count
    small = (huge + 1 + item // count % max(count - 1, 1)) % count
    beside = np.where(number == small, rng.integers(info.minexp, info.minexp + 3, (count, n, 3)), -2)
    at_the_top = rng.integers(info.maxexp - 3, info.maxexp, (count, n, 3))
    return list(_signed(rng, np.where(number == huge, at_the_top, beside), dtype).astype(dtype))


def tiny_products(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Normal numbers, whose products of two are between tiny eps and 4 tiny / eps.

    The smaller products underflow; the rounding errors of all the others, which a compensated operation computes, are
    below 2 tiny.
    """
    info = floats.finfo(dtype)
    lowest, highest = -((info.nmant - info.minexp) // 2), (info.nmant + info.minexp) // 2
    return list(_signed(rng, rng.integers(lowest, highest + 1, (count, n, 3)), dtype).astype(dtype))


def subnormals(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """A third each: subnormal numbers of all sizes, numbers from tiny to 8 tiny, normally distributed numbers."""
    info, size = floats.finfo(dtype), (count, n, 3)
    below = np.ldexp(np.floor(2.0 ** rng.uniform(0, info.nmant, size)), info.minexp - info.nmant)
    above = _signed(rng, rng.integers(info.minexp, info.minexp + 3, size), dtype)
    kinds = [below * rng.choice([-1.0, 1.0], size), above, rng.standard_normal(size)]
    return _rounded(np.choose(rng.integers(0, 3, size), kinds), dtype)


def not_finite(rng: np.random.Generator, count: int, n: int, dtype: DTypeLike):
    """Normally distributed numbers; a quarter of them is replaced by NaN, infinity or minus infinity at random."""
    special = rng.choice([np.nan, np.inf, -np.inf], (count, n, 3))
    return _rounded(np.where(rng.random((count, n, 3)) < 0.25, special, rng.standard_normal((count, n, 3))), dtype)


EXTREMES = {
    family.__name__: family
    for family in (near_overflow_of_products, near_overflow_of_splits, tiny_products, subnormals, not_finite)
}


def with_condition(rng: np.random.Generator, formula: Callable, others: Sequence[np.ndarray], condition: Condition):
    """Arguments [first, *others] of a formula, at which each component of its value has the condition number asked for.

    >>> tau, f, p = with_condition(rng, lambda tau, f, p: tau - np.cross(p, f), benign(rng, 2, 1000, "float32"), 1e6)

    formula: its value must be its first argument plus terms of the others (*unchecked* requirement), in operations that
    `evaluate` knows. others: arrays of one dtype, whose shapes broadcast to that of the value. condition: at
    least 1, a number or one per component.

    Guaranteed up to 1/u: the one reached is within a factor of 2.1, unless `first` over- or underflows or all other
    terms are 0. Beyond, where `first` has no digits left for it, it is at least 1/(2u). At infinity: `first` is minus
    the other terms, correctly rounded; what is left is its rounding error, which may be 0.
    """
    zero = np.zeros(np.broadcast_shapes(*(x.shape for x in others)))
    rest, mag = evaluate(formula, zero, *others)
    return [nearest(_last_term(rest, mag, condition, rng.choice([-1, 1], rest.shape)), others[0].dtype), *others]


def products_with_condition(rng: np.random.Generator, terms: int, n: int, dtype: DTypeLike, condition: float):
    """Arrays x, y (n, terms), so that the sum of the products x y of each item has the condition number asked for.

    After Algorithm 6.1 of Ogita, Rump and Oishi 2005: random products of one sign, then three that cancel most of what
    the ones before add up to, each a cube root of the condition number more; in random order. terms: at least four.
    condition: a number from 1 to 1/u^2 (products have twice the digits; *unchecked* requirement); the one reached is
    within a factor of 2.1. With at most six terms all numbers are of size 2^(-maxexp / 4) to 2^(maxexp / 4).
    """
    share = condition ** (1 / 3) / (2 * terms - 6)
    products = share * 2 ** rng.random((terms - 3, n)) * rng.choice([-1, 1], n)
    pairs = [_factors(rng, product, dtype) for product in rationals(products)]
    for cancelled in condition ** (np.arange(1, 4) / 3):
        rest, mag = evaluate(lambda x, y: (x * y).sum(0), *map(np.stack, zip(*pairs, strict=True)))
        pairs.append(_factors(rng, _last_term(rest, mag, cancelled, -np.sign(rest)), dtype))
    order = rng.permuted(np.tile(np.arange(terms), (n, 1)), axis=1)
    return [np.take_along_axis(np.stack(x, -1), order, -1) for x in zip(*pairs, strict=True)]


def workless(rng: np.random.Generator, n: int, dtype: DTypeLike):
    """tau, f, w, v (n, 3), whose power tau . w + f . v is exactly 0, its products cancelling in pairs.

    No product is 0. All numbers are of size 1/8 to 4.
    """
    tau, w = _halves(rng, 2, n, dtype)
    scale = 2.0 ** rng.integers(-2, 3, (n, 3))
    f, v = _rounded([np.roll(tau, 1, -1) * scale, -np.roll(w, 1, -1) / scale], dtype)
    return [tau, f, w, v]


def shift_with_condition(name: str, rng: np.random.Generator, n: int, dtype: DTypeLike, condition: Condition):
    """Arguments (n, 3) of a shift of `OPERATIONS`: each component of what it computes has this condition number, as
    `with_condition` guarantees.

    All of them but the term to which the others are added (tau, v, a) are of size 1/2 to 1.
    """
    operation = OPERATIONS[name]
    i = operation.in_place or 0

    def formula(first, *others):
        return operation.formulas[0](*others[:i], first, *others[i:])

    others = _halves(rng, len(operation.arguments) - 1, n, dtype)
    first, *others = with_condition(rng, formula, others, condition)
    return [*others[:i], first, *others[i:]]


def dot_with_condition(rng: np.random.Generator, n: int, dtype: DTypeLike, condition: float):
    """tau, f, w, v (n, 3): the power tau . w + f . v of each item has this condition number.

    condition: from 1 to 1/u^2, with the guarantees of `products_with_condition`; or infinity: `workless`.
    """
    if np.isinf(condition):
        return workless(rng, n, dtype)
    x, y = products_with_condition(rng, 6, n, dtype, condition)
    return [x[:, :3], x[:, 3:], y[:, :3], y[:, 3:]]


_SHIFTS = "shift_force", "shift_velocity", "shift_acceleration"
CONDITIONED = {name: functools.partial(shift_with_condition, name) for name in _SHIFTS} | {"dot": dot_with_condition}


def nearest(exact: np.ndarray, dtype: DTypeLike) -> np.ndarray:
    """The correctly rounded numbers (ties to even) of an array of Fractions, which are in the range of the dtype."""
    unit = ulp(exact, dtype)
    return (np.frompyfunc(round, 1, 1)(exact / unit) * unit).astype(np.float64).astype(dtype)


def _last_term(rest, mag, condition, sign):
    """What to add to `rest` so that the sum has a condition number between max(1, condition - 1) and condition + 1.

    The sum is to be t with |t| = (|rest| + mag) / condition. Adding t - rest adds |t - rest| to mag, and that is
    between |rest| - |t| and |rest| + |t|; so the new mag is between (condition - 1) |t| and (condition + 1) |t|.
    """
    return sign * (abs(rest) + mag) * rationals(1 / np.asarray(condition, np.float64)) - rest


def _factors(rng, products, dtype):
    """x, y whose products are `products` (Fractions, none 0) up to the rounding of y; of similar size."""
    spread = 2.0 ** (rng.uniform(-1, 1, len(products)) * floats.finfo(dtype).maxexp / 64)
    sizes = np.sqrt(abs(products).astype(np.float64)) * spread
    x = (sizes * rng.choice([-1, 1], len(products))).astype(dtype)
    return x, nearest(products / rationals(x), dtype)


def _signed(rng, exponents, dtype):
    """Numbers of random sign and significand times 2^exponents, representable, in float64."""
    digits = floats.finfo(dtype).nmant
    significands = 1 + np.ldexp(rng.integers(0, 2**digits, np.shape(exponents)).astype(np.float64), -digits)
    return np.ldexp(significands * rng.choice([-1.0, 1.0], np.shape(exponents)), exponents)


def _halves(rng, count, n, dtype):
    """count arrays (n, 3) of numbers of size 1/2 to 1."""
    return list(_signed(rng, np.full((count, n, 3), -1), dtype).astype(dtype))


def _spread(dtype):
    return max(int(floats.finfo(dtype).maxexp) // 8, 1)


def _rounded(x, dtype):
    return list(np.asarray(x, np.float64).astype(dtype))

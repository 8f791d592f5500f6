"""Functions of numbers that every rotation is made of: series in the squared angle, sine and cosine, angles, norms.

None of them calls a library: they are sums and products, the same bits in any batch and surrounding, vectorised along
with what they are used in, and of twice the precision for double words. The number of terms comes from the unit
roundoff.
"""

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.numerics.floats import finfo
from jaxspatial.numerics.linear import scaled
from jaxspatial.numerics.numbers import Corrected, Number, Rounded, constant, high, is_constant, is_number, where
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.numbers.number import doubled, nearest_integer, noinline, noinline_pairs, times_power_of_two
from jaxspatial.numerics.precision import Precision

# 60 digits: three limbs of float64 are known from it.
_PI = Fraction("3.14159265358979323846264338327950288419716939937510582097494459")
_LN2 = Fraction("0.69314718055994530941723212145817656807550013436025525412068000950")


def unit_roundoff(x: Number) -> Fraction:
    """u of the numbers that x is one of; u^2 where these have two limbs."""
    u = Fraction(1, 2 ** (finfo(x.dtype).nmant + 1))
    return u if isinstance(x, Rounded) else u * u


def series(coefficients: Iterable[Fraction], x: Number, largest: float | Fraction) -> Number:
    """sum of c_n x^n, by Horner's rule, for 0 <= x <= largest; as many terms as u makes a difference for.

    coefficients: an iterable of Fractions, of which those that matter fall off.
    """
    needed: list[Fraction] = []
    for n, c in enumerate(coefficients):
        needed.append(c)
        if abs(c) * Fraction(largest) ** n < unit_roundoff(x) * abs(needed[0]) / 16:
            break
    return _polynomial(tuple(needed))(x)


@functools.cache
def _polynomial(coefficients: tuple[Fraction, ...]) -> Callable:
    def evaluated(x) -> Number:
        if isinstance(x, DoubleWord):
            # In a loop: written out, it would compile for seconds.
            pairs = [constant(x, c) for c in reversed(coefficients)]
            first, rest = pairs[0], jax.tree.map(lambda *limbs: np.stack(limbs), *pairs[1:])
            start = jax.tree.map(lax.full_like, x, first)
            return lax.scan(lambda result, c: (result * x + c, None), start, rest)[0]
        if is_constant(x) or len(coefficients) == 1:
            return _horner(coefficients, x)
        return _corrected(coefficients, x) if isinstance(x, Corrected) else _of_data(coefficients, x.precision)(x)

    return noinline_pairs(evaluated)


def _horner(coefficients: tuple, x) -> Any:
    result, *others = (c if is_number(c) else constant(x, c) for c in reversed(coefficients))
    return functools.reduce(lambda result, c: result * x + c, others, result)


@functools.cache
def _of_data(coefficients: tuple[Fraction, ...], precision: Precision) -> Callable[..., Rounded]:
    """The polynomial of a Rounded, differentiated as one: a pull-back needs its slope, and not every step to it."""

    @jax.custom_jvp
    def value(x: Array) -> Array:
        return _horner(coefficients, Rounded(precision, x)).value

    @value.defjvp  # pyright: ignore[reportFunctionMemberAccess]
    def jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        (x,), (dx,) = primals, tangents
        slope = _polynomial(tuple(n * c for n, c in enumerate(coefficients))[1:])
        # JAX comes here when it differentiates, where the caller's types hold; of a float32, x may be in float64.
        with jax.enable_x64(True):
            rate = slope(Rounded(precision, x)) * Rounded(precision, dx)
            return value(x), rate.value

    return lambda x: Rounded(precision, value(x.value))


def _corrected(coefficients: tuple[Fraction, ...], x: Corrected) -> Number:
    """The polynomial of a number with a correction, for |x| <= 1: plain where a term's rounding makes no difference."""
    n = next((n for n, c in enumerate(coefficients) if c**2 < unit_roundoff(x) * coefficients[0] ** 2), None)
    if n is None:
        return _horner(coefficients, x)
    rest = _of_data(coefficients[n:], Precision.REPRODUCIBLE)(Rounded(Precision.REPRODUCIBLE, x.value))
    return _horner((*coefficients[:n], x._of_limb(rest.value)), x)


def stumpff(k: int, x: Number, largest: float | Fraction) -> Number:
    """Stumpff's function c_k, the sum of (-x)^n / (2 n + k)!, for 0 <= x <= largest. With x = a^2:

    c_0 = cos(a)        c_1 = sin(a) / a        c_2 = (1 - cos(a)) / a^2        c_k+2 = (1 / k! - c_k) / a^2
    """
    return series((Fraction((-1) ** n, math.factorial(2 * n + k)) for n in itertools.count()), x, largest)


def turns(angle: Number, parts: int) -> tuple[Number, Number]:
    """(k, rest) with angle = k (2 pi / parts) + rest, |rest| <= pi / parts, k an integer: a constant to derivatives.

    The error of rest is a few u |rest| while k has at most half of the bits of a limb (float32: |angle| <= 2^13 /
    parts, float64: 2^28 / parts), and 2 u |angle| beyond, as if the angle had been rounded once more. NaN where not
    even the turn is known: where u |angle| is larger than an eighth of a part.
    """
    step = 2 * _PI / parts
    k, rest = _remainder(angle, step)
    is_known = abs(high(k)) <= 2.0 ** (finfo(angle.dtype).nmant - 2)
    return k, where(is_known & (abs(rest.limbs[0]) <= float(step * 9 / 16)), rest, math.nan)


def _remainder(x, step: Fraction) -> Any:
    """(k, x - k step) with k the integer nearest to x / step; see `turns` for errors."""
    k: Any = nearest_integer(x * constant(x, 1 / step))
    if isinstance(x, DoubleWord):
        limbs = np.array([float(limb) for limb in _limbs(step, x)], x.dtype)
        return k, lax.scan(lambda rest, limb: (rest - k * jnp.broadcast_to(limb, rest.shape), None), x, limbs)[0]
    for limb in _limbs(step, x):
        x = x - k * constant(x, limb)
    return k, x


def _limbs(fraction: Fraction, like: Number) -> Iterator[Fraction]:
    """The fraction as a sum of limbs so short that their products with integers of half a limb are exact.

    Of seven, because an angle of that many turns may come as near to a whole one as u / 16, and keeps its digits.
    With corrections four of these are one.
    """
    bits = (finfo(like.dtype).nmant + 1) // 2 - 1
    for _ in range(3 if isinstance(like, Corrected) else 7):
        scale = Fraction(2) ** (bits - math.frexp(float(fraction))[1])
        limb = Fraction(int(fraction * scale)) / scale
        yield limb
        fraction -= limb
    if isinstance(like, Corrected):
        yield fraction


_quarter_turns = noinline_pairs(functools.partial(turns, parts=4))


@noinline
def cosine_sine(angle: Number) -> tuple[Number, Number]:
    """(cos, sin) of an angle, each to 2 u of 1, sine relative to itself near 0. NaN for angles beyond 1 / u."""
    turned, rest = _quarter_turns(angle)
    x = rest * rest
    c, s = stumpff(0, x, 0.64), rest * stumpff(1, x, 0.64)
    k = Rounded(Precision.FAST, high(turned))  # Of integers all this is exact.
    quarter = high(k - 4 * nearest_integer(k * 0.25))  # -2, -1, 0, 1 or 2
    size = abs(quarter)
    half, is_odd = _equal(size, 2), _equal(size, 1)
    cos, sin = where(is_odd, s, c), where(is_odd, c, s)
    either = lax.bitwise_or if isinstance(half, Array) else operator.or_
    return where(either(_equal(quarter, 1), half), -cos, cos), where(either(_equal(quarter, -1), half), -sin, sin)


def _equal(x, number: int):
    return lax.eq(x, x.dtype.type(number)) if isinstance(x, Array) else x == number


@noinline_pairs
def angle_ratio(squared_sine: Number, cosine: Number, length: Number | float = 1) -> Number:
    """t / sin(t) for the angle 0 <= t <= pi / 2 with that squared sine and cosine; smooth at 0.

    length: by which sine and cosine have to be divided to be those of an angle, as the result then is: t = sine times
    it. From tan(t/2) = sine / (length + cosine): neither is rounded to unit length first.
    """
    ratio = 1 / (cosine + length)
    return doubled(ratio * _polynomial(_arc_tangent(unit_roundoff(cosine)))(squared_sine * (ratio * ratio)))


@functools.cache
def _arc_tangent(u: Fraction) -> tuple[Fraction, ...]:
    """Coefficients of atan(a) / a as a polynomial in a^2 <= 1: Chebyshev's expansion of atan(a) in odd polynomials T,

        atan(a) = 2 sum over k of (-1)^k p^(2k+1) / (2k+1) T_2k+1(a)        p = sqrt(2) - 1

    with three terms more than values need: second derivatives have those digits, too. In multiples of 10^-60.
    """
    one = 10**60
    p = math.isqrt(2 * one * one) - one
    power, count = p, 3 + math.ceil(math.log(float(u) / 16) / (2 * math.log(p / one)))
    result, below, odd = [0] * count, [1], [1]  # T_2k-1 / a and T_2k+1 / a by their coefficients; T_-1 = T_1.
    for k in range(count):
        for j, c in enumerate(odd):
            result[j] += 2 * (-1) ** k * power * c // (2 * k + 1)
        # T_n+2 = (4 a^2 - 2) T_n - T_n-2.
        terms = zip([0, *odd], [*odd, 0], [*below, 0, 0], strict=False)
        below, odd = odd, [4 * shifted - 2 * same - lower for shifted, same, lower in terms]
        power = power * p // one * p // one
    return tuple(Fraction(c, one) for c in result)


def pi(like: Number) -> Number:
    """The number nearest to pi."""
    return constant(like, _PI)


@noinline_pairs
def exp(x: Number) -> Number:
    """e^x: 0 below what the format holds, an infinity above. Error at most 4 u e^x; smooth.

    2^k e^r with |r| <= ln(2) / 2; with as many terms as |r| = 1 would need, derivatives have all digits too.
    """
    largest = finfo(x.dtype).maxexp
    is_low, is_high = high(x) < -largest, high(x) > largest
    k, rest = _remainder(where(is_low | is_high, 0.0, x), _LN2)
    power = series((Fraction(1, math.factorial(n)) for n in itertools.count()), rest, 1)
    power = times_power_of_two(power, jnp.asarray(high(k)).astype(jnp.int32))
    return where(is_low, 0.0, where(is_high, math.inf, power))


@noinline_pairs
def log(x: Number) -> Number:
    """The natural logarithm: -inf at 0, NaN below. Error at most 4 u |log x|, also near 1.

    e ln 2 + 2 artanh((m - 1) / (m + 1)) with x = 2^e m, 3/4 <= m < 3/2.
    """
    is_usual = (high(x) > 0) & (high(x) <= finfo(x.dtype).max)
    (m,), e = scaled((where(is_usual, x, 1.0),))
    is_low = high(m) < 0.75
    m, e = where(is_low, 2 * m, m), jnp.where(is_low, e - 1, e)
    ratio = (m - 1) / (m + 1)
    artanh = ratio * series((Fraction(1, 2 * n + 1) for n in itertools.count()), ratio * ratio, Fraction(1, 9))
    result = x._of_limb(e.astype(x.dtype)) * constant(x, _LN2) + 2 * artanh
    return where(is_usual, result, where(high(x) == 0, -math.inf, where(high(x) > 0, x, math.nan)))

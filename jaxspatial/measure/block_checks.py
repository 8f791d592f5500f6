"""Whether the building blocks are what they are taken for: error-free transforms, quotients, double words."""

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic.errorfree import reproducible, transforms
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import to_double_word
from jaxspatial.arithmetic.promise import DOUBLE_WORDS
from jaxspatial.measure import error, exact, inputs
from jaxspatial.measure.findings import DTYPES, cause, differing, finite, in_dtype, rng, scanned, verdict

# (a, b) to a rounded number and its error.
Transform = Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]
# What a transform is used in: a compiler that sees less of the result has other ideas.
_SURROUNDINGS = {
    "both": lambda f: jax.jit(f),
    "error alone, vmap": lambda f: jax.jit(jax.vmap(lambda a, b: f(a, b)[1])),
    "error alone, scan": lambda f: jax.jit(scanned(lambda a, b: f(a, b)[1])),
}


def two_sum():
    return _transform(transforms.two_sum, lambda a, b: a + b, constants=True)


def two_product():
    return _transform(transforms.two_product, lambda a, b: a * b)


def _transform(transform: Transform, operator: Callable[[Any, Any], Any], constants: bool = False):
    shares = {}
    for dtype in DTYPES:
        a, b = (x[:, 0] for x in inputs.benign(rng(), 2, 200, dtype))
        with in_dtype(dtype):
            wrong = [_wrong(f(transform), operator, a, b) for f in _SURROUNDINGS.values()]
            wrong += _wrong_with_constants(transform, operator, a) if constants else []
        shares[dtype] = max(wrong)
    where = "jit, vmap, scan, error alone" + (", constants" if constants else "")
    return verdict(shares, f"exact ({where})")


def _wrong(
    compiled: Callable[[jax.Array, jax.Array], Any], operator: Callable[[Any, Any], Any], a: np.ndarray, b: np.ndarray
):
    """The share of lanes in which rounded result and error do not add up to the exact one."""
    computed = compiled(jnp.asarray(a), jnp.asarray(b))
    errors = computed[1] if isinstance(computed, tuple) else computed
    exactly = operator(exact.rationals(a), exact.rationals(b))
    return float(np.mean(exact.rationals(finite(errors)) != exactly - exact.rationals(operator(a, b))))


def _wrong_with_constants(transform: Transform, operator: Callable[[Any, Any], Any], a: np.ndarray):
    c = np.full_like(a, 0.7)
    known = jnp.asarray(c[0])
    orders = [
        (lambda a, _: transform(jnp.full_like(a, known), a)),
        (lambda a, _: transform(a, jnp.full_like(a, known))),
    ]
    return [_wrong(jax.jit(f), operator, a, c) for f in orders]


def division():
    shares, plain = {}, {}
    for dtype in DTYPES:
        a, b = inputs.benign(rng(), 2, 200, dtype)
        with in_dtype(dtype):
            for found, divide in ((shares, reproducible.quotient), (plain, lax.div)):
                computed = jax.jit(jax.vmap(divide, in_axes=(0, None)))(jnp.asarray(a), jnp.asarray(b[0]))
                found[dtype] = differing([computed], [a / b[0]])
    noted = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in plain.items())
    return verdict(shares, f"rounded correctly (plain division by a shared divisor: {noted} of the lanes differ)")


def double_words():
    """Sums, products and quotients of float32 words, with 64-bit types off."""
    words = rng().standard_normal((2, 200))
    with in_dtype("float32"):
        x, y = (to_double_word(w) for w in words)
        computed = jax.jit(lambda x, y: (x + y, x * y, x / y))(x, y)
        a, b = _value(x), _value(y)
    u = error.unit_roundoff("float32")
    worst = [_over_square(c, e, u) for c, e in zip(computed, (a + b, a * b, a / b), strict=True)]
    holds = all(error <= limit for error, limit in zip(worst, [DOUBLE_WORDS[x] for x in "+*/"], strict=True))
    return holds, "float32: worst errors {:.2g}, {:.2g}, {:.2g} u^2 (+, *, /)".format(*worst), "" if holds else cause()


def _value(x: DoubleWord):
    return exact.rationals(finite(x.hi)) + exact.rationals(finite(x.lo))


def _over_square(computed: DoubleWord, exactly: np.ndarray, u: Fraction):
    return float(np.max(abs(_value(computed) - exactly) / abs(exactly)) / u**2)

"""Rigid bodies put together and taken apart, over numbers, about one point in one frame; and sums over a batch.

In the reduced-mass form I1 + I2 + m1 m2 / m (|d|^2 1 - d d^T), d the distance of the centres of mass, only terms that
are positive semidefinite are added: nothing cancels, however far from the origin. [Featherstone 2008, 2.13]

Sums of few vectors are written out by components, here and beside: an operator of vectors stacks double words, which
takes up to twice as long where nothing else is stacked.
"""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp

from jaxspatial.numerics import floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Inertia, Symmetric, Vector
from jaxspatial.numerics.numbers import Number, Numbers, Rounded, constant, high, noinline_pairs, where
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.numbers.layout import unstack
from jaxspatial.numerics.numbers.rounded import is_known
from jaxspatial.numerics.precision import Precision
from jaxspatial.numerics.sums.pairwise import by_halving, pairwise_sum
from jaxspatial.spatial import algebra

# -- two bodies -------------------------------------------------------------------------------------------------------


def combined(a: Inertia, b: Inertia, share: float = 0.5) -> Inertia:
    """Two bodies as one, with the centre of mass computed from that of the heavier body: exact where both coincide.

    share: of the way from a to b at which the centre of mass is where neither body has mass.
    """
    m = a.mass + b.mass
    is_massless = (high(a.mass) == 0) & (high(b.mass) == 0)
    divisor = where(is_massless, 1.0, m)
    d = Vector(*(y - x for x, y in zip(a.com, b.com, strict=True)))
    is_first = abs(high(a.mass)) >= abs(high(b.mass))
    lighter, heavier = where(is_first, b.mass, a.mass), where(is_first, a.mass, b.mass)
    part = where(is_massless, share, lighter / divisor)
    com = Vector(
        *(where(is_first, x, y) + where(is_first, part, -part) * z for x, y, z in zip(a.com, b.com, d, strict=True))
    )
    arm = steiner(heavier * (lighter / divisor), d)
    return Inertia(m, com, Symmetric(*(x + y + z for x, y, z in zip(a.central, b.central, arm, strict=True))))


with_body = formula(combined)


@formula
def without_body(a: Inertia, b: Inertia) -> Inertia:
    """What is left of the first body without the second; without mass, com stays."""
    return combined(a, Inertia(-b.mass, b.com, -b.central), 0.0)


@noinline_pairs
def steiner(m: Number, d: Vector) -> Symmetric:
    """m (|d|^2 1 - d d^T). The product m d comes first: |d|^2 may overflow where the result does not."""
    return algebra.point_inertia(d, m * d)


# -- many bodies ------------------------------------------------------------------------------------------------------


@functools.partial(jax.jit, static_argnums=0, inline=True)
def composite(precision: Precision, mass, com, central) -> list[jax.Array]:
    """[mass (*batch,), com, central] of n bodies as one, from (*batch, n, 1), (*batch, n, 3), (*batch, n, 6)."""
    mass, com, central = _composite(precision, Inertia(mass, com, central))
    return [mass[..., 0], com[..., 0, :], central[..., 0, :]]


@formula
def _composite(M: Inertia) -> Inertia:
    """An error of the common centre of mass counts in the central inertia by its square only."""
    shape = floats.broadcast_shapes(*(jnp.shape(high(x)) for x in (M.mass, *M.com, *M.central)))
    (mass,) = sums_over_items((M.mass,), shape[-1])
    divisor = _spread(mass, shape)
    is_massless = high(divisor) == 0
    mean = 1 / constant(M.mass, shape[-1])
    share = where(is_massless, mean, M.mass / where(is_massless, 1.0, divisor))
    center = sums_over_items(share * M.com, shape[-1])
    d = Vector(*(c - _spread(x, shape) for c, x in zip(M.com, center, strict=True)))
    central = [x + y for x, y in zip(M.central, steiner(M.mass, d), strict=True)]
    return Inertia(mass, Vector(*center), Symmetric(*sums_over_items(central, shape[-1])))


def _spread(x: Number, shape: Sequence[int]) -> Number:
    """A sum as a number for each of its terms."""
    if isinstance(x, Rounded):
        return x if is_known(x.value) else Rounded(x.precision, jnp.broadcast_to(x.value, shape))
    return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), x)


# -- sums over the last axis of a batch, in one fixed order ------------------------------------------------------------


def sums_over_items(numbers: Numbers, size: int) -> Numbers:
    """The sum of each of a tuple of numbers over the last axis of the batch, which is left with size 1.

    size: of that axis, at least 1. By halving, always in the same order. The error is at most ceil(log2 size) u mag
    with mag the sum of |x_i|; of double words 3 ceil(log2 size) u^2 mag. A known 0 stays one.
    """
    rounded = [x for x in numbers if isinstance(x, Rounded)]
    if not rounded:
        return _sums_of_double_words(numbers)
    data = [x.operand for x in rounded if not is_known(x.value, 0)]
    if not data:
        return tuple(rounded)
    # All of them in one array: one chain of additions.
    shape = floats.broadcast_shapes((size,), *(x.shape for x in data))
    sums = pairwise_sum(jnp.stack([jnp.broadcast_to(x, shape) for x in data]))
    found = iter(unstack(jnp.moveaxis(sums, 0, -1)))
    return tuple(x if is_known(x.value, 0) else Rounded(x.precision, next(found)[..., None]) for x in rounded)


@noinline_pairs
def _sums_of_double_words(numbers: Numbers) -> Numbers:
    words = [jnp.stack([getattr(x, word) for x in numbers]) for word in ("hi", "lo")]
    sums = by_halving(lambda a, b: (DoubleWord(*a) + DoubleWord(*b)).limbs, words, words[0].ndim - 1)
    return tuple(DoubleWord(*sums)[i] for i in range(len(numbers)))


def first(x: Number) -> Number:
    """A number that is the same along the last axis of the batch, with that axis of size 1."""
    if isinstance(x, DoubleWord):
        return x[..., :1]
    return Rounded(x.precision, x.value[..., :1]) if isinstance(x, Rounded) and not is_known(x.value) else x

"""Bodies put together and taken apart, about one point in one frame, as formulas over numbers.

In the reduced-mass form I1 + I2 + m1 m2 / m (|d|^2 1 - d d^T), d the distance of the centres of mass, only terms that
are positive semidefinite are added: nothing cancels, however far from the origin. [Featherstone 2008, 2.13]
"""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Rounded, constant, high, noinline_pairs, where
from jaxspatial.arithmetic.numbers.folding import is_known
from jaxspatial.arithmetic.numbers.protocol import Number, Numbers, Symmetric, Three
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.inertia.reduction import summed
from jaxspatial.spatial import algebra

Parts = list[Number | Numbers]  # mass, com, central


@formula
def combined(mass: Numbers, com: Three, central: Symmetric, mass2: Numbers, com2: Three, central2: Symmetric) -> Parts:
    """[mass, com, central] of two bodies as one; without mass, the mean of their centres of mass."""
    return joined(mass[0], com, central, mass2[0], com2, central2, 0.5)


@formula
def removed(mass: Numbers, com: Three, central: Symmetric, mass2: Numbers, com2: Three, central2: Symmetric) -> Parts:
    """[mass, com, central] of what is left of the first without the second; without mass, com stays."""
    return joined(mass[0], com, central, -mass2[0], com2, vectors.negative(central2), 0.0)


def joined(m1: Number, c1: Three, i1: Symmetric, m2: Number, c2: Three, i2: Symmetric, share: float) -> Parts:
    """Seen from the heavier body: where the centres of mass are one, it is exactly theirs."""
    m = m1 + m2
    is_massless = (high(m1) == 0) & (high(m2) == 0)
    divisor = where(is_massless, 1.0, m)
    d = [b - a for a, b in zip(c1, c2, strict=True)]
    is_first = abs(high(m1)) >= abs(high(m2))
    lighter, heavier = where(is_first, m2, m1), where(is_first, m1, m2)
    part = where(is_massless, share, lighter / divisor)
    com = tuple(where(is_first, a, b) + where(is_first, part, -part) * x for a, b, x in zip(c1, c2, d, strict=True))
    arm = steiner(heavier * (lighter / divisor), d)
    return [m, com, tuple((a + b) + c for a, b, c in zip(i1, i2, arm, strict=True))]


@noinline_pairs
def steiner(m: Number, d: Three) -> Symmetric:
    """m (|d|^2 1 - d d^T), of m d first: its square may not be a number of the format where the product is."""
    return algebra.parallel_axis(d, vectors.times(m, d))


# -- many -------------------------------------------------------------------------------------------------------------


@functools.partial(jax.jit, static_argnums=0, inline=True)
def composite(precision: Precision, mass: jax.Array, com: jax.Array, central: jax.Array) -> list[jax.Array]:
    """[mass (*batch,), com, central] of n bodies as one, given as (*batch, n, 1), (*batch, n, 3), (*batch, n, 6)."""
    one, vector, six = _composite(precision, mass, com, central)
    return [one[..., 0], vector[..., 0, :], six[..., 0, :]]


@formula
def _composite(mass: Numbers, com: Three, central: Symmetric) -> Parts:
    """What the common centre is off by counts in central by its square only."""
    m = mass[0]
    shape = np.broadcast_shapes(*(jnp.shape(high(x)) for x in (m, *com, *central)))
    (whole,) = summed((m,), shape[-1])
    all_of_it = _spread(whole, shape)
    is_massless = high(all_of_it) == 0
    mean = 1 / constant(m, shape[-1])
    share = where(is_massless, mean, m / where(is_massless, 1.0, all_of_it))
    center = summed(vectors.times(share, com), shape[-1])
    arm = steiner(m, [c - _spread(x, shape) for c, x in zip(com, center, strict=True)])
    return [whole, center, summed(tuple(i + a for i, a in zip(central, arm, strict=True)), shape[-1])]


def _spread(x: Number, shape: Sequence[int]) -> Number:
    """A sum as a number for each of its terms."""
    if isinstance(x, Rounded):
        return x if is_known(x.value) else Rounded(x.precision, jnp.broadcast_to(x.value, shape))
    return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), x)

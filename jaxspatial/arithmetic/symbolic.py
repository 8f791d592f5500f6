"""A formula run over symbols, and what it asks for evaluated as sums of products: values, double words, quotients."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import sums
from jaxspatial.arithmetic.double_word import DoubleWord, from_double_word
from jaxspatial.arithmetic.polynomial import Polynomial, Quotient, Symbol, symbol
from jaxspatial.arithmetic.reproducible import quotient


def run_symbolically(formula, precision, arrays):
    """The results of formula(precision, *arrays) in a precision that looks at whole sums.

    An array that is passed on as it came is a sum of one term, so that all its cotangents are added in one sum. Numbers
    known while tracing stay that.
    """
    words = [jax.tree.leaves(a) for a in arrays]
    places = np.cumsum([0] + [len(w) for w in words])
    flat = [x for w in words for x in w]
    symbols = [symbol(flat, range(i, i + len(w))) for i, w in zip(places, words, strict=False)]
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in flat))
    plan = sums.Plan((), batch, str(precision), is_pair=len(flat) > len(arrays))
    given = {id(s): a for s, a in zip(symbols, arrays, strict=True) if plan.is_pair or isinstance(a, np.ndarray)}
    results = formula(precision, *symbols)
    several = results if isinstance(results, tuple) else (results,)
    flat = [_of_rank(x, len(batch) + 1) for x in flat]
    computed = iter(_evaluated(plan, flat, [x for x in several if id(x) not in given]))
    found = tuple(_broadcast(given[id(x)], batch) if id(x) in given else next(computed) for x in several)
    return found if isinstance(results, tuple) else found[0]


def _broadcast(array, batch):
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, x.shape[-1])), array)


def _of_rank(x, rank):
    """x with axes of size 1 in front: what is shared by a batch stays one item, whose cotangents are summed once."""
    return jnp.reshape(x, (1,) * (rank - x.ndim) + x.shape)


def _evaluated(plan, arrays, results):
    """What a formula returned, as arrays or double words; everything that is not a quotient in one plan."""
    quotients = [x for x in results if _is_quotient(x)]
    plain = iter(_bound(plan, arrays, [x for x in results if not _is_quotient(x)]))
    divided = iter([_divided(plan, arrays, x) for x in quotients])
    return [next(divided) if _is_quotient(x) else next(plain) for x in results]


def _is_quotient(x):
    return isinstance(_components(x)[0], Quotient)


def _components(x):
    return x.components if isinstance(x, Symbol) else (x,)


def _divided(plan, arrays, x):
    """Numerators and the one denominator, divided, and rounded once."""
    parts = [Symbol(tuple(q.dividend for q in _components(x))), Symbol((_components(x)[0].divisor,))]
    dtype = arrays[0].dtype
    if plan.is_pair or dtype == np.float64:
        above, below = _bound(plan._replace(is_pair=True), arrays, parts)
        divided = above / below if plan.is_pair else from_double_word(above / below)
    else:
        divided = _divided_wide(plan, arrays, parts, dtype)
    return divided if isinstance(x, Symbol) else divided[..., 0]


def _divided_wide(plan, arrays, parts, dtype):
    with jax.enable_x64(True):
        wide = [lax.convert_element_type(a, np.float64) for a in arrays]
        above, below = _bound(plan, wide, parts)
        return lax.convert_element_type(quotient(above, jnp.broadcast_to(below, above.shape)), dtype)


def _bound(plan, arrays, results):
    """The results of a plan for polynomials: an array or double word each; zeros where there are no terms."""
    wanted = [sums.Sum(tuple(p.terms for p in _components(x)), _reduced(plan, x)) for x in results]
    found = iter(sums.bind_nonzero(plan, wanted, arrays))
    return [_shaped(plan, x, s, next(found), arrays[0].dtype) for x, s in zip(results, wanted, strict=True)]


def _reduced(plan, x):
    return (len(plan.batch) - 1,) if isinstance(x, Symbol) and x.is_summed else ()


def _shaped(plan, x, s, found, dtype):
    """Without the axes that a scalar, or a sum over items, does not have."""
    if found is None:
        found = [np.zeros(plan.shape(s), dtype)] * (1 + plan.is_pair)
    if s.reduced:
        found = [a[..., 0, :] for a in found]
    if isinstance(x, Polynomial):
        found = [a[..., 0] for a in found]
    return DoubleWord(*found) if plan.is_pair else found[0]

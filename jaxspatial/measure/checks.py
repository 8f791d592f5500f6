"""What a self-check looks at: what compiler and device do, whether the building blocks are what they are taken for, and
whether the precisions keep their promises on inputs that make it hard."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike

from jaxspatial.arithmetic.check import finfo
from jaxspatial.arithmetic.errorfree import reproducible, transforms
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import to_double_word
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.promise import DOUBLE_WORDS, Promise
from jaxspatial.measure import error, exact, findings, inputs
from jaxspatial.measure.operation import OPERATIONS, Operation
from jaxspatial.spatial.promises import SHIFT

# -- what the compiler and the device do with single operations --------------------------------------------------------


def contracted():
    def determinant(a: Any, b: Any, c: Any, d: Any):
        return a * b - c * d

    with findings.in_dtype("float32"):
        a, b, c, d = np.stack(inputs.benign(findings.rng(), 4, 400, "float32"))
        share = findings.differing([findings.jit(determinant)(a, b, c, d)], [determinant(a, b, c, d)])
    if share:
        advice = "precision 'fast' depends on the program around it; the other three do not"
        return None, f"contracted: a*b - c*d differs from NumPy in {share:.0%} of the lanes", advice
    return None, "no: a*b - c*d is NumPy's, bit by bit; 'fast' rounds as 'reproducible' does", ""


def subnormals():
    kept = dict[str, bool]()
    for dtype in ("float16", "bfloat16", *findings.DTYPES):
        with findings.in_dtype(dtype):
            tiny = jnp.asarray([float(finfo(dtype).tiny)] * 8, dtype)
            half = jnp.full_like(tiny, 0.5)
            kept[dtype] = bool(np.asarray(findings.jit(lax.mul)(tiny, half)).all())
    flushed = ", ".join(dtype for dtype, k in kept.items() if not k)
    if not flushed:
        return None, "kept", ""
    sizes = ", ".join(f"{dtype} {float(finfo(dtype).tiny):.2g}" for dtype in kept)
    return None, f"flushed to zero in {flushed}", f"bounds hold up to a few finfo.tiny ({sizes}); no flag changes it"


def narrow_formats():
    shares = dict[str, float]()
    for dtype in ("float16", "bfloat16"):
        arrays = inputs.benign(findings.rng(), 3, 200, jnp.dtype(dtype))
        shares[dtype] = findings.differing_from_numpy("shift_force", dtype, arrays, findings.jit)
    if not any(shares.values()):
        return None, "rounded after every operation, as NumPy does", ""
    text = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in shares.items())
    advice = "bounds hold; for NumPy's bits in 16-bit formats: XLA_FLAGS=--xla_allow_excess_precision=false"
    return None, f"intermediate results keep more digits: {text} of the results differ from NumPy", advice


def matmul():
    with findings.in_dtype("float32"):
        a, b = findings.rng().standard_normal((2, 64, 64)).astype(np.float32)
        computed = np.asarray(findings.jit(jnp.matmul)(a, b))
    wide, mag = a.astype(np.float64) @ b.astype(np.float64), abs(a).astype(np.float64) @ abs(b)
    worst = float((abs(computed - wide) / mag).max()) * 2**24
    if worst <= 64:
        return None, f"float32: worst error {worst:.2g} u mag, full precision", ""
    advice = "this library multiplies no matrices; for yours: jax.default_matmul_precision('highest')"
    return None, f"float32: worst error {worst:.2g} u mag, factors are cut to fewer digits (TF32, bfloat16)", advice


# Compiled as a new function by each check: none takes what another has compiled.
def _arithmetic(a: Any, b: Any):
    return a + b, a * b, a / b


def float64():
    with findings.in_dtype("float64"):
        a, b = np.stack(inputs.mixed_scales(findings.rng(), 2, 200, "float64"))
        computed = findings.jit(lambda *x: _arithmetic(*x))(a, b)
        share = findings.differing(computed, _arithmetic(a, b)) if computed[0].dtype == np.float64 else 1.0
    advice = "float64 is emulated with fewer digits (TPU), or compiled under fast-math: use float32, check its promises"
    return findings.verdict({"float64": share}, "sums, products and quotients are IEEE's, bit by bit", advice)


# -- building blocks: error-free transforms, quotients, double words ---------------------------------------------------

# (a, b) to a rounded number and its error.
Transform = Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]


def _error(transform: Transform) -> Callable[[jax.Array, jax.Array], jax.Array]:
    return lambda a, b: transform(a, b)[1]


# What a transform is used in: a compiler that sees less of the result has other ideas.
_SURROUNDINGS: dict[str, Callable[[Transform], Callable[..., Any]]] = {
    "both": findings.jit,
    "error alone, vmap": lambda f: findings.jit(jax.vmap(_error(f))),
    "error alone, scan": lambda f: findings.jit(findings.scanned(_error(f))),
}


def two_sum():
    return _transform(transforms.two_sum, lambda a, b: a + b, constants=True)


def two_product():
    return _transform(transforms.two_product, lambda a, b: a * b)


def _transform(transform: Transform, operator: Callable[[Any, Any], Any], constants: bool = False):
    shares = dict[str, float]()
    for dtype in findings.DTYPES:
        a, b = (x[:, 0] for x in inputs.benign(findings.rng(), 2, 200, dtype))
        with findings.in_dtype(dtype):
            wrong = [_wrong(f(transform), operator, a, b) for f in _SURROUNDINGS.values()]
            wrong += _wrong_with_constants(transform, operator, a) if constants else []
        shares[dtype] = max(wrong)
    where = "jit, vmap, scan, error alone" + (", constants" if constants else "")
    return findings.verdict(shares, f"exact ({where})")


def _wrong(
    compiled: Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array] | jax.Array],
    operator: Callable[[Any, Any], Any],
    a: np.ndarray,
    b: np.ndarray,
):
    """The share of lanes in which rounded result and error do not add up to the exact one."""
    computed = compiled(jnp.asarray(a), jnp.asarray(b))
    errors = computed[1] if isinstance(computed, tuple) else computed
    exactly = operator(exact.rationals(a), exact.rationals(b))
    return float((exact.rationals(findings.finite(errors)) != exactly - exact.rationals(operator(a, b))).mean())


def _wrong_with_constants(transform: Transform, operator: Callable[[Any, Any], Any], a: np.ndarray):
    c = np.full_like(a, 0.7)
    known = jnp.asarray(c[0])
    orders: list[Transform] = [
        (lambda a, _: transform(jnp.full_like(a, known), a)),
        (lambda a, _: transform(a, jnp.full_like(a, known))),
    ]
    return [_wrong(findings.jit(f), operator, a, c) for f in orders]


def division():
    shares, plain = dict[str, float](), dict[str, float]()
    for dtype in findings.DTYPES:
        a, b = inputs.benign(findings.rng(), 2, 200, dtype)
        with findings.in_dtype(dtype):
            for found, divide in ((shares, reproducible.quotient), (plain, lax.div)):
                computed = findings.jit(jax.vmap(divide, in_axes=(0, None)))(jnp.asarray(a), jnp.asarray(b[0]))
                found[dtype] = findings.differing([computed], [a / b[0]])
    noted = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in plain.items())
    what = f"rounded correctly (plain division by a shared divisor: {noted} of the lanes differ)"
    return findings.verdict(shares, what)


def double_words():
    """Sums, products and quotients of float32 words, with 64-bit types off."""
    words = findings.rng().standard_normal((2, 200))
    with findings.in_dtype("float32"):
        x, y = (to_double_word(w) for w in words)
        computed = findings.jit(lambda *x: _arithmetic(*x))(x, y)
        expected = _arithmetic(_value(x), _value(y))
    u = error.unit_roundoff("float32")
    worst = [_over_square(c, e, u) for c, e in zip(computed, expected, strict=True)]
    holds = all(error <= limit for error, limit in zip(worst, [DOUBLE_WORDS[x] for x in "+*/"], strict=True))
    return findings.held(holds, "float32: worst errors {:.2g}, {:.2g}, {:.2g} u^2 (+, *, /)".format(*worst))


def _value(x: DoubleWord):
    return exact.rationals(findings.finite(x.hi)) + exact.rationals(findings.finite(x.lo))


def _over_square(computed: DoubleWord, exactly: np.ndarray, u: Fraction):
    return float(np.max(abs(_value(computed) - exactly) / abs(exactly)) / u**2)


# -- promises ----------------------------------------------------------------------------------------------------------

_N = 48
# Of a rate, the sum of two shifts, and of what is pulled back.
_DERIVATIVE = Promise(u=2 * SHIFT.u, u2=4 * SHIFT.u2)


def _times_one(function: Callable[..., Sequence[jax.Array]], *arrays: jax.Array):
    return [part * 1 for part in function(*arrays)]


def reproducible_bits():
    """Bitwise NumPy; among the vectors crossed are equal ones, for which zero is expected."""
    shares: dict[str, float] = dict.fromkeys(findings.DTYPES, 0.0)
    contexts: list[findings.Context] = [lambda f: f, findings.jit, lambda f: findings.jit(partial(_times_one, f))]
    for dtype in findings.DTYPES:
        numbers: list[np.ndarray] = inputs.mixed_scales(findings.rng(), 4, 200, dtype)
        a, b, c, d = numbers
        equal = np.where(np.arange(200)[:, None] % 2 == 0, a, c), np.where(np.arange(200)[:, None] % 2 == 0, b, d)
        for name, arrays in (("shift_force", (a, b, c)), ("cross_motion", (a, b, *equal)), ("dot", (a, b, c, d))):
            for context in contexts:
                shares[dtype] = max(shares[dtype], findings.differing_from_numpy(name, dtype, arrays, context))
    what = "NumPy's, bit by bit: shift, cross, dot, alone and in a larger program; cross(V, V) is 0"
    return findings.verdict(shares, what)


def bounds(precision: Precision):
    """A check that holds a precision against its promise: values and derivatives, in the dtypes of `DTYPES`."""

    def check():
        worst = {d: max(_values_over(precision, d), _derivatives_over(precision, d)) for d in findings.DTYPES}
        numbers = ", ".join(f"{ratio:.2g} ({dtype})" for dtype, ratio in worst.items())
        what = "shift and dot at any condition number, in batches and item by item, and derivatives"
        return findings.held(max(worst.values()) <= 1, f"{what}: worst error over promised {numbers}")

    return check


def _values_over(precision: Precision, dtype: str):
    names = ("shift_force", "dot")
    return max(_over_promise(OPERATIONS[name], precision, _hostile(name, precision, dtype)) for name in names)


def _hostile(name: str, precision: Precision, dtype: str):
    """Arguments that cancel, up to everything, and differ in size; for a shift, whose results stay in range, also such
    as have products that overflow, where that is promised not to matter."""
    random, u = findings.rng(), float(error.unit_roundoff(dtype))
    conditioned = inputs.CONDITIONED[name]
    groups = [conditioned(random, _N, dtype, c) for c in (1.5, u**-0.5, 0.3 / u, u**-1.5, np.inf)]
    families = ("mixed_scales", "nearly_parallel", "far_offsets", "small_integers_and_zeros")
    groups += [inputs.FAMILIES[family](random, len(groups[0]), _N, dtype) for family in families]
    if name == "shift_force" and (precision.is_within_an_ulp or dtype != "float64"):
        groups.append(inputs.near_overflow_of_products(random, len(groups[0]), _N, dtype))
    return [np.concatenate(x) for x in zip(*groups, strict=True)]


def _over_promise(subject: Operation, precision: Precision, arrays: Sequence[np.ndarray]):
    exactly = subject.exactly(*arrays)
    with findings.in_dtype(arrays[0].dtype.name):
        results = [run(subject, precision)(*arrays) for run in (_in_a_batch, _in_a_loop, _one_by_one)]
    return max(subject.of_promise(precision, computed, exactly)[0] for computed in results)


def _in_a_batch(subject: Operation, precision: Precision):
    return findings.jit(subject.batched(precision))


def _in_a_loop(subject: Operation, precision: Precision):
    return findings.jit(findings.scanned(partial(subject.function, str(precision))))


def _one_by_one(subject: Operation, precision: Precision) -> Callable[..., list[np.ndarray]]:
    """Of scalars a compiler makes other programs than of arrays."""
    compiled = findings.jit(partial(subject.function, str(precision)))
    return lambda *arrays: [np.stack(x) for x in zip(*map(compiled, *arrays), strict=True)]


def _derivatives_over(precision: Precision, dtype: str):
    """Of a shifted torque: its rate, and what is pulled back to the force. Offset and force are nearly parallel."""
    tau, f, p, d = inputs.nearly_parallel(findings.rng(), 4, 4 * _N, dtype)

    def torque(tau: jax.Array, f: jax.Array, p: jax.Array):
        return OPERATIONS["shift_force"].function(str(precision), tau, f, p)[0]

    def derivatives(tau: jax.Array, f: jax.Array, p: jax.Array, d: jax.Array) -> tuple[jax.Array, jax.Array]:
        pull_back = cast(Callable[[jax.Array], tuple[jax.Array, ...]], jax.vjp(torque, tau, f, p)[1])
        rate = jax.jvp(torque, (tau, f, p), (d, f, d))[1]
        return rate, pull_back(d)[1]

    formulas: list[exact.Formula] = [
        lambda tau, f, p, d: d - np.cross(d, f) - np.cross(p, f),
        lambda tau, f, p, d: np.cross(p, d),
    ]
    with findings.in_dtype(dtype):
        computed = findings.jit(jax.vmap(derivatives))(tau, f, p, d)
    exactly = [exact.evaluate(formula, tau, f, p, d) for formula in formulas]
    return max(_over(precision, x, *e) for x, e in zip(computed, exactly, strict=True))


def _over(precision: Precision, computed: ArrayLike, value: np.ndarray, mag: np.ndarray):
    bound = error.allowed(_DERIVATIVE, precision, value, mag, np.asarray(computed).dtype)
    return float(error.in_units_of(bound, computed, value, OPERATIONS["shift_force"].flushed).max())

"""Do the promises hold here: on this backend, with these flags, in this version of the compiler.

    print(js.self_check())

Everything is compiled, run, and compared with NumPy or with exact rationals. What a compiler has been seen to break, it
can break again: a flag, a release or a new device are enough.
"""

import os
from fractions import Fraction
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import contraction, eft, reproducible
from jaxspatial.arithmetic.double_word import DoubleWord, to_double_word
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.promise import DOUBLE_WORDS, Promise
from jaxspatial.measure import error, exact, inputs, timing
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.spatial.promises import SHIFT

_N = 48
_DTYPES = ("float32", "float64")
# Of a rate, the sum of two shifts, and of what is pulled back.
_DERIVATIVE = Promise(u=2 * SHIFT.u, u2=4 * SHIFT.u2)
_SUSPECTS = ("fast_math", "disable_hlo_passes", "xla_backend_extra_options", "fp_mode")


class Finding(NamedTuple):
    """One thing looked at. holds: True, False, or None for what is no promise, but good to know."""

    name: str
    holds: bool | None
    measured: str
    advice: str = ""

    @property
    def verdict(self):
        return {True: "holds", False: "BROKEN", None: "note"}[self.holds]


class Report(NamedTuple):
    """What `self_check` found; `print(report)` shows it."""

    findings: tuple
    surroundings: str

    @property
    def holds(self):
        """True if every promise holds."""
        return all(finding.holds is not False for finding in self.findings)

    @property
    def conclusion(self):
        broken = sum(finding.holds is False for finding in self.findings)
        return "All promises hold here." if self.holds else f"{broken} of the promises do not hold here."

    def __str__(self):
        rows = [line for finding in self.findings for line in _lines(finding)]
        return "\n".join([self.surroundings, "", *rows, "", self.conclusion])

    __repr__ = __str__

    def to_dict(self):
        """As it goes into JSON."""
        found = [finding._asdict() for finding in self.findings]
        return {"holds": self.holds, "surroundings": self.surroundings, "findings": found}


def _lines(finding):
    yield f"{finding.verdict:<7}{finding.name}: {finding.measured}"
    if finding.advice:
        yield f"       -> {finding.advice}"


def self_check() -> Report:
    """Holds the promises of the library against this backend and these flags, in a few seconds.

    Returns a `Report`: `.holds`, `.findings` (each with name, holds, measured, advice), and a text when printed. What
    does not hold comes with the flag that usually is to blame. Does not touch the configuration of JAX, and works with
    64-bit types on or off. The same from a shell: `python -m jaxspatial --self-check`.
    """
    findings = tuple(_found(name, check) for name, check in _CHECKS.items())
    return Report(findings, f"{timing.machine()}\nXLA_FLAGS: {os.environ.get('XLA_FLAGS') or 'none'}")


def _found(name, check):
    """What a check finds; one that cannot even run is a promise that does not hold."""
    try:
        return Finding(name, *check())
    except Exception as problem:  # noqa: BLE001 - a backend may fail in any way
        return Finding(name, False, f"cannot be run: {type(problem).__name__}: {str(problem)[:200]}", _cause())


def _cause():
    """What usually is to blame, by name."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    suspects = [flag for flag in flags if any(word in flag for word in _SUSPECTS)]
    if suspects:
        return f"XLA_FLAGS has {' '.join(suspects)}: take it out"
    return (
        "no flag to blame in XLA_FLAGS; what breaks it is --xla_cpu_enable_fast_math (also given as compiler_options), "
        "or a compiler or device that this library was not tested on: please report it with this text"
    )


def _verdict(shares, what, advice=""):
    """holds, measured and advice of a promise that no result may break; shares: dtype -> share of results that do."""
    holds = not any(shares.values())
    text = ", ".join(f"{share:.0%} in {name}" for name, share in shares.items() if share)
    return holds, what if holds else f"broken for {text} of the results", "" if holds else advice or _cause()


def _rng():
    return np.random.default_rng(2026)


def _in(dtype):
    """The 64-bit types off for all other dtypes: what the caller has switched on does not matter."""
    return jax.enable_x64(dtype == "float64")


def _differing(computed, expected):
    """The share of numbers that differ, bit by bit but for the bits of a NaN."""
    return float(np.mean([_differs(np.asarray(x), y).ravel() for x, y in zip(computed, expected, strict=True)]))


def _differs(x, y):
    same = (x == y) & (np.signbit(x) == np.signbit(y))
    return ~np.where(np.isnan(y), np.isnan(x), same)


def _scanned(function):
    return lambda *arrays: lax.scan(lambda _, x: (None, function(*x)), None, arrays)[1]


# -- the compiler -----------------------------------------------------------------------------------------------------


def _contraction():
    with _in("float32"):
        a, b, c, d = np.stack(inputs.benign(_rng(), 4, 400, "float32"))
        share = _differing([jax.jit(lambda a, b, c, d: a * b - c * d)(a, b, c, d)], [a * b - c * d])
    if share:
        advice = "precision 'fast' depends on the program around it; the other three do not"
        return None, f"contracted: a*b - c*d differs from NumPy in {share:.0%} of the lanes", advice
    return None, "no: a*b - c*d is NumPy's, bit by bit; 'fast' rounds as 'reproducible' does", ""


def _errors_of_products():
    """Which way they are found: see `arithmetic.contraction`."""
    used = [dtype for dtype in _DTYPES if contraction.holds(np.dtype(dtype))]
    if not used:
        return None, "found by splitting factors: no contraction that is exact wherever it was tried", ""
    advice = "keep options of the compiler in XLA_FLAGS: those given to one program (compiler_options) are not seen"
    return None, f"found by contraction to one operation, exact wherever it was tried, in {' and '.join(used)}", advice


def _subnormals():
    kept = {}
    for dtype in ("float16", "bfloat16", *_DTYPES):
        with _in(dtype):
            tiny = jnp.asarray([float(jnp.finfo(dtype).tiny)] * 8, dtype)
            half = jnp.full_like(tiny, 0.5)
            kept[dtype] = bool(np.asarray(jax.jit(lax.mul)(tiny, half)).all())
    flushed = ", ".join(dtype for dtype, k in kept.items() if not k)
    if not flushed:
        return None, "kept", ""
    sizes = ", ".join(f"{dtype} {float(jnp.finfo(dtype).tiny):.2g}" for dtype in kept)
    return None, f"flushed to zero in {flushed}", f"bounds hold up to a few finfo.tiny ({sizes}); no flag changes it"


def _narrow_formats():
    shares = {}
    for dtype in ("float16", "bfloat16"):
        arrays = inputs.benign(_rng(), 3, 200, jnp.dtype(dtype))
        shares[dtype] = _differing_from_numpy("shift_force", dtype, arrays, jax.jit)
    if not any(shares.values()):
        return None, "rounded after every operation, as NumPy does", ""
    text = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in shares.items())
    advice = "bounds hold; for NumPy's bits in 16-bit formats: XLA_FLAGS=--xla_allow_excess_precision=false"
    return None, f"intermediate results keep more digits: {text} of the results differ from NumPy", advice


def _matmul():
    with _in("float32"):
        a, b = _rng().standard_normal((2, 64, 64)).astype(np.float32)
        computed = np.asarray(jax.jit(jnp.matmul)(a, b))
    wide, mag = a.astype(np.float64) @ b.astype(np.float64), abs(a).astype(np.float64) @ abs(b)
    worst = float((abs(computed - wide) / mag).max()) * 2**24
    if worst <= 64:
        return None, f"float32: worst error {worst:.2g} u mag, full precision", ""
    advice = "this library multiplies no matrices; for yours: jax.default_matmul_precision('highest')"
    return None, f"float32: worst error {worst:.2g} u mag, factors are cut to fewer digits (TF32, bfloat16)", advice


def _float64():
    with _in("float64"):
        a, b = np.stack(inputs.mixed_scales(_rng(), 2, 200, "float64"))
        computed = jax.jit(lambda a, b: (a + b, a * b, a / b))(a, b)
        share = _differing(computed, (a + b, a * b, a / b)) if computed[0].dtype == np.float64 else 1.0
    advice = "float64 is emulated with fewer digits (TPU), or compiled under fast-math: use float32, check its promises"
    return _verdict({"float64": share}, "sums, products and quotients are IEEE's, bit by bit", advice)


# -- the building blocks ----------------------------------------------------------------------------------------------

# What a transform is used in: a compiler that sees less of the result has other ideas.
_SURROUNDINGS = {
    "both": lambda f: jax.jit(f),
    "error alone, vmap": lambda f: jax.jit(jax.vmap(lambda a, b: f(a, b)[1])),
    "error alone, scan": lambda f: jax.jit(_scanned(lambda a, b: f(a, b)[1])),
}


def _two_sum():
    return _transform(eft.two_sum, lambda a, b: a + b, constants=True)


def _two_product():
    return _transform(eft.two_product, lambda a, b: a * b)


def _transform(transform, operator, constants=False):
    shares = {}
    for dtype in _DTYPES:
        a, b = (x[:, 0] for x in inputs.benign(_rng(), 2, 200, dtype))
        with _in(dtype):
            wrong = [_wrong(f(transform), operator, a, b) for f in _SURROUNDINGS.values()]
            wrong += _wrong_with_constants(transform, operator, a) if constants else []
        shares[dtype] = max(wrong)
    where = "jit, vmap, scan, error alone" + (", constants" if constants else "")
    return _verdict(shares, f"exact ({where})")


def _wrong(compiled, operator, a, b):
    """The share of lanes in which rounded result and error do not add up to the exact one."""
    computed = compiled(jnp.asarray(a), jnp.asarray(b))
    errors = computed[1] if isinstance(computed, tuple) else computed
    exactly = operator(exact.rationals(a), exact.rationals(b))
    return float(np.mean(exact.rationals(_finite(errors)) != exactly - exact.rationals(operator(a, b))))


def _wrong_with_constants(transform, operator, a):
    c = np.full_like(a, 0.7)
    known = jnp.asarray(c[0])
    orders = [
        (lambda a, _: transform(jnp.full_like(a, known), a)),
        (lambda a, _: transform(a, jnp.full_like(a, known))),
    ]
    return [_wrong(jax.jit(f), operator, a, c) for f in orders]


def _finite(x):
    x = np.asarray(x)
    return np.where(np.isfinite(x), x, np.zeros_like(x))


def _division():
    shares, plain = {}, {}
    for dtype in _DTYPES:
        a, b = inputs.benign(_rng(), 2, 200, dtype)
        with _in(dtype):
            for found, divide in ((shares, reproducible.quotient), (plain, lax.div)):
                computed = jax.jit(jax.vmap(divide, in_axes=(0, None)))(jnp.asarray(a), jnp.asarray(b[0]))
                found[dtype] = _differing([computed], [a / b[0]])
    noted = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in plain.items())
    return _verdict(shares, f"rounded correctly (plain division by a shared divisor: {noted} of the lanes differ)")


def _double_words():
    """Sums, products and quotients of float32 words, with 64-bit types off."""
    words = _rng().standard_normal((2, 200))
    with _in("float32"):
        x, y = (to_double_word(w) for w in words)
        computed = jax.jit(lambda x, y: (x + y, x * y, x / y))(x, y)
        a, b = _value(x), _value(y)
    u = error.unit_roundoff("float32")
    worst = [_over_square(c, e, u) for c, e in zip(computed, (a + b, a * b, a / b), strict=True)]
    holds = all(error <= limit for error, limit in zip(worst, map(DOUBLE_WORDS.get, "+*/"), strict=True))
    return holds, "float32: worst errors {:.2g}, {:.2g}, {:.2g} u^2 (+, *, /)".format(*worst), "" if holds else _cause()


def _value(x: DoubleWord):
    return exact.rationals(_finite(x.hi)) + exact.rationals(_finite(x.lo))


def _over_square(computed, exactly, u: Fraction):
    return float(np.max(abs(_value(computed) - exactly) / abs(exactly)) / u**2)


# -- the precisions ---------------------------------------------------------------------------------------------------


def _differing_from_numpy(name, dtype, arrays, context):
    with _in(dtype):
        computed = context(OPERATIONS[name].batched(Precision.REPRODUCIBLE))(*map(jnp.asarray, arrays))
    return _differing(computed, [formula(*arrays) for formula in OPERATIONS[name].formulas])


def _reproducible():
    """Bitwise NumPy; among the vectors crossed are equal ones, for which zero is expected."""
    shares = dict.fromkeys(_DTYPES, 0.0)
    for dtype in _DTYPES:
        a, b, c, d = inputs.mixed_scales(_rng(), 4, 200, dtype)
        equal = np.where(np.arange(200)[:, None] % 2 == 0, a, c), np.where(np.arange(200)[:, None] % 2 == 0, b, d)
        for name, arrays in (("shift_force", (a, b, c)), ("cross_motion", (a, b, *equal)), ("dot", (a, b, c, d))):
            for context in (lambda f: f, jax.jit, lambda f: jax.jit(lambda *x: [p * 1 for p in f(*x)])):
                shares[dtype] = max(shares[dtype], _differing_from_numpy(name, dtype, arrays, context))
    return _verdict(shares, "NumPy's, bit by bit: shift, cross, dot, alone and in a larger program; cross(V, V) is 0")


def _bounds(precision):
    """A check that holds a precision against its promise: values and derivatives, in the dtypes of `_DTYPES`."""

    def check():
        worst = {dtype: max(_values_over(precision, dtype), _derivatives_over(precision, dtype)) for dtype in _DTYPES}
        numbers = ", ".join(f"{ratio:.2g} ({dtype})" for dtype, ratio in worst.items())
        holds = max(worst.values()) <= 1
        what = "shift and dot at any condition number, in batches and item by item, and derivatives"
        return holds, f"{what}: worst error over promised {numbers}", "" if holds else _cause()

    return check


def _values_over(precision, dtype):
    names = ("shift_force", "dot")
    return max(_over_promise(OPERATIONS[name], precision, _hostile(name, precision, dtype)) for name in names)


def _hostile(name, precision, dtype):
    """Arguments that cancel, up to everything, and differ in size; for a shift, whose results stay in range, also such
    as have products that overflow, where that is promised not to matter."""
    rng, u = _rng(), float(error.unit_roundoff(dtype))
    conditioned = inputs.CONDITIONED[name]
    groups = [conditioned(rng, _N, dtype, c) for c in (1.5, u**-0.5, 0.3 / u, u**-1.5, np.inf)]
    families = ("mixed_scales", "nearly_parallel", "far_offsets", "small_integers_and_zeros")
    groups += [inputs.FAMILIES[family](rng, len(groups[0]), _N, dtype) for family in families]
    if name == "shift_force" and (precision is Precision.FAITHFUL or dtype != "float64"):
        groups.append(inputs.near_overflow_of_products(rng, len(groups[0]), _N, dtype))
    return [np.concatenate(x) for x in zip(*groups, strict=True)]


def _over_promise(subject, precision, arrays):
    exactly = subject.exactly(*arrays)
    with _in(arrays[0].dtype.name):
        results = [run(subject, precision)(*arrays) for run in (_in_a_batch, _in_a_loop, _one_by_one)]
    return max(subject.of_promise(precision, computed, exactly)[0] for computed in results)


def _in_a_batch(subject, precision):
    return jax.jit(subject.batched(precision))


def _in_a_loop(subject, precision):
    return jax.jit(_scanned(lambda *item: subject.function(str(precision), *item)))


def _one_by_one(subject, precision):
    """Of scalars a compiler makes other programs than of arrays."""
    compiled = jax.jit(lambda *item: subject.function(str(precision), *item))
    return lambda *arrays: [np.stack(x) for x in zip(*map(compiled, *arrays), strict=True)]


def _derivatives_over(precision, dtype):
    """Of a shifted torque: its rate, and what is pulled back to the force. Offset and force are nearly parallel."""
    tau, f, p, d = inputs.nearly_parallel(_rng(), 4, 4 * _N, dtype)
    shifted = OPERATIONS["shift_force"].function

    def derivatives(tau, f, p, d):
        torque, pull_back = jax.vjp(lambda *x: shifted(str(precision), *x)[0], tau, f, p)
        rate = jax.jvp(lambda *x: shifted(str(precision), *x)[0], (tau, f, p), (d, f, d))[1]
        return rate, pull_back(d)[1]

    formulas = (lambda tau, f, p, d: d - np.cross(d, f) - np.cross(p, f), lambda tau, f, p, d: np.cross(p, d))
    with _in(dtype):
        computed = jax.jit(jax.vmap(derivatives))(tau, f, p, d)
    exactly = [exact.evaluate(formula, tau, f, p, d) for formula in formulas]
    return max(_over(precision, x, *e) for x, e in zip(computed, exactly, strict=True))


def _over(precision, computed, value, mag):
    bound = error.allowed(_DERIVATIVE, precision, value, mag, np.asarray(computed).dtype)
    return float(error.in_units_of(bound, computed, value, OPERATIONS["shift_force"].flushed).max())


_CHECKS = {
    "products fused with additions": _contraction,
    "errors of products": _errors_of_products,
    "subnormal numbers": _subnormals,
    "float16 and bfloat16": _narrow_formats,
    "default precision of jnp.matmul": _matmul,
    "float64": _float64,
    "error-free sums": _two_sum,
    "error-free products": _two_product,
    "quotients": _division,
    "double words": _double_words,
    "precision 'reproducible'": _reproducible,
    "precision 'compensated'": _bounds(Precision.COMPENSATED),
    "precision 'faithful'": _bounds(Precision.FAITHFUL),
}

"""Do the promises hold here: on this backend, with these flags, in this version of the compiler.

    print(js.self_check())

Everything is compiled, run, and compared with NumPy or with exact rationals. What a compiler has been seen to break, it
can break again: a flag, a release or a new device are enough.
"""

import operator
import os
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.measure import error, inputs, timing
from jaxspatial.measure.error import rationals
from jaxspatial.measure.operation import OPERATIONS, Operation
from jaxspatial.numerics.errorfree import transforms
from jaxspatial.numerics.errorfree.barrier import quotient
from jaxspatial.numerics.floats import finfo
from jaxspatial.numerics.numbers.double_word import to_double_word
from jaxspatial.numerics.precision import DEFAULT, Precision
from jaxspatial.numerics.promise import DOUBLE_WORDS, Promise
from jaxspatial.spatial.operations import SHIFT

DTYPES = ("float32", "float64")
_SUSPECTS = ("fast_math", "disable_hlo_passes", "xla_backend_extra_options", "fp_mode")


class Finding(NamedTuple):
    """One thing looked at. holds: True, False, or None for what is no promise, but good to know.

    Example:
        >>> finding = js.measure.Finding("sums of two", False, "broken for 3% in float32", "take out the flag")
        >>> print(finding.verdict)
        BROKEN
    """

    name: str
    holds: bool | None
    measured: str
    advice: str = ""

    @property
    def verdict(self):
        return {True: "holds", False: "BROKEN", None: "note"}[self.holds]


class Report(NamedTuple):
    """What `self_check` found; `print(report)` shows it.

    Example:
        >>> finding = js.measure.Finding("sums of two", True, "the error is exact")
        >>> report = js.measure.Report((finding,), "one core")
        >>> print(report.holds, report.conclusion)
        True All promises hold here.
    """

    findings: tuple[Finding, ...]
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
        lines = [f"{f.verdict:<7}{f.name}: {f.measured}" + f"\n       -> {f.advice}" * bool(f.advice) for f in self[0]]
        return "\n".join([self.surroundings, "", *lines, "", self.conclusion])

    __repr__ = __str__

    def to_dict(self) -> dict:
        """As it goes into JSON.

        Example:
            >>> report = js.measure.Report((js.measure.Finding("sums of two", True, "the error is exact"),), "one core")
            >>> print(report.to_dict()["holds"])
            True
        """
        findings = [finding._asdict() for finding in self.findings]
        return {"holds": self.holds, "surroundings": self.surroundings, "findings": findings}


def self_check() -> Report:
    """Holds the promises of the library against this backend and these flags, in a few seconds.

    What does not hold comes with the flag that usually is to blame. Does not touch the configuration of JAX, and works
    with 64-bit types on or off. The same from a shell: `python -m jaxspatial --self-check`.

    Returns:
        A `Report`: `.holds`, `.findings` (each with name, holds, measured, advice), and a text when printed.

    Error: what is exact or bitwise is compared exactly, bounds with exact rationals.

    Example:
        >>> report = js.self_check()
        >>> print(report.holds, report.conclusion)
        True All promises hold here.
    """
    findings = list[Finding]()
    for name, check in _CHECKS.items():
        try:
            findings.append(Finding(name, *check()))
        except Exception as problem:  # noqa: BLE001 - a backend may fail in any way, and what cannot run does not hold
            text = f"cannot be run: {type(problem).__name__}: {str(problem)[:200]}"
            findings.append(Finding(name, *judged(False, text)))
    return Report(tuple(findings), f"{timing.machine()}\nXLA_FLAGS: {os.environ.get('XLA_FLAGS') or 'none'}")


# A check returns of its `Finding` all but the name: holds, measured, advice.


def verdict(shares: dict[str, float], what: str, advice: str = ""):
    """The finding of a promise that no result may break; shares: dtype -> share of results that do."""
    text = ", ".join(f"{share:.0%} in {name}" for name, share in shares.items() if share)
    return judged(not text, f"broken for {text} of the results" if text else what, advice)


def judged(holds: bool, measured: str, advice: str = ""):
    """The finding of a promise: what usually is to blame, where it does not hold and nothing better is known."""
    return holds, measured, "" if holds else advice or _cause()


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


# -- what checks have in common ----------------------------------------------------------------------------------------


def _rng():
    return np.random.default_rng(2026)


def _in_dtype(dtype):
    """The 64-bit types off for all other dtypes: what the caller has switched on does not matter."""
    return jax.enable_x64(dtype == "float64")


def differing(computed, expected):
    """The share of numbers that differ, bit by bit but for the bits of a NaN."""
    differ = list[np.ndarray]()
    for x, y in zip(map(np.asarray, computed), expected, strict=True):
        same = (x == y) & (np.signbit(x) == np.signbit(y))
        differ.append(~np.where(np.isnan(y), np.isnan(x), same).ravel())
    return float(np.mean(differ))


def _differing_from_numpy(name, dtype, arrays, context):
    with _in_dtype(dtype):
        computed = context(OPERATIONS[name].batched(DEFAULT))(*[jnp.asarray(x) for x in arrays])
    return differing(computed, [formula(*arrays) for formula in OPERATIONS[name].formulas])


def _scanned(function):
    return lambda *arrays: lax.scan(lambda _, x: (None, function(*x)), None, arrays)[1]


def finite(x):
    """x with 0 in place of what is not finite."""
    x = np.asarray(x)
    return np.where(np.isfinite(x), x, np.zeros_like(x))


# -- what the compiler and the device do with single operations --------------------------------------------------------


def contracted():
    with _in_dtype("float32"):
        a, b, c, d = inputs.benign(_rng(), 4, 400, "float32")
        share = differing([jax.jit(lambda a, b, c, d: a * b - c * d)(a, b, c, d)], [a * b - c * d])
    if share:
        advice = "precision 'fast' depends on the program around it; the other three do not"
        return None, f"contracted: a*b - c*d differs from NumPy in {share:.0%} of the lanes", advice
    return None, "no: a*b - c*d is NumPy's, bit by bit; 'fast' rounds as 'reproducible' does", ""


def subnormals():
    kept = dict[str, bool]()
    for dtype in ("float16", "bfloat16", *DTYPES):
        with _in_dtype(dtype):
            tiny = jnp.asarray([float(finfo(dtype).tiny)] * 8, dtype)
            kept[dtype] = bool(np.asarray(jax.jit(lax.mul)(tiny, jnp.full_like(tiny, 0.5))).all())
    flushed = ", ".join(dtype for dtype, k in kept.items() if not k)
    if not flushed:
        return None, "kept", ""
    sizes = ", ".join(f"{dtype} {float(finfo(dtype).tiny):.2g}" for dtype in kept)
    return None, f"flushed to zero in {flushed}", f"bounds hold up to a few finfo.tiny ({sizes}); no flag changes it"


def narrow_formats():
    shares = dict[str, float]()
    for dtype in ("float16", "bfloat16"):
        arrays = inputs.benign(_rng(), 3, 200, jnp.dtype(dtype))
        shares[dtype] = _differing_from_numpy("shift_force", dtype, arrays, jax.jit)
    if not any(shares.values()):
        return None, "rounded after every operation, as NumPy does", ""
    text = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in shares.items())
    advice = "bounds hold; for NumPy's bits in 16-bit formats: XLA_FLAGS=--xla_allow_excess_precision=false"
    return None, f"intermediate results keep more digits: {text} of the results differ from NumPy", advice


def matmul():
    with _in_dtype("float32"):
        a, b = _rng().standard_normal((2, 64, 64)).astype(np.float32)
        computed = np.asarray(jax.jit(jnp.matmul)(a, b))
    wide, mag = a.astype(np.float64) @ b.astype(np.float64), abs(a).astype(np.float64) @ abs(b)
    worst = float((abs(computed - wide) / mag).max()) * 2**24
    if worst <= 64:
        return None, f"float32: worst error {worst:.2g} u mag, full precision", ""
    advice = "this library multiplies no matrices; for yours: jax.default_matmul_precision('highest')"
    return None, f"float32: worst error {worst:.2g} u mag, factors are cut to fewer digits (TF32, bfloat16)", advice


def _arithmetic(a, b):
    """Compiled as a new function by each check: none takes what another has compiled."""
    return a + b, a * b, a / b


def float64():
    with _in_dtype("float64"):
        a, b = inputs.mixed_scales(_rng(), 2, 200, "float64")
        computed = jax.jit(lambda *x: _arithmetic(*x))(a, b)
        share = differing(computed, _arithmetic(a, b)) if computed[0].dtype == np.float64 else 1.0
    advice = "float64 is emulated with fewer digits (TPU), or compiled under fast-math: use float32, check its promises"
    return verdict({"float64": share}, "sums, products and quotients are IEEE's, bit by bit", advice)


# -- building blocks: error-free transforms, quotients, double words ---------------------------------------------------


def error_free(transform, operation, constants=False):
    """A transform, of (a, b) to a rounded number and its error, in programs that use both or the error alone: a
    compiler that sees less of the result has other ideas."""

    def alone(a, b):
        return transform(a, b)[1]

    shares = dict[str, float]()
    for dtype in DTYPES:
        a, b = (x[:, 0] for x in inputs.benign(_rng(), 2, 200, dtype))
        with _in_dtype(dtype):
            programs = (lambda *x: jax.jit(transform)(*x)[1], jax.jit(jax.vmap(alone)), jax.jit(_scanned(alone)))
            wrong = [_wrong(program, operation, a, b) for program in programs]
            wrong += _wrong_with_constants(transform, operation, a) if constants else []
        shares[dtype] = max(wrong)
    where = "jit, vmap, scan, error alone" + (", constants" if constants else "")
    return verdict(shares, f"exact ({where})")


def _wrong(errors, operation, a, b):
    """The share of lanes in which rounded result and error do not add up to the exact one."""
    computed = errors(jnp.asarray(a), jnp.asarray(b))
    exactly = operation(rationals(a), rationals(b))
    return float((rationals(finite(computed)) != exactly - rationals(operation(a, b))).mean())


def _wrong_with_constants(transform, operation, a):
    c = np.full_like(a, 0.7)
    known = jnp.asarray(c[0])
    orders = (
        lambda a, _: transform(jnp.full_like(a, known), a),
        lambda a, _: transform(a, jnp.full_like(a, known)),
    )
    return [_wrong(lambda *x, order=order: jax.jit(order)(*x)[1], operation, a, c) for order in orders]


def division():
    shares, plain = dict[str, float](), dict[str, float]()
    for dtype in DTYPES:
        a, b = inputs.benign(_rng(), 2, 200, dtype)
        with _in_dtype(dtype):
            for result, divide in ((shares, quotient), (plain, lax.div)):
                computed = jax.jit(jax.vmap(divide, in_axes=(0, None)))(jnp.asarray(a), jnp.asarray(b[0]))
                result[dtype] = differing([computed], [a / b[0]])
    noted = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in plain.items())
    return verdict(shares, f"rounded correctly (plain division by a shared divisor: {noted} of the lanes differ)")


def double_words():
    """Sums, products and quotients of float32 words, with 64-bit types off."""
    words = _rng().standard_normal((2, 200))
    with _in_dtype("float32"):
        x, y = (to_double_word(w) for w in words)
        computed = jax.jit(lambda *x: _arithmetic(*x))(x, y)
        expected = _arithmetic(_value(x), _value(y))
    u = error.unit_roundoff("float32")
    worst = [_over_square(c, e, u) for c, e in zip(computed, expected, strict=True)]
    holds = all(error <= limit for error, limit in zip(worst, [DOUBLE_WORDS[x] for x in "+*/"], strict=True))
    return judged(holds, "float32: worst errors {:.2g}, {:.2g}, {:.2g} u^2 (+, *, /)".format(*worst))


def _value(x):
    return rationals(finite(x.hi)) + rationals(finite(x.lo))


def _over_square(computed, exactly, u):
    return float(np.max(abs(_value(computed) - exactly) / abs(exactly)) / u**2)


# -- promises ----------------------------------------------------------------------------------------------------------

_N = 48
# The bound of a rate, which is the sum of two shifts, and of what is pulled back.
_DERIVATIVE = Promise(u=2 * SHIFT.u, u2=4 * SHIFT.u2)


def reproducible_bits():
    """Bitwise NumPy; among the vectors crossed are equal ones, for which zero is expected."""
    shares: dict[str, float] = dict.fromkeys(DTYPES, 0.0)
    contexts = (lambda f: f), jax.jit, lambda f: jax.jit(lambda *x: [part * 1 for part in f(*x)])
    for dtype in DTYPES:
        a, b, c, d = inputs.mixed_scales(_rng(), 4, 200, dtype)
        is_even = np.arange(200)[:, None] % 2 == 0
        equal = np.where(is_even, a, c), np.where(is_even, b, d)
        for name, arrays in (("shift_force", (a, b, c)), ("cross_motion", (a, b, *equal)), ("dot", (a, b, c, d))):
            for context in contexts:
                shares[dtype] = max(shares[dtype], _differing_from_numpy(name, dtype, arrays, context))
    what = "NumPy's, bit by bit: shift, cross, dot, alone and in a larger program; cross(V, V) is 0"
    return verdict(shares, what)


def bounds(precision: Precision):
    """Holds a precision against its promise: values and derivatives, in the dtypes of `DTYPES`."""
    worst = {d: max(_values_over(precision, d), _derivatives_over(precision, d)) for d in DTYPES}
    numbers = ", ".join(f"{ratio:.2g} ({dtype})" for dtype, ratio in worst.items())
    what = "shift and dot at any condition number, in batches and item by item, and derivatives"
    return judged(max(worst.values()) <= 1, f"{what}: worst error over promised {numbers}")


def _values_over(precision, dtype):
    names = ("shift_force", "dot")
    return max(_over_promise(OPERATIONS[name], precision, _hostile(name, precision, dtype)) for name in names)


def _hostile(name, precision, dtype):
    """Arguments that cancel, up to everything, and differ in size; for a shift, whose results stay in range, also such
    as have products that overflow, where that is promised not to matter."""
    rng, u = _rng(), float(error.unit_roundoff(dtype))
    groups = [inputs.CONDITIONED[name](rng, _N, dtype, c) for c in (1.5, u**-0.5, 0.3 / u, u**-1.5, np.inf)]
    families = ("mixed_scales", "nearly_parallel", "far_offsets", "small_integers_and_zeros")
    groups += [inputs.FAMILIES[family](rng, len(groups[0]), _N, dtype) for family in families]
    if name == "shift_force" and (precision.is_within_an_ulp or dtype != "float64"):
        groups.append(inputs.near_overflow_of_products(rng, len(groups[0]), _N, dtype))
    return [np.concatenate(x) for x in zip(*groups, strict=True)]


def _over_promise(operation: Operation, precision, arrays):
    """The largest error over the bound promised: in a batch, in a loop, and item by item, as a compiler makes other
    programs of scalars than of arrays."""
    exactly, of_one = operation.exactly(*arrays), partial(operation.function, str(precision))
    with _in_dtype(arrays[0].dtype.name):
        single = jax.jit(of_one)
        results = [
            jax.jit(operation.batched(precision))(*arrays),
            jax.jit(_scanned(of_one))(*arrays),
            [np.stack(x) for x in zip(*map(single, *arrays), strict=True)],
        ]
    return max(operation.of_promise(precision, computed, exactly)[0] for computed in results)


def _derivatives_over(precision, dtype):
    """Of a shifted torque: its rate, and what is pulled back to the force. Offset and force are nearly parallel."""
    tau, f, p, d = inputs.nearly_parallel(_rng(), 4, 4 * _N, dtype)

    def torque(tau, f, p):
        return OPERATIONS["shift_force"].function(str(precision), tau, f, p)[0]

    def derivatives(tau, f, p, d):
        rate = jax.jvp(torque, (tau, f, p), (d, f, d))[1]
        return rate, jax.vjp(torque, tau, f, p)[1](d)[1]

    formulas = (lambda tau, f, p, d: d - np.cross(d, f) - np.cross(p, f)), (lambda tau, f, p, d: np.cross(p, d))
    with _in_dtype(dtype):
        computed = jax.jit(jax.vmap(derivatives))(tau, f, p, d)
    exactly = [error.evaluate(formula, tau, f, p, d) for formula in formulas]
    return max(_over(precision, x, *e) for x, e in zip(computed, exactly, strict=True))


def _over(precision, computed, value, mag):
    bound = error.allowed(_DERIVATIVE, precision, value, mag, computed.dtype)
    return float(error.in_units_of(bound, computed, value, OPERATIONS["shift_force"].flushed).max())


_CHECKS = {
    "products fused with additions": contracted,
    "subnormal numbers": subnormals,
    "float16 and bfloat16": narrow_formats,
    "default precision of jnp.matmul": matmul,
    "float64": float64,
    "error-free sums": partial(error_free, transforms.two_sum, operator.add, constants=True),
    "error-free products": partial(error_free, transforms.two_product, operator.mul),
    "quotients": division,
    "double words": double_words,
    "precision 'reproducible'": reproducible_bits,
    **{f"precision '{p}'": partial(bounds, p) for p in Precision if p.sees_whole_sums},
}

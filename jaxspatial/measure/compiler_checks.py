"""What the compiler and the device do with single operations."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic.errorfree import contraction
from jaxspatial.measure import inputs
from jaxspatial.measure.findings import DTYPES, differing, differing_from_numpy, in_dtype, rng, verdict


def contracted():
    with in_dtype("float32"):
        a, b, c, d = np.stack(inputs.benign(rng(), 4, 400, "float32"))
        share = differing([jax.jit(lambda a, b, c, d: a * b - c * d)(a, b, c, d)], [a * b - c * d])
    if share:
        advice = "precision 'fast' depends on the program around it; the other three do not"
        return None, f"contracted: a*b - c*d differs from NumPy in {share:.0%} of the lanes", advice
    return None, "no: a*b - c*d is NumPy's, bit by bit; 'fast' rounds as 'reproducible' does", ""


def errors_of_products():
    """Which way they are found: see `arithmetic.contraction`."""
    used = [dtype for dtype in DTYPES if contraction.holds(np.dtype(dtype))]
    if not used:
        return None, "found by splitting factors: no contraction that is exact wherever it was tried", ""
    advice = "keep options of the compiler in XLA_FLAGS: those given to one program (compiler_options) are not seen"
    return None, f"found by contraction to one operation, exact wherever it was tried, in {' and '.join(used)}", advice


def subnormals():
    kept = {}
    for dtype in ("float16", "bfloat16", *DTYPES):
        with in_dtype(dtype):
            tiny = jnp.asarray([float(jnp.finfo(dtype).tiny)] * 8, dtype)
            half = jnp.full_like(tiny, 0.5)
            kept[dtype] = bool(np.asarray(jax.jit(lax.mul)(tiny, half)).all())
    flushed = ", ".join(dtype for dtype, k in kept.items() if not k)
    if not flushed:
        return None, "kept", ""
    sizes = ", ".join(f"{dtype} {float(jnp.finfo(dtype).tiny):.2g}" for dtype in kept)
    return None, f"flushed to zero in {flushed}", f"bounds hold up to a few finfo.tiny ({sizes}); no flag changes it"


def narrow_formats():
    shares = {}
    for dtype in ("float16", "bfloat16"):
        arrays = inputs.benign(rng(), 3, 200, jnp.dtype(dtype))
        shares[dtype] = differing_from_numpy("shift_force", dtype, arrays, jax.jit)
    if not any(shares.values()):
        return None, "rounded after every operation, as NumPy does", ""
    text = ", ".join(f"{share:.0%} in {dtype}" for dtype, share in shares.items())
    advice = "bounds hold; for NumPy's bits in 16-bit formats: XLA_FLAGS=--xla_allow_excess_precision=false"
    return None, f"intermediate results keep more digits: {text} of the results differ from NumPy", advice


def matmul():
    with in_dtype("float32"):
        a, b = rng().standard_normal((2, 64, 64)).astype(np.float32)
        computed = np.asarray(jax.jit(jnp.matmul)(a, b))
    wide, mag = a.astype(np.float64) @ b.astype(np.float64), abs(a).astype(np.float64) @ abs(b)
    worst = float((abs(computed - wide) / mag).max()) * 2**24
    if worst <= 64:
        return None, f"float32: worst error {worst:.2g} u mag, full precision", ""
    advice = "this library multiplies no matrices; for yours: jax.default_matmul_precision('highest')"
    return None, f"float32: worst error {worst:.2g} u mag, factors are cut to fewer digits (TF32, bfloat16)", advice


def float64():
    with in_dtype("float64"):
        a, b = np.stack(inputs.mixed_scales(rng(), 2, 200, "float64"))
        computed = jax.jit(lambda a, b: (a + b, a * b, a / b))(a, b)
        share = differing(computed, (a + b, a * b, a / b)) if computed[0].dtype == np.float64 else 1.0
    advice = "float64 is emulated with fewer digits (TPU), or compiled under fast-math: use float32, check its promises"
    return verdict({"float64": share}, "sums, products and quotients are IEEE's, bit by bit", advice)

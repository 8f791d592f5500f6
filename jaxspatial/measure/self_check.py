"""Do the promises hold here: on this backend, with these flags, in this version of the compiler.

    print(js.self_check())

Everything is compiled, run, and compared with NumPy or with exact rationals. What a compiler has been seen to break, it
can break again: a flag, a release or a new device are enough.
"""

import os
from collections.abc import Callable

from jaxspatial.arithmetic.precision import Precision
from jaxspatial.measure import checks, timing
from jaxspatial.measure.findings import Finding, Found, Report, held


def self_check() -> Report:
    """Holds the promises of the library against this backend and these flags, in a few seconds.

    What does not hold comes with the flag that usually is to blame. Does not touch the configuration of JAX, and works
    with 64-bit types on or off. The same from a shell: `python -m jaxspatial --self-check`.

    Returns:
        A `Report`: `.holds`, `.findings` (each with name, holds, measured, advice), and a text when printed.

    Error: what is exact or bitwise is compared exactly, bounds with exact rationals.
    """
    findings = tuple(_found(name, check) for name, check in _CHECKS.items())
    return Report(findings, f"{timing.machine()}\nXLA_FLAGS: {os.environ.get('XLA_FLAGS') or 'none'}")


def _found(name: str, check: Callable[[], Found]):
    """What a check finds; one that cannot even run is a promise that does not hold."""
    try:
        return Finding(name, *check())
    except Exception as problem:  # noqa: BLE001 - a backend may fail in any way
        return Finding(name, *held(False, f"cannot be run: {type(problem).__name__}: {str(problem)[:200]}"))


_CHECKS = {
    "products fused with additions": checks.contracted,
    "subnormal numbers": checks.subnormals,
    "float16 and bfloat16": checks.narrow_formats,
    "default precision of jnp.matmul": checks.matmul,
    "float64": checks.float64,
    "error-free sums": checks.two_sum,
    "error-free products": checks.two_product,
    "quotients": checks.division,
    "double words": checks.double_words,
    "precision 'reproducible'": checks.reproducible_bits,
    **{f"precision '{p}'": checks.bounds(p) for p in Precision if p.sees_whole_sums},
}

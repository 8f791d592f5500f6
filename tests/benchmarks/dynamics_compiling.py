"""Programs traced and compiled cold, and timed in turns."""

import gc
import time
import weakref

import jax
import jax.numpy as jnp
from dynamics_claims import Compiling

_MADE = []  # weak references to the mechanisms of programs that were compiled


def cold(make, arrays):
    """(a function without arguments, Compiling) of a program over arrays, with nothing of it in any cache.

    make: makes the program, anew: what is traced of known numbers lives as long as the mechanism that has them.
    """
    _forget()
    _, compiled, found = made(make(), arrays)
    return lambda: compiled(*arrays), found


def made(function, arrays):
    """(what JAX lowers, what XLA compiles, Compiling), whatever is in the caches."""
    jitted = jax.jit(function)
    start = time.perf_counter()
    lowered = jitted.lower(*arrays)
    between = time.perf_counter()
    compiled = lowered.compile()
    return lowered, compiled, Compiling(between - start, time.perf_counter() - between)


def watched(mech):
    """A mechanism of a program that is to be compiled cold."""
    _MADE.append(weakref.ref(mech))
    return mech


def _forget():
    jax.clear_caches()
    gc.collect()
    if any(x() is not None for x in _MADE):
        raise RuntimeError("a mechanism that was compiled before is still there: what comes would not be cold")
    _MADE.clear()


def prepare():
    """Nothing comes from a disk, and the compiler has run once."""
    jax.config.update("jax_enable_compilation_cache", False)
    loop = jax.jit(lambda x: jax.lax.scan(lambda y, z: (jnp.sin(y) + z, y), x[0], x))
    jax.block_until_ready(loop(jnp.ones((4, 3))))


LEAST_SECONDS = 0.02  # that a call takes which is timed


def in_turns(cases, rounds, limit):
    """Case -> seconds per state, one per round: calls are repeated until they take `LEAST_SECONDS`."""
    from jaxspatial.measure import timing  # here: `dynamics_against.py` runs older trees, which may not have it

    calls, counts = {}, {}
    for case, call in cases.items():
        jax.block_until_ready(call())
        calls[case], counts[case] = repeated(call)
    seconds = timing.interleaved(calls, rounds, limit=limit)
    return {case: s / counts[case] / case.batch for case, s in seconds.items()}


def repeated(call):
    """(a function that repeats a call that has run before for about `LEAST_SECONDS`, how often)."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    count = max(1, min(500, round(LEAST_SECONDS / (time.perf_counter() - start))))

    def run():
        for _ in range(count):
            jax.block_until_ready(call())

    return run, count

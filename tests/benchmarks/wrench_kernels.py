"""Batched shift and dot against C kernels compiled on the spot, in one process, on one core, in turns.

    python tests/benchmarks/wrench_kernels.py [--write]

Asserts the claims of the README; exit status 1 if one does not hold. `--write` renews the table beside this file.
Needs gcc.
"""

import os

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core for both sides, before XLA counts them

import argparse  # noqa: E402
import ctypes  # noqa: E402
import pathlib  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
from typing import NamedTuple  # noqa: E402

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jax import lax  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial.measure import timing  # noqa: E402

HERE = pathlib.Path(__file__).parent
FLAGS = ["-O3", "-march=native", "-ffp-contract=fast", "-shared", "-fPIC"]
STEPS = 16
DTYPES = {"float32": "float", "float64": "double"}


class Claim(NamedTuple):
    """`slower` takes at most `limit` times as long as `reference` does."""

    name: str
    slower: str
    reference: str
    limit: float


class Result(NamedTuple):
    dtype: str
    group: str
    seconds: dict  # name -> seconds per wrench and shift, one per round
    claims: tuple


def compiled(dtype):
    """The C kernels for a dtype, as functions of arrays."""
    with tempfile.TemporaryDirectory() as folder:
        library = pathlib.Path(folder) / "kernels.so"
        macros = [f"-DT={DTYPES[dtype]}", "-DNAME(x)=x"]
        subprocess.run(["gcc", *FLAGS, *macros, str(HERE / "wrench_kernels.c"), "-o", library], check=True)
        kernels = ctypes.CDLL(str(library))

    def function(name, *arrays):
        kernel, n = getattr(kernels, name), ctypes.c_size_t(arrays[0].size // (1 if name.startswith("dot") else 3))
        return lambda: kernel(n, *(ctypes.c_void_p(a.ctypes.data) for a in arrays))

    return function


def vectors(count, n, dtype, seed=0):
    return list(np.random.default_rng(seed).standard_normal((count, n, 3)).astype(dtype))


def in_place(step, *state, constants=()):
    """A call that feeds its donated results back in, as ShiftInPlace would."""
    run = jax.jit(step, donate_argnums=tuple(range(len(state))))
    held = [tuple(jnp.array(x) for x in state)]
    constants = tuple(jnp.asarray(x) for x in constants)

    def call():
        held[0] = run(*held[0], *constants)
        return held[0]

    return call


def shift_step(precision, axis):
    def step(tau, f, p):
        F = jax.vmap(lambda F, p: js.shift(F, p, precision=precision), in_axes=axis, out_axes=axis)(
            js.SpatialForce(tau, f) if axis == 0 else batch_last(tau, f), p
        )
        return F.tau, F.f

    return step


def batch_last(tau, f):
    """A SpatialForce whose leaves are (3, n): items along the last axis, for `vmap(..., in_axes=-1)`."""
    return jax.vmap(js.SpatialForce, in_axes=-1, out_axes=-1)(tau, f)


def plain_step(tau, f, p):
    return jax.vmap(lambda tau, f, p: tau - jnp.cross(p, f))(tau, f, p), f


def shift_group(c, n, dtype):
    """One shift, one offset each, in place."""
    tau, f, p = vectors(3, n, dtype)
    p = p * np.asarray(1e-3, dtype)
    soa = [np.ascontiguousarray(x.T) for x in (tau, f, p)]
    yield "C, (n, 3)", c("shift_aos", tau.copy(), f, p)
    yield "C, (3, n)", c("shift_soa", soa[0].copy(), *soa[1:])
    for precision in ("fast", "reproducible"):
        yield f"{precision}, (n, 3)", in_place(shift_step(precision, 0), tau, f, constants=[p])
    yield "reproducible, (3, n)", in_place(shift_step("reproducible", -1), *soa[:2], constants=soa[2:])
    yield "plain jnp.cross, (n, 3)", in_place(plain_step, tau, f, constants=[p])


SHIFT_CLAIMS = (
    Claim("at least 0.85 of C on the same layout", "reproducible, (n, 3)", "C, (n, 3)", 1 / 0.85),
    Claim("reproducible costs at most 1.05 of fast", "reproducible, (n, 3)", "fast, (n, 3)", 1.05),
    Claim("at least 2x plain jnp.cross under vmap", "reproducible, (n, 3)", "plain jnp.cross, (n, 3)", 0.5),
)


def dot_group(c, n, dtype):
    """The power of each wrench."""
    tau, f, w, v = vectors(4, n, dtype)
    yield "C, (n, 3)", c("dot_aos", np.empty(n, dtype), tau, f, w, v)
    F, V = jax.tree.map(jnp.asarray, (js.SpatialForce(tau, f), js.SpatialVelocity(w, v)))
    for precision in ("fast", "reproducible"):
        function = jax.jit(jax.vmap(lambda F, V, q=precision: js.dot(F, V, precision=q)))
        yield f"{precision}, (n, 3)", lambda function=function: function(F, V)
    plain = jax.jit(jax.vmap(lambda t, f, w, v: jnp.dot(t, w) + jnp.dot(f, v)))
    yield "plain jnp.dot, (n, 3)", lambda: plain(F.tau, F.f, V.w, V.v)


DOT_CLAIMS = (
    Claim("at least 0.9 of C on the same layout", "reproducible, (n, 3)", "C, (n, 3)", 1 / 0.9),
    Claim("reproducible costs at most 1.05 of fast", "reproducible, (n, 3)", "fast, (n, 3)", 1.05),
)


def _in_a_row(calls):
    def run():
        for call in calls:
            call()

    return run


def chain_step(axis, offset_axis, reversing):
    """16 shifts in one scan; `reversing` turns the offset round at every step, there and back."""

    def step(tau, f, p):
        shift = jax.vmap(js.shift, in_axes=(axis, offset_axis), out_axes=axis)

        def body(carry, _):
            F, p = carry
            return (shift(F, p), -p if reversing else p), None

        F = js.SpatialForce(tau, f) if axis == 0 else batch_last(tau, f)
        (F, _), _ = lax.scan(body, (F, p), None, length=STEPS)
        return F.tau, F.f

    return step


def chain_group(c, n, dtype):
    """16 chained shifts, one constant offset each. XLA computes p x f once, before the loop; the C kernel 16 times."""
    tau, f, p = vectors(3, n, dtype)
    p = p * np.asarray(1e-3, dtype)
    soa = [np.ascontiguousarray(x.T) for x in (tau, f, p)]
    yield "C, (n, 3)", _in_a_row([c("shift_aos", tau.copy(), f, p)] * STEPS)
    yield "C, (3, n)", _in_a_row([c("shift_soa", soa[0].copy(), *soa[1:])] * STEPS)
    yield "reproducible, (n, 3)", in_place(chain_step(0, 0, False), tau, f, constants=[p])
    yield "reproducible, (3, n)", in_place(chain_step(-1, -1, False), *soa[:2], constants=soa[2:])


def there_and_back_group(c, n, dtype):
    """16 chained shifts by one shared offset, there and back, so that nothing can be computed before the loop.

    With the batch axis last no claim is made: XLA CPU writes the three rows of the result in three loops and so reads
    every row of f twice, 12 words per wrench where C moves 9.
    """
    tau, f, _ = vectors(3, n, dtype)
    soa = [np.ascontiguousarray(x.T) for x in (tau, f)]
    there = np.array([1e-3, -2e-3, 3e-3], dtype)
    for layout, kernel, *arrays in (
        ("(n, 3)", "shared_aos", tau.copy(), f),
        ("(3, n)", "shared_soa", soa[0].copy(), soa[1]),
    ):
        yield f"C, {layout}", _in_a_row([c(kernel, *arrays, p) for p in (there, -there)] * (STEPS // 2))
    yield "reproducible, (n, 3)", in_place(chain_step(0, None, True), tau, f, constants=[there])
    yield "reproducible, (3, n)", in_place(chain_step(-1, None, True), *soa, constants=[there])


CHAIN_CLAIMS = (
    Claim("batch axis last: at least 0.95 of C", "reproducible, (3, n)", "C, (3, n)", 1 / 0.95),
    Claim("batch axis first: at least 0.5 of C", "reproducible, (n, 3)", "C, (n, 3)", 2.0),
)
GROUPS = {
    "shift in place": (shift_group, SHIFT_CLAIMS, 1),
    "dot": (dot_group, DOT_CLAIMS, 1),
    f"{STEPS} chained shifts, one offset each": (chain_group, CHAIN_CLAIMS, STEPS),
    f"{STEPS} chained shifts, there and back": (there_and_back_group, CHAIN_CLAIMS[1:], STEPS),
}


def agree(dtype, n=257):
    """Raises where a case ends in other numbers than the C kernels on the same layout."""
    with jax.enable_x64(dtype == "float64"):
        c = compiled(dtype)
        tau, f, p, v = vectors(4, n, dtype)
        for axis, layout in ((0, "aos"), (-1, "soa")):
            arrays = [np.ascontiguousarray(x if axis == 0 else x.T) for x in (tau, f, p)]
            for kernel, step, offset, signs in (
                ("shift", shift_step("reproducible", axis), arrays[2], [1]),
                ("shift", chain_step(axis, axis, False), arrays[2], [1] * STEPS),
                ("shared", chain_step(axis, None, True), p[0], [1, -1] * (STEPS // 2)),
            ):
                theirs = arrays[0].copy()
                for sign in signs:
                    c(f"{kernel}_{layout}", theirs, arrays[1], offset * np.asarray(sign, dtype))()
                _same(jax.jit(step)(*arrays[:2], offset)[0], theirs)
        power = np.empty(n, dtype)
        c("dot_aos", power, tau, f, p, v)()
        _same(js.dot(js.SpatialForce(tau, f), js.SpatialVelocity(p, v)), power)


def _same(mine, theirs):
    np.testing.assert_allclose(np.asarray(mine), theirs, rtol=0, atol=1000 * np.finfo(theirs.dtype).eps, strict=True)


def ratio(result, claim):
    """Median over the rounds of the ratio of times: both sides of a round saw the same machine."""
    return float(np.median(result.seconds[claim.slower] / result.seconds[claim.reference]))


def measured(n, rounds):
    for dtype in DTYPES:
        with jax.enable_x64(dtype == "float64"):
            kernels = compiled(dtype)
            for name, (group, claims, steps) in GROUPS.items():
                seconds = timing.interleaved(dict(group(kernels, n, dtype)), rounds)
                yield Result(dtype, name, {k: s / n / steps for k, s in seconds.items()}, claims)


def lines(results, n):
    yield f"n = {n:,} wrenches, one core, medians of ns per wrench and shift (10 % to 90 % of the rounds)."
    yield f"{timing.machine()}, gcc {' '.join(FLAGS[:3])}"
    for result in results:
        yield f"\n| {result.group}, {result.dtype} | ns | 10 % | 90 % |\n|---|---|---|---|"
        for name, seconds in result.seconds.items():
            low, middle, high = np.quantile(seconds, [0.1, 0.5, 0.9]) * 1e9
            yield f"| {name} | {middle:.2f} | {low:.2f} | {high:.2f} |"
        for claim in result.claims:
            value = ratio(result, claim)
            verdict = "holds" if value <= claim.limit else "DOES NOT HOLD"
            yield f"\n{claim.name}: time ratio {value:.3f}, at most {claim.limit:.3f}: {verdict}."


def main(arguments=None):
    parser = argparse.ArgumentParser(description="Batched shift and dot against C.")
    parser.add_argument("--n", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=31)
    parser.add_argument("--write", action="store_true", help="write the table to wrench_kernels.md beside this file")
    options = parser.parse_args(arguments)
    results = list(measured(options.n, options.rounds))
    table = "\n".join(lines(results, options.n))
    print(table)
    if options.write:
        (HERE / "wrench_kernels.md").write_text(f"# Batched shift and dot against C\n\n{table}\n")
    return 0 if all(ratio(r, claim) <= claim.limit for r in results for claim in r.claims) else 1


if __name__ == "__main__":
    sys.exit(main())

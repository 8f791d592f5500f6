"""What each precision costs, what derivatives cost, and how often results of this library and of others mean nothing.

    python tests/benchmarks/precisions.py [--write]

One core, interleaved in one process. Asserts what is claimed; exit status 1 if one does not hold. `--write`
renews the table beside this file. jaxlie and Brax are compared where they are installed, the G1 comes with frax.
"""

import os

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, before XLA counts them

import argparse  # noqa: E402
import importlib.util  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
from typing import NamedTuple  # noqa: E402

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jax import lax  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial.command import algorithms  # noqa: E402
from jaxspatial.measure import error, inputs, timing  # noqa: E402
from jaxspatial.numerics.errorfree.barrier import barrier, barrier_or_nan  # noqa: E402

HERE = pathlib.Path(__file__).parent
DTYPES = ("float32", "float64")
IN_CACHE = 2_000
MEANINGFUL = ("compensated", "faithful")
STEPS = 100
STATES = 4096
G1 = "assets/unitree_g1/g1_29dof_rev_1_0.urdf"


class Claim(NamedTuple):
    """`slower` takes at most `limit` times as long as `reference` does."""

    slower: str
    reference: str
    limit: float


class Group(NamedTuple):
    """Calls to be timed in turns, each over `items` wrenches or states, and what is claimed of them."""

    name: str
    calls: dict
    items: int
    claims: tuple


def vectors(count, n, dtype, seed=0):
    """Random arrays (n, 3), small enough for a long chain of shifts."""
    return [jnp.asarray(x, dtype) for x in np.random.default_rng(seed).standard_normal((count, n, 3)) * 0.01]


def _torque(precision):
    return lambda tau, f, p, v: js.shift(js.SpatialForce(tau, f), p, precision=precision).tau


def _power(precision):
    return lambda tau, f, p, v: js.dot(js.SpatialForce(tau, f), js.SpatialVelocity(p, v), precision=precision)


OPERATIONS = {"shift": _torque, "dot": _power}
# What may be asked for, in times of `fast`: float32, float64.
PRICES = {
    "shift, streaming": {"reproducible": (1.03, 1.03), "compensated": (1.1, 1.15), "faithful": (2.5, 3.0)},
    "dot, streaming": {"reproducible": (1.03, 1.03), "compensated": (1.1, 1.15), "faithful": (2.5, 2.5)},
    "shift, streaming, in place": {"reproducible": (1.03, 1.03), "compensated": (1.2, 1.25), "faithful": (2.5, 3.0)},
    "shift, in cache": {"compensated": (1.5, 2.0)},
    "dot, in cache": {"compensated": (1.5, 2.0)},
}
# Inverse dynamics, in times of `fast`: float32, float64.
WHOLE_ALGORITHMS = {"compensated": (2.0, 4.0)}
# An addition of arrays behind barriers, in times of one without.
BARRIER = 1.03
# Of 16 bits, in times of float32.
NARROW = ("bfloat16", "float16"), 1.5
# A value with its gradient, in times of the value.
GRADIENTS = {"fast": 3.0, "reproducible": 3.0, "compensated": 3.0, "faithful": 4.0}


def claims(name, dtype):
    """Of a group of calls in each precision."""
    return tuple(Claim(q, "fast", prices[dtype == "float64"]) for q, prices in PRICES[name].items())


def streaming(operation, n, dtype):
    """From memory into new memory, as `jit(vmap(...))` does it."""
    arrays = vectors(4, n, dtype)
    runs = {str(q): jax.jit(jax.vmap(OPERATIONS[operation](q))) for q in js.Precision}
    calls = {q: lambda r=r: r(*arrays) for q, r in runs.items()}
    name = f"{operation}, streaming"
    return Group(name, calls, n, claims(name, dtype))


def in_place(n, dtype):
    """From memory, the torque donated and written where it was."""
    arrays = vectors(4, n, dtype)
    calls = {str(q): _fed_back(jax.jit(jax.vmap(_torque(q)), donate_argnums=0), arrays) for q in js.Precision}
    name = "shift, streaming, in place"
    return Group(name, calls, n, claims(name, dtype))


def _fed_back(run, arrays):
    held = [arrays[0] + 0]

    def call():
        held[0] = run(held[0], *arrays[1:])
        return held[0]

    return call


def in_cache(operation, dtype):
    """Again and again over arrays in the cache, in one call; the offset turns round: every step has to be done."""
    arrays = vectors(4, IN_CACHE, dtype)

    def repeated(precision):
        function = jax.vmap(OPERATIONS[operation](precision))

        def run(tau, f, p, v):
            def step(_, state):
                result, sign = state
                return (function(result, f, p * sign, v) if is_shift else result + function(tau, f, p * sign, v)), -sign

            first = tau if is_shift else jnp.zeros_like(tau[:, 0])
            return lax.fori_loop(0, STEPS, step, (first, jnp.ones((), dtype)))[0]

        return jax.jit(run)

    is_shift = operation == "shift"
    runs = {str(q): repeated(q) for q in js.Precision}
    calls = {q: lambda r=r: r(*arrays) for q, r in runs.items()}
    name = f"{operation}, in cache"
    return Group(name, calls, IN_CACHE * STEPS, claims(name, dtype))


def converted(n):
    """Digits for float32 arrays: asked for by name, or by converting to float64 where the operation is called."""
    arrays = vectors(4, n, "float32")
    mine = jax.jit(jax.vmap(_torque("compensated")))
    plain = jax.jit(jax.vmap(_torque("fast")))

    def wide():
        return plain(*(x.astype(np.float64) for x in arrays[:3]), arrays[3]).astype(np.float32)

    arrays[3] = arrays[3].astype(np.float64)
    calls = {"compensated": lambda: mine(*arrays[:3], arrays[0]), "float64 at the caller": wide}
    return Group(
        "shift of float32, twice the digits", calls, n, (Claim("compensated", "float64 at the caller", 1 / 1.8),)
    )


def barriers(n, dtype):
    """A sum of two arrays as it is, with its arguments behind barriers, and with the proof that sums have errors."""
    arrays = vectors(4, n, dtype)
    sums = {"without": jnp.add, "barrier": lambda a, b: barrier(a) + barrier(b)}
    sums["barrier and proof"] = lambda a, b: barrier_or_nan(a) + barrier_or_nan(b)
    runs = {name: jax.jit(run, donate_argnums=0) for name, run in sums.items()}
    calls = {name: _fed_back(run, arrays[:2]) for name, run in runs.items()}
    claimed = tuple(Claim(name, "without", BARRIER) for name in runs if name != "without")
    return Group("a sum, streaming, in place", calls, n, claimed)


def derivatives(n, dtype):
    """Value alone, and value with gradient in all twelve numbers, of the power of a shifted wrench."""
    arrays = vectors(4, n, dtype)

    def value(precision):
        def power(tau, f, p, v):
            F = js.shift(js.SpatialForce(tau, f), p, precision=precision)
            return js.dot(F, js.SpatialVelocity(v, v), precision=precision)

        return power

    calls, claimed = {}, []
    for q in map(str, js.Precision):
        one, both = jax.jit(jax.vmap(value(q))), jax.jit(jax.vmap(jax.value_and_grad(value(q), (0, 1, 2, 3))))
        calls |= {q: lambda r=one: r(*arrays), f"{q}, with gradient": lambda r=both: r(*arrays)}
        claimed.append(Claim(f"{q}, with gradient", q, GRADIENTS[q]))
    return Group("power of a shifted wrench", calls, n, tuple(claimed))


def sixteen_bits(n):
    """Evaluated in float32: what half the memory gains, conversions cost."""
    dtypes, limit = NARROW
    calls, claimed = {}, []
    for q in ("fast", "reproducible"):
        for dtype in ("float32", *dtypes):
            run, arrays = jax.jit(jax.vmap(_torque(q))), vectors(4, n, dtype)
            calls[f"{q}, {dtype}"] = lambda r=run, a=arrays: r(*a)
        claimed += [Claim(f"{q}, {dtype}", f"{q}, float32", limit) for dtype in dtypes]
    return Group("shift of 16 bits, streaming", calls, n, tuple(claimed))


def robots():
    """name -> Mechanism: the embedded arm, and a humanoid with a floating base."""
    yield "an arm", algorithms.arm()
    package = importlib.util.find_spec("frax")
    if package and package.origin:
        yield "the G1", js.Mechanism.from_urdf(pathlib.Path(package.origin).parent / G1, floating_base=True)


def whole_algorithm(name, mechanism, n, dtype):
    """Inverse dynamics of many states, with the numbers of the mechanism part of the program."""
    rng, mechanism = np.random.default_rng(0), mechanism.astype(dtype)
    q = js.random_configuration(mechanism, jax.random.key(0), (n,), dtype)
    rates = [jnp.asarray(x, dtype) for x in rng.uniform(-1, 1, (2, n, mechanism.nv))]
    runs = {q: jax.jit(jax.vmap(_inverse_dynamics(mechanism, q))) for q in ("fast", "reproducible", "compensated")}
    calls = {precision: lambda r=r: r(q, *rates) for precision, r in runs.items()}
    claimed = tuple(Claim(q, "fast", limits[dtype == "float64"]) for q, limits in WHOLE_ALGORITHMS.items())
    return Group(f"inverse dynamics of {name}", calls, n, claimed)


def _inverse_dynamics(mechanism, precision):
    return lambda q, v, vdot: js.inverse_dynamics(mechanism, q, v, vdot, precision=precision)


def groups(n, dtype):
    for operation in OPERATIONS:
        yield streaming(operation, n, dtype)
        yield in_cache(operation, dtype)
    yield in_place(n, dtype)
    yield barriers(n, dtype)
    yield derivatives(n // 10, dtype)
    for name, mechanism in robots():
        yield whole_algorithm(name, mechanism, min(n, STATES), dtype)
    if dtype == "float32":
        yield converted(n)
        yield sixteen_bits(n // 10)


# -- how often a result is finite but wrong in all digits --------------------------------------------------------------


def _jaxlie_shift(tau, f, p):
    import jaxlie

    unrotated = jaxlie.SO3(jnp.array([1, 0, 0, 0], tau.dtype))
    X_PQ = jaxlie.SE3.from_rotation_and_translation(unrotated, p)
    return (X_PQ.adjoint().T @ jnp.concatenate((f, tau)))[3:]


def _brax_shift(tau, f, p):
    from brax import base

    force = base.Force(ang=tau, vel=f)
    return base.Transform(pos=-p, rot=jnp.array([1, 0, 0, 0], tau.dtype)).do(force).ang


def shifts():
    """name -> function(tau, f, p): the torque about Q."""
    yield "plain jnp", lambda tau, f, p: tau - jnp.cross(p, f)
    for name, function in (("jaxlie", _jaxlie_shift), ("brax", _brax_shift)):
        if importlib.util.find_spec(name):
            yield name, function
    for q in js.Precision:
        yield str(q), lambda tau, f, p, q=q: js.shift(js.SpatialForce(tau, f), p, precision=q).tau


def families(dtype, n):
    """name -> (tau, f, p)."""
    rng = np.random.default_rng(0)
    for name, family in (inputs.FAMILIES | inputs.EXTREMES).items():
        yield name, family(rng, 3, n, jnp.dtype(dtype))
    _, f, p = inputs.parallel(rng, 3, n, jnp.dtype(dtype))
    yield "parallel, no torque", (np.zeros_like(f), f, p)
    u = float(jnp.finfo(dtype).eps) / 2
    for name, condition in (("condition 1/sqrt(u)", u**-0.5), ("condition 1/u", 1 / u), ("last bit", np.inf)):
        yield name, inputs.CONDITIONED["shift_force"](rng, n, jnp.dtype(dtype), condition)


def meaningless(function, tau, f, p):
    """The share of components that are finite but off by as much as they are, or nonzero where the exact value is 0."""
    computed = np.asarray(jax.jit(jax.vmap(function))(tau, f, p))
    usable = np.all([np.isfinite(x).all(-1, keepdims=True) for x in (tau, f, p)], axis=0) & np.isfinite(computed)
    clean = (np.where(np.isfinite(x), x, np.zeros_like(x)) for x in (tau, f, p))
    value, _ = error.evaluate(lambda tau, f, p: tau - np.cross(p, f), *clean)
    errors = abs(error.rationals(np.where(usable, computed, np.zeros_like(computed))) - value)
    flushed = error.rationals(np.full(1, 16 * float(jnp.finfo(computed.dtype).tiny)))[0]
    return float(np.mean(usable & (errors >= abs(value)) & (errors > flushed)))


def table_of_families(dtype, n):
    """(header, rows): for each family of n shifts the share of meaningless components per library."""
    functions = dict(shifts())
    # jaxlie widens float32 where it can.
    with jax.enable_x64(dtype == "float64"):
        rows = {
            family: {name: meaningless(function, *arrays) for name, function in functions.items()}
            for family, arrays in families(dtype, n)
        }
    return list(functions), rows


def require_meaning(n):
    """Raises where a result of ours, in a precision that promises digits, has none."""
    for dtype in DTYPES:
        for family, shares in table_of_families(dtype, n)[1].items():
            assert not any(shares[q] for q in MEANINGFUL), (family, shares)


# -- report -----------------------------------------------------------------------------------------------------------


def ratio(seconds, claim):
    """Median over the rounds of the ratio of times: both sides of a round saw the same machine."""
    return float(np.median(seconds[claim.slower] / seconds[claim.reference]))


def timed(n, rounds):
    """(dtype, group, seconds) of every group."""
    for dtype in DTYPES:
        with jax.enable_x64(True):
            for group in groups(n, dtype):
                yield dtype, group, timing.interleaved(group.calls, rounds)


def lines_of_times(dtype, group, seconds):
    yield f"\n| {group.name}, {dtype} | ns | 10 % | 90 % | over the first |\n|---|---|---|---|---|"
    first = next(iter(seconds))
    for name, s in seconds.items():
        low, middle, high = np.quantile(s / group.items, [0.1, 0.5, 0.9]) * 1e9
        over = ratio(seconds, Claim(name, first, 1.0))
        yield f"| {name} | {middle:.2f} | {low:.2f} | {high:.2f} | {over:.2f} |"
    for claim in group.claims:
        value = ratio(seconds, claim)
        verdict = "holds" if value <= claim.limit else "DOES NOT HOLD"
        yield f"\n{claim.slower} / {claim.reference}: {value:.2f}, at most {claim.limit:.2f}: {verdict}."


def lines_of_families(dtype, names, rows):
    yield f"\n| finite but wrong in all digits, {dtype} | {' | '.join(names)} |\n|---|{'---|' * len(names)}"
    for family, shares in rows.items():
        yield f"| {family.replace('_', ' ')} | {' | '.join(f'{100 * shares[name]:.3g} %' for name in names)} |"


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What each precision costs, and what it is worth.")
    parser.add_argument("--n", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--sample", type=int, default=500, help="shifts of each hostile family")
    parser.add_argument("--write", action="store_true", help="write the tables to precisions.md beside this file")
    options = parser.parse_args(arguments)
    report, holds = (
        [f"n = {options.n:,} streaming, {IN_CACHE:,} in cache; ns per wrench, or state.", timing.machine()],
        True,
    )
    for dtype, group, seconds in timed(options.n, options.rounds):
        report += _printed(lines_of_times(dtype, group, seconds))
        holds &= all(ratio(seconds, claim) <= claim.limit for claim in group.claims)
    for dtype in DTYPES:
        names, rows = table_of_families(dtype, options.sample)
        report += _printed(lines_of_families(dtype, names, rows))
        holds &= not any(shares[q] for shares in rows.values() for q in MEANINGFUL)
    if options.write:
        (HERE / "precisions.md").write_text(
            "# What each precision costs, and what it is worth\n\n" + "\n".join(report) + "\n"
        )
    return 0 if holds else 1


def _printed(lines):
    lines = list(lines)
    print("\n".join(lines), flush=True)
    return lines


if __name__ == "__main__":
    sys.exit(main())

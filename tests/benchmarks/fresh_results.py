"""What fresh memory costs: shifts of a million wrenches, donated, into a new result, in a scan, by settings of malloc.

    python tests/benchmarks/fresh_results.py [--write]

The settings are those of glibc, read when a process starts: each is measured in processes of its own, in turns, on one
core. Ratios are taken within a process. Asserts the claims of the pages; exit status 1 if one does not hold. `--write`
renews the table beside this file.
"""

import os

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, before XLA counts them

import argparse  # noqa: E402
import json  # noqa: E402
import pathlib  # noqa: E402
import platform  # noqa: E402
import resource  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
from typing import NamedTuple  # noqa: E402

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jax import lax  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial.measure import timing  # noqa: E402

HERE = pathlib.Path(__file__).parent
STEPS = 16
DONATED, FRESH, TORQUE, SCAN = "donated", "fresh", "fresh, the torque alone", f"{STEPS} in a scan, fresh at its end"
# Environments of a process: under "kept" nothing that is freed goes back to the system.
SETTINGS = {
    "as it comes": {},
    "kept": {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": "17179869184"},
    "huge pages": {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"},
}


class Claim(NamedTuple):
    """Under a setting, of the larger batch: `slower` takes at most `limit` times as long as `reference` does."""

    name: str
    setting: str
    slower: str
    reference: str
    limit: float


CLAIMS = (
    Claim("donated at most half of fresh", "as it comes", DONATED, FRESH, 0.5),
    Claim("in a scan at most half of fresh, per shift", "as it comes", SCAN, FRESH, 0.5),
    Claim("freed memory kept: fresh at most 2.5 times donated", "kept", FRESH, DONATED, 2.5),
    Claim("freed memory kept: the torque alone at most 1.5 times donated", "kept", TORQUE, DONATED, 1.5),
)


def cases(n):
    """name -> (call, shifts in it)."""
    rng = np.random.default_rng(0)
    tau, f, p = (jnp.asarray(rng.standard_normal((n, 3)), np.float32) for _ in range(3))
    F, p, shift = js.SpatialForce(tau, f), p * np.float32(1e-3), jax.vmap(js.shift)
    in_place, fresh, torque = jax.jit(shift, donate_argnums=0), jax.jit(shift), jax.jit(lambda F, p: shift(F, p).tau)
    chained = jax.jit(lambda F, p: lax.scan(lambda F, _: (shift(F, p), None), F, length=STEPS)[0])
    held = [jax.tree.map(jnp.array, F)]

    def donated():
        held[0] = in_place(held[0], p)
        return held[0]

    calls = donated, lambda: fresh(F, p), lambda: torque(F, p), lambda: chained(F, p)
    return dict(zip((DONATED, FRESH, TORQUE, SCAN), zip(calls, (1, 1, 1, STEPS), strict=True), strict=True))


def measured_here(n, rounds):
    """name -> (seconds per wrench and shift, a list of rounds; fresh pages per call)."""
    calls = cases(n)
    seconds = timing.interleaved({name: call for name, (call, _) in calls.items()}, rounds)
    return {name: ((seconds[name] / n / steps).tolist(), pages(call)) for name, (call, steps) in calls.items()}


def pages(call, times=5):
    """How many pages of memory the system has to give for a call: no clock says so, but its own count."""
    jax.block_until_ready(call())
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(times):
        jax.block_until_ready(call())
    return (resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) / times


def measured(sizes, rounds, processes):
    """(setting, n) -> name -> (seconds (processes, rounds), pages (processes,))."""
    found = {(setting, n): {} for n in sizes for setting in SETTINGS}
    for _ in range(processes):
        for setting, n in found:
            command = [sys.executable, __file__, "--sizes", str(n), "--rounds", str(rounds), "--here"]
            own = {name: x for name, x in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_"))}
            run = subprocess.run(command, env=own | SETTINGS[setting], capture_output=True, text=True, check=True)
            for name, result in json.loads(run.stdout).items():
                found[setting, n].setdefault(name, []).append(result)
    return {
        case: {name: tuple(map(np.array, zip(*results, strict=True))) for name, results in by_name.items()}
        for case, by_name in found.items()
    }


def ratios(by_name, slower, reference):
    """Of the times in each process, the median over rounds."""
    return np.median(by_name[slower][0] / by_name[reference][0], axis=1)


def ratio(found, claim):
    by_name = found[claim.setting, max(n for _, n in found)]
    return float(np.median(ratios(by_name, claim.slower, claim.reference)))


def lines(found):
    yield "Shifts of n wrenches in float32, one core: medians of ns per wrench and shift (10 % to 90 % of all rounds);"
    yield "of the ratio to a donated shift in the same process (lowest and highest process); of fresh pages of memory"
    yield "per call, which the system counts."
    setting = pathlib.Path("/sys/kernel/mm/transparent_hugepage/enabled")
    huge = setting.read_text().strip() if setting.exists() else "unknown"
    yield f"{timing.machine()}, {' '.join(platform.libc_ver())}, transparent huge pages: {huge}\n"
    for name, variables in SETTINGS.items():
        if variables:
            yield f"- {name}: `{' '.join(f'{key}={x}' for key, x in variables.items())}`"
    for (setting, n), by_name in found.items():
        yield f"\n| {setting}, n = {n:,} | ns | 10 % | 90 % | / donated | lowest | highest | pages |"
        yield "|---|---|---|---|---|---|---|---|"
        for name, (seconds, fresh_pages) in by_name.items():
            low, middle, high = np.quantile(seconds, [0.1, 0.5, 0.9]) * 1e9
            each = ratios(by_name, name, DONATED)
            shown = f"{np.median(each):.2f} | {each.min():.2f} | {each.max():.2f} | {np.median(fresh_pages):.0f}"
            yield f"| {name} | {middle:.2f} | {low:.2f} | {high:.2f} | {shown} |"
    for claim in CLAIMS:
        value = ratio(found, claim)
        verdict = "holds" if value <= claim.limit else "DOES NOT HOLD"
        yield f"\n{claim.name}: time ratio {value:.3f}, at most {claim.limit:.3f}: {verdict}."


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What fresh memory costs.")
    parser.add_argument("--sizes", type=int, nargs="+", default=[1_000_000, 4_000_000], help="wrenches of a batch")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--processes", type=int, default=3, help="of each setting and size")
    parser.add_argument("--here", action="store_true", help="measure in this process, print the results as JSON")
    parser.add_argument("--write", action="store_true", help="write the table to fresh_results.md beside this file")
    options = parser.parse_args(arguments)
    if options.here:
        print(json.dumps(measured_here(options.sizes[0], options.rounds)))
        return 0
    found = measured(options.sizes, options.rounds, options.processes)
    table = "\n".join(lines(found))
    print(table)
    if options.write:
        (HERE / "fresh_results.md").write_text(f"# What fresh memory costs\n\n{table}\n")
    return 0 if all(ratio(found, claim) <= claim.limit for claim in CLAIMS) else 1


if __name__ == "__main__":
    sys.exit(main())

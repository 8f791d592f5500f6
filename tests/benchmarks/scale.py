"""Weak scaling: the same work per device, on one device, on two of one process, and on two processes.

    python tests/benchmarks/scale.py [--write]

Every case runs in processes of its own, in turns; each device has one core, and XLA is told to use no other. The
devices begin every round together. Asserts that programs have no collective operation and that the results of a device
have the bits of one device alone; times are told, and nothing is claimed of them. `--write` renews scale.md beside this
file.
"""

import argparse
import json
import os
import pathlib
import re
import socket
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

COLLECTIVES = "all-reduce|all-gather|all-to-all|reduce-scatter|collective-permute|collective-broadcast"
# name: (processes, devices of each)
CASES = {"one device": (1, 1), "two devices of one process": (1, 2), "two processes": (2, 1)}


def jobs(n_wrenches, n_states):
    """name -> (function, arrays of one device)."""
    import jax
    import numpy as np

    import jaxspatial as js

    rng = np.random.default_rng(0)
    arm = js.testing.random_mechanism(0, 7, ["revolute"], is_chain=True, dtype=np.float32)
    wrenches, states = ((count, 3) for count in (n_wrenches, n_wrenches)), ((n_states, 7),) * 3
    offset = np.float32([0.3, 0, -0.1])
    return {
        f"shift of {n_wrenches:,} wrenches": (
            lambda tau, f: jax.tree.leaves(js.shift(js.SpatialForce(tau, f), offset)),
            [rng.standard_normal(shape, np.float32) for shape in wrenches],
        ),
        f"forward dynamics of {n_states:,} arms of seven joints": (
            lambda *state: [js.forward_dynamics(arm, *state)],
            [rng.standard_normal(shape, np.float32) for shape in states],
        ),
    }


def work(case, which, port, n_wrenches, n_states, rounds):
    """Prints seconds of every round, by job."""
    processes, devices = CASES[case]
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) < processes * devices:
        raise SystemExit(f"expected {processes * devices} cores, got {len(cores)}")
    os.sched_setaffinity(0, cores[which : which + 1] if processes > 1 else cores[:devices])
    os.environ["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={devices} --xla_cpu_multi_thread_eigen=false"
    import jax
    import numpy as np
    from jax.experimental import multihost_utils

    if processes > 1:
        jax.distributed.initialize(f"127.0.0.1:{port}", processes, which)
    mesh = jax.make_mesh((jax.device_count(),), ("batch",))
    rows = jax.NamedSharding(mesh, jax.sharding.PartitionSpec("batch"))
    found = {}
    for name, (function, arrays) in jobs(n_wrenches, n_states).items():
        alone = jax.jit(function)(*arrays)
        own = (np.concatenate([x] * devices) for x in arrays)
        split = [jax.make_array_from_process_local_data(rows, x) for x in own]
        program = jax.jit(function).lower(*split).compile()
        assert not re.findall(COLLECTIVES, program.as_text()), name
        times = []
        for _ in range(rounds + 2):
            multihost_utils.sync_global_devices(name)
            begin = time.perf_counter()
            results = jax.block_until_ready(program(*split))
            times.append(time.perf_counter() - begin)
        for result, expected in zip(results, alone, strict=True):
            for shard in result.addressable_shards:
                np.testing.assert_array_equal(shard.data, expected)
        found[name] = times[2:]
    print(json.dumps(found))


def measured(case, options):
    """job -> milliseconds of a round, of its slowest process: the median."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    sizes = map(str, (options.wrenches, options.states, options.rounds))
    command = [sys.executable, __file__, "--work", case, "--port", str(port), "--sizes", *sizes]
    runs = [
        subprocess.Popen([*command, "--which", str(i)], stdout=subprocess.PIPE, text=True)
        for i in range(CASES[case][0])
    ]
    told = [json.loads(run.communicate(timeout=600)[0].splitlines()[-1]) for run in runs]
    slowest = {name: [max(each) for each in zip(*(x[name] for x in told), strict=True)] for name in told[0]}
    return {name: 1e3 * sorted(times)[len(times) // 2] for name, times in slowest.items()}


def report(found, options):
    """found: case -> a result of `measured` for every repetition."""
    from jaxspatial import measure

    lines = [
        "# Weak scaling",
        "",
        f"The same work per device, float32; each device has one core. Medians of {options.rounds} rounds in",
        f"milliseconds, from the smallest to the largest of {options.repeats} repetitions, and ratios of the smallest.",
        "Our machine has two cores, so that two devices are all that it can tell. Programs have no collective",
        "operation, and each device has the bits of one device alone.",
        measure.machine(),
        "",
        "| work per device | on | ms | over one device |",
        "|---|---|---|---|",
    ]
    for job in found["one device"][0]:
        least = {case: min(x[job] for x in results) for case, results in found.items()}
        for case, results in found.items():
            most = max(x[job] for x in results)
            ratio = least[case] / least["one device"]
            lines.append(f"| {job} | {case} | {least[case]:.3g} to {most:.3g} | {ratio:.2f} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wrenches", type=int, default=1_000_000, help="of a device")
    parser.add_argument("--states", type=int, default=65_536, help="of a device")
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--write", action="store_true", help="renew scale.md")
    for name in ("work", "port", "which"):
        parser.add_argument(f"--{name}", help=argparse.SUPPRESS)
    parser.add_argument("--sizes", type=int, nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        return work(options.work, int(options.which), options.port, *options.sizes)
    found = {case: [] for case in CASES}
    for _ in range(options.repeats):
        for case, results in found.items():
            results.append(measured(case, options))
    text = report(found, options)
    print(text)
    if options.write:
        (HERE / "scale.md").write_text(text)


if __name__ == "__main__":
    main()

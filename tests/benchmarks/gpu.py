"""What the library costs on a GPU, and whether its numbers are those of the CPU.

    python tests/benchmarks/gpu.py [--write]

Wrenches in every precision beside a copy of the same numbers; dynamics of an arm and a humanoid; a quadruped on the
ground beside mjx.step. Float32, in one process, alternately, after warm-up. Asserts the claims below; exit status 1 if
one does not hold. `--write` renews gpu.md beside this file. Elsewhere than on a GPU it runs, too, and says so.

Programs of batches after the first are compiled in parallel, and their time to compile is not told.
"""

import argparse
import functools
import os
import pathlib
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version

# JAX would take most of the memory of the GPU at once.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

HERE = pathlib.Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

import contact_rows as contact  # noqa: E402
from dynamics_compiling import made  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial import measure  # noqa: E402
from tests.helpers import pinocchio_models as models  # noqa: E402

WRENCHES, STATES, COMPARED = 2**22, (4096, 65536), 512
ON_THE_GROUND = "solo12"
ARMS = {"panda": False, "g1_29dof_rev_1_0": True}
PRECISIONS = ("fast", "reproducible", "compensated", "faithful")
COPY = "a copy"
# Whose numbers are compared with those of the CPU.
AS_ON_THE_CPU = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
# Of float32 numbers: how far from the CPU's, over the largest of the result, in units of 2^-24.
CLOSE = 16.0
# How many times as long as a copy a shift takes.
CLAIMS = {"fast": 1.5, "reproducible": 1.5, "compensated": 2.0}


def wrenches(n):
    """case -> (function, arguments): n wrenches, each shifted by its own vector."""
    rng = np.random.default_rng(0)
    tau, f, p = jnp.asarray(rng.standard_normal((3, n, 3)), np.float32)
    F = js.SpatialForce(tau, f)
    return {
        # It reads and writes as many numbers as a shift does.
        COPY: (lambda F, p: (F.rotational + p, F.translational + p), (F, p)),
        **{x: (lambda F, p, x=x: js.shift(F, p, precision=x), (F, p)) for x in PRECISIONS},
    }


def dynamics(name, n):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", js.interop.ModelFileWarning)
        mech = js.Mechanism.from_urdf(models.ROBOTS[name], floating_base=ARMS[name], dtype=np.float32)
    q = js.random_configuration(mech, jax.random.key(0), n, np.float32)
    v, a = jnp.asarray(np.random.default_rng(0).standard_normal((2, n, mech.nv)), np.float32)

    def gradient(q, v, a):
        return jax.grad(lambda *x: js.forward_dynamics(mech, *x).sum(), (0, 1, 2))(q, v, a)

    return {
        "forward_kinematics": (lambda q, v, a: js.forward_kinematics(mech, q), (q, v, a)),
        "inverse_dynamics": (lambda q, v, a: js.inverse_dynamics(mech, q, v, a), (q, v, a)),
        "forward_dynamics": (lambda q, v, a: js.forward_dynamics(mech, q, v, a), (q, v, a)),
        "mass_matrix": (lambda q, v, a: js.mass_matrix(mech, q), (q, v, a)),
        "semi_implicit_step": (lambda q, v, a: js.semi_implicit_step(mech, q, v, a, np.float32(1e-3)), (q, v, a)),
        "gradient of forward_dynamics": (gradient, (q, v, a)),
    }


def compiled(calls, all_at_once):
    """(case -> compiled call, case -> seconds to trace and to compile, as text).

    all_at_once: they are compiled in parallel, so that nobody knows what each takes.
    """
    if all_at_once:
        lowered = {case: jax.jit(function).lower(*arguments) for case, (function, arguments) in calls.items()}
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as threads:
            programs = dict(zip(lowered, threads.map(lambda x: x.compile(), lowered.values()), strict=True))
        seconds = dict.fromkeys(calls, "|")
    else:
        found = {case: made(*x) for case, x in calls.items()}
        programs = {case: program for case, (_, program, _) in found.items()}
        seconds = {case: f"{x.trace:.2g} | {x.compile:.2g}" for case, (_, _, x) in found.items()}
    return {case: functools.partial(programs[case], *arguments) for case, (_, arguments) in calls.items()}, seconds


def beside_the_cpu(calls):
    """case -> (share of numbers with the bits of the CPU, the largest difference in u over the largest number)."""
    cpu = jax.local_devices(backend="cpu")[0]
    found = {}
    for case, (function, arguments) in calls.items():
        here = jax.tree.leaves(jax.jit(function)(*arguments))
        there = jax.tree.leaves(jax.jit(function)(*jax.device_put(arguments, cpu)))
        both = [(np.asarray(x), np.asarray(y)) for x, y in zip(here, there, strict=True)]
        same = np.concatenate([(x == y).ravel() for x, y in both]).mean()
        found[case] = float(same), max(float(abs(x - y).max() / abs(y).max()) * 2**24 for x, y in both)
    return found


def device():
    """What JAX calls it, with the driver's version where there is one."""
    kind = jax.devices()[0].device_kind
    if jax.default_backend() != "gpu":
        return f"{kind}: NO GPU"
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        return f"{kind}, driver {subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()}"
    except (OSError, subprocess.CalledProcessError):
        return kind


class Table:
    """The text, printed and written as it grows; and whether every claim holds."""

    def __init__(self, file):
        self.file, self.lines, self.holds = file, [], True

    def add(self, line):
        self.lines.append(line)
        print(line, flush=True)
        if self.file:
            self.file.write_text("# What the library costs on a GPU\n\n" + "\n".join(self.lines) + "\n")

    def claim(self, what, value, asked, holds):
        self.holds = self.holds and bool(holds)
        self.add(f"\n{what}: {value:.3g}, {asked}: {'holds' if holds else 'DOES NOT HOLD'}.")


def timed(table, calls, of_each, title, rounds, all_at_once=False):
    """Adds rows of medians; case -> seconds."""
    programs, compiling = compiled(calls, all_at_once)
    seconds = measure.interleaved(programs, rounds)
    table.add(f"\n| {title} | us a call | ns each | 10 % | 90 % | trace, s | compile, s |")
    table.add("|---|---|---|---|---|---|---|")
    for case, found in seconds.items():
        low, middle, high = np.quantile(found, [0.1, 0.5, 0.9])
        each = " | ".join(f"{x / of_each * 1e9:.3g}" for x in (middle, low, high))
        table.add(f"| {case} | {middle * 1e6:.4g} | {each} | {compiling[case]} |")
    return seconds


def of_wrenches(table, options):
    n = options.wrenches
    seconds = timed(table, wrenches(n), n, f"{n} wrenches shifted", options.rounds)
    for precision, most in CLAIMS.items():
        value = float(np.median(seconds[precision] / seconds[COPY]))
        table.claim(f"shift, {precision}, over a copy of its numbers", value, f"at most {most}", value <= most)
    equal = {case: share for case, (share, _) in beside_the_cpu(wrenches(COMPARED)).items() if case in PRECISIONS[1:]}
    least = min(equal.values())
    table.claim("Share of numbers with the bits of the CPU, in all precisions but fast", least, "1", least == 1)


def robot_beside_the_cpu(table, name):
    beside = beside_the_cpu({case: x for case, x in dynamics(name, COMPARED).items() if case in AS_ON_THE_CPU})
    table.add(f"\n| {name} beside the CPU | share with its bits | largest difference, u of the largest |")
    table.add("|---|---|---|")
    for case, (share, difference) in beside.items():
        table.add(f"| {case} | {share:.4f} | {difference:.2g} |")
    most = max(difference for _, difference in beside.values())
    table.claim(f"{name}, largest difference from the CPU, in u", most, f"at most {CLOSE:.0f}", most <= CLOSE)


def on_the_ground(table, n, steps, rounds, all_at_once):
    calls = contact.calls(ON_THE_GROUND, n, steps)
    calls = {case: calls[case] for case in (contact.CONVEX, contact.PLAIN, contact.MJX)}
    title = f"{ON_THE_GROUND}, {n} states, {steps} steps"
    seconds = timed(table, calls, n * steps, title, rounds, all_at_once)
    value = float(np.median(seconds[contact.MJX] / seconds[contact.CONVEX]))
    table.claim(f"{title}, mjx.step over {contact.CONVEX}", value, "at least 1", value >= 1)


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What the library costs on a GPU.")
    parser.add_argument("--wrenches", type=int, default=WRENCHES)
    parser.add_argument("--states", type=int, nargs="+", default=STATES)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--write", action="store_true", help="write the table to gpu.md beside this file")
    options = parser.parse_args(arguments)
    table = Table(HERE / "gpu.md" if options.write else None)
    table.add("Float32. Medians, and 10 % and 90 % of all rounds, of ns per wrench, state, or state and step.")
    table.add(f"{device()}; {measure.machine()}, mujoco {version('mujoco')}, mujoco-mjx {version('mujoco-mjx')}")
    report = js.self_check()
    table.claim(
        "Promises of self_check that hold here",
        sum(x.holds is True for x in report.findings),
        "all of them",
        report.holds,
    )
    if not report.holds:
        table.add(f"\n```\n{report}\n```")
    of_wrenches(table, options)
    for n in options.states:
        again = n != options.states[0]
        for name in ARMS:
            timed(table, dynamics(name, n), n, f"{name}, {n} states", options.rounds, again)
            if not again:
                robot_beside_the_cpu(table, name)
        on_the_ground(table, n, options.steps, options.rounds, again)
    return 0 if table.holds else 1


if __name__ == "__main__":
    sys.exit(main())

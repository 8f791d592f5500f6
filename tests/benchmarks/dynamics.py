"""Inverse and forward dynamics of robots next to Pinocchio and MuJoCo in C++, frax and MuJoCo MJX: in one process, on
one core, in turns.

    python tests/benchmarks/dynamics.py [--write] [--robots panda g1] [--batches 1 64 4096 65536]

Asserts the claims of the README; exit status 1 if one does not hold. `--write` renews the table and the picture beside
this file. Needs g++ (with Pinocchio's headers it takes minutes) and jaxspatial[benchmarks].
"""

import os

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core for all sides, before XLA counts them

import argparse  # noqa: E402
import functools  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
import warnings  # noqa: E402
from typing import NamedTuple  # noqa: E402

import dynamics_peers as peers  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from dynamics_peers import ALGORITHMS  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial.interop import ModelFileWarning  # noqa: E402
from jaxspatial.measure import timing  # noqa: E402

HERE = pathlib.Path(__file__).parent
OURS = {"inverse dynamics": js.inverse_dynamics, "forward dynamics": js.forward_dynamics}
PINOCCHIO, MUJOCO = "Pinocchio C++", "MuJoCo C"
# At which batches: a call of MJX's kinematics takes a second for 64 states, as it computes unrolled products again and
# again.
JAX_PEERS = {"frax": (peers.frax_program, (1, 64, 4096)), "MJX": (peers.mjx_program, (64,))}
# Our programs: known numbers folded, in two precisions, and one program for all numbers of such a robot.
PROGRAMS = ("fast", "reproducible", "fast, numbers as data")
MAIN = 4096  # the batch that the claims are about, and that all programs are measured at


class Robot(NamedTuple):
    name: str
    floating_base: bool

    @property
    def urdf(self):
        return peers.urdf(self.name)


ROBOTS = {"panda": Robot("panda", False), "g1": Robot("g1", True)}


class Result(NamedTuple):
    robot: str
    algorithm: str
    dtype: str
    batch: int
    seconds: dict  # name -> seconds per evaluation, one per round
    errors: dict  # name -> the largest error over the largest number of Pinocchio's in float64
    compiling: dict  # name -> seconds to trace and compile

    @property
    def case(self):
        return f"{self.robot}, {self.algorithm}, {self.dtype}, {self.batch}"


class States:
    """Random states in our order and in that of others: a floating base is [quaternion wxyz, position] and (angular,
    linear) here, [position, quaternion xyzw] and (linear, angular) in Pinocchio, wxyz in MuJoCo."""

    def __init__(self, robot, mech, model, n):
        rng = np.random.default_rng(0)
        self.is_floating = robot.floating_base
        self.q = np.asarray(js.random_configuration(mech, jax.random.key(0), n, np.float64))
        self.v, self.a = rng.standard_normal((2, n, mech.nv))
        self.pin_q, self.pin_v = np.arange(mech.nq), np.arange(mech.nv)
        for name in mech.joint_names:
            joint = model.joints[model.getJointId(name)]
            q, v = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
            is_free = len(q) == 7
            self.pin_q[joint.idx_q : joint.idx_q + len(q)] = q[[4, 5, 6, 1, 2, 3, 0]] if is_free else q
            self.pin_v[joint.idx_v : joint.idx_v + len(v)] = v[[3, 4, 5, 0, 1, 2]] if is_free else v

    def ours(self, dtype):
        return [jnp.asarray(x.astype(dtype)) for x in (self.q, self.v, self.a)]

    def pinocchios(self, dtype):
        arrays = self.q[:, self.pin_q], self.v[:, self.pin_v], self.a[:, self.pin_v]
        return [np.ascontiguousarray(x.astype(dtype)) for x in arrays]

    def mujocos(self, dtype):
        """Velocities of a base are in its axes for one and in the world for the other: other numbers, equal work."""
        q, v, a = self.pinocchios(dtype)
        return [q[:, [0, 1, 2, 6, 3, 4, 5, *range(7, q.shape[1])]] if self.is_floating else q, v, a]


# -- measuring --------------------------------------------------------------------------------------------------------


def measured(robot, libraries, dtype, batch, rounds):
    with jax.enable_x64(True), warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelFileWarning)
        mech = js.Mechanism.from_urdf(robot.urdf, robot.floating_base, dtype=np.float64)
        model = peers.load_pinocchio(libraries[dtype], robot)
        peers.load_mujoco(libraries[MUJOCO], robot)
        states = States(robot, mech, model, batch)
    for algorithm in ALGORITHMS:
        yield _compared(robot, libraries, mech, model, states, algorithm, dtype, rounds)


def _compared(robot, libraries, mech, model, states, algorithm, dtype, rounds):
    batch = len(states.q)
    with peers.with_dtype(dtype):
        cases = {PINOCCHIO: peers.run(libraries[dtype], algorithm, states.pinocchios(dtype))}
        if dtype == "float64":
            cases[MUJOCO] = peers.run(libraries[MUJOCO], algorithm, states.mujocos(dtype))
        programs = {**_ours(mech, algorithm, batch, states.ours(dtype))}
        for name, program in ((name, p) for name, (p, batches) in JAX_PEERS.items() if batch in batches):
            arrays = list(map(jnp.asarray, states.mujocos(dtype)))
            programs[name] = (program(robot, algorithm), arrays)
        compiling = {}
        for name, (program, arrays) in programs.items():
            cases[name], compiling[name] = _ready(program, arrays)
        expected = peers.expected(model, algorithm, [x[:32] for x in states.pinocchios("float64")])
        errors = {name: _error(states, name, np.asarray(call()), expected) for name, call in cases.items()}
        seconds = timing.interleaved(cases, rounds, limit=60.0)
    return Result(robot.name, algorithm, dtype, batch, {k: s / batch for k, s in seconds.items()}, errors, compiling)


def _ours(mech, algorithm, batch, arrays):
    """name -> (program of one item, its arrays)."""
    function = OURS[algorithm]
    known = {p: lambda *x, p=p: function(mech, *x, precision=p) for p in ("fast", "reproducible")}
    as_data = mech.astype(arrays[0].dtype).as_data()
    found = {**known, PROGRAMS[2]: functools.partial(_with_data, function, as_data)}
    return {name: (found[name], arrays) for name in (PROGRAMS if batch == MAIN else PROGRAMS[:1])}


def _with_data(function, mech, *arrays):
    return function(mech, *arrays, precision="fast")


def _ready(program, arrays):
    """(the compiled batch without arguments, how long that took)."""
    start = time.perf_counter()
    compiled = jax.jit(jax.vmap(program)).lower(*arrays).compile()
    return lambda: compiled(*arrays), time.perf_counter() - start


def _error(states, name, found, expected):
    """None where the coordinates are others."""
    found = np.asarray(found, float)[: len(expected)]
    if name in PROGRAMS:
        found = found[:, states.pin_v]
    elif name != PINOCCHIO and states.is_floating:
        return None
    return abs(found - expected).max() / abs(expected).max()


# -- claims -----------------------------------------------------------------------------------------------------------

# At the main batch, in "fast": the others' time over ours, at least; seconds to compile, at most.
AT_LEAST = {"float32": 2.0, "float64": 1.0}
OVER_JAX = 4.0
SECONDS = {("panda", "inverse dynamics"): 3.0, ("g1", "inverse dynamics"): 10.0}
SECONDS |= {(robot, "forward dynamics"): 2 * SECONDS[robot, "inverse dynamics"] for robot in ROBOTS}


def ratio(result, name):
    return float(np.median(result.seconds[name] / result.seconds["fast"]))


def claims(result):
    """(what is claimed, what was measured, whether it holds)."""
    if result.batch != MAIN:
        return
    found = ratio(result, PINOCCHIO)
    yield f"Pinocchio's time at least {AT_LEAST[result.dtype]:g} times ours", found, found >= AT_LEAST[result.dtype]
    found = min(ratio(result, name) for name in JAX_PEERS if name in result.seconds)
    yield f"the fastest JAX peer's at least {OVER_JAX:g} times ours", found, found >= OVER_JAX
    limit = SECONDS[result.robot, result.algorithm]
    yield f"compiled in at most {limit:g} s", result.compiling["fast"], result.compiling["fast"] <= limit


# -- table and picture ------------------------------------------------------------------------------------------------


def rows(result):
    for name, seconds in result.seconds.items():
        low, middle, high = np.quantile(seconds, [0.1, 0.5, 0.9]) * 1e6
        compiling = f"{result.compiling[name]:.1f}" if name in result.compiling else ""
        error = "" if result.errors[name] is None else f"{result.errors[name]:.0e}"
        yield f"| {result.case} | {name} | {middle:.3f} | {low:.3f} | {high:.3f} | {error} | {compiling} |"


def lines(results):
    yield "One core, medians of us per evaluation (10 % to 90 % of the rounds), `jax.jit(jax.vmap(...))`. Errors are"
    yield "those of 32 states over the largest number of Pinocchio's in float64, where the coordinates are the same;"
    yield "MuJoCo leaves out the moments of inertia that the Panda's file gives a massless link, and so differs."
    yield f"\n{timing.machine()}, {peers.versions()}"
    yield "\n| robot, algorithm, dtype, batch | | us | 10 % | 90 % | error | compiling, s |"
    yield "|---|---|---|---|---|---|---|"
    for result in results:
        yield from rows(result)
    yield f'\nAt batch {MAIN}, ours in "fast":\n'
    for result in results:
        for claim, found, holds in claims(result):
            yield f"- {result.case}: {claim}: {found:.2f}{'' if holds else ', DOES NOT HOLD'}"


def picture(results, path):
    """us per evaluation at the main batch, a panel for every robot, algorithm and dtype."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    shown = [r for r in results if r.batch == MAIN]
    figure, panels = plt.subplots(-(-len(shown) // 2), 2, figsize=(11, 1.6 * len(shown)), squeeze=False)
    for axes, result in zip(panels.flat, shown, strict=False):
        names = list(result.seconds)[::-1]
        middle = [np.median(result.seconds[name]) * 1e6 for name in names]
        colours = ["#00798c" if name in PROGRAMS else "#b9b9b9" for name in names]
        bars = axes.barh(names, middle, color=colours)
        axes.bar_label(bars, [f"{x:.2g}" for x in middle], padding=3)
        axes.set(xscale="log", xlim=(0.1, 200), xlabel="us per evaluation, logarithmic")
        axes.set_title(f"{result.robot}, {result.algorithm}, {result.dtype}, batch {result.batch}")
        axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main(arguments=None):
    parser = argparse.ArgumentParser(description="Dynamics of robots next to Pinocchio, MuJoCo, frax and MJX.")
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--batches", nargs="+", type=int, default=[1, 64, MAIN, 65536])
    parser.add_argument("--dtypes", nargs="+", default=list(AT_LEAST))
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--folder", help="keep the compiled libraries here")
    parser.add_argument("--write", action="store_true", help="write dynamics.md and dynamics.png beside this file")
    options = parser.parse_args(arguments)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        folder = options.folder or folder
        libraries = {dtype: peers.pinocchio_library(dtype, folder) for dtype in options.dtypes}
        libraries[MUJOCO] = peers.mujoco_library(folder)
        for robot, dtype, batch in ((r, d, b) for r in options.robots for d in options.dtypes for b in options.batches):
            for result in measured(ROBOTS[robot], libraries, dtype, batch, options.rounds):
                print("\n".join(rows(result)), flush=True)
                results.append(result)
    table = "\n".join(lines(results))
    print(f"\n{table}")
    if options.write:
        (HERE / "dynamics.md").write_text(f"# Dynamics of robots\n\n![times](dynamics.png)\n\n{table}\n")
        picture(results, HERE / "dynamics.png")
    return 0 if all(holds for r in results for *_, holds in claims(r)) else 1


if __name__ == "__main__":
    sys.exit(main())

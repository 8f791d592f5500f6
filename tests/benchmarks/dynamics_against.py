"""Two commits in turns: what rows of the benchmark of dynamics cost with the jaxspatial of each.

    python tests/benchmarks/dynamics.py --against COMMIT [--robots panda] [--dtypes float32] [--rows "mass matrix"]

The commit is checked out in a temporary worktree of git. Two processes on one core run the rows of this benchmark, one
with the jaxspatial of each tree; one works while the other waits for its turn. Run by itself, with a tree, this file is
such a process: it reads requests and writes replies, a line of JSON each.
"""

import compileall
import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import dynamics_compiling as compiling
import dynamics_peers as peers
import dynamics_rows as rows
import jax
import jax.numpy as jnp
import numpy as np
from dynamics_claims import Compiling
from dynamics_guard import Compared, difference, lines_of_compared, this_commit

import jaxspatial as js

HERE = pathlib.Path(__file__).parent
SIDES = "before", "now"
LEAST_ROUNDS = 3


# -- the process that asks --------------------------------------------------------------------------------------------


def main(options, machine):
    """The exit status: 1 where a row is slower by more than a tenth, or none could be compared."""
    commit = _git("rev-parse", "--verify", "--end-of-options", f"{options.against}^{{commit}}")
    left_out, compared = [], []
    with contextlib.ExitStack() as stack:
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        old, new = stack.enter_context(_checked_out(commit, folder / "before")), HERE.parents[1]
        sides = [stack.enter_context(_worker(tree)) for tree in (old, new)]
        for robot in options.robots:
            for dtype in options.dtypes:
                compared += _compared(sides, robot, dtype, options, folder, left_out)
    about = [f"Before: {commit[:9]} ({options.against}). Now: {this_commit()}.", machine]
    print("\n".join(["", *lines_of_compared(compared, left_out, about), ""]))
    return 1 if not compared or any(x.is_slower for x in compared) else 0


def _git(*arguments):
    command = ["git", "-C", str(HERE), *arguments]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


@contextlib.contextmanager
def _checked_out(commit, tree):
    _git("worktree", "add", "--quiet", "--detach", str(tree), commit)
    try:
        yield tree
    finally:
        _git("worktree", "remove", "--force", str(tree))


@contextlib.contextmanager
def _worker(tree):
    """A function that sends a request to a process of a tree, and waits for its reply."""
    compileall.compile_dir(tree / "jaxspatial", quiet=2)  # what is imported late would be compiled within a trace
    paths = [str(tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    reads, writes = os.pipe()  # replies have a pipe of their own: libraries print when they are imported
    command = [sys.executable, __file__, str(tree), str(writes)]
    told = {"stdin": subprocess.PIPE, "stdout": sys.stderr, "pass_fds": [writes], "env": environment, "text": True}
    with open(reads) as replies, subprocess.Popen(command, **told) as process:
        os.close(writes)

        def ask(*request):
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            reply = replies.readline()
            if not reply:
                raise RuntimeError(f"the process of {tree} ended while it was asked to {request}")
            return json.loads(reply)

        try:
            yield ask
        finally:
            process.stdin.close()  # it ends with its requests


def _compared(sides, robot, dtype, options, folder, left_out):
    """Of a robot in a dtype, Compared by Compared."""
    where = f"{robot}, {dtype}"
    states, results = folder / "states.npz", [folder / f"{side}.npz" for side in SIDES]
    with jax.enable_x64(True):
        made = rows.States(None, rows.mechanism(peers.ROBOTS[robot]), options.batch)
    np.savez(states, made.q, *made.of_rates)
    begun = [ask("begin", robot, dtype, str(states)) for ask in sides]
    if begun[0] != begun[1] or isinstance(begun[1], str):
        left_out.append(f"{where}: another mechanism before ({begun[0]}) than now ({begun[1]})")
        return []
    found = {}
    for row in options.rows:
        replies = [ask("compile", row, str(path)) for ask, path in zip(sides, results, strict=True)]
        missing = [f"{x['cannot']} ({side})" for side, x in zip(SIDES, replies, strict=True) if "cannot" in x]
        if missing:
            left_out.append(f"{where}, {row}: {', '.join(missing)}")
            continue
        found[row] = [Compiling(**x) for x in replies], difference(*map(_arrays, results))
        told = ", ".join(f"{x.total:.2f} s {side}" for side, x in zip(SIDES, found[row][0], strict=True))
        print(f"{where}: {row}: trace and compile {told}; {found[row][1]}", flush=True)
    seconds = _in_turns(sides, found, max(LEAST_ROUNDS, options.rounds), options.limit)
    return [
        Compared(where, row, *both, *(np.array(x) / options.batch for x in seconds[row]), said)
        for row, (both, said) in found.items()
    ]


def _arrays(path):
    with np.load(path) as file:
        return [file[name] for name in file.files]


def _in_turns(sides, found, rounds, limit):
    """row -> seconds per call (before, now), a list of rounds each; who is first changes from round to round."""
    seconds = {row: ([], []) for row in found}
    begin = time.perf_counter()
    for i in range(rounds):
        if i >= LEAST_ROUNDS and time.perf_counter() > begin + limit:
            break
        for row, both in seconds.items():
            for side in (0, 1) if i % 2 == 0 else (1, 0):
                both[side].append(sides[side]("time", row))
    return seconds


# -- the process that is asked ----------------------------------------------------------------------------------------


class _Programs:
    """Compiled rows of a robot in a dtype."""

    def begin(self, robot, dtype, states):
        """The coordinates, which have to be alike for states to mean the same; or why there is no such mechanism."""
        jax.config.update("jax_enable_x64", dtype == "float64")
        self.robot, self.calls = peers.ROBOTS[robot], {}
        self.states = [jnp.asarray(x.astype(dtype)) for x in _arrays(states)]
        try:
            mech = rows.mechanism(self.robot)
        except Exception as error:
            return _reason(error)
        return [mech.nq, mech.nv, list(mech.joint_names)]

    def compile(self, row, results):
        """Seconds; or why a row cannot be run, where this tree has no such function."""
        try:
            call, found = compiling.cold(lambda: self._program(row), self.states)
            np.savez(results, *map(np.asarray, jax.tree.leaves(call())))
        except Exception as error:
            return {"cannot": _reason(error)}
        self.calls[row] = call, *compiling.repeated(call)
        return found._asdict()

    def _program(self, row):
        return rows.program(compiling.watched(rows.mechanism(self.robot)), self.robot.tip, row)

    def time(self, row):
        """Seconds per call. The first call of a turn is not counted: it finds caches as the other process left them."""
        call, run, count = self.calls[row]
        jax.block_until_ready(call())
        start = time.perf_counter()
        run()
        return (time.perf_counter() - start) / count


def _reason(error):
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"


def _serve(tree, replies):
    if not pathlib.Path(js.__file__).resolve().is_relative_to(tree.resolve()):
        raise ImportError(f"jaxspatial: expected that of {tree}, got {js.__file__}")
    compiling.prepare()
    programs = _Programs()
    for line in sys.stdin:
        name, *arguments = json.loads(line)
        print(json.dumps(getattr(programs, name)(*arguments)), file=replies, flush=True)


if __name__ == "__main__":
    with open(int(sys.argv[2]), "w") as pipe:
        _serve(pathlib.Path(sys.argv[1]), pipe)

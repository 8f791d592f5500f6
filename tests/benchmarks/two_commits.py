"""Two commits in turns: what the rows of a benchmark cost with the jaxspatial of each.

A commit is checked out in a temporary worktree of git. Two processes on one core run the rows of this tree's benchmark,
one with the jaxspatial of each tree; one works while the other waits for its turn. Such a process runs a script that
calls `serve`: it reads requests and writes replies, a line of JSON each.
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
from typing import Any, NamedTuple

import dynamics_compiling as compiling
import jax
import numpy as np
from dynamics_claims import Compiling
from dynamics_report import number, spread

import jaxspatial as js

HERE = pathlib.Path(__file__).parent
SIDES = "before", "now"
LEAST_ROUNDS = 3
SLOWER = 1.1  # time now over before: a row above it is not "as before"
TITLE = "## Beside an earlier commit"


def this_commit():
    """That of this tree, with "-dirty" where it has changes; "unknown" outside of a repository."""
    try:
        return _git("describe", "--always", "--dirty", "--exclude=*", stderr=subprocess.DEVNULL)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _git(*arguments, stderr=None):
    command = ["git", "-C", str(HERE), *arguments]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=stderr, text=True, check=True).stdout.strip()


# -- what was found ---------------------------------------------------------------------------------------------------


class Compared(NamedTuple):
    """A row: Compiling and seconds, one per round, of each tree; what is said of the results."""

    where: str
    row: str
    compiling_before: Compiling
    compiling_now: Compiling
    before: Any
    now: Any
    results: str

    @property
    def ratio(self):
        """Of the time now to that before: the median over the rounds."""
        return float(np.median(np.asarray(self.now) / np.asarray(self.before)))

    @property
    def is_slower(self):
        """True for NaN."""
        return not self.ratio <= SLOWER


def difference(before, now):
    """Of two lists of arrays: "same bits", or the largest difference over the largest number of an array."""
    if [(x.dtype, x.shape) for x in before] != [(x.dtype, x.shape) for x in now]:
        return "of other shapes"
    if all(x.tobytes() == y.tobytes() for x, y in zip(before, now, strict=True)):
        return "same bits"
    return f"{max(_relative(x, y) for x, y in zip(before, now, strict=True) if x.size):.0e}"


def _relative(before, now):
    """Infinite where one is finite and the other is not."""
    same = (before == now) | (np.isnan(before) & np.isnan(now))
    if same.all():
        return 0.0
    if not (np.isfinite(before[~same]).all() and np.isfinite(now[~same]).all()):
        return np.inf
    return float(abs(now - before)[~same].max() / abs(before[np.isfinite(before)]).max())


def lines(compared, left_out, about, per):
    """The report, in Markdown. about: lines on the two trees and the machine. per: what a time is of."""
    yield "One core, a process for each tree, in turns. Seconds to trace and to compile are of one cold run. Times are"
    yield f"medians of microseconds per {per} (10 % to 90 % of the rounds); their ratios are medians of those within a"
    yield "round. Results: the same bits, or the largest difference over the largest number.\n"
    yield from about
    columns = "before | now | now / before"
    yield f"\n| | | trace and compile, s: {columns} | us per {per}: {columns} | results |\n|{'---|' * 9}"
    for x in compared:
        before, now = x.compiling_before.total, x.compiling_now.total
        cells = f"{before:.2f}", f"{now:.2f}", f"{now / before:.2f}", spread(x.before), spread(x.now), number(x.ratio)
        verdict = " **SLOWER**" if x.is_slower else ""
        yield f"| {x.where} | {x.row} | {' | '.join(cells)}{verdict} | {x.results} |"
    slower = sum(x.is_slower for x in compared)
    yield f"\n{slower} of {len(compared)} rows are slower by more than a tenth."
    yield from (f"- Left out: {x}." for x in left_out)


def with_section(table, told):
    """A table, with what is told of two commits as its last section."""
    return f"{table.partition(TITLE)[0].rstrip()}\n\n{TITLE}\n\n{told}\n"


# -- the process that asks --------------------------------------------------------------------------------------------


def main(script, compare, options, about, per, table):
    """Compares this tree with `options.against` and prints the report; with `options.write` it is added to the table.

    script: of the processes. compare: a function from Sides, and a list for what is left out, to Compared by Compared.
    about, per: see `lines`.

    Returns:
        The exit status: 1 where a row is slower by more than a tenth, or none could be compared.
    """
    left_out = []
    with sides(script, options.against) as both:
        found = list(compare(both, left_out))
    told = "\n".join(lines(found, left_out, [both.about, *about], per))
    print(f"\n{told}\n")
    if options.write:
        table.write_text(with_section(table.read_text(), told))
    return int(not found or any(x.is_slower for x in found))


class Sides(NamedTuple):
    """Two processes. ask: sends a request to one, and waits for its reply. about: a line on the commits."""

    ask: list[Any]
    folder: pathlib.Path
    about: str

    def compared(self, where, begin, rows, counts, options, left_out):
        """Compared by Compared. begin: arguments. counts: for how many states, or steps of them, a call of a row is."""
        begun = [ask("begin", *begin) for ask in self.ask]
        if begun[0] != begun[1] or isinstance(begun[1], str):
            left_out.append(f"{where}: another mechanism before ({begun[0]}) than now ({begun[1]})")
            return []
        found, results = {}, [self.folder / f"{side}.npz" for side in SIDES]
        for row in rows:
            replies = [ask("compile", row, str(path)) for ask, path in zip(self.ask, results, strict=True)]
            missing = [f"{x['cannot']} ({side})" for side, x in zip(SIDES, replies, strict=True) if "cannot" in x]
            if missing:
                left_out.append(f"{where}, {row}: {', '.join(missing)}")
                continue
            found[row] = [Compiling(**x) for x in replies], difference(*map(arrays, results))
            told = ", ".join(f"{x.total:.2f} s {side}" for side, x in zip(SIDES, found[row][0], strict=True))
            print(f"{where}: {row}: trace and compile {told}; {found[row][1]}", flush=True)
        seconds = self._in_turns(found, max(LEAST_ROUNDS, options.rounds), options.limit)
        return [
            Compared(where, row, *both, *(np.array(x) / counts[row] for x in seconds[row]), said)
            for row, (both, said) in found.items()
        ]

    def _in_turns(self, found, rounds, limit):
        """row -> seconds per call (before, now), a list of rounds each; who is first changes from round to round."""
        seconds = {row: ([], []) for row in found}
        begin = time.perf_counter()
        for i in range(rounds):
            if i >= LEAST_ROUNDS and time.perf_counter() > begin + limit:
                break
            for row, both in seconds.items():
                for side in (0, 1) if i % 2 == 0 else (1, 0):
                    both[side].append(self.ask[side]("time", row))
        return seconds


@contextlib.contextmanager
def sides(script, commit):
    """Sides of a commit and of this tree, whose processes run a script."""
    name = _git("rev-parse", "--verify", "--end-of-options", f"{commit}^{{commit}}")
    about = f"Before: {name[:9]} ({commit}). Now: {this_commit()}."
    with contextlib.ExitStack() as stack:
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        trees = stack.enter_context(_checked_out(name, folder / "before")), HERE.parents[1]
        yield Sides([stack.enter_context(_worker(script, tree)) for tree in trees], folder, about)


@contextlib.contextmanager
def _checked_out(commit, tree):
    _git("worktree", "add", "--quiet", "--detach", str(tree), commit)
    try:
        yield tree
    finally:
        _git("worktree", "remove", "--force", str(tree))


@contextlib.contextmanager
def _worker(script, tree):
    """A function that sends a request to a process of a tree, and waits for its reply."""
    compileall.compile_dir(tree / "jaxspatial", quiet=2)  # what is imported late would be compiled within a trace
    paths = [str(tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    reads, writes = os.pipe()  # replies have a pipe of their own: libraries print when they are imported
    command = [sys.executable, script, str(tree), str(writes)]
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


# -- the process that is asked ----------------------------------------------------------------------------------------


def arrays(path):
    with np.load(path) as file:
        return [file[name] for name in file.files]


class Programs:
    """Compiled rows of a mechanism. A benchmark's own know which mechanism, and how its rows are compiled."""

    def mechanism(self, *about):
        """That which rows are about from now on."""
        raise NotImplementedError

    def begin(self, *about):
        """The coordinates, which have to be alike for states to mean the same; or why there is no such mechanism."""
        self.calls = {}
        try:
            mech = self.mechanism(*about)
        except Exception as error:
            return _reason(error)
        return [mech.nq, mech.nv, list(mech.joint_names)]

    def cold(self, row):
        """(a function without arguments, Compiling)."""
        raise NotImplementedError

    def compile(self, row, results):
        """Seconds; or why a row cannot be run, where this tree has no such function."""
        try:
            call, found = self.cold(row)
            np.savez(results, *map(np.asarray, jax.tree.leaves(call())))
        except Exception as error:
            return {"cannot": _reason(error)}
        self.calls[row] = call, *compiling.repeated(call)
        return found._asdict()

    def time(self, row):
        """Seconds per call. The first call of a turn is not counted: it finds caches as the other process left them."""
        call, run, count = self.calls[row]
        jax.block_until_ready(call())
        start = time.perf_counter()
        run()
        return (time.perf_counter() - start) / count


def _reason(error):
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"


def serve(programs):
    """Answers requests for the programs of a tree. The arguments of the process: the tree, and where replies go."""
    tree, pipe = pathlib.Path(sys.argv[1]), int(sys.argv[2])
    if not pathlib.Path(js.__file__).resolve().is_relative_to(tree.resolve()):
        raise ImportError(f"jaxspatial: expected that of {tree}, got {js.__file__}")
    compiling.prepare()
    with open(pipe, "w") as replies:
        for line in sys.stdin:
            name, *arguments = json.loads(line)
            print(json.dumps(getattr(programs, name)(*arguments)), file=replies, flush=True)

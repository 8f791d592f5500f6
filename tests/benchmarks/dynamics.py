"""Dynamics of robots next to Pinocchio and MuJoCo in C++, frax and MuJoCo MJX: in one process, on one core, in turns.

    python tests/benchmarks/dynamics.py [--write] [--robots panda g1] [--dtypes float32] [--rows "mass matrix" step]
    python tests/benchmarks/dynamics.py --against COMMIT [--write] [--robots ...] [--dtypes ...] [--rows ...]

Prints what each algorithm costs to trace, to compile and to run, and every claim of `dynamics_claims.py`; exit status 1
with the list of those that are not met. `--write` renews the table and the picture beside this file, and the targets on
the page on contributing. Needs jaxspatial[peers] and g++, which takes minutes for Pinocchio's headers, once: libraries
are kept in `--folder`.

Every run is compared with the ratios to Pinocchio of the last good one, in `dynamics_ratios.json`: a row that fell by
more than a tenth is told, with both numbers, and makes the exit status 1. `--write` renews that file too, where nothing
fell; with `--accept`, whatever fell. That something is as fast as before is claimed by `--against COMMIT`, which runs
two commits in turns and needs no g++: see `two_commits.py`. There `--write` adds them to the table, as a section.
"""

import os
import sys

# Memory that is freed stays with the process, as the sides in C++ keep the arrays that they write to. Otherwise each
# call that returns more than 32 MB waits for new pages of the system: three times its own time for a G1's mass matrix.
KEPT = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**34)}
if __name__ == "__main__" and not os.environ.keys() & KEPT.keys():
    os.execve(sys.executable, sys.orig_argv, os.environ | KEPT)

CORES = os.sched_getaffinity(0)
os.sched_setaffinity(0, {min(CORES)})  # one core for all sides, before XLA counts them

import argparse  # noqa: E402
import datetime  # noqa: E402
import pathlib  # noqa: E402
import time  # noqa: E402

import dynamics_against as against  # noqa: E402
import dynamics_compiling as compiling  # noqa: E402
import dynamics_guard as guard  # noqa: E402
import dynamics_peers as peers  # noqa: E402
import dynamics_report as report  # noqa: E402
import dynamics_rows as rows  # noqa: E402
import dynamics_shapes as shapes  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import two_commits  # noqa: E402
from dynamics_claims import (  # noqa: E402
    FEW,
    FORWARD,
    FRAX,
    GRADIENT_OF_STEP,
    INVERSE,
    LARGE,
    MANY,
    MJX,
    MUJOCO,
    ONE,
    OURS,
    PEERS,
    PINOCCHIO,
    STEP,
    Case,
    Results,
)

from jaxspatial.measure import timing  # noqa: E402

HERE = pathlib.Path(__file__).parent
TABLE = HERE / "dynamics.md"
DTYPES = ("float32", "float64")
PRECISIONS = {OURS: None, rows.FAST: "fast", rows.AS_DATA: None}
# The gradient of a step of MJX takes three to five times as long to compile as the step.
MJX_GRADIENT = 4.0


class Robot:
    """All sides of a robot in a dtype: its states, its programs, and what was found."""

    def __init__(self, robot, dtype, libraries, options, left_out):
        self.robot, self.dtype, self.options, self.left_out = robot, dtype, options, left_out
        mech = rows.mechanism(robot)
        self.model, self.pinocchio = peers.load_pinocchio(libraries[dtype], robot)
        self.mujoco = peers.load_mujoco(libraries[MUJOCO], robot)
        self.orders = rows.orders(robot, mech, self.model)
        self.states = {n: rows.States(self.orders, mech, n) for n in {ONE, FEW, options.batch, options.large}}
        self.programs = {FRAX: peers.frax_programs(robot), MJX: peers.mjx_programs(robot) if self._has_mjx else {}}
        self.results = Results(robot.name, dtype, options.batch, options.large, {}, {}, {})

    @property
    def _has_mjx(self):
        """It is made for float32, and takes a second for 64 states of the Panda."""
        return MJX in self.options.peers and self.dtype == "float32"

    def measured(self):
        """Results of the main batch with the large one, and of one and few states."""
        for cases in (self._main(), self._small()):
            calls = {case: self._ready(case) for case in cases}
            self._compared({case: call for case, call in calls.items() if case.batch == self.options.batch})
            found = compiling.in_turns(calls, self.options.rounds, self.options.limit) if calls else {}
            self.results.seconds.update(found)
        return self.results

    def _main(self):
        """Of every row, at the main batch; of the two recursions, at the large one too, ours alone."""
        for algorithm in self.options.rows:
            yield from self._sides(algorithm, self.options.batch, (*self.options.programs, PINOCCHIO, MUJOCO, FRAX))
        yield from (Case(x, self.options.large, OURS) for x in (INVERSE, FORWARD) if x in self.options.rows)

    def _small(self):
        for algorithm in (x for x in (INVERSE, FORWARD) if x in self.options.rows):
            yield from self._sides(algorithm, ONE, (OURS, PINOCCHIO, MUJOCO, FRAX))
            yield from self._sides(algorithm, FEW, (OURS, PINOCCHIO, MUJOCO, FRAX))
        if self._has_mjx:
            for algorithm in (x for x in (STEP, GRADIENT_OF_STEP) if x in self.options.rows):
                if not self._takes_too_long(Case(algorithm, FEW, MJX)):
                    yield from self._sides(algorithm, FEW, (OURS, FRAX, MJX))

    def _sides(self, algorithm, batch, who):
        able = {PINOCCHIO: self.pinocchio.sizes, **self.programs}
        able[MUJOCO] = self.mujoco.sizes if self.dtype == "float64" else {}  # it has no float32
        for name in who:
            if name in rows.PROGRAMS or (name in self.options.peers and algorithm in able[name]):
                yield Case(algorithm, batch, name)

    # -- a case -------------------------------------------------------------------------------------------------------

    def _ready(self, case):
        """A function without arguments."""
        states = self.states[case.batch]
        if case.who == PINOCCHIO:
            return peers.run(self.pinocchio, case.algorithm, states.pinocchios(self.dtype))
        if case.who == MUJOCO:
            return peers.run(self.mujoco, case.algorithm, states.mujocos(self.dtype))
        call, self.results.compiling[case] = compiling.cold(*self._program(case, states))
        print(f"{self.robot.name}, {self.dtype}: {_told(case, self.results.compiling[case])}", flush=True)
        return call

    def _program(self, case, states):
        """(what makes it, its arrays)."""
        if case.who in self.programs:
            return lambda: self.programs[case.who][case.algorithm], list(map(jnp.asarray, states.mujocos(self.dtype)))
        return lambda: self._ours(case), states.ours(self.dtype)

    def _ours(self, case):
        mech = rows.mechanism(self.robot)
        if case.who == rows.AS_DATA:
            mech = mech.astype(self.dtype).as_data()
        return rows.program(compiling.watched(mech), self.robot.tip, case.algorithm, PRECISIONS[case.who])

    def _takes_too_long(self, case):
        """A compilation cannot be stopped: that of a gradient of MJX's is guessed from the step's, which was first."""
        step = self.results.compiling.get(case._replace(algorithm=STEP)) if case.algorithm == GRADIENT_OF_STEP else None
        if step is None or MJX_GRADIENT * step.total <= self.options.mjx_budget:
            return False
        guess = f"about {MJX_GRADIENT * step.total:.0f} s to compile, more than {self.options.mjx_budget:g} s"
        self.left_out.append(f"{MJX}, {self.robot.name}, {case.algorithm}: {guess}")
        print(self.left_out[-1], flush=True)
        return True

    def _compared(self, calls):
        """The errors of what was computed."""
        for case, call in calls.items():
            n = None if case.algorithm == rows.BY_INERTIAS else 32
            states = self.states[case.batch].pinocchios("float64", n)
            expected = peers.expected(self.model, self.robot, case.algorithm, states)
            error = rows.error(self.orders, case.algorithm, case.who, call(), expected)
            if error is not None:
                self.results.errors[case] = error


def _told(case, found):
    what = f"{case.algorithm}, batch {case.batch}, {case.who}"
    return f"{what}: trace {found.trace:.2f} s, compile {found.compile:.2f} s"


def _options(arguments):
    parser = argparse.ArgumentParser(description="Dynamics of robots next to Pinocchio, MuJoCo, frax and MJX.")
    choices = {"robots": peers.ROBOTS, "dtypes": DTYPES, "rows": rows.ALGORITHMS, "peers": PEERS, "parts": PARTS}
    for name, known in choices.items():
        parser.add_argument(f"--{name}", nargs="+", choices=tuple(known), default=list(known))
    parser.add_argument("--programs", nargs="+", choices=rows.PROGRAMS, default=[OURS], help="ways to run ours")
    parser.add_argument("--batch", type=int, default=MANY, help="the main batch")
    parser.add_argument("--large", type=int, default=LARGE, help="the large batch")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--limit", type=float, default=25.0, help="seconds after which no round begins")
    parser.add_argument("--mjx-budget", type=float, default=30.0, help="seconds that a gradient of MJX may compile")
    parser.add_argument("--folder", type=pathlib.Path, default=peers.CACHE, help="keep the compiled libraries here")
    parser.add_argument("--write", action="store_true", help="write dynamics.md and dynamics.png, and the targets")
    parser.add_argument("--accept", action="store_true", help="with --write: keep ratios to Pinocchio that fell")
    parser.add_argument("--against", metavar="COMMIT", help="run this tree and a commit in turns, without peers")
    options = parser.parse_args(arguments)
    asked = all(getattr(options, name) == list(known) for name, known in choices.items())
    if options.write and not options.against and not (asked and (options.batch, options.large) == (MANY, LARGE)):
        parser.error("--write is for all rows, robots, dtypes, peers and parts, at the batches of the claims")
    if options.accept and (options.against or not options.write):
        parser.error("--accept is for --write, without --against")
    return options


PARTS = ("robots", "sizes")


def _measured(options, libraries, left_out):
    for robot in options.robots if "robots" in options.parts else ():
        for dtype in options.dtypes:
            with jax.enable_x64(dtype == "float64"):
                yield Robot(peers.ROBOTS[robot], dtype, libraries, options, left_out).measured()


def main(arguments=None):
    options, left_out, start = _options(arguments), [], time.perf_counter()
    if options.against:
        return against.main(options, timing.machine(), TABLE)
    libraries = peers.built(options.dtypes, options.folder, CORES) if "robots" in options.parts else {}
    built = time.perf_counter()
    compiling.prepare()
    results = list(_measured(options, libraries, left_out))
    sizes = (
        list(shapes.measured(options.batch, min(3, options.rounds), options.limit)) if "sizes" in options.parts else []
    )
    machine = f"{timing.machine()}, {peers.versions()}"
    spent = f"{built - start:.0f} s to build the C++ libraries, {time.perf_counter() - built:.0f} s to measure."
    table = "\n".join(report.lines(results, sizes, left_out, f"{machine}; {spent}"))
    claims = report.all_claims(results, sizes)
    print("\n".join(["", table, "", *report.lines_of_targets(claims), ""]))
    kept, found = guard.read(), guard.ratios(results)
    falls = guard.fallen(kept.ratios if kept else {}, found)
    print("\n".join([*guard.lines(kept, found, falls), ""]))
    if options.write:
        # The commit before files change.
        now = guard.Kept(two_commits.this_commit(), datetime.date.today().isoformat(), machine, found)
        TABLE.write_text(f"# Dynamics of robots\n\n![times](dynamics.png)\n\n{table}\n")
        report.TARGETS.write_text(report.with_targets(report.TARGETS.read_text(), claims))
        report.picture(results, HERE / "dynamics.png")
        if guard.is_to_be_kept(kept, falls, options.accept):
            guard.PLACE.write_text(guard.to_json(now))
        else:
            print(f"{guard.PLACE.name} is left as it was: --accept keeps ratios that fell.\n")
    return _verdict(claims) or int(bool(falls) and not options.accept)


def _verdict(found):
    """The exit status, with the list of what is not met."""
    missed = [x for x in found if not x.is_met]
    print(f"{len(found) - len(missed)} of {len(found)} claims met." + (" NOT MET:" if missed else ""))
    for x in missed:
        print(f"  {x.where}: {x.what}: {report.told(x)}, asked {report.asked(x)}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

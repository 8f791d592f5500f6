"""What a step with contact costs: convex_step beside mjx.step and semi_implicit_step, of quadrupeds on four feet.

A Go2 also stands on stairs, astride a riser: `js.Stairs` beside boxes of MJX.

    python tests/benchmarks/contact.py [--write]
    python tests/benchmarks/contact.py --against COMMIT [--write] [--robots ...]

Robots of example-robot-data, float32, dropped from up to 2 cm and held by a controller, at 5 ms a step. All cases of a
robot run in one process, on one core, alternately, after warm-up; ratios are taken round by round. MJX has the same
bodies, feet and controller, and its own law of contact: pyramidal cones, at most 8 iterations of Newton's method with
at most 8 of line search. Asserts the claims below; exit status 1 if one does not hold. `--write` renews contact.md
beside this file.

`--against COMMIT` runs our cases with two commits in turns, see `two_commits.py`. There `--write` adds them to the
table, as a section.
"""

import os

# One core, before XLA counts them.
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import argparse  # noqa: E402
import functools  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
from importlib.metadata import version  # noqa: E402
from typing import NamedTuple  # noqa: E402

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

import contact_against as against  # noqa: E402
import jax  # noqa: E402
import numpy as np  # noqa: E402
from contact_rows import (  # noqa: E402
    CALL,
    CONVEX,
    DT,
    GRADIENT,
    MJX,
    MJX_STAIRS,
    ON_STAIRS,
    ONE,
    PLAIN,
    RISE,
    ROBOTS,
    ROLLOUT,
    STAIRS,
    WITHOUT,
    calls,
    per_step,
)
from dynamics_compiling import made  # noqa: E402

from jaxspatial import measure  # noqa: E402

TABLE = HERE / "contact.md"
# Of the cases that end in a state: the place of the trunk's height in it, and the case that begins with the same.
HEIGHTS = {CONVEX: (6, CONVEX), MJX: (2, CONVEX), ONE: (6, CONVEX), STAIRS: (6, STAIRS), MJX_STAIRS: (2, STAIRS)}
# m, in the middle between the feet.
GROUND = {CONVEX: 0.0, STAIRS: 1.5 * RISE}


class Claim(NamedTuple):
    """`slower` takes at least `least`, or at most `most`, times as long as `faster`."""

    slower: str
    faster: str
    least: float = 0.0
    most: float = float("inf")
    robots: tuple[str, ...] = tuple(ROBOTS)


class Bound(NamedTuple):
    """A case takes at most so many us per state and step; or so many seconds to trace and compile."""

    case: str
    most: float
    robots: tuple[str, ...] = tuple(ROBOTS)
    of_compiling: bool = False


CLAIMS = (
    Claim(MJX, CONVEX, least=50.0, robots=("solo12",)),
    Claim(MJX_STAIRS, STAIRS, least=100.0, robots=ON_STAIRS),
    Claim(GRADIENT, ROLLOUT, most=4.5),
    Bound(CONVEX, 2),
    Bound(ONE, 12),
    Bound(CONVEX, 4, of_compiling=True),
    Bound(GRADIENT, 10, of_compiling=True),
)


def cases(name, n, steps):
    """(case -> compiled call, case -> seconds to trace and to compile), after a look at the results."""
    compiled, seconds, programs, found = {}, {}, {}, calls(name, n, steps)
    before = {case: np.asarray(found[case][1][0][:, 6]) - above for case, above in GROUND.items() if case in found}
    for case, (function, arguments) in found.items():
        lowered, program, seconds[case] = made(function, arguments)
        programs[case] = lowered.as_text()
        compiled[case] = functools.partial(repeated, program) if case == CALL else program
        compiled[case] = functools.partial(compiled[case], *arguments)
        if case in HEIGHTS:
            place, of = HEIGHTS[case]
            heights = np.asarray(compiled[case]()[0])[..., place] - GROUND[of]
            check_standing(f"{name}, {case}", heights, before[of])
        elif not all(np.isfinite(x).all() for x in jax.tree.leaves(compiled[case]())):
            raise AssertionError(f"{name}, {case}: not all numbers are finite")
    # No clock tells so much.
    if programs[WITHOUT] != programs[PLAIN]:
        raise AssertionError(f"{name}: without contacts the program is not that of semi_implicit_step")
    return compiled, seconds


def repeated(program, *state):
    """Calls a step a hundred times. The first call after other programs finds cold caches."""
    for _ in range(100):
        state = jax.block_until_ready(program(*state))
    return state


def check_standing(what, heights, before):
    """Raises unless all trunks are at a height at which robots stand: a NaN costs no iterations."""
    stand = (heights > 0.6 * before.min()) & (heights < 1.1 * before.max())
    if not stand.all():
        raise AssertionError(f"{what}: {np.count_nonzero(~stand)} of {stand.size} do not stand after the rollout")


def values(found, n, steps):
    """(robot, what is claimed, the value, what is asked, whether it holds) of all claims."""
    for name, (seconds, compiling) in found.items():
        for claim in CLAIMS:
            if name not in claim.robots:
                continue
            if isinstance(claim, Claim):
                value = float(np.median(seconds[claim.slower] / seconds[claim.faster]))
                asked = f"at least {claim.least}" if claim.least else f"at most {claim.most}"
                holds = claim.least <= value <= claim.most
                yield name, f"{claim.slower} over {claim.faster}", value, asked, holds
            elif claim.of_compiling:
                value = sum(compiling[claim.case])
                yield name, f"{claim.case}, s to trace and compile", value, f"at most {claim.most}", value <= claim.most
            else:
                value = float(np.median(seconds[claim.case]) / per_step(claim.case, n, steps) * 1e6)
                yield name, f"{claim.case}, us", value, f"at most {claim.most}", value <= claim.most


def lines(found, n, steps):
    yield f"{n} states, float32, rollouts of {steps} steps of {DT * 1e3:.0f} ms: medians of us per state and step (10 %"
    yield "to 90 % of all rounds), and seconds to trace and to compile. A call of one step is one of 100 in a row."
    yield f"{measure.machine()}, mujoco {version('mujoco')}, mujoco-mjx {version('mujoco-mjx')}"
    for name, (seconds, compiling) in found.items():
        yield f"\n| {name} | us | 10 % | 90 % | trace, s | compile, s |"
        yield "|---|---|---|---|---|---|"
        for case, each in seconds.items():
            low, middle, high = np.quantile(each / per_step(case, n, steps), [0.1, 0.5, 0.9]) * 1e6
            traced, compiled = compiling[case]
            yield f"| {case} | {middle:.3g} | {low:.3g} | {high:.3g} | {traced:.2g} | {compiled:.2g} |"
    for name, what, value, asked, holds in values(found, n, steps):
        yield f"\n{name}, {what}: {value:.3f}, {asked}: {'holds' if holds else 'DOES NOT HOLD'}."
    yield "\nWithout contacts, convex_step is the program of semi_implicit_step."


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What a step with contact costs.")
    parser.add_argument("--n", type=int, default=4096, help="states")
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--limit", type=float, default=300.0, help="with --against: seconds of a robot's rounds")
    parser.add_argument("--write", action="store_true", help="write the table to contact.md beside this file")
    parser.add_argument("--against", metavar="COMMIT", help="run our cases with this tree and a commit, in turns")
    options = parser.parse_args(arguments)
    if options.against:
        return against.main(options, measure.machine(), TABLE)
    found = {}
    for name in options.robots:
        compiled, compiling = cases(name, options.n, options.steps)
        found[name] = measure.interleaved(compiled, options.rounds), compiling
    table = "\n".join(lines(found, options.n, options.steps))
    print(table)
    if options.write:
        TABLE.write_text(f"# What a step with contact costs\n\n{table}\n")
    return 0 if all(holds for *_, holds in values(found, options.n, options.steps)) else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_compilation_cache", False)  # seconds to compile are those of a first call
    sys.exit(main())

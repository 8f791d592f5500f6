"""What inverse kinematics and closed loops cost, beside Pinocchio in C++.

    python tests/benchmarks/constraints.py [--write]

float32, on one core, all cases of a robot in one process, alternately, after warm-up; ratios are taken round by round.
Inverse kinematics is of a Panda, from one random configuration to the pose of another; the C++ program takes the same
steps, by Pinocchio's Jacobians and logarithms. Dynamics with closed loops is Pinocchio's `constraintDynamics`, with its
proximal iterations; Pinocchio closes no loops. Asserts the claims below; exit status 1 if one does not hold. `--write`
renews constraints.md beside this file.
"""

import os

# One core, before XLA counts them.
os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import argparse  # noqa: E402
import ctypes  # noqa: E402
import functools  # noqa: E402
import pathlib  # noqa: E402
import sys  # noqa: E402
from typing import NamedTuple  # noqa: E402

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

import dynamics_peers as peers  # noqa: E402
import jax  # noqa: E402
import numpy as np  # noqa: E402
from dynamics_compiling import made  # noqa: E402

import jaxspatial as js  # noqa: E402
from jaxspatial import measure  # noqa: E402
from tests.helpers import closed_loops  # noqa: E402

TABLE = HERE / "constraints.md"
FRAME = "panda_link7"
MOST, TOLERANCE, DAMPING, LONGEST = 20, 1e-4, 0.1, 1.0  # as `js.inverse_kinematics` has them
# Of proximal iterations: the accuracy that float32 allows, the weight, and how many at most.
PROXIMAL = 1e-6, 1e-5, 10
IK = "inverse kinematics of a Panda"
LOOPS = {
    "dynamics of a four-bar linkage": "four-bar",
    "dynamics of a ring of seven hinges": "hinges",
    "dynamics of two arms that hold each other": "arms",
}
REPEATS = 100  # of calls with one state
OURS, THEIRS, MANY, ONE, CLOSE = "ours", "Pinocchio", "ours, up to 30 starts", "ours, one state a call", "close_loops"


class Claim(NamedTuple):
    """`slower` takes at least `least` and at most `most` times as long as `case`; or the case, without a slower one, at
    most so many seconds to trace and compile."""

    what: str
    case: str
    slower: str | None = None
    least: float = 0.0
    most: float = float("inf")


CLAIMS = (
    Claim(IK, OURS, THEIRS, least=8.0),
    Claim(IK, MANY, THEIRS, least=2.0),
    Claim(IK, OURS, most=6.0),
    *(Claim(what, OURS, THEIRS, least=least) for what, least in zip(LOOPS, (12.0, 12.0, 6.0), strict=True)),
    *(Claim(what, OURS, CLOSE, most=5.0) for what in LOOPS),
)


# -- Pinocchio --------------------------------------------------------------------------------------------------------


def pointer(x):
    return ctypes.c_void_p(x.ctypes.data)


def numbers_of(placement):
    return np.ascontiguousarray(np.concatenate([placement.rotation.ravel(), placement.translation]), np.float32)


def single(x):
    return ctypes.c_float(x)


# -- inverse kinematics -----------------------------------------------------------------------------------------------


def of_inverse_kinematics(library, n, rounds):
    """(us a state, by case; seconds to trace and compile; lines about what was found)."""
    import pinocchio as pin

    robot = peers.ROBOTS["panda"]
    panda = js.Mechanism.from_urdf(robot.urdf.read_text(), dtype=np.float32)
    model = pin.buildModelFromUrdf(str(robot.urdf))
    peers.hand_over(model, library, model.getFrameId(FRAME))
    keys = jax.random.split(jax.random.key(0), 2)
    q, reached = (js.random_configuration(panda, key, n) for key in keys)
    X_WT = js.forward_kinematics(panda, reached, FRAME)
    key = jax.random.key(1)
    programs = {
        OURS: (lambda q, X: js.inverse_kinematics(panda, q, FRAME, X), (q, X_WT)),
        MANY: (lambda q, X: js.inverse_kinematics(panda, q, FRAME, X, starts=30, key=key), (q, X_WT)),
        ONE: (lambda q, X: js.inverse_kinematics(panda, q, FRAME, X), jax.tree.map(lambda x: x[0], (q, X_WT))),
    }
    begin, rows = np.array(q), np.concatenate([X_WT.rotation.to_matrix().reshape(n, 9), X_WT.translation], -1)
    rows, found, steps = np.ascontiguousarray(rows), np.empty_like(begin), np.empty(n, np.int32)
    numbers = map(single, (TOLERANCE, TOLERANCE, DAMPING, LONGEST))
    arguments = ctypes.c_long(n), pointer(begin), pointer(rows), MOST, *numbers, pointer(found), pointer(steps)
    seconds, compiling, results = timed(programs, lambda: library.inverse_kinematics(*arguments), rounds)
    error = X_WT.inverse_times(js.forward_kinematics(panda, found, FRAME)).log()
    are_solved = (np.linalg.norm(error.w, axis=-1) < 2 * TOLERANCE) & (np.linalg.norm(error.v, axis=-1) < 2 * TOLERANCE)
    solved = {OURS: results[OURS].is_solved, MANY: results[MANY].is_solved, THEIRS: are_solved}
    taken = {OURS: results[OURS].iterations, MANY: results[MANY].iterations, THEIRS: steps}
    if abs(np.mean(solved[OURS]) - np.mean(are_solved)) > 0.05:
        raise AssertionError(f"solved are {np.mean(solved[OURS])} of ours, {np.mean(are_solved)} by Pinocchio")
    told = [f"{case}: {np.mean(solved[case]):.0%} solved, {np.mean(taken[case]):.3g} steps a state." for case in solved]
    return per_state(seconds, n), compiling, told


# -- closed loops -----------------------------------------------------------------------------------------------------


def of_closed_loops(library, name, n, rounds):
    """As `of_inverse_kinematics`, of constrained_forward_dynamics and close_loops."""
    from tests.helpers import pinocchio_closures

    kind = closed_loops.CLOSURES[name][2]
    exact = closed_loops.closed(name, n)
    model = pinocchio_closures.model(exact.model)
    peers.hand_over(model, library, 0)
    for x in pinocchio_closures.closures(model, exact.model, kind):
        of_a, of_b = numbers_of(x.joint1_placement), numbers_of(x.joint2_placement)
        library.add_closure(int(kind == "weld"), x.joint1_id, pointer(of_a), x.joint2_id, pointer(of_b))
    mech = js.Mechanism.from_mjcf(closed_loops.mjcf(name), dtype=np.float32)
    loops = (js.LoopClosure("A", "B", kind),)
    state = [np.ascontiguousarray(x, np.float32) for x in (exact.q, exact.v, exact.tau)]
    off = state[0] + np.float32(0.05) * np.random.default_rng(0).standard_normal(state[0].shape, np.float32)
    programs = {
        OURS: (lambda *x: js.constrained_forward_dynamics(mech, *x, loops).vdot, state),
        ONE: (lambda *x: js.constrained_forward_dynamics(mech, *x, loops).vdot, [x[0] for x in state]),
        CLOSE: (lambda q: js.close_loops(mech, q, loops), [off]),
    }
    found = np.empty_like(state[1])
    arguments = ctypes.c_long(n), *map(pointer, state), *map(single, PROXIMAL[:2]), PROXIMAL[2], pointer(found)
    seconds, compiling, results = timed(programs, lambda: library.constrained_dynamics(*arguments), rounds)
    right = np.asarray(closed_loops.constrained(name, n).vdot)
    errors = {case: relative(x, right) for case, x in ((OURS, results[OURS]), (THEIRS, found))}
    told = [f"{case}: error {x:.1e} of the largest acceleration, half of the states." for case, x in errors.items()]
    return per_state(seconds, n), compiling, told


def relative(found, right):
    return np.median(abs(np.asarray(found, float) - right).max(-1) / abs(right).max(-1))


# -- all --------------------------------------------------------------------------------------------------------------


def timed(programs, theirs, rounds):
    """(seconds of each round by case, seconds to trace and compile, results)."""
    calls, compiling = {THEIRS: theirs}, {}
    for case, (function, arguments) in programs.items():
        _, program, compiling[case] = made(function, arguments)
        calls[case] = functools.partial(repeated, program, REPEATS if case == ONE else 1, arguments)
    results = {case: jax.block_until_ready(call()) for case, call in calls.items()}
    return measure.interleaved(calls, rounds), compiling, results


def repeated(program, count, arguments):
    """The first call after other programs finds cold caches."""
    for _ in range(count - 1):
        jax.block_until_ready(program(*arguments))
    return program(*arguments)


def per_state(seconds, n):
    return {case: 1e6 * x / (REPEATS if case == ONE else n) for case, x in seconds.items()}


def values(found):
    """(claim, its value, what is asked, whether it holds)."""
    for claim in CLAIMS:
        us, compiling, _ = found[claim.what]
        if claim.slower:
            what, value = f"{claim.slower} over {claim.case}", float(np.median(us[claim.slower] / us[claim.case]))
        else:
            what, value = f"{claim.case}, s to trace and compile", sum(compiling[claim.case])
        asked = f"at least {claim.least}" if claim.least else f"at most {claim.most}"
        yield claim, what, value, asked, claim.least <= value <= claim.most


def lines(found, n):
    yield f"{n} states, float32, one core: medians of us per state (10 % to 90 % of all rounds), and seconds to trace"
    yield f"and to compile. Our own code is compiled while JAX lowers. Calls of one state are {REPEATS} in a row."
    yield f"{measure.machine()}, {peers.versions()}"
    for what, (us, compiling, told) in found.items():
        yield f"\n| {what} | us | 10 % | 90 % | Pinocchio over it | trace, s | compile, s |"
        yield "|---|---|---|---|---|---|---|"
        for case, x in us.items():
            low, middle, high = np.quantile(x, [0.1, 0.5, 0.9])
            ratio = "" if case in (ONE, CLOSE) else f"{np.median(us[THEIRS] / x):.2g}"
            spent = [f"{s:.2g}" for s in compiling.get(case, ())] or ["", ""]
            yield f"| {case} | {middle:.3g} | {low:.3g} | {high:.3g} | {ratio} | {' | '.join(spent)} |"
        yield "\n" + "\n".join(told)
    for claim, what, value, asked, holds in values(found):
        yield f"\n{claim.what}, {what}: {value:.3g}, {asked}: {'holds' if holds else 'DOES NOT HOLD'}."


def main(arguments=None):
    parser = argparse.ArgumentParser(description="What inverse kinematics and closed loops cost.")
    parser.add_argument("--n", type=int, default=4096, help="states")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--folder", type=pathlib.Path, default=peers.CACHE, help="keep the compiled library here")
    parser.add_argument("--write", action="store_true", help="write the table to constraints.md beside this file")
    options = parser.parse_args(arguments)
    library = peers.built_from("constraints_pinocchio.cpp", "float32", options.folder)
    found = {IK: of_inverse_kinematics(library, options.n, options.rounds)}
    for what, name in LOOPS.items():
        found[what] = of_closed_loops(library, name, options.n, options.rounds)
    table = "\n".join(lines(found, options.n))
    print(table)
    if options.write:
        TABLE.write_text(f"# What inverse kinematics and closed loops cost\n\n{table}\n")
    return 0 if all(holds for *_, holds in values(found)) else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_compilation_cache", False)  # seconds to compile are those of a first call
    sys.exit(main())

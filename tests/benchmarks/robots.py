"""How far every robot of example-robot-data is from Pinocchio, in every algorithm of tests/helpers/pinocchio_models.py.

    python tests/benchmarks/robots.py [NAME ...] [--write] [--kept FILE]

Takes an hour on one core. Exit status 1 if an error is larger than allowed. `--write` renews tests/peers/robots.md;
`--kept` appends every robot's errors to a file, and takes up what is in it.
"""

import argparse
import gc
import importlib.metadata
import json
import pathlib
import sys

import jax
import numpy as np

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.helpers import pinocchio_models as models  # noqa: E402

PACKAGES = "jax", "jaxlib", "numpy", "pin", "example-robot-data", "lxml"

HEAD = """# Robots against Pinocchio

Written by `tests/benchmarks/robots.py`. Of {which} in example-robot-data, with a fixed and with a floating base: the
largest relative error over all algorithms below and {n} random states, against Pinocchio in float64, and the algorithm
that has it. An error is relative to the largest number of the result, over all states. Inputs are numbers that the
dtype has, the same for both; robots are evaluated op by op, which has the bits of the compiled program
(`test_dynamics_pinocchio.py` shows it).

Allowed: 1e-12 in float64, 2e-5 in float32. What has to do with the inverse of the mass matrix M, on the right, may have
a multiple of u cond(M) where that is more (marked +): 8 what multiplies by M^-1, 1 what goes by articulated bodies,
with u = 2^-53 and 2^-24, and cond(M) in units that make its diagonal 1. Pinocchio's own results have such errors:

- `double_pendulum_continuous`, floating: its derivatives of forward dynamics with respect to v are 5e-12 from those in
  twice the precision, ours 2e-13. In float32 `jax.jacfwd` of our `forward_dynamics` is ten times as accurate as the
  closed form is.
- `icub`: its head is a point mass that three joints turn, some 1e8 rad/s2 under 1 N m. Pinocchio's forward dynamics are
  1.4e-10 from ours in twice the precision, ours 2.6e-13; in float32 ours are 1.4e-4.

No inverse is compared where M is singular up to the rounding of the dtype.

{versions}

Algorithms: {algorithms}.

By the inverse of M: {by_inverse}.
"""

CONVENTIONS = """
## What differs by convention

Converted by the tests: `pinocchio_models.py`, `test_dynamics_drake.py`, `test_dynamics_mujoco.py`, `interop/mujoco`.

| | here | Pinocchio | MuJoCo | Drake |
|---|---|---|---|---|
| parts of spatial vectors | rotational first | translational first | rotational first, but for free joints and forces \
on bodies | rotational first |
| acceleration of a body | classical, of its origin | spatial; `getFrameClassicalAcceleration` is ours | spatial, with \
gravity (`cacc`) | classical |
| coordinates of a free joint | quaternion, position | position, quaternion | position, quaternion | quaternion, \
position |
| quaternions | wxyz | xyzw | wxyz | wxyz |
| rates of a free joint | in the axes of the body | in the axes of the body | linear in world axes, angular in those \
of the body | in world axes |
| continuous joint | an angle | cosine and sine | an angle | an angle |
| order of joints | depth first, children as in the file | depth first, children by name | depth first | depth first |
| mimics | none of their own: the coordinate is the master's, which feels what they feel | coordinates of their own, \
unless asked for; most algorithms then refuse them | soft constraints between coordinates | constraints between \
coordinates |
| fixed joints | bodies merged, frames kept | bodies merged, frames kept | merged where asked for | bodies of their \
own |
| links welded to the world | in no sum | in no sum | in the centre of mass | in centre of mass and potential energy |
| bias | with gravity | with gravity (`nonLinearEffects`) | with gravity (`qfrc_bias`) | without (`CalcBiasTerm`) |
| damping, friction, limits | carried, part of no algorithm | carried, part of no algorithm | in forward dynamics | \
damping in forward dynamics |
| root link called "world" | is the world, and cannot float | floats like any other | is the world | is the world |
| a tip without mass or armature, pushed | its rate keeps vdot = 0 | NaN | model refused | raises an error |

Why ours: one order of parts for all spatial vectors. Rates of a body do not depend on how it is turned, so that a
floating base reads as every other joint does. A continuous joint is a revolute one without limits. A coordinate that
is none of its own costs nothing. What is not of the tree (damping, friction, limits, contact) is for the caller to
apply, from numbers that the mechanism carries. What cannot move is no part of what moves.
"""


def measured(name, floating_base):
    """What the table says of a robot: sizes, and the errors by dtype and algorithm; or why it was refused."""
    try:
        mech = models.load(name, floating_base)[1]
    except ValueError as error:
        return {"refused": str(error)}
    t = mech.topology
    found = {"bodies": len(t), "nq": mech.nq, "nv": mech.nv, "mimics": sum(map(t.is_mimic, range(len(t))))}
    return found | ({"nothing moves": True} if not mech.nv else _compared(name, floating_base))


def _compared(name, floating_base):
    """The condition of the mass matrix, and [error, allowed] by dtype and algorithm."""
    states = {dtype: models.States(name, floating_base, dtype) for dtype in models.ALLOWED}
    errors = {dtype: {what: _error(s, what) for what in s.compared()} for dtype, s in states.items()}
    return {"condition": states["float64"].condition, "errors": errors}


def _error(s, what):
    return s.error(what, is_compiled=False), s.allowed(what)


def fingerprint(name, floating_base):
    """The same of robots that dynamics cannot tell apart."""
    try:
        mech = models.load(name, floating_base)[1]
    except ValueError:
        return name, floating_base
    t = mech.topology
    numbers = [mech.placements, mech.child_placements, mech.axes, mech.mimics, mech.inertias]
    return floating_base, t.kinds, t.parents, t.followed, *(x.tobytes() for x in jax.tree.leaves(numbers))


# -- report -----------------------------------------------------------------------------------------------------------


def holds(row):
    """NaN does not."""
    both = [x for errors in row.get("errors", {}).values() for x in errors.values()]
    return all(error <= allowed for error, allowed in both)


def line(name, floating_base, row, twin):
    sizes = " | ".join(str(row[x]) for x in ("bodies", "nq", "nv", "mimics"))
    return f"| {name} | {_base(floating_base)} | {sizes} | {_text(row, twin)} |"


def _text(row, twin):
    if twin or "nothing moves" in row:
        return " | ".join([f"as {twin}" if twin else "nothing moves", *[""] * 4])
    has_inverse = not models.BY_INVERSE.keys().isdisjoint(row["errors"]["float64"])
    condition = f"{row['condition']:.0e}" if has_inverse else "singular"
    groups = [(group, dtype) for group in (False, True) for dtype in models.ALLOWED]
    return " | ".join([condition, *(_largest(row["errors"][dtype], *x) for *x, dtype in groups)])


def _largest(errors, is_by_inverse):
    """The largest, marked where it is allowed for the condition's sake."""
    own = {what: x for what, x in errors.items() if (what in models.BY_INVERSE) == is_by_inverse}
    if not own:
        return ""
    what = max(own, key=lambda what: own[what][0] if own[what][0] == own[what][0] else np.inf)
    error, _ = own[what]
    is_allowed = all(error <= allowed for error, allowed in own.values())
    is_more = error > min(allowed for _, allowed in errors.values())
    return f"{error:.1e} {what}" + (" +" * is_more if is_allowed else " **more than allowed**")


def _base(floating_base):
    return "floating" if floating_base else "fixed"


def report(rows, twins):
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    by_inverse = [what for what in models.ALGORITHMS if what in models.BY_INVERSE]
    others = "; ".join(what for what in models.ALGORITHMS if what not in models.BY_INVERSE)
    n, known = len({name for name, _ in rows}), len(models.ROBOTS)
    which = f"all {n} robots" if n == known else f"{n} of the {known} robots"
    yield HEAD.format(which=which, n=models.N, versions=versions, algorithms=others, by_inverse="; ".join(by_inverse))
    of_errors = [f"{dtype}{group}" for group in ("", ", by the inverse") for dtype in models.ALLOWED]
    columns = ["robot", "base", "bodies", "nq", "nv", "mimics", "cond(M)", *of_errors]
    yield f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}"
    read = {case: row for case, row in rows.items() if "refused" not in row}
    yield "\n".join(line(*case, row, twins.get(case)) for case, row in read.items())
    yield "\n## Refused\n\n| robot | base | message |\n|---|---|---|"
    yield "\n".join(f"| {n} | {_base(b)} | {row['refused']} |" for (n, b), row in rows.items() if "refused" in row)
    yield CONVENTIONS


def main(arguments=None):
    parser = argparse.ArgumentParser(description="How far every robot of example-robot-data is from Pinocchio.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="of robots; all of them where none is given")
    parser.add_argument("--write", action="store_true", help="write the table to tests/peers/robots.md")
    parser.add_argument("--kept", type=pathlib.Path, help="a file of errors found, one robot per line")
    options = parser.parse_args(arguments)
    # What tracing makes is alive until the end: to look for garbage in it over and over takes a third of the time.
    gc.disable()
    rows, twins = _rows(options.names or list(models.ROBOTS), options.kept)
    text = "\n".join(report(rows, twins))
    print(text)
    if options.write:
        (ROOT / "tests/peers/robots.md").write_text(text)
    return 0 if all(map(holds, rows.values())) else 1


def _rows(names, kept):
    """({(name, base): what was measured}, {(name, base): the robot that is the same, which comes first})."""
    found, firsts, twins = _kept(kept), {}, {}
    cases = [(name, base) for name in names for base in (False, True)]
    for case in cases:
        first = firsts.setdefault(fingerprint(*case), case[0])
        if first != case[0]:
            twins[case] = first
            found[case] = found[first, case[1]]
        elif case not in found:
            found[case] = measured(*case)
            _keep(kept, case, found[case])
            print(*case, found[case].get("refused", f"holds: {holds(found[case])}"), file=sys.stderr, flush=True)
    return {case: found[case] for case in cases}, twins


def _kept(kept):
    lines = kept.read_text().splitlines() if kept and kept.exists() else []
    return {(name, base): row for name, base, row in map(json.loads, lines)}


def _keep(kept, case, row):
    if kept:
        with kept.open("a") as file:
            file.write(json.dumps([*case, row]) + "\n")
    jax.clear_caches()
    gc.collect()


if __name__ == "__main__":
    sys.exit(main())

"""How many small faults the tests see: a sample of mutants of the formulas, each run against the tests beside its file.

    python tests/benchmarks/mutants.py [--n 35] [--seed 0] [--minutes 40] [--only numerics spatial] [--write]

Faults are cosmic-ray's: an operator of arithmetic or comparison replaced by another, a number off by one, a sign, a
`not`, an `and` or a decorator changed, where results may depend on it. Drawn evenly over the places where one is
possible, folder by folder, from a seed. They are planted in a copy; nothing changes in this tree. One process of tests
at a time. Exit status 1 if a mutant survives that is not explained below. `--write` renews the table beside this file.
"""

import argparse
import ast
import difflib
import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[1]
COPIED = ("jaxspatial", "tests", "notebooks", "pyproject.toml", "README.md")
TIMEOUT = 300


class Folder(NamedTuple):
    """share: of the mutants drawn; tests: fast files beside it, run after the one that is named as the mutated file."""

    share: int
    tests: tuple


FOLDERS = {
    "numerics": Folder(
        3,
        (
            "numerics/numbers/test_folding.py",
            "numerics/numbers/test_polynomial.py",
            "numerics/test_precision.py",
            "numerics/sums/test_sums.py",
            "numerics/numbers/test_numbers.py",
            "numerics/numbers/test_components.py",
            "rotation/test_angles.py",
            "spatial/test_quantities.py",
            "numerics/numbers/test_double_word.py",
        ),
    ),
    "spatial": Folder(
        3,
        (
            "spatial/test_wrench.py",
            "spatial/test_vector.py",
            "spatial/test_motion_force.py",
            "spatial/test_errors.py",
            "inertia/test_newton_euler.py",
            "spatial/test_quantities.py",
            "spatial/test_left_out.py",
        ),
    ),
    "inertia": Folder(
        3,
        (
            "inertia/test_reduction.py",
            "inertia/test_parameters.py",
            "inertia/test_articulated.py",
            "inertia/test_newton_euler.py",
            "inertia/test_inertia.py",
            "inertia/test_validity.py",
            "inertia/test_shapes.py",
        ),
    ),
    "rotation": Folder(
        3,
        (
            "rotation/test_rotation.py",
            "rotation/test_directions.py",
            "rotation/test_conversions.py",
            "rotation/test_exponential.py",
        ),
    ),
    "engine": Folder(
        1,
        (
            "engine/test_native_programs.py",
            "dynamics/test_programs.py",
            "dynamics/test_frames.py",
            "dynamics/test_loads.py",
            "dynamics/test_jacobians.py",
        ),
    ),
    "dynamics": Folder(
        1,
        (
            "dynamics/test_steps.py",
            "dynamics/test_loads.py",
            "dynamics/test_laws.py",
            "dynamics/test_jacobians.py",
        ),
    ),
    "contact": Folder(1, ("contact/test_convex_step.py", "contact/test_explicit.py", "contact/test_closed_loops.py")),
}
# What is run last, of whatever folder.
OF_ALL = (
    "test_promises.py",
    "test_docstrings.py",
    "laws/test_extremes.py",
    "laws/test_error_bounds.py",
    "inertia/test_validity.py",
)

# Operators that make a fault which anything would see, shifts and bits of floating point for instance, tell nothing.
KINDS = ("Add", "Sub", "Mul", "Div", "Eq", "NotEq", "Lt", "LtE", "Gt", "GtE")
OTHERS = (
    "NumberReplacer",
    "AddNot",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceContinueWithBreak",
    "RemoveDecorator",
)

# (file, the mutated line) -> why no test can see it.
EQUIVALENT: dict[tuple[str, str], str] = {
    (
        "rotation/quaternion.py",
        "is_proper = (high(determinant) > -1) & (high(determinant) < math.inf)",
    ): "equivalent: the mean of s and 1/s takes singular values to 1 or more, so determinants from -1 to 0 to -1 or "
    "less, which the next step refuses; 0 is divided by",
    (
        "rotation/rotation.py",
        "return R @ exponential.rotation(t[ -1] * exponential.rotation_vector(R.T @ S))",
    ): "equivalent: t is one number",
    (
        "rotation/quaternion.py",
        "length = where(is_zero, 2.0, total).sqrt()",
    ): "equivalent: what is divided by it is 0",
    (
        "dynamics/articulated_bodies.py",
        "x = where(is_none, 0.0, (u - dot((*U.tau, *U.f), (*A.w, *A.v))) / where(is_none, 2.0, D))",
    ): "equivalent: what is divided by it is not used",
    (
        "dynamics/forward_dynamics.py",
        "return bind(solve, [*primals[: source.place(source.n_fields + 1)], *factors, force], n_batch)[ -1]",
    ): "equivalent: there is one result",
    (
        "engine/state.py",
        "flat = np.array([min(j, L - 1) * W + min(c, W + 1) for j, c in places])",
    ): "equivalent: of one chain there is one row, and an index past the end is the last one",
    (
        "numerics/linear.py",
        "return [result[i] for i in range(len(lists[ -1]))]",
    ): "equivalent: all lists are as long",
}


class Mutant(NamedTuple):
    file: str  # below jaxspatial/
    line: int
    before: str
    after: str
    source: str

    @property
    def folder(self):
        return self.file.split("/")[0]

    @property
    def tests(self):
        """The files that are run, the one named as this file first."""
        path = pathlib.PurePath(self.file)
        own = str(path.with_name(f"test_{path.name}"))
        beside = FOLDERS[self.folder].tests + OF_ALL
        return tuple(dict.fromkeys((own, *beside))) if (ROOT / "tests" / own).exists() else beside


class Outcome(NamedTuple):
    mutant: Mutant
    verdict: str  # killed, timeout, survived
    by: str  # the test that failed, or why none can
    seconds: float


def operators():
    """cosmic-ray's, by name."""
    from cosmic_ray import plugins

    return {name: plugins.get_operator(name)() for name in plugins.operator_names() if _is_kept(name.split("/")[1])}


def _is_kept(name):
    kind, _, change = name.partition("_")
    if kind in ("ReplaceBinaryOperator", "ReplaceComparisonOperator"):
        return all(word in KINDS for word in change.split("_"))
    return name in OTHERS


def places(path, found):
    """{start: [(operator, occurrence)]} of every place of a file that can be mutated."""
    from cosmic_ray.ast import ast_nodes, get_ast_from_path

    tree, at = get_ast_from_path(path), {}
    for operator in found.values():
        starts = [start for node in ast_nodes(tree) for start, _ in operator.mutation_positions(node)]
        for occurrence, start in enumerate(starts):
            at.setdefault(tuple(start), []).append((operator, occurrence))
    return at


def mutants(folder, rng):
    """The mutants of a folder in an order drawn by rng: places first, then what is done there."""
    found = operators()
    files = {path: places(path, found) for path in sorted((ROOT / "jaxspatial" / folder).rglob("*.py"))}
    drawn = [(path, start) for path, at in files.items() for start in sorted(at)]
    rng.shuffle(drawn)
    for path, start in drawn:
        if mutant := _mutant(path, *rng.choice(files[path][start])):
            yield mutant


def _mutant(path, operator, occurrence):
    """None where the result is no Python, or says the same."""
    from cosmic_ray.mutating import mutate_code

    source = path.read_text()
    mutated = mutate_code(source, operator, occurrence)
    if mutated is None or not _is_other_program(source, mutated):
        return None
    old, new = source.splitlines(), mutated.splitlines()
    changes = [c for c in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes() if c[0] != "equal"]
    _, i, j, k, m = changes[0]
    before, after = (" ".join(filter(_is_code, map(str.strip, lines))) for lines in (old[i:j], new[k:m]))
    first = next(n for n in range(i, j) if _is_code(old[n].strip()))
    return Mutant(str(path.relative_to(ROOT / "jaxspatial")), first + 1, before, after, mutated)


def _is_code(line):
    return line and not line.startswith("#")


class _Computed(ast.NodeTransformer):
    """What of a program makes its results: no types for a checker, no `strict` of our zips, no calls left as calls."""

    def visit_If(self, node):
        return None if "TYPE_CHECKING" in ast.unparse(node.test) else self.generic_visit(node)

    def visit_keyword(self, node):
        return None if node.arg == "strict" else self.generic_visit(node)

    def visit_FunctionDef(self, node):
        node.decorator_list = [x for x in node.decorator_list if "noinline" not in ast.unparse(x)]
        return self.generic_visit(node)


def _is_other_program(source, mutated):
    try:
        first, second = (ast.dump(_Computed().visit(ast.parse(x))) for x in (source, mutated))
    except SyntaxError:
        return False
    return first != second


def sample(n, seed, only):
    """n mutants, folder by folder, in proportion to their shares."""
    folders = {name: f for name, f in FOLDERS.items() if name in only}
    whole = sum(f.share for f in folders.values())
    drawn = []
    for name, f in folders.items():
        stream = mutants(name, random.Random(f"{seed} {name}"))
        drawn.append([m for m, _ in zip(stream, range(round(n * f.share / whole)), strict=False)])
    # In turns, so that what a time limit leaves is of all folders.
    return [m[k] for k in range(max(map(len, drawn))) for m in drawn if k < len(m)]


class Copy:
    """The library and its tests in another place, where faults are planted."""

    def __init__(self, root):
        self.root = root
        for name in COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, root / name)
        # Programs that a fault does not change need not be compiled again.
        cache = {"JAX_COMPILATION_CACHE_DIR": os.environ.get("JAX_COMPILATION_CACHE_DIR", root / "programs")}
        cache |= {f"JAX_PERSISTENT_CACHE_MIN_{what}": -1 for what in ("COMPILE_TIME_SECS", "ENTRY_SIZE_BYTES")}
        more = {"PYTHONPATH": root, "PYTHONDONTWRITEBYTECODE": 1, **cache}
        self.environment = {**os.environ, **{key: str(value) for key, value in more.items()}}

    def tested(self, tests):
        """(exit status or None after a timeout, the first failure)."""
        files = [f"tests/{name}" for name in tests]
        command = [sys.executable, "-m", "pytest", "-x", "-n", "0", "-q", "--tb=no", "-p", "no:cacheprovider", *files]
        try:
            run = subprocess.run(
                command, cwd=self.root, env=self.environment, capture_output=True, text=True, timeout=TIMEOUT
            )
        except subprocess.TimeoutExpired:
            return None, "time"
        assert run.returncode in (0, 1, 2), run.stdout + run.stderr  # else pytest was asked for what is not there
        failed = [line.split(" ")[1] for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return run.returncode, failed[0].removeprefix("tests/") if failed else f"exit status {run.returncode}"

    def outcome(self, mutant):
        path, start = self.root / "jaxspatial" / mutant.file, time.monotonic()
        source = path.read_text()
        path.write_text(mutant.source)
        try:
            status, by = self.tested(mutant.tests)
        finally:
            path.write_text(source)
        seconds = time.monotonic() - start
        if status == 0:
            return Outcome(mutant, "survived", EQUIVALENT.get((mutant.file, mutant.after), "NOT EXPLAINED"), seconds)
        return Outcome(mutant, "timeout" if status is None else "killed", by, seconds)


def run(drawn, minutes):
    """Outcomes, until the time is over; the tests must pass without a fault first."""
    end = time.monotonic() + 60 * minutes
    with tempfile.TemporaryDirectory() as root:
        copy = Copy(pathlib.Path(root))
        passed = set()
        for mutant in drawn:
            for tests in {(name,) for name in mutant.tests} - passed:
                status, by = copy.tested(tests)
                assert status == 0, f"{tests[0]} fails without a fault: {by}"
                passed.add(tests)
            if time.monotonic() > end:
                return
            yield copy.outcome(mutant)


def line(outcome):
    m = outcome.mutant
    code = [f"`{_shown(x)}`" for x in (m.before, m.after)]
    return (
        f"| {m.file}:{m.line} | {code[0]} | {code[1]} | {outcome.verdict} | {outcome.by.replace('|', chr(92) + '|')} |"
    )


def _shown(code):
    return code.replace("|", "\\|") or " "


def summary(outcomes, drawn, seed):
    """Paragraphs on what was run."""
    git = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    yield f"Lines and folders are those of commit {git.stdout.strip()}.\n"
    survived = [o for o in outcomes if o.verdict == "survived"]
    explained = sum(o.by != "NOT EXPLAINED" for o in survived)
    yield (
        f"Seed {seed}: {len(drawn)} mutants drawn, {len(outcomes)} run in the time given. Tests were written for what "
        "survived of seeds 0 to 2, so that they say little by now: another seed draws another sample.\n"
    )
    yield (
        f"{len(outcomes) - len(survived)} killed by the tests beside them, {len(survived)} survived; of these "
        f"{explained} equivalent, {len(survived) - explained} not explained.\n"
    )
    for name, folder in FOLDERS.items():
        mine = [o for o in outcomes if o.mutant.folder == name]
        killed = sum(o.verdict != "survived" for o in mine)
        yield f"- {name}: {killed} of {len(mine)}, by what is named as the mutated file, {', '.join(folder.tests)}"
    yield f"- last of all: {', '.join(OF_ALL)}"


def main(arguments=None):
    parser = argparse.ArgumentParser(description="How many small faults the tests see.")
    parser.add_argument("--n", type=int, default=35)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=40)
    parser.add_argument("--only", nargs="+", choices=FOLDERS, default=list(FOLDERS))
    parser.add_argument("--write", action="store_true", help="write the table to mutants.md beside this file")
    options = parser.parse_args(arguments)
    drawn, outcomes = sample(options.n, options.seed, options.only), []
    table = ["| where | before | after | | by |", "|---|---|---|---|---|"]
    print("\n".join(table), flush=True)
    for outcome in run(drawn, options.minutes):
        outcomes.append(outcome)
        table.append(line(outcome))
        print(table[-1], flush=True)
    text = "\n".join([*summary(outcomes, drawn, options.seed), "", *table])
    print("\n".join(summary(outcomes, drawn, options.seed)))
    if options.write:
        (HERE / "mutants.md").write_text(f"# Small faults, and whether the tests see them\n\n{text}\n")
    return int(any(o.by == "NOT EXPLAINED" for o in outcomes))


if __name__ == "__main__":
    sys.exit(main())

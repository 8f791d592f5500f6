"""The pages for users of other libraries: both columns of each row run on the same robot, and their numbers agree."""

import ast
import contextlib
import functools
import pathlib
import re
import warnings

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.numerics.quantity import Quantity
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs
from tests.helpers.pages import examples
from tests.helpers.soon import compiled_soon

FOLDER = pathlib.Path(__file__).parent.parent.parent / "notebooks"
# What follows a heading about members is C++; tests/test_readme.py runs our column of it.
PAGES = {
    name: (FOLDER / f"coming_from_{name}.md").read_text().partition("\n## SpatialForce, member by member\n")[0]
    for name in ("pinocchio", "mujoco", "brax", "frax", "drake")
}
# Of both columns, relative to the largest number: in float64, and in float32, where inverses of mass matrices are.
ALLOWED = {"pinocchio": 1e-11, "mujoco": 1e-11, "drake": 1e-11, "brax": 2e-4, "frax": 2e-4}
pytestmark = [
    # Brax reads attributes that MJX has moved, and says that it is no longer developed.
    pytest.mark.filterwarnings("ignore:Accessing .* from `Data` is deprecated:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:Brax System, piplines:UserWarning"),
    pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning"),
    pytest.mark.filterwarnings("ignore:.*frax.*:UserWarning"),
]


def rows(text):
    """(theirs, ours) of every row of the tables of calls, as code."""
    lines = [
        line for line in text.splitlines() if line.startswith("| ") and not re.match(r"\| \w+ \| jaxspatial \|", line)
    ]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    return [(theirs.strip("| `"), ours.strip("| `")) for theirs, ours, *_ in cells]


@contextlib.contextmanager
def numbers_of(name):
    """float64 where a page has it; libraries mix dtypes and ranks. Compiled in "fast", which takes the least time."""
    with jax.enable_x64(name in ("pinocchio", "mujoco", "drake")), js.default_precision("fast"), compiled_soon():
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            yield


@functools.cache
def scope(name):
    """What the code of a page defines."""
    needs({"mujoco": "mujoco.mjx", "brax": "brax.io.mjcf", "drake": "pydrake"}.get(name, name))
    found = {}
    with numbers_of(name), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for block in examples(PAGES[name]):
            exec(block, found)
    return found


def evaluated(code, names):
    """The value of the last expression of a cell, after the statements before it."""
    *before, last = ast.parse(code.replace("; ", "\n")).body
    exec(compile(ast.Module(before, []), "row", "exec"), names)
    return eval(compile(ast.Expression(last.value), "row", "eval"), names)


def ours_evaluated(code, names):
    """As `evaluated`, of what is ours without compiling it: in NumPy, operation by operation."""
    arrays = {key: x for key, x in names.items() if isinstance(x, np.ndarray) and re.search(rf"\b{key}\b", code)}
    arrays = {key: x for key, x in arrays.items() if x.dtype.kind == "f"}
    if "js." not in code or "random" in code:
        return evaluated(code, names)
    return interpreted(lambda arrays: evaluated(code, names | arrays))(arrays)


def numbers(x):
    """A result of any library as one array; six components with the rotational part first."""
    kind = type(x).__module__.split(".")[0]
    if kind.startswith("pinocchio"):
        return _of_pinocchio(x)
    if kind == "pydrake":
        return np.array(x.GetAsMatrix4() if hasattr(x, "GetAsMatrix4") else x.get_coeffs())
    if kind == "brax":
        return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(_of_brax(x))])
    if isinstance(x, Quantity):
        return numbers(x.to_array() if hasattr(x, "to_array") else x.to_matrix())
    if isinstance(x, (tuple, list)):
        return np.stack([numbers(part) for part in x])
    return np.asarray(x)


def _of_pinocchio(x):
    kind = type(x).__name__
    if kind in ("Force", "Motion"):
        return np.concatenate([x.angular, x.linear])
    if kind == "SE3":
        return np.array(x.homogeneous)
    return np.asarray(js.interop.pinocchio.from_inertia(x).to_matrix())


def _of_brax(x):
    """Transforms as matrices, like ours."""
    return js.interop.brax.from_transform(x).to_matrix() if hasattr(x, "rot") else (x.ang, x.vel)


LONG = (
    "mjx.", "jax.jit(mjx.", "jax.vmap(lambda x: mjx.", "jax.jacobian(robot", "jax.vmap(lambda x: kinematics.",
    "jax.jit(pipeline.step)", "jax.vmap(robot.",
)  # fmt: skip


def cases():
    """Every row; what others compile for many seconds, in the slow lane."""
    for name, text in PAGES.items():
        for i, (theirs, _) in enumerate(rows(text)):
            is_long = theirs.startswith(LONG)
            yield pytest.param(name, i, marks=[pytest.mark.slow] if is_long else [])


@pytest.mark.parametrize(("name", "row"), list(cases()))
def test_both_columns_agree(name, row):
    theirs, ours = rows(PAGES[name])[row]
    names = dict(scope(name))
    with numbers_of(name):
        expected = numbers(evaluated(theirs, names))
        if expected.dtype.kind in "OUSb":
            assert (expected == numbers(evaluated(ours, names))).all()
            return
        found = numbers(ours_evaluated(ours, names))
    if re.search(r"\.rot$|xquat|quat_mul|quat_rot_axis", theirs):  # q and -q are one rotation
        expected, found = expected * np.sign(expected[..., :1]), found * np.sign(found[..., :1])
    found = found.reshape(expected.shape)
    finite = np.isfinite(expected)
    assert (finite == np.isfinite(found)).all() and expected.size
    np.testing.assert_allclose(
        found[finite], expected[finite], rtol=0, atol=ALLOWED[name] * max(abs(expected[finite]).max(), 1e-3)
    )


@pytest.mark.parametrize("name", PAGES)
def test_every_table_is_read(name):
    """A row that is not understood would go untested."""
    tables = re.findall(r"^\|---\|---\|---\|$", PAGES[name], re.M)
    lines = [line for line in PAGES[name].splitlines() if line.startswith("|")]
    assert len(rows(PAGES[name])) == len(lines) - 2 * len(tables) >= 20
    assert all(theirs and ours and "`" not in theirs + ours for theirs, ours in rows(PAGES[name]))

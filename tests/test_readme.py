"""What the README and the pages of the documentation say runs."""

import importlib.metadata
import inspect
import os
import pathlib
import re
import subprocess
import sys
import tomllib
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism.joints import BUILT_IN
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.optional import needs
from tests.helpers.pages import examples, faults, run
from tests.helpers.soon import compiled_soon
from tests.interop import test_ros
from tests.test_architecture import LAYERS

ROOT = pathlib.Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
PAGES = {path.name: path.read_text() for path in sorted((ROOT / "notebooks").glob("*.md"))}
# Imported by pages, and brought by the extra `peers`.
OPTIONAL = ("equinox", "flax", "optax", "orbax.checkpoint")


def _table(text, heading):
    """The cells of the table under a heading, without its head."""
    section = re.split(rf"^#+ {heading}\n", text, flags=re.M)[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def _told():
    """All that users read: pages, notebooks, docstrings and messages, by path."""
    paths = [ROOT / "README.md", *(ROOT / "notebooks").iterdir(), *(ROOT / "jaxspatial").rglob("*.py")]
    return {str(path.relative_to(ROOT)): path.read_text() for path in paths if path.suffix in (".md", ".ipynb", ".py")}


def test_what_is_told_to_install_can_be_installed():
    """Before a release from a clone alone, with extras that there are."""
    assert "## 0.2.0, not published yet" in PAGES["releases.md"], "published: say `pip install jaxspatial`"
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    found = []
    for path, text in _told().items():
        assert not re.findall(r"pip install[^\n`&]*jaxspatial|[\"']jaxspatial\[", text), path
        found += re.findall(r"pip install[^\n`]*\.\[([\w,]+)\]", text)
    assert len(found) >= 10 and {extra for names in found for extra in names.split(",")} <= set(extras)


ROBOTS_ARE_THERE = "example-robot-data" in {x.metadata["Name"] for x in importlib.metadata.distributions()}


@pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")
def test_the_first_lines_of_first_steps_run(capsys):
    """Those that end in a number; the rest compiles for long."""
    if not ROBOTS_ARE_THERE:
        pytest.skip("the extra peers has the robots")
    run(examples(README)[:1])
    assert capsys.readouterr().out == "joint 4 holds 22 N m, 25% of its limit\n"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")
def test_first_steps_run(capsys, tmp_path, monkeypatch):
    """What they print is told; the gradient is that of the squares of the torques, by differences in float64."""
    if not ROBOTS_ARE_THERE:
        pytest.skip("the extra peers has the robots")
    arm, more, contact = examples(README)
    assert sum(bool(line) for line in arm.splitlines()) <= 10
    monkeypatch.chdir(tmp_path)
    scope = run([arm, more, contact])
    holds, reach, on_ground = capsys.readouterr().out.splitlines()
    assert holds == "joint 4 holds 22 N m, 25% of its limit" and f"`{holds}`" in README
    share = int(re.fullmatch(r"(\d+)% of 1000 arms reach the point", reach)[1])
    assert 80 < share <= 100 and (tmp_path / "panda.png").exists()
    panda, q = scope["panda"], np.asarray(scope["many"])
    p_WT = js.forward_kinematics(panda, scope["found"].q, "panda_hand_tcp").translation
    is_there = np.linalg.norm(np.asarray(p_WT) - [0.5, 0.2, 0.4], axis=-1) < 1.1e-4
    assert (is_there == np.asarray(scope["found"].is_solved)).all()
    with jax.enable_x64(True):
        wide, first = panda.astype(np.float64), q[0].astype(np.float64)
        ahead = first + 1e-6 * np.concatenate([np.eye(8), -np.eye(8)])
        shares = np.asarray(interpreted(js.gravity_forces)(wide, ahead))[:, :7] / wide.effort_limit[:7]
        squares = (shares**2).sum(-1)
    differences = (squares[:8] - squares[8:]) / 2e-6
    np.testing.assert_allclose(scope["slope_of_effort"][0], differences, rtol=0, atol=1e-4 * abs(differences).max())
    value, slope = float(scope["value"]), np.asarray(scope["slope"].f)
    assert on_ground == f"{value:.3f} m; by the push: {scope['slope'].f} m/N"
    at, aside = np.float32([0, 20, 0]), np.float32([[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]])
    with compiled_soon(), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        height = jax.vmap(lambda f: scope["height"](js.SpatialForce(jnp.zeros(3), f)))
        moved = np.asarray(jax.jit(height)(at + aside))
    assert 0.1 < value < 0.235
    np.testing.assert_allclose(slope[[0, 2]], (moved[[0, 2]] - moved[[1, 3]]) / 2, rtol=0.1, atol=3e-5)


TIMES = {
    "dynamics.md": [("forward dynamics | 1 ", 2, 13), ("forward dynamics | 1 ", 3, 4.8)]
    + [("forward dynamics | 4096 ", 2, 0.049), ("forward dynamics | 4096 ", 3, 1.9)],
    "contact.md": [("convex_step ", 1, 1.2), ("mjx.step ", 1, 80)],
}


@pytest.mark.parametrize("page", TIMES)
def test_times_are_those_of_the_benchmarks(page):
    """Of the first table of each: to two digits, and in the README."""
    text = (ROOT / "tests/benchmarks" / page).read_text().split("## panda, float32: us per state")[-1]
    for start, column, told in TIMES[page]:
        row = next(line for line in text.splitlines() if line.startswith(f"| {start}|"))
        measured = float(row.split("|")[1 + column].split("(")[0])
        assert f"{measured:.2g}" == f"{told:.2g}" and f"{told:g} µs" in README, row


def test_what_it_is_comes_first():
    assert len(README.splitlines()) <= 130
    headings = re.findall(r"^## (.*)", README, re.M)
    assert headings[:3] == ["First steps", "What you can rely on", "Quick start"]
    first = README.split("## First steps")[0]
    assert "load a URDF, batch it, differentiate it,\nthrough contact too" in first
    assert "notebooks/quadrupeds.webp" in first and "notebooks/robot.png" in README


# Pages whose code other tests run.
OF_OTHERS = ("brax", "drake", "frax", "mujoco", "pinocchio")
OWN_TESTS = [
    "quadrupeds.md",
    "walking.md",
    "drawing.md",
    "simulators.md",
    "inverse_kinematics.md",
    "scale.md",
    "internals.md",
    "reference.md",
]
OWN_TESTS += [f"coming_from_{name}.md" for name in OF_OTHERS]
# Its sections run one by one, where their simulators are.
SIMULATORS = PAGES["simulators.md"].split("\n## ")


# What they tell is bits and digits.
OF_DIGITS = ["precision.md", "layouts.md", "arrays.md"]


# Their programs compile for more than three seconds. By default they are looked at alone.
COMPILE_LONG = ["answers.md", "closed_loops.md", "compute.md", "contact.md", "install.md", "learning.md", "sensors.md"]
COMPILE_LONG += ["predictive_control.md", "gallery.md"]
RUN_HERE = [name for name, text in PAGES.items() if examples(text) and name not in OWN_TESTS]
SOON = [(name, False) for name in RUN_HERE]


@pytest.mark.parametrize("name", ["README.md", *(name for name, text in PAGES.items() if examples(text))])
def test_code_of_pages_is_whole(name):
    """Without running it: names are defined, modules have their attributes, our functions their arguments."""
    assert faults(examples(README if name == "README.md" else PAGES[name])) == []


def test_faults_of_a_page_are_seen():
    code = """import jaxspatial as js
from jaxspatial import nothing
x = js.shft(missing)
js.shift(1, 2, exactness=3)
js.inverse_dynamics(1)
js.Rotation.exp(1).inverse()
js.measure.recommends()
"""
    told = "\n".join(faults([code]))
    for word in ("Undefined name `missing`", "js has no shft", "'exactness'", "missing a required argument: 'q'",
                 "jaxspatial has no nothing", "js.measure has no recommends"):  # fmt: skip
        assert word in told
    assert told.count("\n") == 5


@pytest.mark.parametrize(
    ("name", "as_read"),
    [
        *slow_but([case for case in SOON if case[0] not in COMPILE_LONG], SOON),
        *(slow(name, True) for name in RUN_HERE),
    ],
    ids=lambda x: {True: "as read", False: "soon"}.get(x, x) if isinstance(x, bool) else x,
)
def test_pages_run(name, as_read, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # Some write files.
    blocks = examples(PAGES[name])
    for module in OPTIONAL:
        if re.search(rf"^(import|from) {re.escape(module)}\b", "\n".join(blocks), re.M):
            needs(module)
    run(blocks, None if name in OF_DIGITS else "fast", as_read)


# Brax reads attributes that MJX has moved, and says that it is no longer developed.
@pytest.mark.filterwarnings("ignore:Accessing .* from `Data` is deprecated:DeprecationWarning")
@pytest.mark.filterwarnings("ignore:Brax System, piplines:UserWarning")
@pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")
@pytest.mark.parametrize(
    "section",
    [slow(text) if text.startswith(("Brax", "MJX")) else text for text in SIMULATORS[1:]],
    ids=[re.split(r"\W", text)[0] for text in SIMULATORS[1:]],
)
def test_recipes_of_simulators_run(section, monkeypatch):
    """Each behind what all share, in at most 25 lines."""
    (shared,), (recipe,) = examples(SIMULATORS[0]), examples(section)
    for module in ("mujoco.mjx", "brax.io.mjcf", "brax.generalized.pipeline"):
        if f"from {module.rpartition('.')[0]} import {module.rpartition('.')[2]}" in recipe:
            needs(module)
    if "import newton" in recipe:
        pytest.importorskip("newton")
    if "geometry_msgs" in recipe:
        declared = types.SimpleNamespace(Vector3=test_ros.Vector3, Wrench=test_ros.Wrench)
        for name, module in ("geometry_msgs", types.SimpleNamespace(msg=declared)), ("geometry_msgs.msg", declared):
            monkeypatch.setitem(sys.modules, name, module)
    assert len([line for line in recipe.splitlines() if line]) <= 25
    run([shared, recipe])


def test_example_of_double_words(capsys):
    exec(examples(PAGES["precision.md"])[0], {})
    assert capsys.readouterr().out == "SpatialForce(tau=[0.1, 0.2, 0.3], f=[1.0, 2.0, 3.0])\n"


def test_coordinates_of_every_kind_of_joint():
    found = {kind.strip("`"): (int(nq), int(nv)) for kind, nq, nv, _, _ in _table(PAGES["robots.md"], "Coordinates")}
    assert found == {kind.name: (kind.nq, kind.nv) for kind in BUILT_IN}


def test_a_floating_base_is_as_told():
    """q = [wxyz, position], v = [angular, linear] in the axes of the base."""
    mech = js.Mechanism.build([js.Body("base")], [js.Joint("root", "free", "world", "base")])
    half = np.float32(0.5**0.5)
    q = np.float32([half, 0, 0, half, 1, 2, 3])  # a quarter turn about z, at (1, 2, 3)
    V_WB_W = js.body_velocities(mech, q, np.float32([0, 0, 4, 5, 0, 0])).at_batch(0)
    np.testing.assert_allclose(js.forward_kinematics(mech, q).translation, [[1, 2, 3]], atol=1e-6)
    np.testing.assert_allclose(V_WB_W.to_array(), [0, 0, 4, 0, 5, 0], atol=1e-5)


def test_every_convention_is_listed():
    """And nothing else."""
    for name in ("orders", "mujoco", "brax", "newton", "ros", "pinocchio", "drake", "jaxlie", "scipy"):
        module = getattr(js.interop, name)
        own = {k for k, f in vars(module).items() if inspect.isfunction(f) and f.__module__.startswith(module.__name__)}
        rows = _table(PAGES["conventions.md"], f".*`interop.{name}`")
        listed = {cell.strip("`") for row in rows for cell in row[:2] if cell}
        assert listed == {k for k in own if k[0] != "_"} - {"single"}, name


def _theirs():
    """What the expressions of the table read, by name."""
    turn, place, six = [0.5, 0.5, -0.5, 0.5], [1, 2, 3], np.arange(6, dtype=np.float32)
    X = js.RigidTransform(js.Rotation.from_quaternion(np.float32(turn)), np.float32(place))
    sixes = "x6 cvel cfrc xfrc_applied fullinertia v6 velocities6 tangent coordinates".split()
    return dict.fromkeys(sixes, six) | {
        "J": np.arange(24, dtype=np.float32).reshape(6, 4), "xpos": X.translation, "xquat": np.float32(turn),
        "xmat": X.rotation.entries, "xmat_of_mjx": X.rotation.to_matrix(), "qpos7": np.float32(place + turn),
        "q7": np.float32(place + turn[1:] + turn[:1]), "positions7": np.float32(turn + place),
        "mass": np.float32(2), "pos": np.float32(place), "pi10": np.float32([2, 2, 0, 0, 1, 0, 4, 0, 0, 4]),
        "adjoint": js.interop.orders.matrix_to_linear_first(X.to_motion_matrix()),
        "F_Wo_W": js.SpatialForce.from_array(six), "F_Bo_W": js.SpatialForce.from_array(six),
    }, {"js": js, "np": np, "orders": js.interop.orders, "X": X, "X_WB": X}  # fmt: skip


@pytest.mark.parametrize("row", _table(PAGES["conventions.md"], "What needs no function"), ids=lambda row: row[1])
def test_what_needs_no_function(row):
    """What one operation reads, the other gives back."""
    reading, making = (cell.strip("`") for cell in row[1:])
    theirs, scope = _theirs()
    letters = {js.SpatialVelocity: "V", js.SpatialForce: "F", js.RigidTransform: "X", js.SpatialInertia: "M"}
    ours = eval(reading, scope | theirs)
    made = eval(making, scope | {letters.get(type(ours), "m"): ours})
    read = [_array(theirs[name]) for name in re.findall(r"\w+", reading) if name in theirs]
    made = [_array(x) for x in (made if isinstance(made, tuple) else (made,))]
    assert len(read) == len(made)
    for x, y in zip(sorted(read, key=np.shape), sorted(made, key=np.shape), strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=2.0**-20)


def _array(x):
    return np.asarray(x.to_array() if isinstance(x, js.SpatialForce) else x)


def test_layers_are_those_there_are():
    rows = _table(PAGES["contributing.md"], "Where things are")
    assert [row[0].strip("`") for row in rows][: len(LAYERS)] == LAYERS


def test_folders_of_tests_are_those_there_are():
    (told,) = re.findall(r"^`tests/` has the same folders, and also (.*?)\.\s", PAGES["contributing.md"], re.M | re.S)
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/__init__.py")}
    assert {*re.findall(r"`(\w+)/`", told)} == folders - {*LAYERS} and {*LAYERS} <= folders


def test_every_benchmark_is_listed():
    scripts = (ROOT / "tests" / "benchmarks").glob("*.py")
    told = "".join(row[0] for row in _table(PAGES["contributing.md"], "Where things are"))
    assert all(
        f"`{path.name}" in told for path in scripts if f"python tests/benchmarks/{path.name}" in path.read_text()
    )


def test_extras_exist():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for text in (README, *PAGES.values()):
        for names in re.findall(r"(?:jaxspatial|\.)\[([\w,]+)\]", text):
            assert set(names.split(",")) <= set(extras), names


@pytest.mark.slow
def test_robots_are_compiled_once_on_disk(tmp_path):
    """The cache of JAX serves a second process, in which names have other hashes."""
    source = "import numpy as np, jaxspatial as js; m = js.testing.random_mechanism(0, 2, dtype=np.float32); "
    source += "js.gravity_forces(m, m.neutral())"
    setup = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    kept = []
    for seed in ("1", "2"):
        environment = os.environ | setup | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
        subprocess.run([sys.executable, "-c", source], check=True, env=environment)
        kept.append({path.name for path in tmp_path.glob("*-cache")})
    assert kept[0] and kept[0] == kept[1]


def test_quick_start_has_two_lines():
    section = README.split("## Quick start\n")[1].split("\n## ")[0]
    blocks = re.findall(r"```sh\n(.*?)```", section, re.S)
    assert [block.count("\n") for block in blocks] == [1, 1]
    assert "python -m jaxspatial" in blocks[0] and "pytest" in blocks[1]


MEMBERS = _table(PAGES["coming_from_drake.md"], "SpatialForce, member by member")


@pytest.mark.parametrize("row", MEMBERS, ids=lambda row: row[0])
def test_coming_from_drake(row):
    """No row is empty, and every expression of ours works."""
    drake, ours, _ = row
    assert drake and re.fullmatch(r"`.+`", ours)
    scope = {}
    exec(examples(PAGES["coming_from_drake.md"])[-1], scope)
    assert eval(ours.strip("`"), scope) is not None


def test_every_public_name_is_in_the_reference():
    for name in dir(js):
        if not name.startswith("_") and name not in (*LAYERS, "Precision", "CentralAxis"):
            assert re.search(rf"\b{name}\b", PAGES["reference.md"]), name


@pytest.mark.parametrize("name", ["README.md", *PAGES])
def test_links_and_pictures_exist(name):
    text, folder = (README, ROOT) if name == "README.md" else (PAGES[name], ROOT / "notebooks")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if not target.startswith("https://"):
            assert (folder / target).exists(), target


def test_every_page_is_two_clicks_away():
    """From the README; and every picture is on a page."""
    found = linked = _linked(README, "notebooks/")
    for name in linked & PAGES.keys():
        found = found | _linked(PAGES[name], "")
    names = {path.name for path in (ROOT / "notebooks").iterdir() if path.suffix in (".md", ".ipynb")}
    assert names - {"index.md"} <= found
    for path in (*(ROOT / "notebooks").glob("*.png"), *(ROOT / "notebooks").glob("*.webp")):
        assert any(path.name in text for text in (README, *PAGES.values())), path.name


@pytest.mark.parametrize("name", ["README.md", *PAGES])
def test_places_in_pages_that_are_linked_exist(name):
    """Of a link `page.md#place` there is a heading."""
    text = README if name == "README.md" else PAGES[name]
    for page, place in re.findall(r"\]\((?:notebooks/)?(\w*(?:\.md)?)#([\w-]+)\)", text):
        target = PAGES[page] if page else text
        headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", target, flags=re.M | re.S), re.M)
        assert place in {_slug(heading) for heading in headings}, f"{page}#{place}"


def _slug(heading):
    """As GitHub makes it, and MyST."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def _linked(text, folder):
    return set(re.findall(rf"\]\({folder}(\w+\.(?:md|ipynb))[)#]", text))

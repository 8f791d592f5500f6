"""The benchmarks still run: every case, on few wrenches. What they claim is asserted by running them, not here."""

import pathlib
import re
import shutil
import subprocess
import sys

import pytest

from tests.helpers.marks import slow

HERE = pathlib.Path(__file__).parent


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_wrench_kernels():
    command = [sys.executable, HERE / "wrench_kernels.py", "--n", "64", "--rounds", "2"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode in (0, 1) and not run.stderr, run.stderr
    for dtype in ("float32", "float64"):
        assert run.stdout.count(dtype) == 4
    assert "16 chained shifts, there and back" in run.stdout


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_the_c_kernels_compute_what_we_compute(dtype):
    """Both sides of the comparison end in the same numbers: one shift, one power, 16 shifts, there and back."""
    program = f"import sys; sys.path.insert(0, {str(HERE)!r}); import wrench_kernels as k; k.agree({dtype!r})"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
def test_fresh_results():
    options = ["--sizes", "64", "300000", "--rounds", "2", "--processes", "1"]
    run = subprocess.run(
        [sys.executable, HERE / "fresh_results.py", *options], capture_output=True, text=True, timeout=300
    )
    assert run.returncode in (0, 1) and not run.stderr, run.stderr
    for setting in ("as it comes", "kept", "huge pages"):
        assert f"| {setting}, n = 64 | ns" in run.stdout
    donated = [line for line in run.stdout.splitlines() if line.startswith("| donated")]
    assert len(donated) == 6 and all(line.endswith("| 1.00 | 1.00 | 1.00 | 0 |") for line in donated)


@pytest.mark.slow
def test_xfrc_applied():
    for name in ("brax", "mujoco.mjx"):
        pytest.importorskip(name)
    command = [sys.executable, HERE / "xfrc_applied.py", "--n", "16", "--rounds", "3", "--robots", "ant"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    rows = [line for line in run.stdout.splitlines() if line.startswith("| ")]
    names = [row.split(" | ")[0].removeprefix("| ") for row in rows]
    assert names == ["ant", "mjx.step", "mjx.step of wrenches", "to_xfrc_applied"]
    assert run.stdout.count(" over mjx.step: ") == 2


@pytest.mark.slow
def test_contact():
    for name in ("pinocchio", "mujoco.mjx"):
        pytest.importorskip(name)
    options = ["--n", "8", "--steps", "4", "--rounds", "2", "--robots", "go2"]
    run = subprocess.run([sys.executable, HERE / "contact.py", *options], capture_output=True, text=True, timeout=900)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    on_stairs = "convex_step on stairs", "mjx.step on stairs"
    for case in ("convex_step", "semi_implicit_step", "mjx.step", "convex_step, one state, a call", *on_stairs):
        assert f"\n| {case} | " in run.stdout
    assert "go2, mjx.step on stairs over convex_step on stairs: " in run.stdout
    assert run.stdout.count("at most") == 5 and "the program of semi_implicit_step" in run.stdout


@pytest.mark.slow
@pytest.mark.skipif(not (HERE.parents[1] / ".git").exists() or not shutil.which("git"), reason="needs the repository")
def test_contact_against_a_commit():
    """The last one, on few states: every row is compiled and timed in both trees, and results are compared."""
    for name in ("pinocchio", "mujoco.mjx"):
        pytest.importorskip(name)
    options = ["--against", "HEAD", "--n", "8", "--steps", "4", "--rounds", "3", "--robots", "go1"]
    run = subprocess.run([sys.executable, HERE / "contact.py", *options], capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    for case in ("convex_step", "60 steps, one state", "gradient of 60 steps, one state"):
        (told,) = (line for line in run.stdout.splitlines() if line.startswith(f"| go1, float32 | {case} | "))
        assert told.count(" | ") == 8
    assert "of 6 rows are slower" in run.stdout and "Left out" not in run.stdout


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_constraints():
    """On few states: both sides solve the same targets, in as many steps, and find the same accelerations."""
    for name in ("pinocchio", "mujoco.mjx", "frax"):
        pytest.importorskip(name)
    command = [sys.executable, HERE / "constraints.py", "--n", "64", "--rounds", "2"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    solved, steps = zip(*re.findall(r"(\d+)% solved, ([\d.]+) steps", run.stdout), strict=True)
    assert solved[0] == solved[2] and steps[0] == steps[2]
    errors = [float(x) for x in re.findall(r"error (\S+) of", run.stdout)]
    assert len(errors) == 6 and max(errors) < 2e-4 and run.stdout.count("at least") == 5


@pytest.mark.slow
def test_precisions():
    command = [sys.executable, HERE / "precisions.py", "--n", "640", "--rounds", "2", "--sample", "20"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    for dtype in ("float32", "float64"):
        assert f"shift, streaming, {dtype}" in run.stdout and f"wrong in all digits, {dtype}" in run.stdout
        assert f"inverse dynamics of an arm, {dtype}" in run.stdout
    assert run.stdout.count("of 16 bits") == 1 and "reproducible, bfloat16 / reproducible, float32: " in run.stdout


@pytest.mark.slow
def test_results_of_compensated_and_faithful_are_never_meaningless():
    """What the benchmark asserts without a clock: the table of hostile families, ours never wrong in all digits."""
    program = f"import sys; sys.path.insert(0, {str(HERE)!r}); import precisions as p; p.require_meaning(100)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
@pytest.mark.parametrize("dtype, peer", [("float32", "frax"), ("float64", "MuJoCo C")])
def test_dynamics(dtype, peer):
    """All rows but the longest to compile, on few states of one robot: every one is timed, right, and told."""
    for name in ("pinocchio", "mujoco.mjx", "frax"):
        pytest.importorskip(name)
    rows = ["inverse dynamics", "forward dynamics", "mass matrix", "kinematics", "Jacobian", "step"]
    rows += ["derivatives of inverse dynamics", "jacfwd of inverse dynamics", "gradient by inertial parameters"]
    rows += ["inverse mass matrix times a vector", "mass matrix times a vector", "Jacobian transposed times a wrench"]
    rows += [f"{rows[-2]}, by inverse dynamics", f"{rows[-1]}, by pull-back"]
    rows += ["derivatives of inverse dynamics times vectors, by jvp"]
    options = ["--robots", "panda", "--dtypes", dtype, "--peers", "Pinocchio C++", peer, "--parts", "robots"]
    options += ["--batch", "40", "--large", "80", "--rounds", "2", "--limit", "1", "--rows", *rows]
    run = subprocess.run([sys.executable, HERE / "dynamics.py", *options], capture_output=True, text=True, timeout=3000)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    assert f"panda, {dtype}: us per state" in run.stdout and f"Pinocchio C++ | {peer}" in run.stdout
    for row in rows:
        assert f"\n| {row} | 40 | " in run.stdout and f"\n| panda, {dtype} | {row} | " in run.stdout
    # What is right is right whatever the machine: the one claim that no clock decides. What is not met is bold.
    (agreement,) = (line for line in run.stdout.splitlines() if "largest error over largest number" in line)
    assert "at most" in agreement and "**" not in agreement, agreement


@pytest.mark.slow
@pytest.mark.skipif(not (HERE.parents[1] / ".git").exists() or not shutil.which("git"), reason="needs the repository")
def test_dynamics_against_a_commit():
    """The last one, on few states: every row is compiled and timed in both trees, and results are compared."""
    for name in ("mujoco.mjx", "frax"):
        pytest.importorskip(name)
    rows = ["kinematics", "Jacobian"]
    options = ["--against", "HEAD", "--robots", "panda", "--dtypes", "float32", "--batch", "40", "--rounds", "3"]
    command = [sys.executable, HERE / "dynamics.py", *options, "--rows", *rows]
    run = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    for row in rows:
        (told,) = (line for line in run.stdout.splitlines() if line.startswith(f"| panda, float32 | {row} | "))
        assert told.count(" | ") == 8
    assert "of 2 rows are slower" in run.stdout and "Left out" not in run.stdout
    trees = subprocess.run(["git", "-C", HERE, "worktree", "list"], capture_output=True, text=True).stdout
    assert "/before " not in trees


@pytest.mark.slow
def test_sizes_of_mechanisms():
    for name in ("pinocchio", "mujoco.mjx", "frax"):
        pytest.importorskip(name)
    options = ["--parts", "sizes", "--batch", "8", "--rounds", "1", "--limit", "1"]
    run = subprocess.run([sys.executable, HERE / "dynamics.py", *options], capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    for told in ("1000 links over 10 links", "five fingers over one finger", "four legs over one leg"):
        assert run.stdout.count(told) >= 2


@pytest.mark.slow
def test_robots():
    pytest.importorskip("pinocchio")
    command = [sys.executable, HERE / "robots.py", "double_pendulum"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert run.returncode == 0 and "| double_pendulum | floating |" in run.stdout, run.stderr


def test_files_that_see_mutants_exist():
    """Also where the extra `mutants` is not installed."""
    program = "import mutants as m; print(*m.OF_ALL, *(name for folder in m.FOLDERS.values() for name in folder.tests))"
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(HERE)!r}); {program}"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert all((HERE.parent / name).is_file() for name in run.stdout.split())


def test_mutants_are_drawn_from_the_seed():
    """The same twice, each another program than the one it is made of, and of the folder asked for."""
    pytest.importorskip("cosmic_ray")
    program = "import mutants as m; print([(x.file, x.after) for x in m.sample(6, 1, ['spatial', 'rotation'])])"
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(HERE)!r}); {program}"]
    runs = [subprocess.run(command, capture_output=True, text=True, timeout=300) for _ in range(2)]
    assert runs[0].returncode == 0, runs[0].stderr
    assert runs[0].stdout == runs[1].stdout and runs[0].stdout.count(".py") == 6


@pytest.mark.slow
def test_mutants():
    pytest.importorskip("cosmic_ray")
    command = [sys.executable, HERE / "mutants.py", "--n", "1", "--only", "rotation"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "1 mutants drawn, 1 run" in run.stdout, run.stderr


@pytest.mark.slow
def test_gpu():
    """Also without one: every row is there, and results have the bits of the CPU, being of it."""
    for name in ("pinocchio", "mujoco.mjx"):
        pytest.importorskip(name)
    options = ["--wrenches", "4096", "--states", "16", "--most", "64", "--bits", "panda", "--rounds", "2"]
    run = subprocess.run([sys.executable, HERE / "gpu.py", *options], capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    for case in ("faithful", "gradient of forward_dynamics", "convex_step", "mjx.step"):
        assert f"\n| {case} | " in run.stdout
    for told in ("in all precisions but fast: 1, 1: holds", "with the bits of the CPU: 1, 1: holds"):
        assert told in run.stdout


@pytest.mark.slow
def test_model_files(tmp_path):
    """Of a folder: one file of each format that loads and is compared, one that does not."""
    pytest.importorskip("pinocchio")
    body = '<inertial pos=".1 0 0" mass="1" diaginertia="1 1 1"/>'
    (tmp_path / "a.xml").write_text(f"<mujoco><worldbody><body><joint/>{body}</body></worldbody></mujoco>")
    mass = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    joint = '<joint name="j" type="continuous"><parent link="world"/><child link="l"/></joint>'
    (tmp_path / "b.urdf").write_text(
        f'<robot><link name="l"><inertial>{mass}</inertial></link><traits/>{joint}</robot>'
    )
    (tmp_path / "c.urdf").write_text('<robot><link name="l"/><loop_joint/></robot>')
    rows = tmp_path / "rows.jsonl"
    command = [sys.executable, HERE / "model_files.py", f"here={tmp_path}", "--rows", rows]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert "| here | MJCF | 1 | 1 |  | 1 | 1 | " in run.stdout
    assert "| URDF | <loop_joint>: this changes how the robot moves" in run.stdout
    assert len(rows.read_text().splitlines()) == 3

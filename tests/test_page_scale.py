"""The page on many wrenches and many machines: its code on eight devices, its script in two processes, its commands."""

import os
import pathlib
import re
import shlex
import socket
import subprocess
import sys

import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.command.main import main
from tests.helpers import soon
from tests.helpers.optional import needs
from tests.helpers.pages import FOLDER

ROOT = FOLDER.parent
PAGE = (FOLDER / "scale.md").read_text()
(SCRIPT,) = re.findall(r"```py\n(.*?)```", PAGE, re.S)


def _run(*command, folder, **environment):
    surroundings = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT), **environment}
    return subprocess.Popen(
        [sys.executable, *map(str, command)], cwd=folder, env=surroundings, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def _finished(run):
    out, error = run.communicate(timeout=600)
    assert run.returncode == 0, error
    return out


def _on_eight_devices(tmp_path, sizes):
    needs("orbax.checkpoint")
    program = f"from tests.helpers.pages import run_page; run_page('scale.md', precision=None, **{sizes})"
    out = _finished(_run("-W", "error::jaxspatial.NarrowingWarning", "-c", program, folder=tmp_path))
    assert out.strip().endswith(" 8")


@pytest.mark.slow
def test_on_eight_devices(tmp_path):
    """Its assertions: the same bits, no collective operation, blocks of a file, a checkpoint for fewer devices."""
    _on_eight_devices(tmp_path, {"WRENCHES": 8000, "STATES": 8192, "BLOCK": 3000})


@pytest.mark.slow
def test_a_million_wrenches_on_eight_devices(tmp_path):
    _on_eight_devices(tmp_path, {})


LINK = '<link name="{0}"><inertial><origin xyz="0.1 0 -0.3"/><mass value="2"/><inertia ixx="0.2" iyy="0.2" izz="0.1" \
ixy="0" ixz="0" iyz="0"/></inertial></link>'
ARM = f"""<robot name="arm"><link name="base"/>{LINK.format("upper")}{LINK.format("lower")}
<joint name="a" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="b" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.slow
def test_two_processes(tmp_path):
    """What they write, one behind the other, has the bits of what one process writes."""
    (tmp_path / "torques.py").write_text(SCRIPT)
    (tmp_path / "arm.urdf").write_text(ARM)
    q = np.random.default_rng(0).standard_normal((3000, 2)).astype(np.float32)
    np.save(tmp_path / "configurations.npy", q)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    two = [_run("torques.py", address, 2, which, folder=tmp_path) for which in (0, 1)]
    for run in two:
        _finished(run)
    _finished(_run("torques.py", "none", 1, 0, folder=tmp_path))
    parts, whole = ([np.load(tmp_path / f"torques_{n}_{i}.npy") for i in range(n)] for n in (2, 1))
    assert [len(x) for x in parts] == [1500, 1500] and whole[0].shape == (3000, 2) and abs(whole[0]).max() > 1
    np.testing.assert_array_equal(np.concatenate(parts), whole[0])


def test_its_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    tau, f, p = rng.standard_normal((3, 20, 3))
    np.savez("log.npz", tau=tau, f=f)
    names = [f"{part}_{axis}" for part in ("tau", "f", "p") for axis in "xyz"] + ["q_w", "q_x", "q_y", "q_z"]
    table = np.c_[tau, f, p, np.tile([0.5, 0.5, 0.5, 0.5], (20, 1))]
    np.savetxt("log.csv", table, delimiter=",", header=",".join(names), comments="")
    for line in re.findall(r"^jaxspatial (.*)$", PAGE, re.M):
        assert main(shlex.split(line)) == 0
    assert capsys.readouterr().out.count("20 wrenches") == 2
    np.testing.assert_array_equal(np.load("log_shifted.npz")["tau"], tau - np.cross([0.3, 0.0, -0.1], f))


# By default the tests above, and `engine.test_devices`, hold what it asserts: the same bits, and that nothing is sent.
@pytest.mark.slow
def test_the_benchmark_runs():
    """In all its cases, on few states; it asserts that bits are the same and nothing is sent."""
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("needs two cores")
    command = ["tests/benchmarks/scale.py", "--wrenches", 640, "--states", 640, "--rounds", 2, "--repeats", 1]
    out = _finished(_run(*command, folder=ROOT, **soon.environment()))
    assert len(re.findall(r"^\| (shift|forward).*\|$", out, re.M)) == 6


def test_the_page_says_how_long_a_block_is():
    source = pathlib.Path(js.__file__).parent / "command" / "wrench_file.py"
    (rows,) = re.findall(r"^_BLOCK = (\S+)$", source.read_text(), re.M)
    assert f"reads {rows.replace('_', ' ')} rows of a table" in " ".join(PAGE.split())

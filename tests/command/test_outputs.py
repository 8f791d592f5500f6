"""What the command leaves behind: whole files by the umask, none overwritten unasked, one line where it cannot."""

import contextlib
import gc
import os
import pathlib
import re
import resource
import signal
import stat
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxspatial.command import files, measuring, picture, trade
from jaxspatial.command.files import staged
from jaxspatial.command.main import interrupts_heard, main
from jaxspatial.measure.operation import rotating_body

OFFSET = ["--offset", "0.1", "-0.2", "0.3"]
SMALL = ["--largest", "1000", "--operation", "shift_force", "--dtype", "float32"]
COMMAND = [sys.executable, "-m", "jaxspatial"]


@pytest.fixture(params=["mine.npz", "mine.csv"])
def path(request, tmp_path, monkeypatch):
    """A file of 400 wrenches without a motion, in the working folder."""
    monkeypatch.chdir(tmp_path)
    wrenches = rotating_body(400)
    if request.param.endswith("npz"):
        np.savez(request.param, tau=wrenches.tau, f=wrenches.f)
    else:
        table = np.concatenate([wrenches.tau, wrenches.f], axis=1)
        np.savetxt(request.param, table, delimiter=",", header="tau_x,tau_y,tau_z,f_x,f_y,f_z", comments="")
    return pathlib.Path(request.param)


@pytest.fixture
def quick(monkeypatch):
    """The main job without the measuring, which other tests wait for."""
    monkeypatch.setattr(trade, "measure", lambda *_: [])
    monkeypatch.setattr(trade, "curves", lambda *_: [])
    monkeypatch.setattr(picture, "draw", lambda result, file, ending: file.write(b"x" * 100_000))
    monkeypatch.setattr(measuring, "_show", lambda *_: None)


def _failed(arguments, capsys, status=2):
    """The one line of a job that could not be done, and that nothing is there that was not before."""
    before = {p: p.stat().st_mtime_ns for p in pathlib.Path().iterdir()}
    assert main([str(a) for a in arguments]) == status
    out = capsys.readouterr()
    assert out.err.startswith("error: ") and out.err.count("\n") == 1
    assert {p: p.stat().st_mtime_ns for p in pathlib.Path().iterdir()} == before
    return out.err


@contextlib.contextmanager
def _umask(mask):
    before = os.umask(mask)
    yield
    os.umask(before)


@contextlib.contextmanager
def _no_file_larger_than(size):
    """What a full disk looks like."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o027, 0o640)])
def test_permissions_are_those_of_any_new_file(mask, mode, path, quick):
    with _umask(mask):
        assert main([str(path), *OFFSET, *SMALL]) == 0
    written = [p for p in pathlib.Path().iterdir() if p != path]
    assert {p.name for p in written} == {"mine_trade.png"}
    assert {stat.S_IMODE(p.stat().st_mode) for p in written} == {mode}


def test_nothing_is_overwritten_unasked(path, capsys):
    target = pathlib.Path(f"mine_shifted{path.suffix}")
    target.write_text("precious")
    assert "exists already, and is only replaced with --overwrite" in _failed(["shift", path, *OFFSET], capsys)
    assert main(["shift", str(path), *OFFSET, "--overwrite"]) == 0
    assert target.stat().st_size > 1000


@pytest.mark.slow
def test_a_picture_without_a_name_takes_a_free_one(tmp_path, quick, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(3):
        assert main(SMALL) == 0
    assert sorted(os.listdir()) == ["jaxspatial_trade.png", "jaxspatial_trade_2.png", "jaxspatial_trade_3.png"]
    assert "exists already" in _failed([*SMALL, "--picture", "jaxspatial_trade.png"], capsys)
    assert main([*SMALL, "--overwrite"]) == 0 and len(os.listdir()) == 3


@pytest.mark.parametrize("job", [["shift"], [*SMALL]])
def test_a_full_disk(job, path, quick, capsys):
    with _no_file_larger_than(1000):
        assert "File too large" in _failed([*job, path, *OFFSET], capsys)


def test_a_folder_in_the_way(path, quick, capsys):
    pathlib.Path(f"mine_shifted{path.suffix}").mkdir()
    for job in (["shift", path, *OFFSET], [*SMALL, "--picture", "."]):
        for overwrite in ([], ["--overwrite"]):
            error = _failed([*job, *overwrite], capsys)
            assert "a folder is in the way" in error or "--picture" in error


def test_no_device_is_replaced():
    with pytest.raises(files.OutputError, match="got a device"):
        files.writable("/dev/null", overwrite=True)


def test_a_file_that_appears_meanwhile_stays(tmp_path):
    target = tmp_path / "x"
    with pytest.raises(files.OutputError, match="exists"), staged(target) as file:
        file.write(b"new")
        target.write_text("precious")
    assert target.read_text() == "precious" and os.listdir(tmp_path) == ["x"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to("there")
    with staged(tmp_path / "link", overwrite=True) as file:
        file.write(b"new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "there").read_text() == "new"


def _of(scale, dtype):
    x = np.linspace(0.5, 1.5, 30).reshape(10, 3)
    return {"tau": x.astype(dtype), "f": (x * scale).astype(dtype)}


# name: (arrays, message, whether only measuring refuses them)
HARD = {
    "long double": (_of(1, np.longdouble), "tau: expected float16, float32, float64 numbers, got float128", False),
    "1e155": (_of(1e155, float), "too large for float32; --dtype float64 measures only float64", True),
    "float16 overflows": (
        _of(4e4, np.float16),
        "torque about .* too large, got -?inf in row .*, column tau_., in float16",
        False,
    ),
    "float64 overflows": (_of(1.1e308, float), "too large", False),
}


@pytest.mark.parametrize("case", HARD)
@pytest.mark.parametrize("job", ["shift", "trade"])
def test_numbers_that_cannot_be_done(job, case, tmp_path, quick, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arrays, message, measuring_only = HARD[case]
    if arrays["tau"].dtype == np.float64 and case == "long double":
        pytest.skip("long double is double here")
    np.savez("mine.npz", **arrays)
    if job == "trade" and arrays["tau"].dtype == np.float16:
        pytest.skip("measured in wider dtypes")
    if job == "shift" and measuring_only:
        assert main([job, "mine.npz", "--offset", "3", "2", "1"]) == 0
        assert all(np.isfinite(x).all() for x in np.load("mine_shifted.npz").values())
    else:
        error = _failed([job, "mine.npz", "--offset", "3", "2", "1"], capsys)
        assert re.search(message, error), error


def test_large_forces_in_float64_alone(tmp_path, quick, monkeypatch, capsys):
    """And with a motion; their power is finite."""
    monkeypatch.chdir(tmp_path)
    motion = {"w": np.ones((10, 3)), "v": np.ones((10, 3))}
    np.savez("mine.npz", **_of(1e155, float), **motion)
    assert main(["mine.npz", *OFFSET, *SMALL[:4], "--dtype", "float64", "--json"]) == 0
    out = capsys.readouterr().out
    assert '"float64": {' in out and '"float32": {' not in out and '"before": null' not in out


@pytest.mark.parametrize("where", ["measuring", "writing"])
def test_an_interrupt(where, path, quick, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(*{"measuring": (trade, "measure"), "writing": (os, "fsync")}[where], interrupted)
    assert "interrupted" in _failed([path, *OFFSET, *SMALL], capsys, status=130)


def test_control_c(tmp_path):
    """As a user does it, in the middle of measuring."""
    # A process started in the background of a shell would not hear it.
    listening = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{listening}; import runpy; runpy.run_module('jaxspatial', run_name='__main__', alter_sys=True)"
    run = subprocess.Popen(
        [sys.executable, "-u", "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert run.stdout is not None
    while "jaxlib" not in run.stdout.readline():
        assert run.poll() is None
    run.send_signal(signal.SIGINT)
    _, error = run.communicate(timeout=60)
    assert run.returncode == 130 and error == "error: interrupted\n" and not os.listdir(tmp_path)


def test_an_interrupt_that_python_drops_comes_again(capfd):
    """As in the callbacks of the garbage collector: JAX has one, and measuring makes much garbage."""

    def callback(*_):
        gc.callbacks.remove(callback)
        raise KeyboardInterrupt

    # Another test may have left a handler of its own, or none.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), interrupts_heard():
            gc.callbacks.append(callback)
            gc.collect(0)  # the youngest: after other tests there are millions of older objects
            for _ in range(500):
                time.sleep(0.01)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert not capfd.readouterr().err


def test_standard_output_that_is_full(path):
    with open("/dev/full", "w") as full:
        run = subprocess.run([*COMMAND, "shift", path, *OFFSET], stdout=full, stderr=subprocess.PIPE, text=True)
    assert run.returncode == 2 and run.stderr == "error: No space left on device\n"


def test_memory_that_is_not_there(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _failed(["--largest", str(10**15), "--json"], capsys)

"""python -m jaxspatial: the built-in scene, the user's file, and everything that can be wrong with one."""

import json
import re
import sys

import jax
import jaxlib
import numpy as np
import pytest
from PIL import Image

import jaxspatial as js
from jaxspatial.command import algorithms, measuring, options, picture, result, trade
from jaxspatial.command.files import WrenchFileError
from jaxspatial.command.main import main
from jaxspatial.command.wrench_file import WrenchFile
from jaxspatial.measure.operation import OPERATIONS, rotating_body
from jaxspatial.numerics.promise import Promise
from tests.helpers.marks import slow

OFFSET = ["--offset", "0.1", "-0.2", "0.3"]
COLUMNS = [f"{part}_{axis}" for part in ("tau", "f", "w", "v") for axis in "xyz"]
SMALL = ["--largest", "1000", "--operation", "shift_force", "--dtype", "float32"]


@pytest.fixture
def wrenches():
    return rotating_body(40)


@pytest.fixture
def quick(monkeypatch):
    """The main job without the measuring and the picture of it, which other tests wait for."""
    monkeypatch.setattr(trade, "measure", lambda *_: [])
    monkeypatch.setattr(trade, "curves", lambda *_: [])
    monkeypatch.setattr(picture, "draw", lambda result, file, ending: file.write(b"a picture"))


def _write_csv(path, wrenches, columns=COLUMNS):
    table = np.concatenate(wrenches, axis=1)[:, : len(columns)]
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in table.tolist())]) + "\n")
    return path


def test_the_scene_is_a_rigid_body(wrenches):
    """Velocities of points of one body: v - v_C is orthogonal to w, and no faster than |w| times the farthest point."""
    relative = wrenches.v - np.array([1.0, 0.0, 0.2])
    np.testing.assert_allclose((relative * wrenches.w).sum(-1), 0, atol=1e-13)
    assert (np.linalg.norm(relative, axis=-1) <= 3 * 0.5 * np.sqrt(3)).all()


@pytest.mark.slow
def test_built_in_scene(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*SMALL, "--dtype", "bfloat16", "--full"]) == 0
    text = capsys.readouterr().out
    assert "Power before and after the shift" in text and "1,000" in text
    for name in ("shift force", "float32", "bfloat16", *js.Precision, "3 u mag", "1 ulp", "N m"):
        assert name in text, name
    with Image.open(tmp_path / "jaxspatial_trade.png") as picture:
        assert picture.size[0] > 1000


@pytest.mark.slow
def test_json(tmp_path, capsys, monkeypatch):
    """Nothing but JSON on standard output, no picture, and no need for the packages that show tables and pictures."""
    monkeypatch.chdir(tmp_path)
    for name in ("matplotlib", "rich", "rich.console"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main([*SMALL, "--json"]) == 0
    out = capsys.readouterr()
    found = json.loads(out.out, parse_constant=pytest.fail)
    assert found["holds"] and not found["broken"] and not list(tmp_path.iterdir()) and not out.err
    assert found["sizes"] == {"in_cache": 1000, "streamed": 1000} and found["versions"].keys() >= {"jax", "jaxlib"}
    assert found["power"]["float64"]["difference"] <= found["power"]["float64"]["bound"]
    assert [row["precision"] for row in found["rows"]] == [str(p) for p in js.Precision]
    for row in found["rows"]:
        assert row["holds"] and row["of_promise"] <= 1 and row["in_cache"]["nanoseconds"] > 0
        assert row["streamed"]["gigabytes_per_second"] > 0 and row["ulps"]["worst"] >= row["ulps"]["median"] >= 0
    curves = {(c["operation"], c["dtype"], c["precision"]): c["points"] for c in found["conditions"]}
    assert {name for name, _, _ in curves} == {"shift_force"} and len(curves) == 4
    assert max(point["worst_ulps"] for point in curves["shift_force", "float32", "faithful"]) <= 1


@pytest.mark.slow
def test_json_with_progress_and_picture(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = ["--operation", "dot", "--dtype", "float32", "--dtype", "float16", "--json", "--picture", "mine.png"]
    assert main([*SMALL[:2], *asked]) == 0
    out = capsys.readouterr()
    found = json.loads(out.out, parse_constant=pytest.fail)
    assert [row["dtype"] for row in found["rows"] if row["streamed"] is None] == ["float16"] * 4
    assert any(point["condition"] is None for curve in found["conditions"] for point in curve["points"])
    assert "Power before and after" in out.err and (tmp_path / "mine.png").exists()


def test_keys_of_the_json_object_are_documented(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    keys = ["about", "machine", "versions", "offset", "sizes", "power", "rows", "conditions", "algorithms"]
    keys += ["applications", "broken", "holds"]
    assert all(key in text and key in str(result.__doc__) for key in keys)


def test_versions(capsys):
    with pytest.raises(SystemExit) as exit:
        main(["--version"])
    assert exit.value.code == 0
    assert (
        capsys.readouterr().out == f"jaxspatial {js.__version__}, jax {jax.__version__}, jaxlib {jaxlib.__version__}\n"
    )


@pytest.mark.parametrize("dtype", trade.STREAMED)
def test_power_is_unchanged_and_a_wrong_sign_is_seen(dtype, wrenches, monkeypatch):
    offset = np.array([0.1, -0.2, 0.3])
    found = trade.power(wrenches, offset, dtype)
    assert found.difference <= trade.POWER_BOUND
    terms = np.concatenate([wrenches.tau * wrenches.w, wrenches.f * wrenches.v])
    eps = np.finfo(dtype).eps
    assert found.before == pytest.approx(terms.sum(), abs=4 * eps * abs(terms).sum())
    assert found.after == pytest.approx(terms.sum(), abs=14 * eps * abs(terms).sum())
    monkeypatch.setattr(trade, "_powers", lambda F, V, p: (js.dot(F, V), js.dot(F.shift(-p), V.shift(p))))
    assert trade.power(wrenches, offset, dtype).difference > 1e4


def test_a_broken_promise_is_an_exit_status(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(OPERATIONS, "shift_force", OPERATIONS["shift_force"]._replace(bounds=(Promise(0.1, 4),)))
    assert main(SMALL) == 1
    out = capsys.readouterr().out
    assert "does not hold here: shift_force float32 fast" in out and "float32 faithful" not in out


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("rich", SMALL), ("matplotlib", [*SMALL, "--json", "--picture", "x.png"]), ("lxml", [])],
)
def test_what_is_missing_is_said(name, arguments, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    assert main(arguments) == 2
    assert "from a clone, pip install '.[plot]'" in capsys.readouterr().err


@pytest.mark.parametrize(("scale", "dtypes"), [slow(x, ["float32", "float16"]) for x in (1e-25, 1e-17, 1e15)])
def test_small_and_large_wrenches_keep_the_promises(scale, dtypes, tmp_path, wrenches):
    path = tmp_path / "mine.npz"
    np.savez(path, **wrenches._replace(tau=wrenches.tau * scale, f=wrenches.f * scale)._asdict())
    narrow = [x for dtype in dtypes for x in ("--dtype", dtype)]
    assert main([str(path), *OFFSET, *SMALL[:2], "--operation", "cross_force", *narrow]) == 0


def test_a_file_is_measured_and_stays(tmp_path, wrenches, quick):
    """To move its wrenches is another job."""
    np.savez(tmp_path / "mine.npz", **wrenches._asdict(), time=np.arange(40))
    assert main([str(tmp_path / "mine.npz"), *OFFSET, *SMALL]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.npz", "mine_trade.png"]


@pytest.mark.slow
def test_no_motion_is_invented(tmp_path, wrenches, capsys):
    """Of a file without w and v there is no power, and only what needs neither is measured."""
    path = _write_csv(tmp_path / "mine.csv", wrenches, COLUMNS[:6])
    path.write_text(path.read_text().replace("\n", ",1,2,3\n").replace("f_z,1,2,3", "f_z,v[x],v[y],v[z]"))
    assert main([str(path), *OFFSET, "--largest", "1000", "--dtype", "float32", "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert found["power"] == {} and {row["operation"] for row in found["rows"]} == {"shift_force"}
    assert "gives no motion" in found["about"] and found["rows"][0]["absolute"][0]["unit"] == "N m"
    assert main([str(path), *OFFSET, *SMALL, "--operation", "dot", "--overwrite"]) == 2
    assert "--operation dot: expected w, v" in capsys.readouterr().err


def test_no_acceleration_is_invented(tmp_path, wrenches):
    path = _write_csv(tmp_path / "mine.csv", wrenches)
    parts = WrenchFile(path).all_parts()
    assert measuring._operations(path, parts, None) == ["shift_force", "shift_velocity", "cross_force", "dot"]
    assert measuring._operations(None, None, None) == list(OPERATIONS)


def test_trade_is_the_main_job(tmp_path, quick, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["trade", *SMALL, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["about"] == "1,000 wrenches on a rotating body"


_URDF = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/>
<mass value="2"/><inertia ixx="0.2" iyy="0.2" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.slow
def test_the_robot_of_a_file(tmp_path, capsys):
    path = tmp_path / "pendulum.urdf"
    path.write_text(_URDF)
    asked = ["--operation", "inverse_dynamics", "--dtype", "float32", "--json", "--picture", str(tmp_path / "x.png")]
    assert main(["--largest", "1000", "--robot", str(path), *asked]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["about"].endswith("; pendulum.urdf") and found["rows"] == found["applications"] == []
    assert found["power"] == {}
    rows = {row["precision"]: row for row in found["algorithms"]}
    assert list(rows) == ["fast", "reproducible", "compensated"] and rows["compensated"]["worst_ulps"] <= 0.51
    for row in rows.values():
        assert row["dtype"] == "float32" and row["nanoseconds"] > 0 and 0 < row["worst"] < 1e-4 and row["unit"] == "N m"
    assert (tmp_path / "x.png").exists()


@pytest.mark.parametrize(("text", "message"), [(None, "no such file"), ("<robot", "malformed XML"), (
    '<robot name="stone"><link name="stone"/></robot>', "expected joints that move, got none")])  # fmt: skip
def test_a_robot_that_cannot_be_measured(text, message, tmp_path, capsys):
    path = tmp_path / "bad.urdf"
    if text is not None:
        path.write_text(text)
    assert main(["--robot", str(path), "--operation", "inverse_dynamics", "--json"]) == 2
    assert re.fullmatch(f"error: .*bad.urdf: .*{message}.*", capsys.readouterr().err.strip())


def test_what_is_measured_unasked(monkeypatch):
    """Of a wrench file no robot, of a robot's file no applications."""
    monkeypatch.setattr(measuring, "_check_sizes", lambda *_: None)

    def plan(*arguments):
        return measuring._plan(options.measuring().parse_args([*arguments, "--json", "--largest", "1000"]))

    everything = plan()
    assert everything.algorithms == list(algorithms.ALGORITHMS) and everything.robot and everything.robot.nv == 7
    assert everything.has_applications
    assert not plan("--operation", "dot").algorithms and not plan("--dtype", "float64").has_applications
    forward = plan("--operation", "forward_dynamics")
    assert forward.algorithms == ["forward_dynamics"] and not forward.operations and not forward.has_applications


def test_any_wish_is_no_first_look():
    for wish in (["--full"], ["--json"], ["--dtype", "float32"], ["--largest", "1000"], ["--operation", "dot"]):
        assert not options.is_first_look(options.measuring().parse_args(wish))


# By default `test_report` holds the page and the picture, and `test_first_look` what it measures.
@pytest.mark.slow
def test_the_first_look(tmp_path, capsys, monkeypatch):
    """Without a wish: a page, and a picture."""
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 45 and any("js.shift(F, p)" in line for line in lines)
    with Image.open(tmp_path / "jaxspatial_trade.png") as drawn:
        assert drawn.size[0] > 1.5 * drawn.size[1]


def _csv(text):
    return "bad.csv", lambda path: path.write_text(text)


def _npz(**arrays):
    return "bad.npz", lambda path: np.savez(path, **arrays)


_HEADER = "tau_x,tau_y,tau_z,f_x,f_y,f_z\n"
_ONES = np.ones((4, 3))
_HOLE = np.where(np.arange(12).reshape(4, 3) == 7, np.nan, _ONES)
BAD_FILES = {
    "missing columns": (_csv("tau_x,tau_y,f_x,f_y,f_z\n1,2,3,4,5\n"), "torque as columns tau_x, .*; found tau_x"),
    "comment": (_csv(f"# by hand\n{_HEADER}1,2,3,4,5,6\n"), "row 1: expected 1 values, got 6"),
    "decimal commas": (
        _csv(_HEADER.replace(",", ";") + "1;2;3;-1,25;5;6\n"),
        "got '-1,25' in row 1, column f_x; numbers have a decimal point, as -1.25",
    ),
    "commas of two kinds": (_csv(_HEADER + "1,2,3,4,0,5,6\n"), "got 7; numbers have decimal points, not commas"),
    "no rows": (_csv(_HEADER), "at least one wrench, got no rows"),
    "empty": (_csv(""), "found nothing"),
    "NaN row": (_csv(_HEADER + "1,2,3,4,5,6\n1,nan,3,4,5,6\n"), "finite numbers, got nan in row 2, column tau_y"),
    "word": (_csv(_HEADER + "1,2,3,4,five,6\n"), "a number, got 'five' in row 1, column f_y"),
    "short row": (_csv(_HEADER + "1,2,3\n"), "row 1: expected 6 values, got 3"),
    "not text": (("bad.csv", lambda path: path.write_bytes(b"\xff\xfe\x00\x01")), "text in UTF-8"),
    "missing array": (_npz(tau=_ONES), "force as columns f_x, f_y, f_z; found tau_x"),
    "half a motion": (_npz(tau=_ONES, f=_ONES, w=_ONES), "velocity as columns v_x, v_y, v_z"),
    "wrong shape": (
        _npz(tau=_ONES, f=np.ones((4, 2))),
        "force as columns .*; found tau_x, tau_y, tau_z, f_0, f_1",
    ),
    "different lengths": (_npz(tau=_ONES, f=np.ones((5, 3))), "all parts of one length, got .*'tau': 4, 'f': 5"),
    "integers": (_npz(tau=_ONES.astype(int), f=_ONES.astype(int)), "tau: expected float16, .* numbers, got int64"),
    "NaN array": (_npz(tau=_ONES, f=_HOLE), r"finite numbers, got nan in row 3, column f_y"),
    "no rows, npz": (_npz(tau=np.ones((0, 3)), f=np.ones((0, 3))), "at least one wrench"),
    "objects": (_npz(f=np.array([None, {}])), "NumPy .npz archive of arrays"),
    "not an archive": (("bad.npz", lambda path: path.write_text("hello")), "NumPy .npz archive"),
    "other ending": (("bad.txt", lambda path: path.write_text("")), "ending in .npz, .csv or .tsv, got .txt"),
    "no file": (("bad.npz", lambda path: None), "no such file"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_file_says_where_and_writes_nothing(case, tmp_path, capsys):
    (name, write), message = BAD_FILES[case]
    write(tmp_path / name)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(WrenchFileError, match=message):
        WrenchFile(tmp_path / name).all_parts()
    assert main([str(tmp_path / name), *OFFSET, *SMALL]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and name in error
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["FILE"],
            "--offset: expected X Y Z, the position of the new point from the old, with a file, as in --offset 0.3",
        ),
        (["FILE", "--offset", "1", "2"], "expected 3 arguments; as in --offset 0.3 0 -0.1\n"),
        (["FILE", "--offset", "1", "2", "inf"], "expected a finite number of metres, got inf; as in --offset 0.3"),
        (
            ["FILE", "--offset", "1,5", "2", "0"],
            "of metres, got 1,5; numbers have a decimal point, as 1.5; as in --offset",
        ),
        (["FILE", "--offset", "1", "2", "three"], "expected a finite number of metres, got three"),
        (["--operation", "twist"], "invalid choice: 'twist'"),
        (["--largest", "10"], "expected at least 1000 wrenches, got 10"),
        (["FILE", *OFFSET, "--picture", "nowhere/x.png"], "expected a folder to write to"),
        (["FILE", *OFFSET, "--picture", "x.doc"], "expected a name ending in"),
    ],
)
def test_bad_arguments(arguments, message, tmp_path, wrenches, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = _write_csv(tmp_path / "mine.csv", wrenches)
    try:
        status = main([str(path) if a == "FILE" else a for a in arguments])
    except SystemExit as exit:
        status = exit.code
    assert status == 2 and message in capsys.readouterr().err

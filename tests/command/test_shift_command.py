"""python -m jaxspatial shift: wrenches of a file about another point and in other axes, and nothing else."""

import cProfile
import io
import pathlib
import pstats
import re
import sys
import tracemalloc

import numpy as np
import pytest

from jaxspatial.command import wrench_file
from jaxspatial.command.main import main
from jaxspatial.command.wrench_file import WrenchFile, moved
from jaxspatial.measure.operation import rotating_body

OFFSET = ["--offset", "0.1", "-0.2", "0.3"]
P = np.array([0.1, -0.2, 0.3])
# A third of a turn about the diagonal: x to y, y to z, z to x; exact, and told from its inverse.
THIRD = ["0.5", "0.5", "0.5", "0.5"]
COLUMNS = [f"{part}_{axis}" for part in ("tau", "f", "w", "v") for axis in "xyz"]


@pytest.fixture
def wrenches(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return rotating_body(40)


def _write(columns, table, separator=",", path="mine.csv", end="\n"):
    lines = [separator.join(columns), *(separator.join(map(repr, row)) for row in np.asarray(table).tolist())]
    with open(path, "w", newline="") as file:
        file.write("".join(line + end for line in lines))
    return path


def _table(wrenches):
    return np.concatenate(wrenches, axis=1)


def _turned(x):
    return np.roll(x, 1, axis=-1)


def _read(path="mine_shifted.csv", **named):
    return WrenchFile(path, named).all_parts()


def test_only_converts(wrenches, tmp_path, capsys):
    _write([*COLUMNS, "time"], np.c_[_table(wrenches), np.arange(40.0)])
    assert main(["shift", "mine.csv", *OFFSET]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said == ["40 wrenches and velocities shifted: mine_shifted.csv", "as they were: time"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.csv", "mine_shifted.csv"]
    out = _read()
    np.testing.assert_array_equal(out["tau"], wrenches.tau - np.cross(P, wrenches.f))
    np.testing.assert_array_equal(out["v"], wrenches.v + np.cross(wrenches.w, P))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_and_what_is_not_moved_stay(separator, end, wrenches):
    """Down to the spelling of numbers, and the ends of lines."""
    columns = ["note", *COLUMNS[:6]]
    lines = [separator.join(columns), *(separator.join(["a b", "1", "2", "3", "1e0", "5.00", "+6"]) for _ in range(2))]
    with open("mine.csv", "w", newline="") as file:
        file.write(end.join(lines) + end)
    assert main(["shift", "mine.csv", "--offset", "1", "0", "0"]) == 0
    with open("mine_shifted.csv", newline="") as file:
        rows = file.read().split(end)
    assert rows[0] == lines[0] and rows[-1] == "" and len(rows) == 4
    assert rows[1].split(separator) == ["a b", "1.0", "8.0", "-2.0", "1e0", "5.00", "+6"]


def test_quotes_are_kept_where_needed(wrenches):
    with open("mine.csv", "w") as file:
        file.write('"a,b",' + ",".join(COLUMNS[:6]) + '\n"x, ""y""",1,2,3,4,5,6\n')
    assert main(["shift", "mine.csv", "--offset", "0", "0", "0"]) == 0
    assert pathlib.Path("mine_shifted.csv").read_text() == pathlib.Path("mine.csv").read_text()


def test_columns_by_name(wrenches):
    names = ["Mx", "My", "Mz", "force_x", "force_y", "force_z"]
    _write(names, _table(wrenches)[:, :6], ";")
    assert main(["shift", "mine.csv", *OFFSET, "--columns", "tau=Mx,My,Mz", "f=force"]) == 0
    out = _read(tau=("Mx", "My", "Mz"), f=("force",))
    np.testing.assert_array_equal(out["tau"], wrenches.tau - np.cross(P, wrenches.f))
    assert pathlib.Path("mine_shifted.csv").read_text().startswith(";".join(names) + "\n")


def test_arrays_by_name(wrenches):
    both = np.concatenate([wrenches.f, wrenches.tau], axis=1)
    np.savez("mine.npz", wrench=both, unit="N")
    named = ["--columns", "tau=wrench_3,wrench_4,wrench_5", "--columns", "f=wrench_0,wrench_1,wrench_2"]
    assert main(["shift", "mine.npz", *OFFSET, *named, "--output", "out.npz"]) == 0
    out = np.load("out.npz")
    expected = np.concatenate([wrenches.f, wrenches.tau - np.cross(P, wrenches.f)], axis=1)
    np.testing.assert_array_equal(out["wrench"], expected)
    assert out["unit"] == "N"


@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_other_names_are_asked_for(ending, wrenches, capsys):
    """The message names the option that takes them, and with it the command does its work."""
    names = "Mx,My,Mz", "Fx,Fy,Fz"
    both = dict(zip(",".join(names).split(","), _table(wrenches)[:, :6].T, strict=True))
    path = _write(both, np.stack([*both.values()], axis=1)) if ending == "csv" else "mine.npz"
    if ending == "npz":
        np.savez(path, **both)
    assert main(["shift", path, *OFFSET]) == 2
    message = capsys.readouterr().err
    assert re.search(r"expected force as .*; found Mx, .*; if named otherwise: --columns tau=", message)
    option = [f"{part}={x}" for part, x in zip(("tau", "f"), names, strict=True)]
    assert " ".join(["--columns", *option]) in message
    assert main(["shift", path, *OFFSET, "--columns", *option]) == 0


def test_velocities_that_stay_behind_are_mentioned(wrenches, capsys):
    """Of other names, they are not moved: the command says which columns stay, and moves them once they are named."""
    names = ["wx", "wy", "wz", "vx", "vy", "vz"]
    columns = [*COLUMNS[:6], *names, "t", "x", "y", "z"]
    _write(columns, np.c_[_table(wrenches), np.arange(40.0), np.tile(P, (40, 1))])
    assert main(["shift", "mine.csv", "--offset", "x", "y", "z"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == "40 wrenches shifted: mine_shifted.csv"
    assert second.startswith("as they were: wx, wy, wz, vx, vy, vz, t; what is a velocity among them moves once it")
    named = ["--columns", "w=wx,wy,wz", "v=vx,vy,vz"]
    assert main(["shift", "mine.csv", "--offset", "x", "y", "z", *named, "--overwrite"]) == 0
    assert capsys.readouterr().out.startswith("40 wrenches and velocities shifted: mine_shifted.csv\n")
    moved_v = _read(w=("wx", "wy", "wz"), v=("vx", "vy", "vz"))["v"]
    np.testing.assert_array_equal(moved_v, wrenches.v + np.cross(wrenches.w, P))


def test_forces_alone_in_a_table(wrenches, capsys):
    """Act at the point itself: about another they have a torque, for which there are new columns."""
    _write(["t", *COLUMNS[3:6]], np.c_[np.arange(40.0), wrenches.f])
    assert main(["shift", "mine.csv", *OFFSET]) == 0
    assert "no torques tau_x, tau_y, tau_z: its forces act at their point" in capsys.readouterr().out
    out = _read()
    np.testing.assert_array_equal(out["tau"], -np.cross(P, wrenches.f))
    np.testing.assert_array_equal(out["f"], wrenches.f)
    header, first, *_ = pathlib.Path("mine_shifted.csv").read_text().splitlines()
    assert header == "t,f_x,f_y,f_z,tau_x,tau_y,tau_z" and first.startswith("0.0,")


def test_forces_alone_in_an_archive(wrenches):
    np.savez("mine.npz", force=wrenches.f.astype(np.float32))
    assert main(["shift", "mine.npz", *OFFSET, "--columns", "f=force"]) == 0
    out = np.load("mine_shifted.npz")
    expected = -np.cross(P.astype(np.float32), wrenches.f.astype(np.float32))
    np.testing.assert_array_equal(out["tau"], expected, strict=True)


def test_half_a_torque_is_refused(wrenches, capsys):
    _write(["tau_x", "tau_y", *COLUMNS[3:6]], _table(wrenches)[:, 1:6])
    assert main(["shift", "mine.csv", *OFFSET]) == 2
    assert "expected torque as columns tau_x, tau_y, tau_z; found tau_x, tau_y, f_x" in capsys.readouterr().err


def test_rotation(wrenches):
    _write(COLUMNS, _table(wrenches))
    assert main(["shift", "mine.csv", "--rotation", *THIRD]) == 0
    for part, x in _read().items():
        np.testing.assert_array_equal(x, _turned(getattr(wrenches, part)))


def test_rotation_comes_after_the_offset(wrenches):
    _write(COLUMNS, _table(wrenches))
    assert main(["shift", "mine.csv", "--rotation", *THIRD, *OFFSET]) == 0
    np.testing.assert_array_equal(_read()["tau"], _turned(wrenches.tau - np.cross(P, wrenches.f)))


def test_pose(wrenches):
    """Of frame B in A: from B's origin, in B, to A's, in A; power does not change."""
    _write(COLUMNS, _table(wrenches))
    assert main(["shift", "mine.csv", "--pose", *THIRD, "0.1", "-0.2", "0.3"]) == 0
    out, f = _read(), _turned(wrenches.f)
    np.testing.assert_allclose(out["tau"], _turned(wrenches.tau) + np.cross(P, f), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(out["f"], f)
    before = (wrenches.tau * wrenches.w).sum(-1) + (wrenches.f * wrenches.v).sum(-1)
    after = (out["tau"] * out["w"]).sum(-1) + (out["f"] * out["v"]).sum(-1)
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-11)


def test_a_pose_per_row(wrenches):
    """Each row is what it is with its pose given for all."""
    rng = np.random.default_rng(1)
    q, p = rng.standard_normal((40, 4)), rng.standard_normal((40, 3))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    _write([*COLUMNS, "a", "b", "c", "d", "px", "py"], np.c_[_table(wrenches), q, p[:, :2]])
    assert main(["shift", "mine.csv", "--pose", "a", "b", "c", "d", "px", "py", "-1e-3"]) == 0
    out, parts = _read(), _read("mine.csv")
    for i in (0, 17, 39):
        single = moved(parts, pose=np.array([*q[i], *p[i, :2], -1e-3]))
        for part, x in single.items():
            np.testing.assert_array_equal(out[part][i], x[i])
    assert len({tuple(row) for row in out["f"] / np.linalg.norm(out["f"], axis=1, keepdims=True)}) == 40


def test_an_offset_per_row_of_an_archive(wrenches):
    p = np.random.default_rng(2).standard_normal((40, 3)).astype(np.float32)
    parts = {"tau": wrenches.tau.astype(np.float32), "f": wrenches.f.astype(np.float32)}
    np.savez("mine.npz", **parts, p=p, height=np.arange(40))
    assert main(["shift", "mine.npz", "--offset", "p_x", "0", "height"]) == 0
    offset = np.stack([p[:, 0], 0 * p[:, 0], np.arange(40, dtype=np.float32)], axis=-1)
    expected = parts["tau"] - np.cross(offset, parts["f"])
    np.testing.assert_array_equal(np.load("mine_shifted.npz")["tau"], expected, strict=True)


def test_precision(wrenches):
    """What cancels keeps its digits where asked for."""
    np.savez("mine.npz", tau=np.float32([[1, 0, 0]]), f=np.float32([[0, 16777216, 16777215]]))
    compensated = ["--offset", "0", "1", "1.0000001", "--precision", "compensated"]
    p = [float(np.float32(x)) for x in (0, 1, 1.0000001)]
    assert main(["shift", "mine.npz", *compensated]) == 0
    exact = 1 - (p[1] * 16777215 - p[2] * 16777216)
    assert np.load("mine_shifted.npz")["tau"][0, 0] == np.float32(exact)


BAD = {
    "nothing to do": ([], "expected --offset X Y Z, --rotation W X Y Z or --pose.*, as in --offset 0.3 0 -0.1, or"),
    "absent columns": (
        ["--offset", "p_x", "p_y", "p_z"],
        "expected one column 'p_x', got no.*; as in --offset 0.3 0 -0.1, or with columns of .*, --offset p_x p_y p_z",
    ),
    "absent quaternion": (
        ["--rotation", *"wxyz"],
        "column 'w', .*; as in --rotation 1 0 0 0, .* --rotation q_w q_x q_y",
    ),
    "one column for three": (
        ["--offset", "p"],
        "--offset: expected 3 arguments; as in --offset 0.3 .* --offset p_x p_y p_z",
    ),
    "one text for three": (["--offset", "0.3,0,0"], "--offset: expected 3 arguments; as in --offset 0.3 0 -0.1"),
    "decimal comma": (
        ["--offset", "0,3", "0", "0"],
        "expected a finite number, got 0,3; .* decimal point, as 0.3; as in",
    ),
    "two positions": (["--pose", *THIRD, "0", "0", "0", *OFFSET], "--pose: is a rotation and a position"),
    "no such column": (["--offset", "0", "0", "height"], "expected one column 'height', got no numbers of that name"),
    "twice": (["--offset", "0", "0", "twice"], "expected one column 'twice', got 2 of that name"),
    "words": (["--offset", "0", "0", "word"], "expected a number, got 'up' in row 1, column word"),
    "infinite": (["--offset", "0", "0", "far"], "expected 1 finite numbers, got others in row 1, column far"),
    "not a unit": (["--rotation", "1", "1", "0", "0"], "--rotation: expected a unit quaternion W X Y Z first.*1.41421"),
    "not a unit, in a row": (["--rotation", "tau_x", "0", "0", "0"], "one of norm 2 in row 1"),
    "another format": ([*OFFSET, "--output", "x.npz"], "--output: expected a name ending in .csv"),
    "unknown part": ([*OFFSET, "--columns", "torque=x,y,z"], "--columns: expected tau, f, w, v with one name or three"),
    "absent": ([*OFFSET, "--columns", "f=Fx,Fy,Fz"], "force as columns Fx, Fy, Fz; found tau_x.*far$"),
    "absent motion": ([*OFFSET, "--columns", "w=a,b,c", "v=d,e,f"], "angular velocity as columns a, b, c"),
    "no number": (["--offset", "0", "0", "nan"], "expected a finite number, got nan"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_done_is_said(case, wrenches, tmp_path, capsys):
    arguments, message = BAD[case]
    with open("mine.csv", "w") as file:
        file.write(",".join([*COLUMNS[:6], "twice", "twice", "word", "far"]) + "\n2,2,3,4,5,6,0,0,up,inf\n")
    try:
        status = main(["shift", "mine.csv", *arguments])
    except SystemExit as exit:
        status = exit.code
    assert status == 2 and [p.name for p in tmp_path.iterdir()] == ["mine.csv"]
    assert re.search(message, capsys.readouterr().err)


def test_rows_take_few_calls(wrenches):
    """Of functions of Python and C: for a row of ten numbers, one to write each, and six more."""

    def calls(copies):
        table = np.tile(np.c_[_table(wrenches)[:, :6], np.tile([1.0, 0, 0, 0], (40, 1))], (copies, 1))
        _write([*COLUMNS[:6], *"abcd"], table)
        with cProfile.Profile() as profile:
            assert main(["shift", "mine.csv", "--pose", *"abcd", "1", "2", "3", "--overwrite"]) == 0
        return pstats.Stats(profile).total_calls

    for copies in (10, 20):
        calls(copies)  # compiles
    assert calls(20) - calls(10) <= 18 * 400


# -- files that are read and written in blocks -------------------------------------------------------------------------

# Not a divisor of 40.
BLOCK = 7


def _both(monkeypatch, name, *arguments):
    """The bytes of what the command writes in one block and in several."""
    found = []
    for rows in (10**6, BLOCK):
        monkeypatch.setattr(wrench_file, "_BLOCK", rows)
        assert main(["shift", name, *arguments, "--overwrite"]) == 0
        found.append(pathlib.Path(name).with_stem("mine_shifted").read_bytes())
    return found


def test_blocks_of_a_table_are_not_seen(wrenches, monkeypatch, capsys):
    """Quotes in one of them, empty lines and a pose per row included."""
    table = np.c_[_table(wrenches), np.random.default_rng(0).standard_normal((40, 3))]
    _write([*COLUMNS, "p_x", "p_y", "p_z"], table)
    lines = pathlib.Path("mine.csv").read_text().splitlines()
    notes = [f"note {i}" if i % 5 else f'"a, {i}"' for i in range(40)]
    rows = [f"{note},{line}" for note, line in zip(notes, lines[1:], strict=True)]
    pathlib.Path("mine.csv").write_text("\n".join([f"note,{lines[0]}", "", *rows[:20], "", *rows[20:]]) + "\n")
    whole, blocks = _both(monkeypatch, "mine.csv", "--offset", "p_x", "p_y", "p_z")
    assert blocks.splitlines()[:20] == whole.splitlines()[:20] and len(blocks.splitlines()) == 41
    out = _read()
    np.testing.assert_array_equal(out["tau"], wrenches.tau - np.cross(table[:, 12:], wrenches.f))
    assert [row.rpartition(b",")[0].startswith(b'"a, ') for row in blocks.splitlines()[1:]] == [
        i % 5 == 0 for i in range(40)
    ]
    assert capsys.readouterr().out.count("40 wrenches and velocities shifted") == 2


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_an_archive_holds(save, wrenches):
    """Arrays in Fortran's order, columns of one array, and what has another length included."""
    both = np.concatenate([wrenches.f, wrenches.tau], axis=1)
    p = np.asfortranarray(np.random.default_rng(0).standard_normal((40, 3)))
    save("mine.npz", wrench=both, p=p, w=np.asfortranarray(wrenches.w), v=wrenches.v, unit="N", times=np.arange(100))
    named = ["--columns", "tau=wrench_3,wrench_4,wrench_5", "f=wrench_0,wrench_1,wrench_2"]
    assert main(["shift", "mine.npz", "--pose", *THIRD, "p_x", "p_y", "p_z", *named]) == 0
    out = np.load("mine_shifted.npz")
    whole = moved(_read("mine.npz", tau=("wrench_3", "wrench_4", "wrench_5"), f=("wrench_0", "wrench_1", "wrench_2")),
                  pose=np.c_[np.full((40, 4), 0.5), p])  # fmt: skip
    np.testing.assert_array_equal(out["wrench"], np.concatenate([whole["f"], whole["tau"]], axis=1))
    np.testing.assert_array_equal(out["w"], whole["w"])
    np.testing.assert_array_equal(out["v"], whole["v"])
    assert out["unit"] == "N" and (out["times"] == np.arange(100)).all() and (out["p"] == p).all()


LATE = {
    "short row": (lambda rows: rows[30].__delitem__(0), "row 31: expected 6 values, got 5"),
    "word": (lambda rows: rows[30].__setitem__(0, "up"), "expected a number, got 'up' in row 31, column tau_x"),
    "nan": (lambda rows: rows[30].__setitem__(0, "nan"), "got nan in row 31, column tau_x, in float64$"),
    "several": (
        lambda rows: [rows[i].__setitem__(0, "nan") for i in (29, 30, 39)],
        "got nan in row 30, column tau_x",
    ),
    "overflow": (
        lambda rows: rows[30].__setitem__(4, "1e308"),
        "torque about the new point is too large, got -?inf in row 31, column tau_x, in float64",
    ),
}


@pytest.mark.parametrize("case", LATE)
def test_what_is_wrong_in_a_later_block(case, wrenches, monkeypatch, tmp_path, capsys):
    """Is named by its row in the file, and nothing is written."""
    change, message = LATE[case]
    rows = [list(map(repr, row)) for row in np.asarray(_table(wrenches)[:, :6]).tolist()]
    change(rows)
    pathlib.Path("mine.csv").write_text("\n".join(map(",".join, [COLUMNS[:6], *rows])))
    monkeypatch.setattr(wrench_file, "_BLOCK", BLOCK)
    assert main(["shift", "mine.csv", "--offset", "0", "0", "100"]) == 2
    assert re.search(message, capsys.readouterr().err.strip()) and [p.name for p in tmp_path.iterdir()] == ["mine.csv"]


def test_an_archive_that_is_damaged(wrenches, tmp_path, capsys):
    """Where its numbers are read: the last rows of the first array."""
    np.savez("mine.npz", tau=np.tile(wrenches.tau, (10, 1)), f=np.tile(wrenches.f, (10, 1)))
    content = bytearray(pathlib.Path("mine.npz").read_bytes())
    content[9000] ^= 1
    pathlib.Path("mine.npz").write_bytes(content)
    assert main(["shift", "mine.npz", *OFFSET]) == 2
    assert "Bad CRC-32" in capsys.readouterr().err and len(list(tmp_path.iterdir())) == 1


def test_memory_is_that_of_a_block(wrenches, monkeypatch):
    """Not of the table: four times the rows take no more."""
    monkeypatch.setattr(wrench_file, "_BLOCK", 500)
    peaks = []
    for n in (50, 200):
        _write(COLUMNS, np.tile(_table(wrenches), (n, 1)))
        assert main(["shift", "mine.csv", *OFFSET, "--overwrite"]) == 0
        tracemalloc.start()
        assert main(["shift", "mine.csv", *OFFSET, "--overwrite"]) == 0
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_a_bar_on_a_terminal(wrenches, monkeypatch):
    """Which ends at all of the work; it leaves nothing behind."""
    pytest.importorskip("rich")
    _write(COLUMNS, _table(wrenches))

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    shares, terminal = [], Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(wrench_file, "_BLOCK", BLOCK)
    assert main(["shift", "mine.csv", *OFFSET]) == 0
    assert "100%" in terminal.getvalue()
    log = WrenchFile("mine.csv")
    assert log.rewrite(io.BytesIO(), lambda table, parts: moved(parts, P), shares.append) == 40
    assert len(shares) >= 6 and shares == sorted(shares) and shares[-1] == 1.0


def test_help_of_subcommands(capsys):
    for name in ("shift", "self-check", "trade", "demo"):
        with pytest.raises(SystemExit) as exit:
            main([name, "--help"])
        assert exit.value.code == 0 and "usage: jaxspatial" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "shift FILE" in capsys.readouterr().out


@pytest.mark.parametrize("job", [[], ["shift"]])
def test_the_help_has_examples(job, wrenches, capsys):
    """Which do what they say."""
    with pytest.raises(SystemExit):
        main([*job, "--help"])
    text = capsys.readouterr().out
    assert "--offset 0.3 0 -0.1" in text and ("--offset p_x p_y p_z" in text) is bool(job)
    (lines,) = re.findall(r"  (tau_x,.*)\n  (.*)\n", text)
    pathlib.Path("mine.csv").write_text("\n".join(lines))
    assert main(["shift", "mine.csv", *OFFSET]) == 0


def test_names_behind_a_sign_of_comments(wrenches):
    """As NumPy writes them."""
    np.savetxt("mine.csv", _table(wrenches), delimiter=",", header=",".join(COLUMNS))
    assert main(["shift", "mine.csv", *OFFSET]) == 0
    np.testing.assert_array_equal(_read()["tau"], wrenches.tau - np.cross(P, wrenches.f))


def test_a_column_of_row_numbers_is_no_comment(wrenches):
    _write(["#", *COLUMNS[:6]], np.c_[np.arange(40), _table(wrenches)[:, :6]])
    assert main(["shift", "mine.csv", *OFFSET]) == 0


def test_a_subcommand_that_is_misspelt_is_told(wrenches, capsys):
    assert main(["shfit", "mine.csv", *OFFSET]) == 2
    assert capsys.readouterr().err == "error: shfit: expected a subcommand or a file; did you mean 'shift'?\n"


@pytest.mark.parametrize("port", ["abc", "-1", "65536"])
def test_a_port_that_there_is_not_is_refused_before_any_work(port, capsys):
    with pytest.raises(SystemExit):
        main(["demo", "--port", port])
    assert f"argument --port: expected a number from 0 to 65535, got {port}" in capsys.readouterr().err


def test_nobody_is_advised_to_load_pickles(wrenches, capsys):
    pathlib.Path("mine.npz").write_text("tau_x")
    assert main(["shift", "mine.npz", *OFFSET]) == 2
    assert capsys.readouterr().err == "error: mine.npz: expected a NumPy .npz archive of arrays, got no archive\n"

"""What people see: a table of a screen, SI units beside ulps, a picture that says what its lines are."""

import math
import re

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

import jaxspatial as js
from jaxspatial.command import algorithms, first_look, picture, quadruped, report, trade
from jaxspatial.command.algorithms import Evaluated, Loss
from jaxspatial.command.result import Result
from jaxspatial.command.trade import Curve, Point
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.numerics.precision import OF_ALGORITHMS, Precision

SCREEN = (80, 24)


def _row(case, worst=3.21e-17):
    seconds, errors = np.array([1.5e-9, 2.5e-8, 4.5e-8]), np.array([0.25, 77_000.0])
    streamed = seconds if case.dtype in trade.STREAMED else None
    return trade.Row(case, seconds, streamed, 0.5, errors, 0.9, tuple(worst for _ in OPERATIONS[case.operation].units))


def _evaluated(case):
    is_reference = (case.dtype, case.precision) == algorithms.REFERENCE
    errors = (np.full(3, np.nan), np.nan) if is_reference else (np.array([0.5, 77_000.0, 2.0]), 3.21e-17)
    return Evaluated(case, np.array([1.25e-6, 2.5e-6, 3e-5]), 0.5, *errors, "rad/s²")


def _curve(name, dtype, precision):
    return Curve(name, dtype, precision, tuple(Point(10.0**i, 20, 10.0**i, 0.5) for i in range(0, 16, 4)))


@pytest.fixture
def result():
    """All rows and curves that there can be, with numbers as wide as they come."""
    rows = [_row(case) for case in trade.cases()]
    curves = [_curve(name, dtype, str(p)) for name, dtype in trade.curved() for p in Precision]
    evaluated = [_evaluated(case) for case in algorithms.cases()]
    losses = [Loss("x" * 40, "rad/s²", 1.25e3, dict.fromkeys(map(str, OF_ALGORITHMS), 3.21e-17))] * 5
    return Result("1,000,000 wrenches", "a machine", np.zeros(3), trade.sizes(), {}, rows, curves, evaluated, losses)


def _lines(result, full, capsys):
    report.print_trade(Console(width=SCREEN[0]), result, full)
    return capsys.readouterr().out.rstrip().splitlines()


def test_the_table_is_a_screen(result, capsys):
    lines = _lines(result._replace(algorithms=[], losses=[]), False, capsys)
    assert len(lines) < SCREEN[1] and max(map(len, lines)) <= SCREEN[0]
    for operation in OPERATIONS.values():
        assert sum(operation.title in line for line in lines) == 2
    assert "--full" in lines[-1]


@pytest.mark.parametrize("full", [False, True])
def test_algorithms_and_applications_are_another_screen(result, full, capsys):
    lines = _lines(result._replace(rows=[]), full, capsys)
    assert 15 < len(lines) < SCREEN[1] and max(map(len, lines)) <= SCREEN[0]
    both = [line for line in lines if line.startswith("inverse dynamics")]
    assert re.fullmatch(r"inverse dynamics +2\.50 +2\.50 +2\.50 +77000 3\.2e-17 +77000 3\.2e-17 rad/s²", both[0])
    assert both[1].endswith("77000 3.2e-17   ref.    ref. rad/s²")
    assert lines[-1].split() == ["x" * 40, "1250", *["3.2e-17"] * 3, "rad/s²"]


def test_newtons_beside_ulps(result, capsys):
    """In both tables: the worst error of a torque, in N m, and in ulps."""
    line = next(line for line in _lines(result, False, capsys) if line.startswith("shift force"))
    assert re.fullmatch(r"shift force +25\.0 +25\.0 +25\.0 +25\.0 +77000 +3\.2e-17 +77000 +3\.2e-17 N m", line)
    line = next(line for line in _lines(result, True, capsys) if "cross force" in line)
    assert "3.2e-17 N m/s, 3.2e-17 N/s" in line and "77000" in line


def test_gigabytes_are_what_is_read_and_written_in_the_median_time():
    """Of a power twelve numbers in and one out, 4 bytes each, in 25 ns."""
    assert _row(trade.Case("dot", "float32", "fast")).gigabytes_per_second == pytest.approx(13 * 4 / 25)


def test_full_is_everything(result, capsys):
    text = "\n".join(_lines(result._replace(algorithms=[], losses=[]), True, capsys))
    assert all(name in text for name in (*trade.DTYPES, *Precision, "GB/s", "compile", "promised"))
    assert "u |r| + 8 u² mag" in text and "u |r| + 32 u² mag" in text
    assert "…" not in text and text.count("reproducible") == len(OPERATIONS) * len(trade.DTYPES)


def test_dtypes_asked_for_are_shown(result, capsys):
    some = [row for row in result.rows if row.case.dtype in ("float16", "float64")]
    lines = _lines(result._replace(rows=some, algorithms=[], losses=[]), False, capsys)
    assert {"float16", "float64"} <= set(lines) and "float32" not in lines


def test_what_was_not_measured_is_a_dash(result, capsys):
    rows = [_row(row.case, math.nan)._replace(ulps=np.array([])) for row in result.rows]
    for full in (False, True):
        text = "\n".join(_lines(result._replace(rows=rows), full, capsys))
        assert "nan" not in text and " -" in text


def test_errors_in_units_are_exact():
    """Off by a quarter of a newton metre in one torque of three."""
    operation = OPERATIONS["shift_force"]
    tau, f, p = (np.float32([[1, 2, 3], [4, 5, 6]]) for _ in range(3))
    computed = (tau - np.cross(p, f)).astype(np.float32)
    computed[1, 2] += 0.25
    assert operation.in_units([computed], operation.exactly(tau, f, p)) == (0.25,)
    assert operation.in_units([np.full_like(computed, np.nan)], operation.exactly(tau, f, p)) == (math.inf,)
    assert all(len(o.units) == len(o.bounds) == len(o.formulas) for o in OPERATIONS.values())


def test_the_picture_explains_itself(result, tmp_path):
    """In SVG the texts and the legends can be found."""
    picture.draw(result, tmp_path / "x.svg", "svg")
    text = (tmp_path / "x.svg").read_text()
    assert text.count("of a cancelled result") == 3
    assert [f'id="legend_{i}"' in text for i in range(1, 7)] == [True] * 5 + [False]
    assert "of 1250 rad/s² fast is off by 3.2e-17, compensated by 3.2e-17" in text and "inverse dynamics" in text
    for words in ("one operation, in", "rounded correctly", "promised: never above", "error as large as the result"):
        assert words in text, words
    assert text.count("faithful") >= 3 and text.count("shift acceleration") >= 2


def test_picture_of_little(result, tmp_path):
    """One narrow format, and no curve: still a picture."""
    rows = [row for row in result.rows if (row.case.operation, row.case.dtype) == ("cross_motion", "float16")]
    picture.draw(result._replace(rows=rows, curves=[], algorithms=[], losses=[]), tmp_path / "little.png", "png")
    with Image.open(tmp_path / "little.png") as drawn:
        assert rows and len(drawn.convert("RGB").getcolors(2**24)) > 100


@pytest.mark.slow
def test_curves_of_one_dtype_are_labelled_alone(result, tmp_path):
    curves = [curve for curve in result.curves if curve.dtype == "float32"]
    picture.draw(result._replace(curves=curves), tmp_path / "x.svg", "svg")
    text = (tmp_path / "x.svg").read_text()
    assert "float64: no digit" not in text and "float32: no digit" in text


@pytest.fixture
def look():
    """A first look with numbers as wide as they come, and names as long as they are."""
    times = dict.fromkeys((*first_look.PRECISIONS, first_look.CROSS, first_look.MEMORY), 21.0)
    errors = dict.fromkeys(first_look.PRECISIONS, 3.21e-17)
    losses = [Loss(a.name, a.unit, 1.25e3, errors, a.states) for a in algorithms.FIRST_LOOK]
    return first_look.Look(times, dict.fromkeys(first_look.PRECISIONS, 1.25), 1_250_000.0, 1250.0, 2.5, losses)


def test_the_first_look_is_a_page_with_batch_and_unit_in_every_row(look, capsys):
    report.print_first_look(Console(width=SCREEN[0]), look)
    lines = capsys.readouterr().out.rstrip().splitlines()
    assert len(lines) < 40 and max(map(len, lines)) <= SCREEN[0]
    batches = re.findall("batch ([0-9,]*[0-9])", "\n".join(lines))
    assert batches == ["1,000,000", "4096", "256", "1,000,000", "4096", "200", "200", "8", "64"]
    for words in ("ns each", "1,250,000", "2.50 mm", "of 1250 N m,", "of 1250 m/s²,", "--full", ".[view]"):
        assert any(words in line for line in lines), words


@pytest.mark.slow
def test_the_first_look_is_a_picture(look, tmp_path, monkeypatch):
    """With a robot that is pushed, its contact forces, and what applications lose."""
    mech, (q, _) = quadruped.mechanism(), quadruped.standing()
    feet = js.AppliedForces(quadruped.FEET.frames, js.SpatialForce(f=np.tile(np.float32([0, 0, 30]), (1, 4, 1))))
    push = {"trunk": js.SpatialForce(f=np.float32([[0, 60, 0]]))}
    monkeypatch.setattr(quadruped, "pushed", lambda *_: (mech, q[None], [feet, push]))
    picture.draw_first_look(look, tmp_path / "x.svg", "svg")
    text = (tmp_path / "x.svg").read_text()
    for words in ("1,250,000 steps a second, batch 4096", "js.shift", "of 1250 m/s²", "What an application"):
        assert words in text, words

"""Ratios that are kept, and what fell below them: of numbers that are known."""

import pathlib

import numpy as np
import pytest

# For these imports only, as in `test_dynamics_claims.py`.
with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(pathlib.Path(__file__).parent))
    import dynamics_guard as guard
    from dynamics_claims import FORWARD, INVERSE, MANY, OURS, PINOCCHIO, Case, Results

ROW = guard.Row("g1", "float32", INVERSE, MANY)
OTHER = ROW._replace(dtype="float64", algorithm=FORWARD, batch=64)
KEPT = guard.Kept("abc1234", "2026-01-01", "a machine", {ROW: 5.0, OTHER: 2.0})


def test_ratios_are_of_rows_that_both_sides_ran():
    ours = Case(INVERSE, MANY, OURS)
    seconds = {ours: np.ones(3), ours._replace(who=PINOCCHIO): np.array([4.0, 5.0, 9.0]), Case(FORWARD, 1, OURS): [1.0]}
    assert guard.ratios([Results("g1", "float32", MANY, 2 * MANY, seconds, {}, {})]) == {ROW: 5.0}


@pytest.mark.parametrize("found, falls", [(4.51, False), (4.49, True), (50.0, False), (np.nan, True)])
def test_a_row_falls_where_it_loses_more_than_a_tenth(found, falls):
    fallen = guard.fallen(KEPT.ratios, {ROW: found})
    assert [x.row for x in fallen] == [ROW] * falls
    text = "\n".join(guard.lines(KEPT, {ROW: found}, fallen))
    assert f"{int(falls)} of 1 ratios" in text and "abc1234, 2026-01-01\n(a machine)" in text
    assert (f"g1, float32: {INVERSE}, batch {MANY}: 5 before, {found:.3g} now" in text) == falls


def test_new_rows_fall_below_nothing():
    assert not guard.fallen({}, {ROW: 1.0}) and not guard.fallen({OTHER: 2.0}, {ROW: 1.0})
    assert "nothing to compare with" in "\n".join(guard.lines(None, {ROW: 1.0}, []))


def test_a_run_takes_the_place_of_a_better_one_only_where_that_is_accepted():
    fallen = guard.fallen(KEPT.ratios, {ROW: 1.0})
    assert guard.is_to_be_kept(None, [], False) and guard.is_to_be_kept(KEPT, [], False)
    assert not guard.is_to_be_kept(KEPT, fallen, False) and guard.is_to_be_kept(KEPT, fallen, True)


def test_what_is_kept_is_read_back(tmp_path):
    path = tmp_path / "ratios.json"
    assert guard.read(path) is None
    path.write_text(guard.to_json(KEPT))
    assert guard.read(path) == KEPT


def test_what_is_kept_beside_the_benchmark_is_read():
    kept = guard.read()
    assert kept is None or all(x > 0 for x in kept.ratios.values())

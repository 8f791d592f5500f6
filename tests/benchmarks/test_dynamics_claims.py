"""What the benchmark of dynamics says of numbers that are known: which claims are met, and what it ends with."""

import pathlib

import numpy as np
import pytest

# For these imports only: the folder has a `dynamics.py`, and `dynamics` is a folder of tests too.
with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(pathlib.Path(__file__).parent))
    import dynamics_claims as claims
    import dynamics_report as report
    from dynamics_claims import (
        FORWARD,
        FORWARD_DERIVATIVES,
        FRAX,
        GRADIENT,
        INVERSE,
        JACFWD_FORWARD,
        LARGE,
        MANY,
        MASS,
        OURS,
        PINOCCHIO,
        PRODUCTS,
        RECOMMENDED,
        Case,
        Compiling,
        Results,
        Shape,
    )


def results(seconds, compiling=None, errors=None, robot="g1", dtype="float32"):
    seconds = {case: np.array([x, x, 3 * x]) * 1e-6 for case, x in seconds.items()}
    return Results(robot, dtype, MANY, LARGE, seconds, compiling or {}, errors or {})


def pair(algorithm, batch, other, ratio):
    """Ours of 10 us per state, and another's."""
    ours = Case(algorithm, batch, OURS)
    return {ours: 10.0, ours._replace(who=other): 10.0 * ratio}


def verdicts(found):
    return {x.what: x.is_met for x in claims.claims(found)}


@pytest.mark.parametrize(
    "dtype, algorithm, asked",
    [("float32", INVERSE, 5.0), ("float64", FORWARD, 2.5), ("float32", MASS, 3.0), ("float64", MASS, 1.5)],
)
def test_pinocchios_time_is_asked_to_be_a_multiple_of_ours(dtype, algorithm, asked):
    for ratio, is_met in ((1.01 * asked, True), (0.99 * asked, False)):
        (found,) = claims.claims(results(pair(algorithm, MANY, PINOCCHIO, ratio), dtype=dtype))
        assert (found.asked, found.is_met) == (asked, is_met) and np.isclose(found.found, ratio)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("algorithm", PRODUCTS)
def test_products_as_they_are_recommended_take_at_most_pinocchios_time_for_the_g1(algorithm, dtype):
    if algorithm not in RECOMMENDED:
        assert not list(claims.claims(results(pair(algorithm, MANY, PINOCCHIO, 0.5), dtype=dtype)))
        return
    for ratio, is_met in ((1.01, True), (0.99, False)):
        (found,) = claims.claims(results(pair(algorithm, MANY, PINOCCHIO, ratio), dtype=dtype))
        assert (found.asked, found.is_met) == (1.0, is_met) and np.isclose(found.found, ratio)
    assert not list(claims.claims(results(pair(algorithm, MANY, PINOCCHIO, 0.5), dtype=dtype, robot="panda")))


def test_seconds_to_trace_and_compile_are_added():
    case = Case(INVERSE, MANY, OURS)
    for compile_seconds, is_met in ((1.9, True), (2.1, False)):
        found = results({}, {case: Compiling(1.0, compile_seconds)})
        assert verdicts(found) == {f"{INVERSE}: trace and compile": is_met}


def test_large_batches_and_gradients_are_compared_with_the_main_batch_and_the_value():
    value = Case(FORWARD, MANY, OURS)
    times = {value: 10.0, value._replace(batch=LARGE): 10.9, value._replace(algorithm=GRADIENT): 41.0}
    large, gradient = claims.claims(results(times))
    assert large.is_met and np.isclose(large.found, 1.09)
    assert not gradient.is_met and np.isclose(gradient.found, 4.1)


def test_autodiff_is_compared_with_the_closed_forms():
    for took, is_met in ((0.9, True), (1.1, False)):
        times = {Case(JACFWD_FORWARD, MANY, OURS): took, Case(FORWARD_DERIVATIVES, MANY, OURS): 1.0}
        (found,) = claims.claims(results(times))
        assert found.is_met == is_met and np.isclose(found.found, took)


def test_one_state_is_told_in_microseconds_and_next_to_frax():
    ours, ahead = claims.claims(results(pair(INVERSE, 1, FRAX, 0.9), robot="panda"))
    assert ours.is_met and np.isclose(ours.found, 10.0) and ours.asked == 20.0
    assert not ahead.is_met and np.isclose(ahead.found, 0.9)


def test_the_worst_error_counts_and_nan_is_the_worst():
    errors = {Case(INVERSE, MANY, OURS): 1e-7, Case(FORWARD, MANY, OURS): 1e-2, Case(MASS, MANY, PINOCCHIO): 1.0}
    (found,) = claims.claims(results({}, errors=errors))
    assert found.found == 1e-2 and not found.is_met
    (found,) = claims.claims(results({}, errors=errors | {Case(MASS, MANY, OURS): np.nan}))
    assert np.isnan(found.found) and not found.is_met


def test_sizes_are_compared_with_the_smallest():
    seconds = {"10 links": np.ones(3), "1000 links": np.full(3, 1.4)}
    compiling, per_link = claims.claims_of_shape(Shape("chain", INVERSE, {k: np.ones(3) for k in seconds}, seconds))
    assert compiling.is_met and not per_link.is_met and np.isclose(per_link.found, 1.4)


def test_the_tables_have_every_time_with_its_spread_and_its_best_peer():
    times = pair(MASS, MANY, PINOCCHIO, 2.0) | {Case(MASS, MANY, FRAX): 80.0}
    compiling = {Case(MASS, MANY, OURS): Compiling(1.0, 2.5)}
    text = "\n".join(report.lines([results(times, compiling)], [], ["MJX: too long"], "a machine"))
    assert f"| {MASS} | {MANY} | 10 (10-26) | 20 (20-52) | 80 (80-208) | 2.00 (Pinocchio C++) |" in text
    assert f"| g1, float32 | {MASS} | 1.00 | 2.50 | 3.50 |\n" in text
    assert "- Left out: MJX: too long." in text and "a machine" in text
    assert "at least" not in text and "arget" not in text


def test_targets_end_the_page_on_contributing():
    times, compiling = pair(MASS, MANY, PINOCCHIO, 2.0), {Case(MASS, MANY, OURS): Compiling(1.0, 2.5)}
    shape = Shape("chain", INVERSE, {k: np.ones(3) for k in ("10 links", "1000 links")}, {})
    found = report.all_claims([results(times, compiling)], [shape])
    page = report.with_targets(f"# A page\n\n{report.MARK}\n\nas it was", found)
    assert page.startswith(f"# A page\n\n{report.MARK}\n\n2 of 3 were met") and "as it was" not in page
    assert "| | g1, float32 |\n" in page and f"| {MASS}: trace and compile | 3.5 s, at most 4 s |\n" in page
    assert f"| {MASS}, batch {MANY}: Pinocchio C++'s time over ours | **2, at least 3** |\n" in page
    assert "| chain | inverse dynamics, trace and compile: 1000 links over 10 links | 1, at most 1.3 |\n" in page
    assert report.with_targets(page, found) == page


def test_the_page_on_contributing_has_the_targets_of_today():
    text = report.TARGETS.read_text().partition(report.MARK)[2]
    times = pair(MASS, MANY, PINOCCHIO, 2.0)
    compiling = {Case(x, MANY, OURS): Compiling(0.0, 1.0) for x in claims.SECONDS}
    for claim in claims.claims(results(times, compiling)):
        assert claim.what in text and report.asked(claim) in text, claim.what


def test_the_picture_is_drawn_of_what_there_is(tmp_path):
    pytest.importorskip("matplotlib")
    found = results(pair(MASS, MANY, PINOCCHIO, 2.0), {Case(MASS, MANY, OURS): Compiling(1.0, 2.5)})
    report.picture([found, found._replace(dtype="float64")], tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 1000

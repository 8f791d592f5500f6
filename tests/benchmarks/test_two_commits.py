"""Two commits next to each other: of numbers that are known."""

import pathlib

import numpy as np
import pytest

# For these imports only, as in `test_dynamics_claims.py`.
with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(pathlib.Path(__file__).parent))
    import two_commits
    from dynamics_claims import INVERSE, Compiling


def test_results_are_compared_by_their_bits():
    x = np.array([1.0, -4.0, np.nan])
    assert two_commits.difference([x, x], [x.copy(), x.copy()]) == "same bits"
    assert two_commits.difference([x, x], [x, x + np.array([0.0, 0.04, 0.0])]) == "1e-02"
    assert two_commits.difference([np.zeros(2)], [-np.zeros(2)]) == "0e+00"
    assert two_commits.difference([x], [np.ones(3)]) == "inf"
    for other in ([x[:2]], [x.astype(np.float32)], [x, x]):
        assert two_commits.difference([x], other) == "of other shapes"


@pytest.mark.parametrize("now, is_slower", [(1.09, False), (1.11, True), (0.5, False), (np.nan, True)])
def test_a_row_is_slower_by_the_median_of_the_ratios_within_a_round(now, is_slower):
    before = np.array([1.0, 10.0, 100.0]) * 1e-6
    both = Compiling(1.0, 1.0), Compiling(0.5, 0.5)
    found = two_commits.Compared("g1, float32", INVERSE, *both, before, before * now, "same bits")
    assert found.is_slower == is_slower
    text = "\n".join(two_commits.lines([found], ["a row: no such function"], ["two trees"], "state"))
    assert f"| g1, float32 | {INVERSE} | 2.00 | 1.00 | 0.50 | 10 (2.8-82) | " in text and "two trees" in text
    assert ("**SLOWER** | same bits |" in text) == is_slower and f"\n{int(is_slower)} of 1 rows are slower" in text
    assert "- Left out: a row: no such function." in text


def test_what_is_told_of_two_commits_is_the_last_section_of_a_table():
    once = two_commits.with_section("# A table\n\n| 1 |\n", "first")
    assert once == f"# A table\n\n| 1 |\n\n{two_commits.TITLE}\n\nfirst\n"
    assert two_commits.with_section(once, "second") == once.replace("first", "second")

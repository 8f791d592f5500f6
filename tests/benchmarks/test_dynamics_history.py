"""The history of ratios to Pinocchio is read from tables as they were committed."""

import json
import re
import subprocess
import sys

import pytest

from tests.benchmarks import dynamics_history as history

FIRST_FORM = """
| panda, inverse dynamics, float32, 4096 | Pinocchio C++ | 0.763 | 0.753 | 0.772 | 2e-07 |  |
| panda, inverse dynamics, float32, 4096 | fast | 0.154 | 0.150 | 0.175 | 1e-07 | 1.5 |
| panda, inverse dynamics, float32, 4096 | reproducible | 0.163 | 0.159 | 0.170 | 2e-07 | 2.2 |
"""


def test_both_forms_of_tables_are_read():
    """The one of today has medians, whose ratio is near the median of ratios that the benchmark keeps: within a third,
    where rounds differ by two, as they do on the machines of clouds. Rows beside it differ by more."""
    assert history.ratios(FIRST_FORM) == {("panda", "inverse dynamics"): 0.763 / 0.163}
    found = history.ratios(history.TABLE.read_text())
    assert found.keys() == {(robot, name) for robot in history.ROBOTS for name in history.ALGORITHMS}
    kept = json.loads((history.HERE / "dynamics_ratios.json").read_text())["ratios"]
    for (robot, name), x in found.items():
        assert x == pytest.approx(kept[robot]["float32"][name]["4096"], rel=0.33), (robot, name)


def test_the_page_tells_what_was_committed():
    """Each of its rows that this clone has the commit of."""
    committed = {x.commit: x for x in history.history()}
    rows = re.findall(r"^\| ([0-9a-f]{7}) \| (.*?) \| (.*?) \| (.*) \|$", history.PAGE.read_text(), re.M)
    known = [row for row in rows if row[0] in committed]
    if not known:
        pytest.skip("a clone without its history")
    for commit, date, machine, numbers in known:
        found = committed[commit]
        texts = [
            " | ".join(history._digits(found.ratios.get((r, a))) for a in history.ALGORITHMS) for r in history.ROBOTS
        ]
        assert (date, machine) == (found.date, found.machine) and numbers in texts
    assert len({row[0] for row in rows}) * 2 == len(rows)


def test_it_is_drawn(tmp_path):
    """A line in each panel for each algorithm, and a marker for each machine; in a process, for its backend."""
    source = f"""
import sys; sys.path.insert(0, {str(history.HERE)!r})
import dynamics_history as h
found = [h.Measured("a", "2026-11-21", m, {{(r, a): 2.0 for r in h.ROBOTS for a in h.ALGORITHMS}}) for m in "xy"]
h.draw(found, {str(tmp_path / "history.png")!r})
"""
    subprocess.run([sys.executable, "-c", source], check=True)
    assert (tmp_path / "history.png").stat().st_size > 10_000

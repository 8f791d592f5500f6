"""What is as fast as before: ratios to Pinocchio that are kept from run to run, and times of two commits.

The ratio of a row is Pinocchio's time over ours. `dynamics_ratios.json` has those of the last good run; a row that lost
more than a tenth since then is told, and `dynamics.py` ends with status 1, as for a claim that is not met. Times of two
commits are measured by `dynamics_against.py`.
"""

import json
import pathlib
import subprocess
from typing import Any, NamedTuple

import numpy as np
from dynamics_claims import OURS, PINOCCHIO, Compiling, ratio
from dynamics_report import number, spread

HERE = pathlib.Path(__file__).parent
PLACE = HERE / "dynamics_ratios.json"
FALL = 0.1  # of a ratio, what is taken for more than noise
SLOWER = 1.1  # time now over before: a row above it is not "as before"


class Row(NamedTuple):
    robot: str
    dtype: str
    algorithm: str
    batch: int


class Kept(NamedTuple):
    """Of one run. ratios: Row -> Pinocchio's time over ours."""

    commit: str
    date: str
    machine: str
    ratios: dict


class Fall(NamedTuple):
    row: Row
    kept: float
    found: float


def ratios(results):
    """Of all Results, Row -> Pinocchio's time over ours, where both were measured."""
    found = {}
    for r in results:
        for case in (x for x in r.seconds if x.who == OURS):
            other = case._replace(who=PINOCCHIO)
            if other in r.seconds:
                found[Row(r.robot, r.dtype, case.algorithm, case.batch)] = ratio(r.seconds, other, case)
    return found


def fallen(kept, found):
    """Of ratios by row, Fall by Fall: those that lost more than a tenth, or became NaN. Rows that were not measured, or
    were not kept, say nothing."""
    both = [row for row in kept if row in found]
    return [Fall(row, kept[row], found[row]) for row in both if not found[row] >= (1 - FALL) * kept[row]]


def is_to_be_kept(kept, falls, accepts):
    """Whether a run may take the place of the kept one, None for none."""
    return kept is None or not falls or accepts


def to_json(kept):
    """With a line for each row."""
    nested = {}
    for row, x in kept.ratios.items():
        batches = nested.setdefault(row.robot, {}).setdefault(row.dtype, {}).setdefault(row.algorithm, {})
        batches[str(row.batch)] = round(x, 4)
    return json.dumps({**kept._asdict(), "ratios": nested}, indent=1) + "\n"


def from_json(text):
    told = json.loads(text)
    told["ratios"] = {
        Row(robot, dtype, algorithm, int(batch)): x
        for robot, dtypes in told["ratios"].items()
        for dtype, algorithms in dtypes.items()
        for algorithm, batches in algorithms.items()
        for batch, x in batches.items()
    }
    return Kept(**told)


def read(path=PLACE):
    """What is kept, None without the file."""
    return from_json(path.read_text()) if path.exists() else None


def lines(kept, found, falls):
    """What a run says of itself next to the kept one."""
    if kept is None:
        yield f"No ratios to Pinocchio are kept ({PLACE.name}): nothing to compare with."
        return
    compared = sum(row in found for row in kept.ratios)
    yield f"{len(falls)} of {compared} ratios to Pinocchio fell by more than a tenth since {kept.commit}, {kept.date}"
    yield f"({kept.machine})" + (":" if falls else ".")
    for row, before, now in falls:
        yield f"  {row.robot}, {row.dtype}: {row.algorithm}, batch {row.batch}: {before:.3g} before, {now:.3g} now"


def this_commit():
    """That of this tree, with "-dirty" where it has changes; "unknown" outside of a repository."""
    command = ["git", "-C", str(HERE), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


# -- two commits -------------------------------------------------------------------------------------------------------


class Compared(NamedTuple):
    """A row: Compiling and seconds per state, one per round, of each tree; what is said of the results."""

    where: str
    algorithm: str
    compiling_before: Compiling
    compiling_now: Compiling
    before: Any
    now: Any
    results: str

    @property
    def ratio(self):
        """Of the time now to that before: the median over the rounds."""
        return float(np.median(np.asarray(self.now) / np.asarray(self.before)))

    @property
    def is_slower(self):
        """True for NaN."""
        return not self.ratio <= SLOWER


def difference(before, now):
    """Of two lists of arrays: "same bits", or the largest difference over the largest number of an array."""
    if [(x.dtype, x.shape) for x in before] != [(x.dtype, x.shape) for x in now]:
        return "of other shapes"
    if all(x.tobytes() == y.tobytes() for x, y in zip(before, now, strict=True)):
        return "same bits"
    return f"{max(_relative(x, y) for x, y in zip(before, now, strict=True) if x.size):.0e}"


def _relative(before, now):
    """Infinite where one is finite and the other is not."""
    same = (before == now) | (np.isnan(before) & np.isnan(now))
    if same.all():
        return 0.0
    if not (np.isfinite(before[~same]).all() and np.isfinite(now[~same]).all()):
        return np.inf
    return float(abs(now - before)[~same].max() / abs(before[np.isfinite(before)]).max())


def lines_of_compared(compared, left_out, about):
    """The report, in Markdown. about: lines on the two trees and the machine."""
    yield "One core, a process for each tree, in turns. Seconds to trace and to compile are of one cold run. Times are"
    yield "medians of microseconds per state (10 % to 90 % of the rounds); their ratios are medians of those within a"
    yield "round. Results: the same bits, or the largest difference over the largest number.\n"
    yield from about
    columns = "before | now | now / before"
    yield f"\n| | | trace and compile, s: {columns} | us per state: {columns} | results |\n|{'---|' * 9}"
    for x in compared:
        before, now = x.compiling_before.total, x.compiling_now.total
        cells = f"{before:.2f}", f"{now:.2f}", f"{now / before:.2f}", spread(x.before), spread(x.now), number(x.ratio)
        verdict = " **SLOWER**" if x.is_slower else ""
        yield f"| {x.where} | {x.algorithm} | {' | '.join(cells)}{verdict} | {x.results} |"
    slower = sum(x.is_slower for x in compared)
    yield f"\n{slower} of {len(compared)} rows are slower by more than a tenth."
    yield from (f"- Left out: {x}." for x in left_out)

"""What is as fast as before: ratios to Pinocchio that are kept from run to run.

The ratio of a row is Pinocchio's time over ours. `dynamics_ratios.json` has those of the last good run; a row that lost
more than a tenth since then is told, and `dynamics.py` ends with status 1, as for a claim that is not met.
"""

import json
import pathlib
from typing import NamedTuple

from dynamics_claims import OURS, PINOCCHIO, ratio

HERE = pathlib.Path(__file__).parent
PLACE = HERE / "dynamics_ratios.json"
FALL = 0.1  # of a ratio, what is taken for more than noise


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

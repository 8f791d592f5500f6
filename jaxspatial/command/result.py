"""All that one run of the command measures, what of it breaks a promise, and how it is written down as JSON.

The keys of the JSON object:

    about, machine, versions, offset    what was measured, where: texts, and the offset p_PQ in metres
    sizes                               {"in_cache": items, "streamed": items}
    power       {dtype: {"before", "after", "difference", "bound"}}: watts about P and about Q, and the largest
                difference for one wrench over u mag; empty where the motion is not known
    rows        [{"operation", "dtype", "precision", "words_per_item", "promise", "holds",
                  "in_cache": {"nanoseconds", "fastest", "ninety_percent"}: per item, median, fastest, 90 % quantile,
                  "streamed": the same and "gigabytes_per_second"; null for formats that only hold data,
                  "compile_seconds", "ulps": {"median", "worst"}: errors against exact rationals,
                  "absolute": [{"unit", "worst"}]: the same, the largest of each part in its SI unit,
                  "of_promise": the largest error over the bound promised}]
    conditions  [{"operation", "dtype", "precision", "holds",
                  "points": [{"condition", "results", "worst_ulps", "of_promise"}]}]: error against
                condition number, the worst of so many components
    algorithms  [{"operation", "dtype", "precision", "nanoseconds", "fastest", "ninety_percent": per evaluation,
                  "compile_seconds", "worst_ulps": the largest error in units in the last place of the largest number of
                  the result, "worst", "unit"}]: of the robot; errors of the reference, float64 compensated, are null
    applications [{"name", "unit", "size", "errors": {precision: largest}}]: what float32 loses, in the unit, of results
                as large as size
    broken      [text]: what does not hold here; "holds": true if nothing is broken

Numbers that are not finite are null: the condition number of an exact result of zero, errors of a NaN.
"""

import json
import math
from importlib.metadata import version
from typing import NamedTuple

import jax
import numpy as np

from jaxspatial.command.algorithms import Evaluated, Loss
from jaxspatial.command.trade import POWER_BOUND, Curve, Power, Row


class Result(NamedTuple):
    """One run: texts, sizes (in cache, streamed), power per dtype, what `trade` and `algorithms` measured."""

    about: str
    machine: str
    offset: np.ndarray
    sizes: tuple[int, int]
    powers: dict[str, Power]
    rows: list[Row]
    curves: list[Curve]
    algorithms: list[Evaluated]
    losses: list[Loss]

    @property
    def broken(self):
        """What does not hold here, as texts."""
        unequal = [f"power in {dtype}" for dtype, p in self.powers.items() if not p.difference <= POWER_BOUND]
        rows = [" ".join(row.case) for row in self.rows if not row.holds]
        curves = [f"{c.operation} {c.dtype} {c.precision}, terms that cancel" for c in self.curves if not c.holds]
        return unequal + rows + curves

    def to_json(self):
        """As text: an object with the keys of the module's docstring."""
        return as_json(
            {
                "about": self.about,
                "machine": self.machine,
                "versions": {"jax": jax.__version__, "jaxlib": version("jaxlib"), "numpy": np.__version__},
                "offset": self.offset.tolist(),
                "sizes": dict(zip(("in_cache", "streamed"), self.sizes, strict=True)),
                "power": {dtype: {**p._asdict(), "bound": POWER_BOUND} for dtype, p in self.powers.items()},
                "rows": [_row(row) for row in self.rows],
                "conditions": [
                    {**c._asdict(), "holds": c.holds, "points": [x._asdict() for x in c.points]} for c in self.curves
                ],
                "algorithms": [_evaluated(row) for row in self.algorithms],
                "applications": [loss._asdict() for loss in self.losses],
                "broken": self.broken,
                "holds": not self.broken,
            }
        )


def readable(x: float):
    """A number of two or three digits; a dash for what could not be measured."""
    if math.isnan(x):
        return "-"
    if x == 0 or 0.01 <= x < 1e5:
        return f"{x:.{2 if 0 < x < 10 else 1 if 0 < x < 100 else 0}f}"
    return f"{x:.1e}".replace("e-0", "e-").replace("e+0", "e")


def as_json(x):
    """A tree of dicts, lists, numbers and texts as JSON that every reader takes: NaN and infinities are null."""
    return json.dumps(_finite(x), indent=1, allow_nan=False)


def _finite(x):
    if isinstance(x, dict):
        return {key: _finite(value) for key, value in x.items()}
    if isinstance(x, (list, tuple)):
        return [_finite(value) for value in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x


def _row(row: Row):
    gigabytes = {"gigabytes_per_second": row.gigabytes_per_second}
    return {
        **row.case._asdict(),
        "words_per_item": row.operation.words,
        "in_cache": _times(row.in_cache),
        "streamed": None if row.streamed is None else _times(row.streamed) | gigabytes,
        "compile_seconds": row.compile_seconds,
        "ulps": {"median": row.median_ulps, "worst": row.worst_ulps},
        "absolute": [{"unit": unit, "worst": worst} for unit, worst in row.errors_in_units],
        **{"promise": row.promise, "of_promise": row.of_promise, "holds": row.holds},
    }


def _times(seconds):
    fastest, median, ninety = (float(x) * 1e9 for x in np.quantile(seconds, [0, 0.5, 0.9]))
    return {"nanoseconds": median, "fastest": fastest, "ninety_percent": ninety}


def _evaluated(row: Evaluated):
    errors = {"worst_ulps": row.worst_ulps, "worst": row.worst_in_units, "unit": row.unit}
    return {**row.case._asdict(), **_times(row.seconds), "compile_seconds": row.compile_seconds, **errors}

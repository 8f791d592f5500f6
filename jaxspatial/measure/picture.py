"""The trade as a picture: what an operation costs and what its result is worth; and where a precision loses its digits."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 - after the choice of a backend without a window
import numpy as np  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402

from jaxspatial.measure import conditions, trade  # noqa: E402
from jaxspatial.measure.operation import OPERATIONS  # noqa: E402

# Okabe and Ito 2008: told apart with every kind of colour vision, and in grey.
_COLOURS = {"fast": "#D55E00", "reproducible": "#0072B2", "compensated": "#009E73", "faithful": "#AA4499"}
_MARKERS = dict(zip(OPERATIONS, "osD^vX", strict=False))
_DTYPES = ("float32", "float64")
_SMALLEST = 0.1


def draw(result, path):
    """Writes the picture of a `Result` to path."""
    figure, axes = plt.subplots(1, 2, figsize=(15, 7), layout="constrained", width_ratios=[1, 1])
    _draw_trade(axes[0], [row for row in result.rows if row.case.dtype in _DTYPES], result.sizes[0])
    _draw_conditions(axes[1], result.curves)
    figure.suptitle(f"{result.about}\n{result.machine}", fontsize=9)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _style(dtype, colour):
    """Filled for float32, hollow for float64."""
    return {"markerfacecolor": colour if dtype == "float32" else "white", "markeredgecolor": colour}


# -- the trade --------------------------------------------------------------------------------------------------------


def _draw_trade(axes, rows, n):
    for row in rows:
        colour = _COLOURS[row.case.precision]
        x, y = trade.nanoseconds(row.in_cache), max(row.worst_ulps, _SMALLEST)
        style = {"markersize": 8, "linestyle": "", "zorder": 3, **_style(row.case.dtype, colour)}
        axes.plot(x, y, marker=_MARKERS[row.case.operation], **style)
    axes.set(xscale="log", yscale="log", title="What an operation costs, and what its result is worth")
    axes.set_xlabel(f"time per item, ns (median, {n:,} items in cache)")
    axes.set_ylabel("worst error of these items, units in the last place")
    axes.grid(alpha=0.25)


def _draw_conditions(axes, curves):
    for curve in curves:
        colour = _COLOURS[curve.precision]
        points = [point for point in curve.points if np.isfinite(point.condition)]
        x = np.array([point.condition for point in points])
        y = np.maximum([point.worst_ulps for point in points], _SMALLEST)
        axes.plot(x, y, color=colour, marker=_MARKERS[curve.operation], linewidth=1, markersize=5, **_style(curve.dtype, colour))
        axes.plot(x, conditions.promised_ulps(curve, x), color=colour, linewidth=0.6, alpha=0.7)
    axes.set(xscale="log", yscale="log", title="Where digits are lost: terms that cancel")
    axes.grid(alpha=0.25)

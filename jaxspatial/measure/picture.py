"""The trade as a picture: what an operation costs and what its result is worth; and where a precision loses its digits."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 - after the choice of a backend without a window
import numpy as np  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402

from jaxspatial.measure import conditions, trade  # noqa: E402
from jaxspatial.measure.operation import OPERATIONS  # noqa: E402

# After Okabe and Ito 2008: told apart with every kind of colour vision.
_COLOURS = {"fast": "#D55E00", "reproducible": "#0072B2", "compensated": "#009E73", "faithful": "#AA4499"}
_MARKERS = dict(zip(OPERATIONS, "osD^vX", strict=True))
_DTYPES = ("float32", "float64")
# Errors of 0 are shown as this, and of bins of the curves those with so many results.
_SMALLEST, _ENOUGH = 0.1, 10
_LIGHT, _GREY = "0.8", "0.35"


def draw(result, path):
    """Writes the picture of a `Result` to path."""
    places = [[dtype, "conditions"] for dtype in _DTYPES]
    figure, axes = plt.subplot_mosaic(places, figsize=(15, 8), layout="constrained")
    for dtype in _DTYPES:
        _draw_trade(axes[dtype], [row for row in result.rows if row.case.dtype == dtype], dtype)
    _label_trade([axes[dtype] for dtype in _DTYPES], result)
    _draw_conditions(axes["conditions"], result.curves)
    figure.suptitle(f"{result.about}\n{result.machine}", fontsize=9)
    figure.savefig(path, dpi=130)
    plt.close(figure)


# -- the trade: one axes per dtype ------------------------------------------------------------------------------------


def _draw_trade(axes, rows, dtype):
    """Every case as a point; those of one operation joined, from fast to faithful."""
    for operation in dict.fromkeys(row.case.operation for row in rows):
        points = [(trade.nanoseconds(row.in_cache), _shown(row.worst_ulps)) for row in _of(rows, operation=operation)]
        axes.plot(*zip(*points, strict=True), color=_LIGHT, linewidth=1, zorder=1)
    for row in rows:
        style = {"color": _COLOURS[row.case.precision], "marker": _MARKERS[row.case.operation], "alpha": 0.85}
        axes.plot(trade.nanoseconds(row.in_cache), _shown(row.worst_ulps), markersize=8, linestyle="", zorder=2, **style)
    axes.set(xscale="log", yscale="log", ylabel=f"worst error in {dtype}, ulps")
    axes.grid(alpha=0.25)


def _of(rows, **names):
    return [row for row in rows if all(getattr(row.case, name) == x for name, x in names.items())]


def _shown(ulps):
    return np.maximum(np.nan_to_num(ulps, nan=np.nan, posinf=np.nan), _SMALLEST)


def _label_trade(axes, result):
    """One scale for both; legends where no point is: errors are large where operations are quick."""
    first, last = axes
    limits = [(low, high) for a in axes for low, high in (a.get_xlim(),)]
    for a in axes:
        a.set_xlim(min(low for low, _ in limits), 2 * max(high for _, high in limits))
        a.set_ylim(_SMALLEST, None)
    first.set_title("What an operation costs, and what its result is worth")
    last.set_xlabel(f"time per item, ns (median, {result.sizes[0]:,} items in cache)")
    known = dict.fromkeys(row.case.operation for row in result.rows)
    precisions = [_key("o", colour, name) for name, colour in _COLOURS.items()]
    operations = [_key(_MARKERS[name], _GREY, OPERATIONS[name].title) for name in known]
    first.legend(handles=precisions + operations, ncols=2, frameon=False, loc="upper right", fontsize=9)
    for a, dtype in zip(axes, _DTYPES, strict=True):
        a.text(0.015, 0.03, dtype, transform=a.transAxes, fontweight="bold", fontsize=11)


def _key(marker, colour, label):
    return Line2D([], [], marker=marker, color=colour, linestyle="", markersize=7, label=label)


# -- error against condition number -----------------------------------------------------------------------------------


def _draw_conditions(axes, curves):
    for curve in curves:
        _draw_curve(axes, curve)
    axes.set(xscale="log", yscale="log", xlim=(1, 1e33), ylim=(_SMALLEST, 1e19))
    axes.set_title("Where digits are lost: terms that cancel (shift force, dot)")
    axes.set_xlabel("condition number: sizes of the terms added up / size of the result")
    axes.set_ylabel(f"worst error, ulps (0 shown as {_SMALLEST})")
    _draw_ends(axes)
    _label_conditions(axes, {(curve.dtype, curve.precision) for curve in curves})
    axes.grid(alpha=0.25)


def _draw_curve(axes, curve):
    """Filled for float32, hollow for float64; the promise as a thin line."""
    points = [point for point in curve.points if np.isfinite(point.condition) and point.count >= _ENOUGH]
    x, colour = np.array([point.condition for point in points]), _COLOURS[curve.precision]
    face = {"markerfacecolor": colour if curve.dtype == "float32" else "white", "markersize": 5}
    y = _shown(np.array([point.worst_ulps for point in points]))
    axes.plot(x, y, color=colour, marker=_MARKERS[curve.operation], linewidth=1.2, **face)
    dense = np.geomspace(1, x.max(), 200)
    axes.plot(dense, conditions.promised_ulps(curve, dense), color=colour, linewidth=0.6, linestyle="--")


def _draw_ends(axes):
    """Where an error is as large as the result."""
    for dtype in _DTYPES:
        lost = 2.0 / float(np.finfo(dtype).eps)
        axes.axhline(lost, color=_GREY, linewidth=0.8, linestyle=":")
        axes.text(6e32, lost * 1.3, f"{dtype}: no digit is right above", ha="right", fontsize=8, color=_GREY)


def _label_conditions(axes, drawn):
    """Names at the curves, in their colours, at places that every machine's curves leave free."""
    labels = [
        (3e3, 3e6, "fast and reproducible", "fast", 0, "float32"),
        (3e13, 4e2, "compensated\nfloat32", "compensated", 0, "float32"),
        (1e24, 3e4, "compensated\nfloat64", "compensated", 0, "float64"),
        (1e24, 0.75, "faithful", "faithful", 0, "float64"),
    ]
    for x, y, text, precision, turned, dtype in labels:
        if (dtype, precision) in drawn:
            axes.text(x, y, text, color=_COLOURS[precision], rotation=turned, fontweight="bold", fontsize=10)
    handles = [_key(_MARKERS[name], _GREY, OPERATIONS[name].title) for name in conditions.OPERATIONS_WITH_CURVES]
    handles += [Line2D([], [], color=_GREY, linewidth=0.6, linestyle="--", label="promised")]
    axes.legend(handles=handles, frameon=False, loc="upper left", fontsize=9, title="filled float32, hollow float64")

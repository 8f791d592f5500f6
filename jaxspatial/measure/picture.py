"""The trade as a picture: what an operation costs, what its result is worth, and where a precision loses digits."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 - after the choice of a backend without a window
import numpy as np  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402

from jaxspatial.measure import conditions, trade  # noqa: E402
from jaxspatial.measure.operation import OPERATIONS  # noqa: E402

# Drawn where measured; the narrow formats only where nothing else is.
_DTYPES = ("float32", "float64")
# After Okabe and Ito 2008: told apart with every kind of colour vision.
_COLOURS = {"fast": "#D55E00", "reproducible": "#0072B2", "compensated": "#009E73", "faithful": "#AA4499"}
_MARKERS = dict(zip(OPERATIONS, "osD^vX", strict=True))
# The lowest error shown, and the number of results that make a point of a curve.
_LOWEST, _ENOUGH = 0.2, 10
_LIGHT, _GREY = "0.8", "0.35"


def draw(result, path):
    """Writes the picture of a `Result` to path."""
    known = dict.fromkeys(row.case.dtype for row in result.rows)
    dtypes = [dtype for dtype in known if dtype in _DTYPES] or list(known)
    places = [[dtype, "conditions"] if result.curves else [dtype] for dtype in dtypes]
    figure, axes = plt.subplot_mosaic(places, figsize=(15, 8), layout="constrained")
    for dtype in dtypes:
        _draw_trade(axes[dtype], [row for row in result.rows if row.case.dtype == dtype], dtype)
    _label_trade([axes[dtype] for dtype in dtypes], result)
    if result.curves:
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
        axes.plot(
            trade.nanoseconds(row.in_cache), _shown(row.worst_ulps), markersize=8, linestyle="", zorder=2, **style
        )
    axes.set(xscale="log", yscale="log", ylabel=f"worst error in {dtype}, ulps")
    axes.grid(alpha=0.25)


def _of(rows, **names):
    return [row for row in rows if all(getattr(row.case, name) == x for name, x in names.items())]


def _shown(ulps):
    """What is too small for the scale at its lower end; infinities not at all."""
    return np.maximum(np.where(np.isfinite(ulps), ulps, np.nan), _LOWEST)


def _label_trade(axes, result):
    """One scale for both; legends where no point is: errors are large where operations are quick."""
    first, last = axes[0], axes[-1]
    limits = [(low, high) for a in axes for low, high in (a.get_xlim(),)]
    for a in axes:
        a.set_xlim(min(low for low, _ in limits), 2 * max(high for _, high in limits))
        a.set_ylim(_LOWEST, None)
    first.set_title("What an operation costs, and what its result is worth")
    last.set_xlabel(f"time per item, ns (median, {result.sizes[0]:,} items in cache)")
    known = dict.fromkeys(row.case.operation for row in result.rows)
    precisions = [_key("o", colour, name) for name, colour in _COLOURS.items()]
    operations = [_key(_MARKERS[name], _GREY, OPERATIONS[name].title) for name in known]
    for handles, place in ((precisions, 0.74), (operations, 1.0)):
        legend = first.legend(handles=handles, frameon=False, loc="upper right", bbox_to_anchor=(place, 1), fontsize=9)
        first.add_artist(legend)


def _key(marker, colour, label):
    return Line2D([], [], marker=marker, color=colour, linestyle="", markersize=7, label=label)


# -- error against condition number -----------------------------------------------------------------------------------


def _draw_conditions(axes, curves):
    for curve in curves:
        _draw_curve(axes, curve)
    axes.set(xscale="log", yscale="log", xlim=(1, 1e33), ylim=(_LOWEST, 1e19))
    axes.set_title("Where digits are lost: terms that cancel (shift force, dot)")
    axes.set_xlabel("condition number: sizes of the terms added up / size of the result")
    axes.set_ylabel("worst error, units in the last place (ulps); none where results are exact")
    _draw_ends(axes)
    _label_conditions(axes, {curve.precision for curve in curves})
    axes.grid(alpha=0.25)


def _draw_curve(axes, curve):
    """Filled for float32, hollow for float64; the promise as a thin line."""
    points = [point for point in curve.points if np.isfinite(point.condition) and point.results >= _ENOUGH]
    x, colour = np.array([point.condition for point in points]), _COLOURS[curve.precision]
    face = {"markerfacecolor": colour if curve.dtype == "float32" else "white", "markersize": 5}
    y = [point.worst_ulps or np.nan for point in points]
    axes.plot(x, y, color=colour, marker=_MARKERS[curve.operation], linewidth=1.2, **face)
    dense = np.geomspace(1, x.max(), 200)
    axes.plot(dense, conditions.promised_ulps(curve, dense), color=colour, linewidth=0.8, linestyle="--")


def _draw_ends(axes):
    """Where an error is as large as the result."""
    for dtype in _DTYPES:
        lost = 2.0 / float(np.finfo(dtype).eps)
        axes.axhline(lost, color=_GREY, linewidth=0.8, linestyle=":")
        axes.text(6e32, lost * 1.3, f"{dtype}: no digit is right above", ha="right", fontsize=8, color=_GREY)


def _label_conditions(axes, precisions):
    """Names beside the curves, in their colours: where these run is known, as none depends on the machine much."""
    labels = [
        (2e14, 3e12, "reproducible", "reproducible"),
        (2e14, 5e11, "fast", "fast"),
        (4e14, 2e5, "compensated\nfloat32", "compensated"),
        (1e24, 3e4, "compensated\nfloat64", "compensated"),
        (1e24, 1.8, "faithful", "faithful"),
    ]
    for x, y, text, precision in labels:
        if precision in precisions:
            axes.text(x, y, text, color=_COLOURS[precision], fontweight="bold", fontsize=10)
    handles = [_key(_MARKERS[name], _GREY, OPERATIONS[name].title) for name in conditions.CURVED]
    handles += [Line2D([], [], color=_GREY, linewidth=0.8, linestyle="--", label="promised")]
    axes.legend(handles=handles, frameon=False, loc="upper left", fontsize=9, title="filled float32, hollow float64")

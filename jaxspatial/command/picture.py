"""The trade as a picture: what an operation costs, what its result is worth, and where a precision loses digits."""

import pathlib
from collections.abc import Iterable, Sequence
from typing import Any, BinaryIO

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 - after the choice of a backend without a window
import numpy as np  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.axis import Axis  # noqa: E402
from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402
from matplotlib.ticker import LogLocator, NullLocator  # noqa: E402

from jaxspatial.arithmetic.precision import Precision  # noqa: E402
from jaxspatial.command.result import Result, readable  # noqa: E402
from jaxspatial.measure import conditions, trade  # noqa: E402
from jaxspatial.measure.algorithms import ALGORITHMS, Evaluated  # noqa: E402
from jaxspatial.measure.applications import Loss  # noqa: E402
from jaxspatial.measure.operation import OPERATIONS  # noqa: E402

# Formats by the endings of their names.
ENDINGS = tuple(sorted(FigureCanvasAgg.get_supported_filetypes()))

# Drawn where measured; the narrow formats only where nothing else is.
_DTYPES = ("float32", "float64")
# After Okabe and Ito 2008: told apart with every kind of colour vision.
_PALETTE = "#D55E00", "#0072B2", "#009E73", "#AA4499", "#E69F00", "#56B4E9"
_COLOURS = dict(zip(map(str, Precision), _PALETTE, strict=False))
_MARKERS = dict(zip(OPERATIONS, "osD^vX", strict=True))
# The lowest error shown, and the number of results that make a point of a curve.
_LOWEST, _ENOUGH = 0.2, 10
_LIGHT, _GREY = "0.75", "0.35"
_SMALL = 9


def draw(result: Result, file: BinaryIO | str | pathlib.Path, ending: str = "png"):
    """Writes the picture of a `Result` into a binary file, or to a path."""
    known = dict.fromkeys(row.case.dtype for row in result.rows)
    dtypes = [dtype for dtype in known if dtype in _DTYPES] or list(known)
    places: Any = _places(result, dtypes)
    figure, axes = plt.subplot_mosaic(places, figsize=(16, 4.75 * len(places)), layout="constrained")
    for dtype in dtypes:
        _draw_trade(axes[dtype], [row for row in result.rows if row.case.dtype == dtype], dtype)
    if dtypes:
        _label_trade([axes[dtype] for dtype in dtypes], result)
    if result.curves:
        _draw_conditions(axes["conditions"], result.curves)
    if result.algorithms:
        _draw_algorithms(axes["algorithms"], result.algorithms)
    if result.losses:
        _draw_losses(axes["losses"], result.losses)
    figure.suptitle(f"{result.about}\n{result.machine}", fontsize=_SMALL)
    figure.savefig(file, dpi=130, format=ending)
    plt.close(figure)


def _places(result: Result, dtypes: list[str]):
    """Where each axes is: operations beside their condition numbers, algorithms beside applications."""
    places = [[dtype, "conditions"] if result.curves else [dtype, dtype] for dtype in dtypes]
    last = [name for name, rows in (("algorithms", result.algorithms), ("losses", result.losses)) if rows]
    return [*places, [last[0], last[-1]]] if last else places


# -- the trade: one axes per dtype ------------------------------------------------------------------------------------


def _draw_trade(axes: Axes, rows: list[trade.Row], dtype: str):
    """Every case as a point; those of one operation joined, from fast to faithful."""
    for operation in dict.fromkeys(row.case.operation for row in rows):
        points = [(trade.nanoseconds(row.in_cache), _shown(row.worst_ulps)) for row in _of(rows, operation=operation)]
        axes.plot(*zip(*points, strict=True), color=_LIGHT, linewidth=1, zorder=1)
    for row in rows:
        style = {"color": _COLOURS[row.case.precision], "marker": _MARKERS[row.case.operation], "alpha": 0.85}
        axes.plot(
            trade.nanoseconds(row.in_cache), _shown(row.worst_ulps), markersize=8, linestyle="", zorder=2, **style
        )
    axes.set(xscale="log", yscale="log", ylabel=f"{dtype}: worst error,\nulps of a cancelled result")
    axes.grid(alpha=0.25)


def _of(rows: list[trade.Row], **names: str):
    return [row for row in rows if all(getattr(row.case, name) == x for name, x in names.items())]


def _shown(ulps: float):
    """What is too small for the scale at its lower end; infinities not at all."""
    return np.maximum(np.where(np.isfinite(ulps), ulps, np.nan), _LOWEST)


def _label_trade(axes: list[Axes], result: Result):
    """One scale for both, and a legend beside each."""
    limits = [a.get_xlim() for a in axes]
    for a in axes:
        a.set(xlim=(min(low for low, _ in limits), max(high for _, high in limits)), ylim=(_LOWEST, None))
        _number_decades(a.xaxis)
        a.axhline(0.5, color=_GREY, linewidth=0.8, linestyle=":", zorder=0)
        _add_keys(a, result)
    axes[0].set_title("What an operation costs, and what its result is worth")
    axes[-1].set_xlabel(f"time per item, ns (median, {result.sizes[0]:,} items in cache)")
    _explain(axes[-1], _OF_TRADE)


def _number_decades(axis: Axis):
    """At 1, 2, 5, 10, ..., as plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


_OF_TRADE = (
    "The error is that of the worst of 500 results: one whose terms cancel,\n"
    "so that the result is small, and so is its unit in the last place (ulp)"
)


def _explain(axes: Axes, text: str):
    """Beneath the label of the x axis."""
    axes.set_xlabel(f"{axes.get_xlabel()}\n{text}", linespacing=1.4)


def _add_keys(axes: Axes, result: Result):
    operations = dict.fromkeys(row.case.operation for row in result.rows)
    keys = [_heading("precision"), *(_key("o", colour, name) for name, colour in _COLOURS.items())]
    keys += [_heading("operation"), *(_key(_MARKERS[name], _GREY, OPERATIONS[name].title) for name in operations)]
    keys += [_heading("lines"), _line("-", "one operation, in\nits four precisions", color=_LIGHT)]
    keys += [_line(":", "rounded correctly\n(half an ulp)")]
    axes.legend(handles=keys, frameon=False, loc="upper left", bbox_to_anchor=(1, 1.02), fontsize=_SMALL)


def _heading(text: str):
    return Line2D([], [], linestyle="", label=f"$\\bf{{{text}}}$")


def _line(style: str, label: str, **names: Any):
    return Line2D([], [], linestyle=style, label=label, **{"color": _GREY, "linewidth": 0.8, **names})


def _key(marker: str, colour: str, label: str, **style: Any):
    return Line2D([], [], marker=marker, color=colour, linestyle="", markersize=7, label=label, **style)


# -- error against condition number -----------------------------------------------------------------------------------


def _draw_conditions(axes: Axes, curves: Sequence[conditions.Curve]):
    for curve in curves:
        _draw_curve(axes, curve)
    axes.set(xscale="log", yscale="log", xlim=(1, 1e33), ylim=(_LOWEST, 1e19))
    names = ", ".join(OPERATIONS[name].title for name in dict.fromkeys(curve.operation for curve in curves))
    axes.set_title(f"Where digits are lost: terms that cancel ({names})")
    axes.set_xlabel("condition number: sizes of the terms added up / size of the result")
    _explain(axes, _OF_CONDITIONS)
    axes.set_ylabel("worst error, ulps of a cancelled result; no point where all results are exact")
    _draw_ends(axes, dict.fromkeys(curve.dtype for curve in curves))
    _label_conditions(axes, {(curve.precision, curve.dtype) for curve in curves})
    _add_keys_of_conditions(axes, curves)
    axes.grid(alpha=0.25)


_OF_CONDITIONS = (
    "Each point is the worst of 10 results or more of about that condition number;\n"
    "an ulp is the unit in the last place of the exact result"
)


def _draw_curve(axes: Axes, curve: conditions.Curve):
    """Filled for float32, hollow for float64; the promise as a thin line."""
    points = [point for point in curve.points if np.isfinite(point.condition) and point.results >= _ENOUGH]
    x, colour = np.array([point.condition for point in points]), _COLOURS[curve.precision]
    face = {"markerfacecolor": colour if curve.dtype == "float32" else "white", "markersize": 5}
    y = [point.worst_ulps or np.nan for point in points]
    axes.plot(x, y, color=colour, marker=_MARKERS[curve.operation], linewidth=1.2, **face)
    dense = np.geomspace(1, x.max(), 200)
    axes.plot(dense, conditions.promised_ulps(curve, dense), color=colour, linewidth=0.8, linestyle="--")


def _draw_ends(axes: Axes, dtypes: Iterable[str]):
    """Where an error is as large as the result."""
    for dtype in dtypes:
        lost = 2.0 / float(np.finfo(dtype).eps)
        axes.axhline(lost, color=_GREY, linewidth=0.8, linestyle=":")
        axes.text(6e32, lost * 1.3, f"{dtype}: no digit is right above", ha="right", fontsize=8, color=_GREY)


def _label_conditions(axes: Axes, known: set[tuple[str, str]]):
    """Names beside the curves, in their colours: where these run is known, as none depends on the machine much."""
    labels = [
        (2e14, 3e12, "reproducible", "reproducible", known),
        (2e14, 5e11, "fast", "fast", known),
        (4e14, 2e5, "compensated\nfloat32", "compensated", [("compensated", "float32")]),
        (1e24, 3e4, "compensated\nfloat64", "compensated", [("compensated", "float64")]),
        (1e24, 1.8, "faithful", "faithful", known),
    ]
    for x, y, text, precision, needed in labels:
        if known.intersection(needed):
            axes.text(x, y, text, color=_COLOURS[precision], fontweight="bold", fontsize=10)


def _add_keys_of_conditions(axes: Axes, curves: Sequence[conditions.Curve]):
    keys = [_heading("operation")]
    keys += [_key(_MARKERS[n], _GREY, OPERATIONS[n].title) for n in dict.fromkeys(c.operation for c in curves)]
    keys += [_heading("dtype")]
    for dtype in dict.fromkeys(curve.dtype for curve in curves):
        keys.append(_key("o", _GREY, dtype, markerfacecolor=_GREY if dtype == "float32" else "white"))
    keys += [_heading("lines"), _line("-", "measured", linewidth=1.2), _line("--", "promised: never above")]
    keys += [_line(":", "error as large as the result")]
    legend = axes.legend(handles=keys, loc="upper left", fontsize=_SMALL, framealpha=1, edgecolor="white")
    legend.set_zorder(3)


# -- whole algorithms and applications --------------------------------------------------------------------------------

# What is drawn at the left end of the scale.
_NOTHING = 1e-9
_OF_ALGORITHMS = dict(zip(ALGORITHMS, "os", strict=True))
_ROUNDED = 0.5


def _draw_algorithms(axes: Axes, rows: Sequence[Evaluated]):
    """Filled for float32, hollow for float64; one algorithm in one dtype joined, from fast to compensated."""
    for group in dict.fromkeys(row.case[:2] for row in rows):
        points = [_point(row) for row in rows if row.case[:2] == group]
        axes.plot(*zip(*points, strict=True), color=_LIGHT, linewidth=1, zorder=1)
    for row in rows:
        colour = _COLOURS[row.case.precision]
        face = colour if row.case.dtype == "float32" else "white"
        style = {"color": colour, "marker": _OF_ALGORITHMS[row.case.operation], "markerfacecolor": face}
        axes.plot(*_point(row), markersize=8, linestyle="", zorder=2, **style)
    axes.set(xscale="log", yscale="log", title="What a whole algorithm costs, and what its result is worth")
    _number_decades(axes.xaxis)
    axes.set(xlabel="time per state, \N{MICRO SIGN}s (median, a batch in one call)", ylim=(_LOWEST, None))
    axes.set_ylabel("worst error, ulps of the\nlargest number of a result")
    axes.axhline(_ROUNDED, color=_GREY, linewidth=0.8, linestyle=":", zorder=0)
    _explain(axes, "All errors are told against float64 compensated, which is drawn as rounded correctly")
    axes.grid(alpha=0.25)
    _add_keys_of_algorithms(axes, rows)


def _point(row: Evaluated):
    """Time and error; the reference, whose error nobody knows, where it is promised to be."""
    return trade.nanoseconds(row.seconds) / 1e3, _ROUNDED if np.isnan(row.worst_ulps) else _shown(row.worst_ulps)


def _add_keys_of_algorithms(axes: Axes, rows: Sequence[Evaluated]):
    precisions, names = (dict.fromkeys(row.case[i] for row in rows) for i in (2, 0))
    keys = [_heading("precision"), *(_key("o", _COLOURS[name], name) for name in precisions)]
    keys += [_heading("algorithm"), *(_key(_OF_ALGORITHMS[name], _GREY, ALGORITHMS[name].title) for name in names)]
    keys += [_heading("dtype")]
    for dtype in dict.fromkeys(row.case.dtype for row in rows):
        keys.append(_key("o", _GREY, dtype, markerfacecolor=_GREY if dtype == "float32" else "white"))
    keys += [_heading("lines"), _line(":", "rounded correctly\n(half an ulp)")]
    axes.legend(handles=keys, frameon=False, loc="upper left", bbox_to_anchor=(1, 1.02), fontsize=_SMALL)


def _draw_losses(axes: Axes, losses: Sequence[Loss]):
    """Each application a line: its errors over its size, and beside it the errors in its own unit."""
    for i, loss in enumerate(losses):
        shares = {name: max(error / loss.size, _NOTHING) for name, error in loss.errors.items()}
        axes.plot([min(shares.values()), max(shares.values())], [i, i], color=_LIGHT, linewidth=1, zorder=1)
        for k, (name, share) in enumerate(shares.items()):
            axes.plot(share, i, color=_COLOURS[name], marker="o", markersize=11 - 2.5 * k, linestyle="", label=name)
        axes.text(_NOTHING, i - 0.18, _said(loss), fontsize=_SMALL, va="bottom")
    axes.set(xscale="log", xlim=(_NOTHING / 2, 2), ylim=(len(losses) - 0.5, -1.0), yticks=[])
    axes.set(title="What an application loses in float32", xlabel="worst error over the largest result")
    axes.grid(alpha=0.25, axis="x")
    handles, names = axes.get_legend_handles_labels()
    found = dict(zip(names, handles, strict=True))
    axes.legend(found.values(), found.keys(), frameon=False, loc="lower right", fontsize=_SMALL)


def _said(loss: Loss):
    """In its own unit."""
    size, worst, best = map(readable, (loss.size, loss.errors["fast"], loss.errors["compensated"]))
    return f"{loss.name}\nof {size} {loss.unit} fast is off by {worst}, compensated by {best}"

"""The trade-off as a picture: what an operation costs, what its result is worth, and where a precision loses digits."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from jaxspatial.command import quadruped, trade
from jaxspatial.command.algorithms import ALGORITHMS
from jaxspatial.command.first_look import CROSS, GRADIENTS, MEMORY, STATES, WRENCHES, Look
from jaxspatial.command.result import Result, readable
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.measure import timing
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.numerics.precision import Precision

# Formats by the endings of their names.
ENDINGS = tuple(sorted(FigureCanvasAgg.get_supported_filetypes()))

# After Okabe and Ito 2008: distinct with every kind of colour vision.
_PALETTE = "#D55E00", "#0072B2", "#009E73", "#AA4499", "#E69F00", "#56B4E9"
_COLOURS = dict(zip(map(str, Precision), _PALETTE, strict=False))
_MARKERS = dict(zip(OPERATIONS, "osD^vX", strict=True))
# The lowest error shown, and the number of results that make a point of a curve.
_LOWEST, _ENOUGH = 0.2, 10
_LIGHT, _GREY = "0.75", "0.35"
_SMALL = 9
_ROUNDED, _CORRECTLY = 0.5, "rounded correctly\n(half an ulp)"


def draw(result: Result, file, ending: str = "png"):
    """Writes the picture of a `Result` into a binary file, or to a path.

    Narrow formats are drawn only where nothing else was measured."""
    known = dict.fromkeys(row.case.dtype for row in result.rows)
    dtypes = [dtype for dtype in known if dtype in trade.STREAMED] or list(known)
    grid: Any = _places(result, dtypes)
    # Made without pyplot: it needs no backend with windows, and nothing is left open.
    figure = Figure(figsize=(16, 4.75 * len(grid)), layout="constrained")
    axes: dict[str, Axes] = figure.subplot_mosaic(grid)
    for dtype in dtypes:
        rows = [row for row in result.rows if row.case.dtype == dtype]
        places = [(trade.nanoseconds(row.in_cache), _shown(row.worst_ulps)) for row in rows]
        points = [(row.case, at, {"alpha": 0.85}) for row, at in zip(rows, places, strict=True)]
        _draw_points(axes[dtype], points, _MARKERS)
        axes[dtype].set(ylabel=f"{dtype}: worst error,\nulps of a cancelled result")
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


def draw_first_look(look: Look, file, ending: str = "png"):
    """A wrench beside its bounds, the robot that is pushed, and what a precision costs and buys."""
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    places: Any = figure.add_gridspec(1, 3, width_ratios=(1, 1, 1.3))
    _draw_wrenches(figure.add_subplot(places[0]), look)
    _draw_robot(figure, places[1], look)
    _draw_losses(figure.add_subplot(places[2]), look.losses)
    figure.suptitle(timing.machine(), fontsize=_SMALL)
    figure.savefig(file, dpi=130, format=ending)


def _draw_wrenches(axes, look: Look):
    """A bar for each, as long as its nanoseconds."""
    colours = {**_COLOURS, CROSS: _LIGHT, MEMORY: _LIGHT}
    names = [name if name in (CROSS, MEMORY) else f"js.shift\n{name}" for name in look.wrenches]
    for i, (name, x) in enumerate(look.wrenches.items()):
        axes.barh(i, x, color=colours[name], height=0.8)
        axes.text(x, i, f" {readable(x)}", va="center", fontsize=_SMALL)
    axes.set_yticks(range(len(names)), names, fontsize=_SMALL)
    axes.set(title=f"{WRENCHES:,} wrenches moved, float32", xlabel="ns each")
    axes.invert_yaxis()
    axes.margins(x=0.15)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_robot(figure, place, look: Look):
    """The quadruped at the end of a push."""
    from jaxspatial import plot

    push = (0.1, 0.2, (0.0, quadruped.PUSH, 0.0))
    mech, q, (feet, trunk) = quadruped.pushed(0.2, [push])
    ax: Any = plot.axes(figure, place)
    plot.mechanism(mech, q[-1], ax, ground=quadruped.GROUND)
    plot.wrench(trunk["trunk"].at_batch(-1), q[-1, 4:7], ax, axis=False, name="push")
    points = forward_kinematics(mech, q[-1], feet.frames).translation
    plot.wrench(feet.wrenches.at_batch(-1), points, ax, axis=False)
    ax.set_axis_off()
    steps = f"{look.steps:,.0f} steps a second, batch {STATES}"
    gradients = f"{look.gradients:,.0f} gradients a second, batch {GRADIENTS}"
    ax.set_title("A quadruped, pushed")
    # Beneath it, as titles as wide as this would reach into those beside it.
    ax.text2D(0.5, 0.0, f"{steps}\n{gradients}", transform=ax.transAxes, ha="center", va="bottom", fontsize=_SMALL)


def _places(result, dtypes):
    """Where each axes is: operations beside their condition numbers, algorithms beside applications."""
    places = [[dtype, "conditions"] if result.curves else [dtype, dtype] for dtype in dtypes]
    last = [name for name, rows in (("algorithms", result.algorithms), ("losses", result.losses)) if rows]
    return [*places, [last[0], last[-1]]] if last else places


# -- the trade-off: one axes per dtype ---------------------------------------------------------------------------------


def _draw_points(axes, points, markers):
    """Points (case, place, style); those of one operation in one dtype joined, in the colours of their precisions."""
    for group in dict.fromkeys(case[:2] for case, _, _ in points):
        line = [at for case, at, _ in points if case[:2] == group]
        axes.plot(*zip(*line, strict=True), color=_LIGHT, linewidth=1, zorder=1)
    for case, at, style in points:
        look: Any = {"color": _COLOURS[case.precision], "marker": markers[case.operation], "markersize": 8, **style}
        axes.plot(*at, linestyle="", zorder=2, **look)
    axes.set(xscale="log", yscale="log")
    axes.grid(alpha=0.25)


def _shown(ulps):
    """What is too small for the scale at its lower end; infinities not at all."""
    return np.maximum(np.where(np.isfinite(ulps), ulps, np.nan), _LOWEST)


def _label_trade(axes, result):
    """One scale for both, and a legend beside each."""
    limits, names = [a.get_xlim() for a in axes], dict.fromkeys(row.case.operation for row in result.rows)
    keys = {
        "precision": [_key("o", name, colour) for name, colour in _COLOURS.items()],
        "operation": [_key(_MARKERS[name], OPERATIONS[name].title) for name in names],
        "lines": [_line("-", "one operation, in\nits four precisions", color=_LIGHT), _line(":", _CORRECTLY)],
    }
    for a in axes:
        a.set(xlim=(min(low for low, _ in limits), max(high for _, high in limits)), ylim=(_LOWEST, None))
        _number_decades(a.xaxis)
        a.axhline(_ROUNDED, color=_GREY, linewidth=0.8, linestyle=":", zorder=0)
        _add_legend(a, keys)
    axes[0].set_title("What an operation costs, and what its result is worth")
    axes[-1].set_xlabel(f"time per item, ns (median, {result.sizes[0]:,} items in cache)")
    _explain(
        axes[-1],
        "The error is that of the worst of 500 results: one whose terms cancel,\n"
        "so that the result is small, and so is its unit in the last place (ulp)",
    )


def _number_decades(axis):
    """At 1, 2, 5, 10, ..., as plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def _explain(axes, text):
    """Beneath the label of the x axis."""
    axes.set_xlabel(f"{axes.get_xlabel()}\n{text}", linespacing=1.4)


def _add_legend(axes, keys, **place):
    """Keys under headings; beside the axes unless another place is named."""
    place = place or {"frameon": False, "loc": "upper left", "bbox_to_anchor": (1, 1.02)}
    handles = [key for title, keys in keys.items() for key in (_line("", f"$\\bf{{{title}}}$"), *keys)]
    return axes.legend(handles=handles, fontsize=_SMALL, **place)


def _line(style, label, **names):
    look: Any = {"linestyle": style, "color": _GREY, "linewidth": 0.8, **names}
    return Line2D([], [], label=label, **look)


def _key(marker, label, colour=_GREY, **style):
    return Line2D([], [], marker=marker, color=colour, linestyle="", markersize=7, label=label, **style)


def _keys_of_dtypes(dtypes):
    return [_key("o", dtype, markerfacecolor=_face(dtype)) for dtype in dict.fromkeys(dtypes)]


def _face(dtype, colour=_GREY):
    """Filled for float32, hollow for float64."""
    return colour if dtype == "float32" else "white"


# -- error against condition number -----------------------------------------------------------------------------------


def _draw_conditions(axes, curves):
    for curve in curves:
        _draw_curve(axes, curve)
    axes.set(xscale="log", yscale="log", xlim=(1, 1e33), ylim=(_LOWEST, 1e19))
    names = ", ".join(OPERATIONS[name].title for name in dict.fromkeys(curve.operation for curve in curves))
    axes.set_title(f"Where digits are lost: terms that cancel ({names})")
    axes.set_xlabel("condition number: sizes of the terms added up / size of the result")
    _explain(
        axes,
        "Each point is the worst of 10 results or more of about that condition number;\n"
        "an ulp is the unit in the last place of the exact result",
    )
    axes.set_ylabel("worst error, ulps of a cancelled result; no point where all results are exact")
    for dtype in dict.fromkeys(curve.dtype for curve in curves):
        # Where an error is as large as the result.
        lost = 2.0 / float(np.finfo(dtype).eps)
        axes.axhline(lost, color=_GREY, linewidth=0.8, linestyle=":")
        axes.text(6e32, lost * 1.3, f"{dtype}: no digit is right above", ha="right", fontsize=8, color=_GREY)
    _label_conditions(axes, {(curve.precision, curve.dtype) for curve in curves})
    _add_legend(axes, _keys_of_conditions(curves), loc="upper left", framealpha=1, edgecolor="white").set_zorder(3)
    axes.grid(alpha=0.25)


def _draw_curve(axes, curve):
    """The promise as a thin line."""
    points = [point for point in curve.points if np.isfinite(point.condition) and point.results >= _ENOUGH]
    x, colour = [point.condition for point in points], _COLOURS[curve.precision]
    marker: Any = {"marker": _MARKERS[curve.operation], "markerfacecolor": _face(curve.dtype, colour), "markersize": 5}
    axes.plot(x, [point.worst_ulps or np.nan for point in points], color=colour, linewidth=1.2, **marker)
    dense = np.geomspace(1, max(x), 200)
    axes.plot(dense, trade.promised_ulps(curve, dense), color=colour, linewidth=0.8, linestyle="--")


def _label_conditions(axes, known):
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


def _keys_of_conditions(curves):
    names = dict.fromkeys(curve.operation for curve in curves)
    return {
        "operation": [_key(_MARKERS[name], OPERATIONS[name].title) for name in names],
        "dtype": _keys_of_dtypes(curve.dtype for curve in curves),
        "lines": [
            _line("-", "measured", linewidth=1.2),
            _line("--", "promised: never above"),
            _line(":", "error as large as the result"),
        ],
    }


# -- whole algorithms and applications --------------------------------------------------------------------------------

# What is drawn at the left end of the scale.
_NOTHING = 1e-9
_OF_ALGORITHMS = dict(zip(ALGORITHMS, "os", strict=True))


def _draw_algorithms(axes, rows):
    """One algorithm in one dtype joined, from fast to compensated."""
    points = list[tuple]()
    for row in rows:
        # The error of the reference nobody knows: it is drawn where it is promised to be.
        worst = _ROUNDED if np.isnan(row.worst_ulps) else _shown(row.worst_ulps)
        face = {"markerfacecolor": _face(row.case.dtype, _COLOURS[row.case.precision])}
        points.append((row.case, (trade.nanoseconds(row.seconds) / 1e3, worst), face))
    _draw_points(axes, points, _OF_ALGORITHMS)
    axes.set(title="What a whole algorithm costs, and what its result is worth")
    _number_decades(axes.xaxis)
    axes.set(xlabel="time per state, \N{MICRO SIGN}s (median, a batch in one call)", ylim=(_LOWEST, None))
    axes.set_ylabel("worst error, ulps of the\nlargest number of a result")
    axes.axhline(_ROUNDED, color=_GREY, linewidth=0.8, linestyle=":", zorder=0)
    _explain(axes, "All errors are those against float64 compensated, which is drawn as rounded correctly")
    _add_legend(axes, _keys_of_algorithms(rows))


def _keys_of_algorithms(rows):
    names, dtypes, precisions = (dict.fromkeys(row.case[i] for row in rows) for i in range(3))
    return {
        "precision": [_key("o", name, _COLOURS[name]) for name in precisions],
        "algorithm": [_key(_OF_ALGORITHMS[name], ALGORITHMS[name].title) for name in names],
        "dtype": _keys_of_dtypes(dtypes),
        "lines": [_line(":", _CORRECTLY)],
    }


def _draw_losses(axes, losses):
    """Each application a line: its errors over its size, and beside it the errors in its own unit."""
    for i, loss in enumerate(losses):
        shares = {name: max(error / loss.size, _NOTHING) for name, error in loss.errors.items()}
        axes.plot([min(shares.values()), max(shares.values())], [i, i], color=_LIGHT, linewidth=1, zorder=1)
        for k, (name, share) in enumerate(shares.items()):
            axes.plot(share, i, color=_COLOURS[name], marker="o", markersize=11 - 2.5 * k, linestyle="", label=name)
        size, worst, best = map(readable, (loss.size, loss.errors["fast"], loss.errors["compensated"]))
        text = f"{loss.name}\nof {size} {loss.unit} fast is off by {worst}, compensated by {best}"
        axes.text(_NOTHING, i - 0.18, text, fontsize=_SMALL, va="bottom")
    axes.set(xscale="log", xlim=(_NOTHING / 2, 2), ylim=(len(losses) - 0.2, -1.0), yticks=[])
    axes.set(title="What an application loses in float32", xlabel="worst error over the largest result")
    axes.grid(alpha=0.25, axis="x")
    handles, names = axes.get_legend_handles_labels()
    keys = dict(zip(names, handles, strict=True))
    axes.legend(keys.values(), keys.keys(), frameon=False, loc="lower right", ncols=3, fontsize=_SMALL)

"""The trade as a picture: what a wrench costs, and what the result is worth."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402 - after the choice of a backend without a window
import numpy as np  # noqa: E402

_COLOURS = {"fast": "#d1495b", "reproducible": "#00798c"}
_MARKERS = {"float32": "o", "float64": "s"}


def draw(rows, path, title):
    """Writes the picture of the rows of `trade.measure` to path."""
    figure, (cost, worth) = plt.subplots(1, 2, figsize=(13, 5.6), layout="constrained")
    _draw_cost(cost, rows)
    _draw_worth(worth, rows)
    figure.suptitle(title, fontsize=10)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _draw_cost(axes, rows):
    labels = [f"{r.case.operation}\n{r.case.dtype}" for r in rows]
    places = {label: i for i, label in enumerate(dict.fromkeys(labels))}
    precisions = list(dict.fromkeys(r.case.precision for r in rows))
    sizes = list(rows[0].seconds)
    width = 0.8 / (len(precisions) * len(sizes))
    for row, label in zip(rows, labels, strict=True):
        for i, n in enumerate(sizes):
            place = places[label] - 0.4 + (i * len(precisions) + precisions.index(row.case.precision) + 0.5) * width
            times = row.seconds[n] / n * 1e9
            axes.bar(
                place, np.median(times), width * 0.92, color=_COLOURS[row.case.precision], alpha=0.45 + 0.5 * i / 2
            )
            axes.plot([place, place], [times.min(), np.quantile(times, 0.9)], color="black", linewidth=0.8)
    for precision in precisions:
        axes.bar(0, 0, color=_COLOURS[precision], label=precision)
    axes.set(yscale="log", ylabel="ns per wrench (median; line: fastest to 90 %)", title="What it costs")
    axes.set_xticks(range(len(places)), list(places))
    axes.set_xlabel("pale to full colour: " + ", ".join(f"{n:,}" for n in sizes) + " wrenches")
    axes.set_ylim(top=4 * axes.get_ylim()[1])
    axes.legend(frameon=False, ncols=len(precisions), loc="upper center")
    axes.grid(axis="y", alpha=0.3)


def _draw_worth(axes, rows):
    rows = [row for row in rows if row.case.operation == "shift"]
    for row in rows:
        shown = np.isfinite(row.condition) & np.isfinite(row.ulps)
        style = {"color": _COLOURS[row.case.precision], "marker": _MARKERS[row.case.dtype], "alpha": 0.35}
        label = f"{row.case.precision}, {row.case.dtype}"
        error = np.maximum(row.ulps[shown], 1e-2)
        axes.scatter(row.condition[shown], error, s=9, linewidths=0, label=label, **style)
    condition = np.geomspace(1, max(float(r.condition[np.isfinite(r.condition)].max()) for r in rows), 50)
    bound = rows[0].bound
    axes.plot(condition, bound * condition, color="black", linewidth=1, label=f"promised: {bound:g} u mag")
    axes.set(xscale="log", yscale="log", title="What it is worth: torque after a shift")
    axes.set_xlabel("condition number: size of the terms / size of the result")
    axes.set_ylabel("error in units in the last place (0 shown as 0.01)")
    axes.legend(frameon=False, loc="upper left")
    axes.grid(alpha=0.3)

"""Tables and picture of what was measured."""

import pathlib

import numpy as np
from dynamics_claims import (
    FRAX,
    MJX,
    MUJOCO,
    OURS,
    PEERS,
    PINOCCHIO,
    Case,
    best_peer,
    claims,
    claims_of_shape,
)

# What the picture shows the compiling of.
COMPILED = (
    "inverse dynamics",
    "forward dynamics",
    "mass matrix",
    "kinematics",
    "derivatives of inverse dynamics",
    "derivatives of forward dynamics",
    "gradient of forward dynamics",
    "gradient by inertial parameters",
    "step",
    "gradient of a step",
)
COLOURS = {OURS: "#00798c", PINOCCHIO: "#d1495b", MUJOCO: "#edae49", FRAX: "#66a182", MJX: "#8d6a9f"}
MARKERS = {OURS: "o", PINOCCHIO: "s", MUJOCO: "D", FRAX: "^", MJX: "v"}


# The page on contributing, and the line on it before what is written there.
TARGETS = pathlib.Path(__file__).parent.parent.parent / "notebooks/contributing.md"
MARK = "<!-- written by dynamics.py -->"


def all_claims(results, shapes):
    return [x for r in results for x in claims(r)] + [x for s in shapes for x in claims_of_shape(s)]


def lines(results, shapes, left_out, machine):
    """The whole report, in Markdown."""
    yield "One core, everything in one process and in turns, after warm-up; `jax.jit(jax.vmap(...))`, results waited"
    yield "for. Default precision, known numbers folded. Times are medians of microseconds per state (10 % to 90 % of"
    yield "the rounds); ratios are medians over the rounds of the ratio within a round. Memory of results stays with"
    yield "the process (see the page on layouts), as the sides in C++ keep theirs. Measured by `dynamics.py`.\n"
    yield machine
    for result in results:
        yield from _lines_of_times(result)
    yield from _lines_of_compiling(results)
    yield from _lines_of_shapes(shapes)
    yield "\n## What the rows are\n"
    yield from NOTES
    yield from (f"- Left out: {x}." for x in left_out)


NOTES = (
    "- Derivatives: `inverse_dynamics_derivatives`, `forward_dynamics_derivatives` next to Pinocchio's",
    "  `computeRNEADerivatives` and `computeABADerivatives`: three matrices each.",
    "- Gradient of forward dynamics: `jax.vjp` by q, v and tau of every state; Pinocchio's is `computeABADerivatives`",
    "  times what comes back, by a step of q. By inertial parameters: of inverse dynamics, by ten parameters of every",
    "  body, added up over the batch; Pinocchio's is `computeJointTorqueRegressor`, transposed, times what comes back.",
    "- Matrices times vectors, in a program that returns the vector: M x is `mass_matrix(...) @ x`, next to `crba` and",
    "  a product; by inverse dynamics from rest without gravity it is the same without M. M^-1 x is",
    "  `forward_dynamics` from rest without gravity, next to `crba` and `cholesky::solve`, its fastest way; J^T F is",
    "  `jacobian(...).T @ F`, next to `computeFrameJacobian` and a product; by pull-back, `jax.vjp` of",
    "  `body_velocities`. Derivatives: the three matrices, times a vector each, added up; by jvp: `jax.jvp` along the",
    "  same vectors, next to Pinocchio's matrices again.",
    "- A step is `semi_implicit_step`, `mj_step` and `mjx.step` without contacts and limits; of frax and Pinocchio",
    "  forward dynamics and then `integrate`.",
    "- Pinocchio writes the upper triangle of a mass matrix, we write both.",
    "- Errors are of 32 states (of all, by inertial parameters), over the largest number of Pinocchio's in float64.",
    "- Trace and compile: `lower` and `compile` after `jax.clear_caches()`, of a mechanism read anew.",
)


def asked(claim):
    return f"at {'most' if claim.is_at_most else 'least'} {claim.asked:g} {claim.unit}".rstrip()


def told(claim):
    return f"{number(claim.found)} {claim.unit}".rstrip()


def lines_of_targets(found):
    """For the page on contributing: of all claims what is asked, and what was measured."""
    yield f"{sum(x.is_met for x in found)} of {len(found)} were met when it was last measured; the others are bold."
    robots = [x for x in found if ", " in x.where]
    columns = list(dict.fromkeys(x.where for x in robots))
    if columns:
        yield f"\n| | {' | '.join(columns)} |\n|{'---|' * (len(columns) + 1)}"
    by_place = {(x.what, x.where): _cell_of_target(x) for x in robots}
    for what in dict.fromkeys(x.what for x in robots):
        yield f"| {what} | {' | '.join(by_place.get((what, where), '') for where in columns)} |"
    others = [x for x in found if ", " not in x.where]
    if others:
        yield "\n| | | |\n|---|---|---|"
        yield from (f"| {x.where} | {x.what} | {_cell_of_target(x)} |" for x in others)


def _cell_of_target(claim):
    cell = f"{told(claim)}, {asked(claim)}"
    return cell if claim.is_met else f"**{cell}**"


def with_targets(page, found):
    """The text of the page on contributing, with these targets at its end."""
    kept, mark, _ = page.partition(MARK)
    assert mark, f"the page has no line {MARK}"
    return "\n".join([kept + mark, "", *lines_of_targets(found), ""])


def number(x):
    return f"{x:.3g}" if x < 1000 else f"{x:.0f}"


def spread(seconds, scale=1e6):
    low, middle, high = (number(x) for x in np.quantile(seconds, [0.1, 0.5, 0.9]) * scale)
    return f"{middle} ({low}-{high})"


def _lines_of_times(result):
    order = list(dict.fromkeys(x.algorithm for x in result.seconds))
    measured = sorted({(x.algorithm, x.batch) for x in result.seconds}, key=lambda x: (order.index(x[0]), x[1]))
    others = dict.fromkeys(x.who for x in result.seconds if x.who != OURS)
    who = [OURS, *sorted(others, key=lambda x: PEERS.index(x) if x in PEERS else -1)]
    yield f"\n## {result.robot}, {result.dtype}: us per state\n"
    yield f"| | batch | {' | '.join(who)} | best peer over ours | error |\n|{'---|' * (len(who) + 4)}"
    for algorithm, batch in measured:
        case = Case(algorithm, batch, OURS)
        times = [case._replace(who=x) for x in who]
        cells = [spread(result.seconds[x]) if x in result.seconds else "" for x in times]
        best, error = best_peer(result, case), result.errors.get(case)
        cells.append(f"{best[1]:.2f} ({best[0]})" if best else "")
        cells.append(f"{error:.0e}" if error is not None else "")
        yield f"| {algorithm} | {batch} | {' | '.join(cells)} |"


def _lines_of_compiling(results):
    who = list(dict.fromkeys(case.who for r in results for case in r.compiling))
    yield "\n## Seconds to trace and to compile, cold\n"
    yield f"| | | {' | '.join(f'{x}: trace | compile | both' for x in who)} |\n|{'---|' * (2 + 3 * len(who))}"
    for result in results:
        # Of a batch of the same size where there is one: MJX runs on fewer.
        for algorithm in dict.fromkeys(case.algorithm for case in result.compiling):
            found = [_of_largest(result, algorithm, x) for x in who]
            cells = [_cells(x) for x in found]
            yield f"| {result.robot}, {result.dtype} | {algorithm} | {' | '.join(cells)} |"


def _of_largest(result, algorithm, who):
    """At the main batch, or the one there is."""
    found = {case.batch: x for case, x in result.compiling.items() if case[::2] == (algorithm, who)}
    return found.get(result.many) or next(iter(found.values()), None)


def _cells(compiling):
    numbers = (compiling.trace, compiling.compile, compiling.total) if compiling else (None,) * 3
    return " | ".join("" if x is None else f"{x:.2f}" for x in numbers)


def _lines_of_shapes(shapes):
    if not shapes:
        return
    yield "\n## Size\n"
    yield "| | | trace and compile, s | us per state | us per state and link |\n|---|---|---|---|---|"
    for shape in shapes:
        for size, compiling in shape.compiling.items():
            per_link = shape.seconds.get(size)
            cells = (spread(per_link * int(size.split()[0])), spread(per_link)) if per_link is not None else ("", "")
            yield f"| {shape.name}, {shape.algorithm} | {size} | {spread(compiling, 1)} | {' | '.join(cells)} |"


# -- picture ----------------------------------------------------------------------------------------------------------


def picture(results, path):
    """Rows of us per state in each dtype, for each robot, and below what compiling costs against what running costs."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt
    from matplotlib.lines import Line2D

    robots = list(dict.fromkeys(r.robot for r in results))
    own = {robot: [r for r in results if r.robot == robot] for robot in robots}
    # As wide as a page, so that texts are read as they are.
    height = 5.5 * len(robots)
    figure = plt.figure(figsize=(11, height + 5), layout="constrained")
    times, compiling = figure.subfigures(2, 1, height_ratios=(height, 5))
    panels = times.subplots(len(robots), max(map(len, own.values())), squeeze=False)
    for row, several in zip(panels, own.values(), strict=True):
        for axes, result in zip(row, several, strict=False):
            _dots(axes, result, is_first=result is several[0])
    for axes, several in zip(compiling.subplots(1, len(robots), squeeze=False)[0], own.values(), strict=True):
        _scatter(axes, several[0])
    shown = [x for x in (OURS, *PEERS) if any((x, r.many) == c[:0:-1] for r in results for c in r.seconds)]
    handles = [Line2D([], [], marker=MARKERS[x], color=COLOURS[x], ls="", ms=8) for x in shown]
    figure.legend(handles, shown, loc="outside upper center", ncols=5, frameon=False, fontsize=12)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def _scatter(axes, result):
    points = []
    for case, compiling in result.compiling.items():
        is_shown = case.who in COLOURS and case.algorithm in COMPILED
        if is_shown and case.batch == result.many and case in result.seconds:
            x, y = compiling.total, np.median(result.seconds[case]) * 1e6
            axes.plot(x, y, MARKERS[case.who], color=COLOURS[case.who], ms=7, zorder=3)
            points.append((case, x, y))
    where = {(case.algorithm, case.who): (x, y) for case, x, y in points}
    for (algorithm, who), (x, y) in where.items():
        other = where.get((algorithm, FRAX))
        if who == OURS and other:
            axes.plot((x, other[0]), (y, other[1]), color="#cccccc", lw=1, zorder=1)
    axes.set(xscale="log", yscale="log", xlabel="seconds to trace and compile, cold", ylabel="us per state")
    axes.set_title(f"{result.robot}, {result.dtype}: compiling and running", loc="left")
    _name(axes, [(case.algorithm, x, y) for case, x, y in points if case.who == OURS])
    _bare(axes)


def _name(axes, points):
    """Names in a column on the right, where room is made, each with a line to its point."""
    axes.margins(0.1)
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * (high / low) ** 1.4)
    places = np.linspace(0.03, 0.97, len(points))
    for (name, x, y), place in zip(sorted(points, key=lambda p: p[2]), places, strict=True):
        told = {"xycoords": "data", "textcoords": axes.transAxes, "fontsize": 9, "va": "center"}
        line = {"arrowstyle": "-", "color": COLOURS[OURS], "lw": 0.6, "alpha": 0.6, "relpos": (0, 0.5)}
        axes.annotate(name, (x, y), (0.52, place), arrowprops=line, **told)


def _dots(axes, result, is_first):
    """A line for each algorithm, a mark for each side."""
    algorithms = list(dict.fromkeys(x.algorithm for x in result.seconds if x.batch == result.many))[::-1]
    for height, algorithm in enumerate(algorithms):
        found = {x: result.seconds.get(Case(algorithm, result.many, x)) for x in (*PEERS, OURS)}
        times = {x: np.median(s) * 1e6 for x, s in found.items() if s is not None}
        axes.plot((min(times.values()), max(times.values())), (height, height), color="#cccccc", lw=1, zorder=1)
        for who, time in times.items():
            axes.plot(time, height, MARKERS[who], color=COLOURS[who], ms=8, zorder=3)
        if OURS in times:
            is_least = times[OURS] == min(times.values())  # then there is room on the left
            told = {"textcoords": "offset points", "va": "center", "fontsize": 8, "color": COLOURS[OURS]}
            at = {"xytext": (-7, 0), "ha": "right"} if is_least else {"xytext": (7, 0), "ha": "left"}
            axes.annotate(number(times[OURS]), (times[OURS], height), **at, **told)
    axes.set_yticks(range(len(algorithms)), algorithms if is_first else [""] * len(algorithms))
    axes.set(xscale="log", xlabel="us per state", ylim=(-0.6, len(algorithms) - 0.3))
    axes.set_xlim(axes.get_xlim()[0] / 3)  # room for the numbers
    axes.set_title(f"{result.robot}, {result.dtype}, batch {result.many}")
    _bare(axes)


def _bare(axes):
    from matplotlib import ticker

    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="both", which="major", color="#eeeeee", zorder=0)
    axes.set_axisbelow(True)
    for axis in (x for x in (axes.xaxis, axes.yaxis) if x.get_scale() == "log"):
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5) if _decades(axis) < 2 else (1,)))
        axis.set_major_formatter(ticker.FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_formatter(ticker.NullFormatter())


def _decades(axis):
    low, high = axis.get_view_interval()
    return np.log10(high / low)

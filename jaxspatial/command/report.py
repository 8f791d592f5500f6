"""What the command prints where rich is installed: progress while it works, then tables."""

import itertools
import math

from rich import box, progress
from rich.console import Console
from rich.table import Table
from rich.text import Text

from jaxspatial.command.algorithms import ALGORITHMS, Evaluated
from jaxspatial.command.first_look import CROSS, GRADIENTS, MEMORY, PRECISIONS, STATES, STEPS, WRENCHES, Look
from jaxspatial.command.result import Result, readable
from jaxspatial.command.trade import POWER_BOUND, STREAMED, Power, Row, nanoseconds
from jaxspatial.measure.checks import Report
from jaxspatial.numerics.precision import OF_ALGORITHMS, Precision

_STYLES = {True: "green", False: "bold red", None: "dim"}


def with_progress(console: Console, work, total: int):
    """work(advance), with a progress bar that `advance` moves `total` times."""
    columns = (progress.TextColumn("measuring"), progress.BarColumn(), progress.MofNCompleteColumn())
    with progress.Progress(*columns, progress.TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task("", total=total)
        return work(lambda: bar.advance(task))


def print_power(console: Console, powers: dict[str, Power]):
    """Power about P and about Q, per dtype."""
    table = Table(title="Power before and after the shift", box=box.SIMPLE_HEAD, title_justify="left")
    for heading in ("", "about P, W", "about Q, W", "largest difference, u mag", "bound"):
        table.add_column(heading, justify="right")
    for dtype, p in powers.items():
        watts = (f"{x:.{9 if dtype == 'float32' else 17}g}" for x in (p.before, p.after))
        table.add_row(dtype, *watts, f"{p.difference:.2f}", f"{POWER_BOUND:g}")
    if powers:
        console.print(table)


# Of the whole table: wider than some terminals, which wrap its lines; cut off it would say nothing.
_WIDTH = 172
# Of the short one: fits on every screen.
_SCREEN = 80
_LEFT = ("operation", "dtype", "precision", "promised error")
_SHORT_LINE = "{:<18} {:>5} {:>6} {:>5} {:>6} {:>7} {:>7} {:>5} {:>7} {}"
_SHORT_HEAD = """\
                        time, ns per item         worst error of   and of
                    fast reprod. comp. faithf.   reproducible   compensated
                                                ulps SI units  ulps SI units"""


def print_trade(console: Console, result: Result, full: bool = False):
    """The trade-off: at most a screen, or all of it; then, a screen too, that of whole algorithms and applications."""
    if result.rows:
        _print_full(_as_wide(console, _WIDTH), result) if full else _print_short(_as_wide(console), result)
    if result.algorithms:
        lines = _lines(sorted(result.algorithms, key=lambda row: row.case.dtype), _whole_line)
        _print_lines(_as_wide(console), "Whole algorithms", _WHOLE_HEAD, lines, _WHOLE_NOTES)
    if result.losses:
        numbers = ([readable(x) for x in (loss.size, *loss.errors.values())] for loss in result.losses)
        lines = (_LOSS_LINE.format(loss.name, *x, loss.unit) for loss, x in zip(result.losses, numbers, strict=True))
        _print_lines(_as_wide(console), "What an application loses, in its own units", _LOSS_HEAD, lines, "")


def _as_wide(console, width=_SCREEN):
    return Console(file=console.file, width=max(console.width, width), force_terminal=console.is_terminal)


def _print_lines(wide, title, head, lines, notes):
    wide.print(Text(title, "italic"))
    wide.print(head, highlight=False)
    for line in lines:
        wide.print(line, highlight=False, soft_wrap=True)
    wide.print(notes, highlight=False)


# -- the first look: for who has never seen an ulp ---------------------------------------------------------------------

_FIRST_NOTES = """\
fast          when only time counts; the compiler may fuse a product with a sum
reproducible  the default: the same digits in every program, batch and run
compensated   as if computed with twice the digits, then rounded once
What a state in float32 loses from step to step, as in the last two rows,
no precision gives back: take float64 there.

Another precision: js.shift(F, p, precision="compensated")
The robot, in a browser: python -m jaxspatial demo, after pip install ".\\[view]"
All operations, dtypes and errors, in minutes: --full
"""
_ONE, _THREE = "  {:<66} {:>11}", "  {:<39} {:>11} {:>12} {:>11}"


def print_first_look(console: Console, look: Look):
    """A page: numbers with their batch and unit, and what accuracy costs and buys in three precisions."""
    n, shifts = f"{WRENCHES:,}", [look.wrenches[precision] for precision in PRECISIONS]
    lines = [
        Text(f"Wrenches moved to another point, float32, batch {n}, ns each", "bold"),
        _ONE.format("js.shift(F, p)", readable(look.wrenches["reproducible"])),
        _ONE.format(CROSS, readable(look.wrenches[CROSS])),
        _ONE.format(f"{MEMORY}: as fast as memory is", readable(look.wrenches[MEMORY])),
        "",
        Text("A quadruped of 12 joints on four feet, float32", "bold"),
        _ONE.format(f"steps of 5 ms, in a second, batch {STATES}", f"{look.steps:,.0f}"),
        _ONE.format(
            f"gradients of a push through {STEPS} steps, in a second, batch {GRADIENTS}", f"{look.gradients:,.0f}"
        ),
        _ONE.format("a push of 1 N more moves its trunk farther, in 0.3 s, by", f"{look.response:.2f} mm"),
        "",
        Text("What accuracy costs", "bold"),
        _THREE.format("", *PRECISIONS),
        _THREE.format(f"a wrench moved, batch {n}, ns", *map(readable, shifts)),
        _THREE.format(f"torques of a 7-joint arm, batch {STATES}, µs", *map(readable, look.torques.values())),
        "",
        Text("and where it decides: off by at most, float32, in the unit of the result", "bold"),
    ]
    for loss in look.losses:
        lines.append(_THREE.format(loss.name, *map(readable, loss.errors.values())))
        lines.append(f"    of {readable(loss.size)} {loss.unit}, batch {loss.states}")
    wide = _as_wide(console)
    for line in (*lines, "", _FIRST_NOTES):
        wide.print(line, highlight=False, soft_wrap=True)


# -- a screen ---------------------------------------------------------------------------------------------------------


def _print_short(wide, result: Result):
    """Per operation: time in the four precisions, and the worst error of two of them, in ulps and in SI units.

    Of more than two dtypes float32 and float64: no more fits."""
    known = list(dict.fromkeys(row.case.dtype for row in result.rows))
    dtypes = known if len(known) <= 2 else [dtype for dtype in known if dtype in STREAMED]
    rows = [row for dtype in dtypes for row in result.rows if row.case.dtype == dtype]
    _print_lines(
        wide,
        "The trade-off on this machine",
        _SHORT_HEAD,
        _lines(rows, _short_line),
        _SHORT_NOTES.format(result.sizes[0]),
    )


def _lines(rows, line):
    """For each dtype a heading, and a line for each operation."""
    for dtype, group in itertools.groupby(rows, lambda row: row.case.dtype):
        yield Text(dtype, "bold")
        yield from (line(list(some)) for _, some in itertools.groupby(group, lambda row: row.case.operation))


def _short_line(rows: list[Row]):
    """One operation in one dtype. Of its parts the one of most terms stands for all."""
    by_precision = {row.case.precision: row for row in rows}
    operation = rows[0].operation
    part = operation.bounds.index(max(operation.bounds, key=lambda promise: promise.u))
    errors = [
        text
        for row in (by_precision["reproducible"], by_precision["compensated"])
        for text in (readable(row.worst_ulps), readable(row.worst_in_units[part]))
    ]
    times = [readable(nanoseconds(by_precision[name].in_cache)) for name in map(str, Precision)]
    return _SHORT_LINE.format(operation.title, *times, *errors, operation.units[part])


_SHORT_NOTES = """\
Times: {:,} items that stay in the cache. Errors: worst of 500 results against
exact rationals; an ulp is a unit in the last place of the exact result, small
where terms cancel. fast promises the errors of reproducible, faithful 1 ulp;
a shift passes forces on as they are. All dtypes, precisions, times: --full
"""


# -- whole algorithms and applications: a screen ----------------------------------------------------------------------

_WHOLE_LINE = "{:<17} {:>6} {:>7} {:>6}  {:>6} {:>7} {:>6} {:>7} {}"
_WHOLE_HEAD = """\
                  time, us per state    worst error of  and of
                    fast reprod.  comp. reproducible    compensated
                                          ulps SI units   ulps SI units"""
_WHOLE_NOTES = """\
Times: a batch in one call. Errors: against float64 compensated (ref.), in units
in the last place of the largest number of each result, and in SI units, the
worst of many states. faithful promises what compensated does.
"""


def _whole_line(rows: list[Evaluated]):
    """One algorithm in one dtype."""
    by_precision = {row.case.precision: row for row in rows}
    times = [readable(nanoseconds(by_precision[name].seconds) / 1e3) for name in OF_ALGORITHMS]
    errors = [
        "ref." if math.isnan(error) else readable(error)
        for row in (by_precision["reproducible"], by_precision["compensated"])
        for error in (row.worst_ulps, row.worst_in_units)
    ]
    return _WHOLE_LINE.format(ALGORITHMS[rows[0].case.operation].title, *times, *errors, rows[0].unit)


_LOSS_LINE = "{:<40} {:>7} {:>7} {:>7} {:>7} {}"
_LOSS_HEAD = """\
                                          largest  worst error in float32
                                           result    fast reprod.   comp."""


# -- all of it --------------------------------------------------------------------------------------------------------


def _print_full(wide, result: Result):
    """Cost in cache and streaming, error against exact rationals, promise."""
    in_cache, streamed = (f"{n:,}" for n in result.sizes)
    table = Table(
        title="The trade-off on this machine", box=box.SIMPLE_HEAD, title_justify="left", padding=(0, 1, 0, 0)
    )
    costs = (f"in cache\n{in_cache}\nns", "\nover\nfast", f"streaming\n{streamed}\nns", "\nover\nfast", "\n\nGB/s")
    errors = ("compile\n\ns", "median\nerror\nulps", "worst\nerror\nulps", "worst\nerror\nSI units")
    for heading in (*_LEFT[:3], *costs, *errors, "worst\nover\npromised", _LEFT[3]):
        table.add_column(heading, justify="left" if heading in _LEFT else "right", no_wrap=True)
    for _, group in itertools.groupby(result.rows, lambda row: row.case[:2]):
        _add_group(table, list(group))
    wide.print(table)
    wide.print(_NOTES, highlight=False)


def _add_group(table: Table, rows: list[Row]):
    """The precisions of one operation in one dtype."""
    fast = rows[0]
    for row in rows:
        names = (row.operation.title, row.case.dtype) if row is fast else ("", "")
        streamed = ["", "", ""]
        if row.streamed is not None:
            streamed = [*_relative(row.streamed, fast.streamed), f"{row.gigabytes_per_second:.1f}"]
        costs = (*_relative(row.in_cache, fast.in_cache), *streamed, f"{row.compile_seconds:.2f}")
        units = ", ".join(f"{readable(worst)} {unit}" for unit, worst in row.errors_in_units)
        errors = (readable(row.median_ulps), readable(row.worst_ulps), units, f"{row.of_promise:.2f}")
        table.add_row(*names, row.case.precision, *costs, *errors, row.promise)
    table.add_section()


def _relative(seconds, fast):
    return [f"{nanoseconds(seconds):.2f}", f"{nanoseconds(seconds) / nanoseconds(fast):.1f}"]


_NOTES = """\
ns per item, medians. In cache: 100 steps in one call, arguments and results stay in the cache. Streaming: one call over
all items, in place where the operation can be; of few items this is the cost of a call. compile: tracing and compiling
the loop. Momenta shift as forces do; float16 and bfloat16 are timed in cache only.
Errors against exact rationals: in units in the last place (ulp) of the exact result r, which is small where terms
cancel; in SI units, per part; and over the bound promised. u is the unit roundoff, mag the sizes of the terms added up:
where terms cancel, mag is large next to r. A shift passes on the part that it does not change without any error.
"""


def print_self_check(console: Console, report: Report):
    """What `self_check` found."""
    console.print(report.surroundings, highlight=False)
    table = Table(box=box.SIMPLE_HEAD, show_header=False)
    for style in (None, "bold", None):
        table.add_column(style=style)
    for finding in report.findings:
        advice = f"\n-> {finding.advice}" if finding.advice else ""
        table.add_row(Text(finding.verdict, _STYLES[finding.holds]), finding.name, Text(finding.measured + advice))
    console.print(table)
    console.print(report.conclusion, style=_STYLES[report.holds])

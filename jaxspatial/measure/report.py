"""What the command prints where rich is installed: progress while it works, then tables."""

import itertools

from rich import box, progress
from rich.console import Console
from rich.table import Table
from rich.text import Text

from jaxspatial.measure import power
from jaxspatial.measure.operation import OPERATIONS
from jaxspatial.measure.trade import nanoseconds

_STYLES = {True: "green", False: "bold red", None: "dim"}


def with_progress(console, work, total):
    """work(advance), with a progress bar that `advance` moves `total` times."""
    columns = (progress.TextColumn("measuring"), progress.BarColumn(), progress.MofNCompleteColumn())
    with progress.Progress(*columns, progress.TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task("", total=total)
        return work(lambda: bar.advance(task))


def print_power(console, powers):
    """Power about P and about Q, per dtype."""
    table = Table(title="Power before and after the shift", box=box.SIMPLE_HEAD, title_justify="left")
    for heading in ("", "about P, W", "about Q, W", "largest difference, u mag", "bound"):
        table.add_column(heading, justify="right")
    for dtype, p in powers.items():
        digits = 9 if dtype == "float32" else 17
        numbers = (f"{p.before:.{digits}g}", f"{p.after:.{digits}g}", f"{p.difference:.2f}", f"{power.BOUND:g}")
        table.add_row(dtype, *numbers)
    console.print(table)


# Of the trade: wider than some terminals, which wrap its lines; cut off it would say nothing.
_WIDTH = 144
_LEFT = ("operation", "dtype", "precision", "promised error")


def print_trade(console, result):
    """The trade: cost in cache and streaming, error against exact rationals, promise."""
    in_cache, streamed = (f"{n:,}" for n in result.sizes)
    table = Table(title="The trade on this machine", box=box.SIMPLE_HEAD, title_justify="left", padding=(0, 1, 0, 0))
    costs = (f"in cache\n{in_cache}\nns", "\nover\nfast", f"streaming\n{streamed}\nns", "\nover\nfast", "\n\nGB/s")
    errors = ("compile\n\ns", "median\nerror\nulps", "worst\nerror\nulps", "worst\nover\npromised")
    for heading in (*_LEFT[:3], *costs, *errors, _LEFT[3]):
        table.add_column(heading, justify="left" if heading in _LEFT else "right", no_wrap=True)
    for _, group in itertools.groupby(result.rows, lambda row: row.case[:2]):
        _add_group(table, list(group))
    wide = Console(file=console.file, width=max(console.width, _WIDTH), force_terminal=console.is_terminal)
    wide.print(table)
    wide.print(_NOTES, highlight=False)


def _add_group(table, rows):
    """The precisions of one operation in one dtype."""
    fast = rows[0]
    for row in rows:
        names = (OPERATIONS[row.case.operation].title, row.case.dtype) if row is fast else ("", "")
        costs = (*_relative(row.in_cache, fast.in_cache), *_streamed(row, fast), f"{row.compile_seconds:.2f}")
        errors = (f"{row.median_ulps:.2f}", _short(row.worst_ulps), f"{row.of_promise:.2f}")
        table.add_row(*names, row.case.precision, *costs, *errors, row.promise)
    table.add_section()


def _streamed(row, fast):
    if row.streamed is None:
        return ["", "", ""]
    return [*_relative(row.streamed, fast.streamed), f"{row.gigabytes_per_second:.1f}"]


def _short(ulps):
    return f"{ulps:.0f}" if 100 <= ulps < 1e6 else f"{ulps:.3g}"


def _relative(seconds, fast):
    return [f"{nanoseconds(seconds):.2f}", f"{nanoseconds(seconds) / nanoseconds(fast):.1f}"]


_NOTES = """\
ns per item, medians. In cache: 100 steps in one call, arguments and results stay in the cache. Streaming: one call over
all items, in place where the operation can be; of few items this is the cost of a call. compile: tracing and compiling
the loop. Momenta shift as forces do; float16 and bfloat16 are timed in cache only.
Errors against exact rationals: in units in the last place (ulp) of the exact result r, and over the bound promised.
u is the unit roundoff, mag the sizes of the terms added up: where terms cancel, mag is large next to r.
"""


def print_self_check(console, report):
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

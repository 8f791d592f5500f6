"""What the command prints: progress while it works, then tables."""

import numpy as np
from rich import box, progress
from rich.table import Table

from jaxspatial.measure import power, trade


def with_progress(console, work, sizes):
    """work(advance), with a progress bar that `advance` moves."""
    columns = (progress.TextColumn("measuring"), progress.BarColumn(), progress.MofNCompleteColumn())
    with progress.Progress(*columns, progress.TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task("", total=trade.steps(sizes))
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


def print_trade(console, rows, sizes):
    """The trade: cost per size, error against exact rationals, promise."""
    table = Table(title="The trade on this machine", box=box.SIMPLE_HEAD, title_justify="left")
    for heading in ("operation", "dtype", "precision"):
        table.add_column(heading)
    for n in sizes:
        table.add_column(f"n = {n:,}\nns (GB/s)", justify="right")
    for heading in ("error, ulps\nmedian", "error, ulps\nworst", "error,\nu mag", "promised,\nu mag"):
        table.add_column(heading, justify="right")
    for row in rows:
        costs = (f"{row.nanoseconds(n):.2f} ({row.gigabytes_per_second(n):.1f})" for n in sizes)
        errors = (f"{np.median(row.ulps):.2f}", f"{row.ulps.max():.3g}", f"{row.u_of_magnitude:.2f}", f"{row.bound:g}")
        table.add_row(*row.case, *costs, *errors)
    console.print(table)
    console.print(
        "Per wrench: ns (and GB/s), medians; shift in place (donated). n = 1,000 is mostly the cost of a call.\n"
        "Errors against exact rationals: in units in the last place of the exact result, and over u mag, u the unit\n"
        "roundoff, mag the sizes of the terms added up; where terms cancel, the first grows and the second does not.\n"
    )

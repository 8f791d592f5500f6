"""Which job of the command it is, and its failures as one line and an exit status."""

import _thread
import contextlib
import os
import pathlib
import sys
import threading
from collections.abc import Iterable

from jaxspatial.command import demo, first_look, measuring, options, wrench_file
from jaxspatial.command.files import WrenchFileError
from jaxspatial.command.result import as_json
from jaxspatial.measure.checks import self_check
from jaxspatial.numerics.check import did_you_mean

# Exit statuses beside 0, and 1 where a promise does not hold; the last as shells have it, 128 and the signal.
_IMPOSSIBLE, _INTERRUPTED = 2, 130
# Seconds until a dropped interrupt comes again: by then the callback and the hook have returned, on a busy machine too.
_PAUSE = 0.2


def main(arguments: Iterable[str] | None = None):
    """Runs the command; returns its exit status: 0, 1 where a promise does not hold, 2 for what cannot be done, 130."""
    try:
        with interrupts_heard():
            status = _run(sys.argv[1:] if arguments is None else list(arguments))
            sys.stdout.flush()
        return status
    except (WrenchFileError, OSError, MemoryError) as error:
        return _failed(_line(error), _IMPOSSIBLE)
    except KeyboardInterrupt:
        return _failed("interrupted", _INTERRUPTED)


def _run(arguments):
    """What is done without a subcommand is `trade`; without any argument, the first look."""
    jobs = ("trade", "shift", "self-check", "demo")
    first = arguments[0] if arguments else "-"
    if first not in jobs and first[:1] != "-" and not pathlib.Path(first).suffix:
        if near := did_you_mean(first, jobs, 0.75):
            raise WrenchFileError(f"{first}: expected a subcommand or a file{near}")
    job, *rest = arguments if first in jobs else ["trade", *arguments]
    if job == "shift":
        return wrench_file.convert(options.to_shift(rest))
    if job == "demo":
        return demo.run(options.showing().parse_args(rest))
    given = options.checking().parse_args(rest) if job == "self-check" else options.to_measure(rest)
    if job == "self-check" or given.self_check:
        return _print_self_check(given.json)
    return first_look.run(given) if options.is_first_look(given) else measuring.run(given)


def _print_self_check(json):
    result, console = self_check(), None if json else measuring.console_on()
    if console:
        from jaxspatial.command import report

        report.print_self_check(console, result)
    else:
        print(as_json(result.to_dict()) if json else result)
    return 0 if result.holds else 1


def _line(error):
    """What happened in one line."""
    name, reason = getattr(error, "filename", None), getattr(error, "strerror", None) or str(error)
    text = f"{name}: {reason}" if name else reason or type(error).__name__
    return text.splitlines()[0]


def _failed(text, status):
    try:
        sys.stdout.flush()
    except OSError:
        # What does not fit would be tried again, and complained about, when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    print(f"error: {text}", file=sys.stderr)
    return status


@contextlib.contextmanager
def interrupts_heard():
    """Hears also those that Python drops, as in the callback of the garbage collector that JAX has: while this lasts, a
    KeyboardInterrupt raised where nothing can catch it comes again, until it is caught."""
    before, timers = sys.unraisablehook, list[threading.Timer]()

    def again(dropped):
        if not issubclass(dropped.exc_type, KeyboardInterrupt):
            return before(dropped)
        timers.append(threading.Timer(_PAUSE, _thread.interrupt_main))
        timers[-1].start()

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = before
        for timer in timers:
            timer.cancel()

"""The command line: which job it is, and its failures as one line and an exit status."""

import _thread
import contextlib
import os
import sys
import threading
from collections.abc import Iterable

from jaxspatial.command import measuring, moving, options
from jaxspatial.command.result import as_json
from jaxspatial.command.wrench_file import WrenchFileError
from jaxspatial.measure.self_check import self_check

# Exit statuses beside 0, and 1 where a promise does not hold; the last as shells have it, 128 and the signal.
_IMPOSSIBLE, _INTERRUPTED = 2, 130
# Seconds until a dropped interrupt comes again: by then the callback is over.
_PAUSE = 0.02


def main(arguments: Iterable[str] | None = None):
    """Runs the command; returns its exit status: 0, 1 where a promise does not hold, 2 for what cannot be done, 130."""
    try:
        with interrupts_heard():
            status = _run(sys.argv[1:] if arguments is None else list(arguments))
            sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return _failed("interrupted", _INTERRUPTED)
    except (WrenchFileError, OSError, MemoryError) as error:
        return _failed(_line(error), _IMPOSSIBLE)


def _run(arguments: list[str]):
    """What is done without a subcommand is `trade`."""
    job, *rest = arguments if arguments and arguments[0] in ("trade", "shift", "self-check") else ["trade", *arguments]
    if job == "shift":
        return moving.run(options.shifting().parse_args(rest))
    given = (options.checking() if job == "self-check" else options.measuring()).parse_args(rest)
    return _print_self_check(given.json) if job == "self-check" or given.self_check else measuring.run(given)


def _print_self_check(json: bool):
    found, console = self_check(), None if json else measuring.console_on()
    if console:
        from jaxspatial.command import report

        report.print_self_check(console, found)
    else:
        print(as_json(found.to_dict()) if json else found)
    return 0 if found.holds else 1


def _line(error: BaseException):
    """What happened in one line."""
    name, reason = getattr(error, "filename", None), getattr(error, "strerror", None) or str(error)
    text = f"{name}: {reason}" if name else reason or type(error).__name__
    return text.splitlines()[0]


def _failed(text: str, status: int):
    try:
        sys.stdout.flush()
    except OSError:
        # What does not fit would be tried again, and complained about, when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    print(f"error: {text}", file=sys.stderr)
    return status


@contextlib.contextmanager
def interrupts_heard():
    """Also those that Python drops, as in the callback of the garbage collector that JAX has: while this lasts, a
    KeyboardInterrupt raised where nothing can catch it comes again, until it is caught."""
    before, timers = sys.unraisablehook, list[threading.Timer]()

    def again(dropped: "sys.UnraisableHookArgs"):
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

"""Interrupts that are heard: also those that Python drops, as in the callback of the garbage collector that JAX has."""

import _thread
import contextlib
import sys
import threading

# Seconds until a dropped interrupt comes again: by then the callback is over.
_PAUSE = 0.02


@contextlib.contextmanager
def heard():
    """While it lasts, a KeyboardInterrupt raised where nothing can catch it comes again, until it is caught."""
    before, timers = sys.unraisablehook, []

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

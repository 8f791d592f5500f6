"""Fair timing: every case in one process, in turns, after warm-up, until the result is there."""

import os
import platform
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from typing import Any, TypeVar

import jax
import numpy as np

Name = TypeVar("Name")
# What is called after each step of the work, for a progress bar.
Advance = Callable[[], object]


Calls = Mapping[Name, Callable[[], Any]]


def interleaved(cases: Calls[Name], rounds: int = 15, advance: Advance = lambda: None, limit: float = float("inf")):
    """Seconds per call of every case: name -> array (rounds,).

    cases: name -> function without arguments; what it returns is waited for. In turns, so that what disturbs the
    machine disturbs all. `advance` is called after every round, for a progress bar. limit: no new round begins after so
    many seconds, but the first three do.
    """
    for call in cases.values():
        jax.block_until_ready(call())
        jax.block_until_ready(call())
    seconds: dict[Name, list[float]] = {name: [] for name in cases}
    begin = time.perf_counter()
    for i in range(rounds):
        for name, call in cases.items() if i < 3 or time.perf_counter() < begin + limit else ():
            start = time.perf_counter()
            jax.block_until_ready(call())
            seconds[name].append(time.perf_counter() - start)
        advance()
    return {name: np.array(s) for name, s in seconds.items()}


def machine():
    """One line that says where numbers come from."""
    n = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    cores = f"{n} core{'' if n == 1 else 's'} in use, {jax.default_backend()}"
    versions = f"jax {jax.__version__}, jaxlib {version('jaxlib')}, numpy {np.__version__}"
    return f"{_processor()}, {cores}, Python {platform.python_version()}, {versions}"


def _processor():
    try:
        with open("/proc/cpuinfo") as lines:
            return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()

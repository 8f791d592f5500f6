"""Programs that XLA compiles in less than half of the time, and that run slower: for tests of what pages, notebooks and
examples compute. What is promised of bits and bounds is tested as users compile."""

import contextlib
import functools
import os
from unittest import mock

import jax
from jax._src import compiler

# Kernels of one operation each, in one module of LLVM.
_OPTIONS = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_parallel_codegen_split_count": 1}


@functools.cache
def _options():
    """None where this XLA does not know them: a process with an unknown flag would abort. What is compiled with options
    of its own keeps them."""
    try:
        jax.jit(lambda: 0, compiler_options=_OPTIONS)()
    except Exception:
        return {}
    return _OPTIONS


@contextlib.contextmanager
def compiled_soon(and_runs_long=False):
    """What is compiled in this process. and_runs_long: LLVM optimises a little."""
    given, before = compiler.get_compile_options, jax.config.values[_MOST]
    more = {"xla_backend_optimization_level": 1} if and_runs_long else {}

    def with_options(*arguments, env_options_overrides=None, **others):
        # Asked at the first program, and not before: pages say first how many devices there are.
        return given(*arguments, env_options_overrides=env_options_overrides or {**_options(), **more}, **others)

    jax.config.update(_MOST, not and_runs_long)
    try:
        with mock.patch.object(compiler, "get_compile_options", with_options):
            yield
    finally:
        jax.config.update(_MOST, before)


_MOST = "jax_disable_most_optimizations"


def environment():
    """Variables for a process that compiles so, in which LLVM optimises a little: what notebooks run takes longer
    without."""
    options = _options() and {**_options(), "xla_backend_optimization_level": 1}
    flags = [os.environ.get("XLA_FLAGS", ""), *(f"--{name}={str(x).lower()}" for name, x in options.items())]
    return {"XLA_FLAGS": " ".join(flags).strip()}

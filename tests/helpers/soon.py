"""Programs that XLA compiles in less than half of the time, and that run slower: for tests of what pages, notebooks and
examples compute. What is promised of bits and bounds is tested as users compile."""

import contextlib
import functools
import os
import threading
from unittest import mock

import jax
from jax._src import compiler
from jax._src.interpreters import mlir, pxla
from jaxlib.mlir import ir

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


@contextlib.contextmanager
def compiled_as_for_users():
    """For one test, in a file whose programs are compiled soon."""
    jax.clear_caches()
    before = jax.config.values[_MOST]
    jax.config.update(_MOST, False)
    try:
        with mock.patch.object(compiler, "get_compile_options", _GIVEN):
            yield
    finally:
        jax.config.update(_MOST, before)


_MOST = "jax_disable_most_optimizations"
_GIVEN = compiler.get_compile_options


def environment():
    """Variables for a process that compiles so, in which LLVM optimises a little: what notebooks run takes longer
    without."""
    options = _options() and {**_options(), "xla_backend_optimization_level": 1}
    flags = [os.environ.get("XLA_FLAGS", ""), *(f"--{name}={str(x).lower()}" for name, x in options.items())]
    return {"XLA_FLAGS": " ".join(flags).strip()}


# Operations that hand on the numbers they are given; and those that round, once.
_MOVES = {
    "broadcast_in_dim", "compare", "concatenate", "constant", "convert", "dynamic_slice", "dynamic_update_slice",
    "gather", "iota", "pad", "reshape", "reverse", "select", "slice", "transpose",
}  # fmt: skip
_ROUNDS = {"add", "divide", "multiply", "subtract"}
_AROUND = {"builtin.module", "func.func", "func.call", "func.return"}


def _is_of_one_operation(module):
    """Whether a program computes one thing at most, so that there is nothing to fuse or to contract."""
    rounded = 0
    operations = [module.operation]
    for operation in operations:
        name = operation.name.removeprefix("stablehlo.")
        rounded += name in _ROUNDS
        if rounded > 1 or name not in _MOVES | _ROUNDS | _AROUND:
            return False
        operations += [o.operation for region in operation.regions for block in region.blocks for o in block.operations]
    return True


def compile_single_operations_soon():
    """From now on: half of all programs are slices and the like outside of a program. Their bits are the same."""
    given = pxla.create_compile_options

    def with_options(computation, tuple_args, to_inputs, to_outputs, backend, devices, compiler_options):
        if not compiler_options and _is_of_one_operation(computation):
            compiler_options = {**_options(), "xla_backend_optimization_level": 0}
        return given(computation, tuple_args, to_inputs, to_outputs, backend, devices, compiler_options)

    pxla.create_compile_options = with_options


def share_contexts():
    """MLIR's context, which takes longer to make than most programs take to be lowered, is made once per call of the
    function that this returns. A program that is needed while another is lowered has its own, and so have those that
    are lowered in other threads."""
    given = mlir.make_ir_context
    shared = functools.cache(given)

    def make_ir_context():
        is_alone = ir.Context.current is None and threading.current_thread() is threading.main_thread()
        return shared() if is_alone else given()

    mlir.make_ir_context = make_ir_context
    return shared.cache_clear

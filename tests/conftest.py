"""Every test runs under JAX's strictest rules, and knows how to ask for 64 bits."""

import datetime
import gc
import os
import pathlib
import shutil
import tempfile
import time
import zlib

import chex
import jax
import mpmath
import pytest

from tests.helpers.soon import compile_single_operations_soon, compiled_soon, share_contexts

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
# One for all modules, whichever is imported last: of what cancels at an angle of 1e-30, 60 digits are left.
mpmath.mp.dps = 160
compile_single_operations_soon()
forget_context = share_contexts()

# Tracing makes millions of objects, few of them garbage in cycles. Looking for it as often as Python does takes a tenth
# of the time of the tests.
gc.set_threshold(100_000, 10, 10)

# Compiled programs are shared by the workers of a run, by its modules, and by the processes that tests start.
CACHE = "JAX_COMPILATION_CACHE_DIR"
SHORTEST, SMALLEST = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"

# These files take the longest. They run first, so that no worker is left alone with one of them at the end of a run:
# workers take files in the order in which they are collected.
HERE = pathlib.Path(__file__).parent
LONGEST = (
    "contact/test_convex_step.py",
    "laws/test_transformations.py",
    "laws/test_error_bounds.py",
    "contact/test_closed_loops.py",
    "dynamics/test_fields.py",
    "laws/test_extremes.py",
    "test_readme.py",
    "command/test_trade_command.py",
    "dynamics/test_laws.py",
    "dynamics/test_extremes.py",
    "engine/test_native_programs.py",
    "spatial/test_quantities.py",
    "peers/test_coming_from.py",
    "mechanism/test_distances.py",
    "contact/test_pairs.py",
    "numerics/numbers/test_double_word.py",
    "contact/test_tendons.py",
)

# Here XLA compiles what callers write around our programs, and what is compared are formulas, within limits, or
# programs with one another: for them it compiles in a third of the time. Programs themselves are machine code of our
# own all the same. Distances of shapes are no programs: their errors are held as XLA compiles them for users.
COMPILED_SOON = (
    "contact", "dynamics", "inertia", "interop", "mechanism", "peers", "spatial/test_errors.py",
    "spatial/test_left_out.py", "spatial/test_quantities.py", "test_debug_nans.py", "test_docstrings.py",
    "test_export.py", "test_page_identification.py", "test_page_inverse_kinematics.py", "test_readme.py",
    "test_viewer.py",
)  # fmt: skip
COMPILED_AS_FOR_USERS = ("test_distances.py", "test_height_field.py", "test_signed_distances.py")


def pytest_addoption(parser):
    parser.addoption(
        "--third",
        choices=["1", "2", "3", "auto"],
        help="of the slow tests, run only one third, the same on every machine; auto: today's (UTC), which is printed",
    )
    parser.addoption("--minutes", type=float, help="skip tests that would begin after so many minutes")


def pytest_report_header(config):
    third = config.option.third
    return third and f"third of the slow tests: {third}, again with: pytest -m slow --third {third}"


def pytest_collection_modifyitems(config, items):
    places = {HERE / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))
    if third := config.option.third:
        kept, left = [], []
        for item in items:
            (left if item.get_closest_marker("slow") and third_of(item.nodeid) != third else kept).append(item)
        items[:] = kept
        config.hook.pytest_deselected(items=left)


def pytest_collection_finish():
    _out_of_sight()


def _out_of_sight():
    """What is there now stays: Python's collector need not look through millions of objects again and again."""
    gc.collect()
    gc.freeze()


def pytest_runtest_setup(item):
    minutes = item.config.option.minutes
    if minutes and time.monotonic() - item.config.start > 60 * minutes:
        pytest.skip(f"{minutes:g} minutes are over")


def third_of(nodeid):
    """The third of the slow tests that a test is in. A draw: it needs no list of tests, nor of how long each takes."""
    return "123"[zlib.crc32(nodeid.encode()) % 3]


def third_of_day(date):
    """Three days on end have three thirds."""
    return "123"[date.toordinal() % 3]


def pytest_configure(config):
    """Makes the cache of this run, unless there is one that outlives it; workers find it in their environment.

    Workers are told which third it is, too: after midnight they would draw another.
    """
    config.start = time.monotonic()
    if config.option.third == "auto":
        config.option.third = third_of_day(datetime.datetime.now(datetime.UTC).date())
    if CACHE not in os.environ:
        config.own_cache = os.environ[CACHE] = tempfile.mkdtemp(prefix="jaxspatial-tests-")
        os.environ |= {SHORTEST: "0", SMALLEST: "-1"}
    # JAX was imported, and has read its environment, before.
    jax.config.update("jax_compilation_cache_dir", os.environ[CACHE])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", float(os.environ.get(SHORTEST, "1")))
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", int(os.environ.get(SMALLEST, "0")))


def pytest_unconfigure(config):
    if hasattr(config, "own_cache"):
        shutil.rmtree(config.own_cache, ignore_errors=True)
        for name in (CACHE, SHORTEST, SMALLEST):
            del os.environ[name]


@pytest.fixture(params=[False, True], ids=["x32", "x64"])
def x64(request):
    """Runs the test twice, with 64-bit types off and on."""
    with jax.enable_x64(request.param):
        yield request.param


@pytest.fixture(autouse=True)
def count_traces_anew():
    """`chex.assert_max_traces` takes the cases of one test for calls of one function."""
    chex.clear_trace_counter()


@pytest.fixture(autouse=True, scope="module")
def forget_programs():
    """Thousands of compiled programs would take gigabytes."""
    yield
    jax.clear_caches()
    forget_context()
    _out_of_sight()


@pytest.fixture(autouse=True, scope="module")
def compiled(request, forget_programs):
    """As users do, or soon."""
    path = request.path.relative_to(HERE)
    if {path.parts[0], path.as_posix()} & {*COMPILED_SOON} and path.name not in COMPILED_AS_FOR_USERS:
        with compiled_soon():
            yield
    else:
        yield

"""What operations promise holds in programs drawn at random, whatever a caller computes beside them."""

import warnings

import jax
import pytest

from tests.helpers.marks import slow
from tests.helpers.random_programs import OPERATIONS, SURROUNDINGS, Program

# In small groups: pytest gives files of many tests to its workers first, and none is left with this one at the end.
FEW, MANY, GROUP = 24, 3000, 4


def programs(first, count):
    with jax.enable_x64(True):
        return [p for p in map(Program, range(first, first + count)) if p.checks]


def wrong(program, **options):
    with jax.enable_x64(True), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*donated buffers were not usable")
        return program.wrong(program.run(**options))


@pytest.mark.parametrize("first", [*range(0, FEW, GROUP), *map(slow, range(FEW, MANY, 25 * GROUP))])
def test_every_number_is_what_it_must_be(first):
    count = GROUP if first < FEW else 25 * GROUP
    assert {p.seed: w for p in programs(first, count) if (w := wrong(p))} == {}


def test_the_default_run_has_all_operations_in_all_surroundings():
    """Of these each at least once."""
    drawn = programs(0, FEW)
    assert {p.surrounding for p in drawn} == set(SURROUNDINGS)
    assert {check[0] for p in drawn for check in p.checks} == set(OPERATIONS)


@pytest.mark.parametrize(("first", "count"), [(0, GROUP), slow(GROUP, 3 * FEW)])
def test_unoptimised_code_is_right_too(first, count):
    options = {"xla_backend_optimization_level": 0}
    assert {p.seed: w for p in programs(first, count) if (w := wrong(p, compiler_options=options))} == {}

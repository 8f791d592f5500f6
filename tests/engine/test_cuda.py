"""Kernels for GPUs, without one: run by warps of threads of the CPU, and read as text."""

import jax
import numpy as np
import pytest

from jaxspatial.engine import cpu, cuda
from tests.helpers import graphs
from tests.helpers.graphs import assert_same_bits, graph_of, with_numpy
from tests.helpers.warps import by_warps

pytest.importorskip("llvmlite.binding")

F32, F64, I32, BOOL = np.float32, np.float64, np.int32, np.bool_


@pytest.fixture(autouse=True)
def in_64_bits():
    with jax.enable_x64(True):
        yield


def code_of(g, arrays, n, is_summed=()):
    arguments = [cpu.Argument(x[0].size, x.dtype, len(x) != n) for x in arrays]
    results = zip(g.results, graphs.dtypes_of(g), strict=True)
    results = [cpu.Result(x.size, dtype, k in is_summed) for k, (x, dtype) in enumerate(results)]
    return cuda.code_of(g, arguments, results, n)


@pytest.mark.parametrize("n", [1, 2, 5, 31, 32, 33, 50, 64, 100])
@pytest.mark.parametrize("size", [1, 3, 7, 8, 33, 70])
def test_rows_are_read_and_written_where_they_are(size, n):
    rng = np.random.default_rng(size)
    arrays = [rng.standard_normal((n, size)).astype(F32), rng.integers(0, 9, (n, 3)).astype(I32)]
    arrays += [rng.standard_normal((n, 2)), rng.standard_normal((n, 5)) < 0]

    def f(x, i, y, mask):
        return x[::-1] * x[0], i + 1, (y, y.sum()), ~mask, x.sum() > 0

    g = graph_of(f, *arrays)
    assert_same_bits(by_warps(code_of(g, arrays, n), arrays, n), with_numpy(g, arrays))

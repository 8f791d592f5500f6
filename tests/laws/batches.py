"""Operations over a batch: their inputs, the expected results, and how these are compared. Each is computed once."""

import functools

import jax
import numpy as np

from tests.helpers.operations import OPERATIONS

BATCH = (3, 1, 2)
ALL, FIRST, ONE = np.s_[:], np.s_[0, :, 0], np.s_[0, 0, 0]


@functools.cache
def arrays(name, dtype="float32"):
    return OPERATIONS[name].arrays(BATCH, dtype)


@functools.cache
def value(name, dtype="float32"):
    """The result in "reproducible", to the bit."""
    return OPERATIONS[name].naive(*arrays(name, dtype))


@functools.cache
def precisely(name, dtype, precision):
    """The result in another precision, op by op and with 64-bit types on."""
    return OPERATIONS[name].op_by_op(*arrays(name, dtype), precision=precision)


@functools.cache
def sized(name, dtype="float32"):
    return OPERATIONS[name].sized(*arrays(name, dtype))


def together(names, precision=None):
    """Operations as one function of a dict of their arrays: one program compiles in the time of a few."""
    functions = {name: OPERATIONS[name].on_arrays(precision) for name in names}
    return lambda inputs: {name: function(*inputs[name]) for name, function in functions.items()}


def on_device(tree):
    return jax.tree.map(jax.numpy.asarray, tree)


def assert_same_bits(result, expected, note=""):
    for x, y in zip(map(np.asarray, result), map(np.asarray, expected), strict=True):
        assert (x.shape, x.dtype) == (y.shape, y.dtype), note
        assert x.tobytes() == y.tobytes(), (note, x, y)

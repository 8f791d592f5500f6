"""How many operations a program asks for, and how many the compiler leaves in it."""

import collections
import re
from unittest import mock

import jax

from jaxspatial.engine import cpu
from jaxspatial.measure import count_operations as done

__all__ = ["asked_for", "compiled", "done", "flops"]

ARITHMETIC = ("multiply", "add", "subtract", "divide", "negate", "select", "compare", "abs", "sqrt")
FLOPS = ("multiply", "add", "subtract", "divide", "negate", "sqrt")


def asked_for(function, *arguments):
    """How often each arithmetic operation stands in the StableHLO of a function: operations on arrays.

    Programs are as XLA compiles them where it does so by itself; on CPUs they are calls of machine code of our own.
    """
    # JAX has never seen this function, whose lowering it would remember from another way.
    with mock.patch.object(cpu, "is_available", lambda: False):
        return _counted(r"stablehlo\.(\w+)", jax.jit(lambda *x: function(*x)).lower(*arguments).as_text())


def compiled(function, *arguments):
    """The same in the program that XLA makes of it, where each output's kernel computes what it shares with others."""
    return _counted(r"= \S+ (\w+)\(", jax.jit(function).lower(*arguments).compile().as_text())


def _counted(pattern, text):
    found = collections.Counter(re.findall(pattern, text))
    return collections.Counter({name: found[name] for name in ARITHMETIC if found[name]})


def flops(counted):
    return sum(counted[name] for name in FLOPS)

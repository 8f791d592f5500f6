"""How many operations a program asks for, and how many the compiler leaves in it."""

import collections
import re
from unittest import mock

import jax

from jaxspatial.engine import cpu, graph, program

ARITHMETIC = ("multiply", "add", "subtract", "divide", "negate", "select", "compare", "abs", "sqrt")
FLOPS = ("multiply", "add", "subtract", "divide", "negate", "sqrt")
# The names of the same operations in a graph.
OF_GRAPHS = {"mul": "multiply", "product_error": "multiply", "add": "add", "sub": "subtract", "div": "divide"}
OF_GRAPHS |= {"neg": "negate", "select": "select", "abs": "abs", "sqrt": "sqrt"}
OF_GRAPHS |= dict.fromkeys(graph.COMPARISONS, "compare")


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


def done(function, *arguments, in_all_turns=True):
    """How often a program does each operation on single numbers, on CPUs and for one state.

    What a loop does counts as often as the loop turns, or once if that is not known or is not asked for: as often as it
    stands in the machine code.
    """
    g = graph.graph_of(jax.make_jaxpr(function)(*arguments), program._expanded)
    found, live = collections.Counter(), set()
    waiting = [int(node) for nodes in g.results for node in nodes.ravel()]
    while waiting:
        node = waiting.pop()
        if node in live:
            continue
        live.add(node)
        waiting += [*g.operands[node], *_needed(g, node)]
        if name := OF_GRAPHS.get(g.operations[node]):
            found[name] += _turns(g, g.regions[node]) if in_all_turns else 1
    return found


def _needed(g, node):
    """What a number that belongs to a loop needs: the end of the loop, and what the number is made of."""
    name, details = g.operations[node], g.details.get(node)
    if name not in ("carried", "row", "last", "stacked"):
        return ()
    loop = g.loops[details if name in ("carried", "row") else details[0]]
    end = () if loop.length is not None else (loop.condition,)
    if name == "row":
        return (*end, *loop.rows[node])
    if name == "stacked":
        return (*end, loop.stacked[details[1]])
    return (*end, *(next(x for x in loop.carried if x[0] == node) if name == "carried" else loop.carried[details[1]]))


def _turns(g, region):
    """How often a region is run."""
    turns = 1
    while region:
        loop = next(x for x in g.loops if x.region == region)
        turns, region = turns * (loop.length or 1), g.parents[region]
    return turns


def _counted(pattern, text):
    found = collections.Counter(re.findall(pattern, text))
    return collections.Counter({name: found[name] for name in ARITHMETIC if found[name]})


def flops(counted):
    return sum(counted[name] for name in FLOPS)

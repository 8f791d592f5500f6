"""How many operations on numbers a function asks for, at one state."""

import collections
from collections.abc import Callable, Iterable
from typing import Any, cast

import jax

from jaxspatial.engine import graph, program

# The names of operations of a graph, in words.
_NAMES = {"mul": "multiply", "product_error": "multiply", "add": "add", "sub": "subtract", "div": "divide"}
_NAMES |= {"neg": "negate", "select": "select", "abs": "abs", "sqrt": "sqrt"}
_NAMES |= dict.fromkeys(graph.COMPARISONS, "compare")


def count_operations(function: Callable, *arguments: Any, in_all_turns: bool = True) -> collections.Counter[str]:
    """Counts the operations on numbers that a function asks for: what a scene costs, and what its known numbers save.

    Counted is what machine code of this library does on CPUs for these arguments. What nothing needs is left out. What
    the function closes over is known, and folds; its arguments are data. Nothing is compiled or run.

    Args:
        function: of the arguments, to arrays or trees of them.
        arguments: trees of arrays: one state. Of a batch every state counts.
        in_all_turns: whether what stands in a loop counts as often as the loop turns, rather than once. A loop that
            turns until something holds counts once.

    Returns:
        How often it asks for "multiply", "add", "subtract", "divide", "negate", "sqrt", "abs", "select" and "compare".

    Raises:
        NotImplementedError: the function has an operation that this machine code lacks, such as a sort.

    Example:
        >>> count = js.measure.count_operations
        >>> print(count(js.shift, F, p_PQ)["multiply"], count(lambda F: js.shift(F, [0.0, 0.0, 0.5]), F)["multiply"])
        6 2
    """
    try:
        g = graph.graph_of(jax.make_jaxpr(function)(*arguments), program._expanded)
    except graph.NotSupportedError as error:
        raise NotImplementedError(f"count_operations: cannot count {error}") from None
    found: collections.Counter[str] = collections.Counter()
    live: set[int] = set()
    waiting = [int(node) for nodes in g.results for node in nodes.ravel()]
    while waiting:
        node = waiting.pop()
        if node in live:
            continue
        live.add(node)
        waiting += [*g.operands[node], *_needed(g, node)]
        if name := _NAMES.get(g.operations[node]):
            found[name] += _turns(g, g.regions[node]) if in_all_turns else 1
    return found


def _needed(g: graph.Graph, node: int) -> Iterable[int]:
    """What a number that belongs to a loop needs: the end of the loop, and what the number is made of."""
    name, details = g.operations[node], cast(Any, g.details.get(node))
    if name not in ("carried", "row", "last", "stacked"):
        return ()
    loop = g.loops[details if name in ("carried", "row") else details[0]]
    end = () if loop.length is not None else (loop.condition,)
    if name == "row":
        return (*end, *loop.rows[node])
    if name == "stacked":
        return (*end, loop.stacked[details[1]])
    return (*end, *(next(x for x in loop.carried if x[0] == node) if name == "carried" else loop.carried[details[1]]))


def _turns(g: graph.Graph, region: int) -> int:
    """How often a region is run."""
    turns = 1
    while region:
        loop = next(x for x in g.loops if x.region == region)
        turns, region = turns * (loop.length or 1), g.parents[region]
    return turns

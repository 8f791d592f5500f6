"""What compiles graphs and calls them: `cpu` and `cuda` are modules with what a Machine has."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeVar

import jax
import numpy as np

from jaxspatial.engine.graph import Graph

C = TypeVar("C")


class Argument(NamedTuple):
    """What code takes of one state: numbers, or numbers that all states share."""

    size: int
    dtype: np.dtype
    is_shared: bool = False


class Result(NamedTuple):
    """What code gives of one state, or what is added up over all states."""

    size: int
    dtype: np.dtype
    is_summed: bool = False


class Machine(Protocol[C]):
    """MOST_UNROLLED: of `graph.graph_of`; None as it has it. C is the type of its code."""

    @property
    def MOST_UNROLLED(self) -> int | None: ...

    def is_available(self) -> bool:
        """Whether code can be compiled and called here: llvmlite is installed, and a known result comes out right."""
        ...

    def least_alike(self, n: int) -> int:
        """The smallest number of states that runs the same code as n states."""
        ...

    def code_of(self, graph: Graph, arguments: Sequence[Argument], results: Sequence[Result], n: int) -> C:
        """The code of a graph for n states."""
        ...

    def compiled(self, code: C) -> object:
        """What keeps compiled code alive. A lowering rule holds it until XLA has made the executable."""
        ...

    def call(self, code: C, arrays: Sequence[jax.Array], n: int, *, n_devices: int = 1) -> list[jax.Array]:
        """Calls code over n states, while JAX traces: arrays (n, size), or (1, size) if all states share them.

        n_devices: for how many devices XLA compiles one program. It then splits the states as its inputs are split.

        Returns:
            Arrays (n, size), or (1, size) where results are summed over states.
        """
        ...

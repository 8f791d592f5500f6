"""Programs over batches: what the primitive runs.

An algorithm is one primitive. Its formula sees one axis of states, innermost in memory, however many times and along
whichever axes a caller maps it: (L, W, B), L joints along a chain, W chains side by side, B states.
"""

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar, cast

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun
from jax.interpreters import partial_eval as pe

from jaxspatial.arithmetic import check

T = TypeVar("T")
Aval = jax.ShapeDtypeStruct
Result = tuple[tuple[int, ...], Any]  # shape and dtype

# How many states run side by side: enough for long loops, few enough for the cache; and how many numbers of results.
LARGEST_BLOCK, SMALLEST_BLOCK, NUMBERS = 2048, 64, 2**18


class Program:
    """What is run: `evaluate(*arrays)`, of arrays (B, ...), or (1, ...) where all states share one, to a list of these.

    `outputs(avals, sizes)`: shape, without the batch, and dtype of the results, of arguments without it, with so many
    states of each.
    """

    # How many states make a block, on processors.
    block = LARGEST_BLOCK
    # Whether it computes in 64 bits whatever the caller's numbers are: what JAX makes of it to differentiate it, and
    # what another such program has kept in 64 bits, is traced so as well.
    is_wide = False

    @functools.cached_property
    def _made(self) -> dict[Hashable, Any]:
        """What is made of a program lives as long as it does: derivatives and traces."""
        return {}

    def made(self, key: Hashable, maker: Callable[[], T]) -> T:
        if key not in self._made:
            self._made[key] = maker()
        return self._made[key]

    def traced(self, avals: Sequence[Aval]):
        """Traced once for the same shapes."""
        in_64_bits = self.is_wide or bool(check.config.jax_enable_x64)
        key = tuple((a.shape, np.dtype(a.dtype).name) for a in avals), in_64_bits
        return self.made(key, lambda: Traced(self, avals, in_64_bits))

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        raise NotImplementedError

    def from_outside(self, x: jax.Array) -> jax.Array:
        """An argument, to compute with: behind a barrier where bits are promised, or errors computed."""
        raise NotImplementedError

    def outputs(self, avals: Sequence[Aval], sizes: Sequence[int]) -> list[Result]:
        raise NotImplementedError

    def owner(self, i: int) -> int | None:
        """The argument that result i is the cotangent of: it has its batch. None for results over all states."""
        return None

    def takes_cotangent(self, i: int) -> bool:
        """Whether argument i is a cotangent: of states that only fill a block up it is 0."""
        return False

    def needs_own(self, i: int) -> bool:
        """Whether argument i has to be one for every state, as its cotangents are not to be added up."""
        return False

    def columns(self, arrays: Sequence[jax.Array], n_batch: int) -> list[int]:
        """The axes of the batch along which only the last argument varies, where these are better gone through one by
        one than side by side, on processors."""
        return []

    def over_columns(self) -> "Program":
        """With these columns as an axis of the last argument, and of the result, behind the states."""
        raise NotImplementedError

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int) -> Any:
        """The results along a new axis in front, where that is no matter of one state more; None where it is."""
        return None

    def jvp(self, primals: list[Any], tangents: list[Any], n_batch: int) -> tuple[list[Any], list[Any]]:
        """(results, their tangents)."""
        raise NotImplementedError

    def transposed(self, cotangents: list[Any], arguments: list[Any], n_batch: int) -> list[Any]:
        """The cotangents of the arguments that are linear, None for others."""
        raise NotImplementedError


class Traced:
    """The trace of a program, without what its results do not need."""

    def __init__(self, program: Program, avals: Sequence[Aval], in_64_bits: bool):
        def flat(*arrays: jax.Array):
            return list(program.evaluate(*arrays))

        with jax.enable_x64(in_64_bits):
            closed = jax.make_jaxpr(flat)(*avals)
        jaxpr, _ = pe.dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars), instantiate=True)
        self.closed = ClosedJaxpr(jaxpr, closed.consts)
        self.out_avals = closed.out_avals

    def __call__(self, *arrays: jax.Array) -> list[jax.Array]:
        return cast(list[jax.Array], jaxpr_as_fun(self.closed)(*arrays))

"""The programs of the derivatives of programs.

They are made of the same formula, which they run again: what they keep are the arguments. The tangent of a program is
linear, its transpose the pull-back; of these there are tangents and pull-backs again, to any order.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters import ad

from jaxspatial.dynamics.primitive import batch_axis_first, bind, is_zero, over_own, zeros
from jaxspatial.dynamics.program import Aval, Program, Result

Moving = tuple[bool, ...]


class Differentiable(Program):
    """A program with a tangent and a pull-back."""

    def tangent(self, moving: Moving):
        return self.made(("tangent", moving), lambda: Tangent(self, moving))

    def pullback(self, moving: Moving):
        return self.made(("pullback", moving), lambda: Pullback(self, moving))

    def jacobians(self, moving: Moving, n_columns: int) -> "Differentiable | None":
        """The program of the Jacobians of the one result by the arguments that move, where so many columns or rows at
        one state are worth it; None where not, or where there is none."""
        return None

    def jvp(self, primals: list[Any], tangents: list[Any], n_batch: int) -> tuple[list[Any], list[Any]]:
        """(results, their tangents)."""
        moving = tuple(not is_zero(t) for t in tangents)
        given = [t for t in tangents if not is_zero(t)]
        return bind(self, primals, n_batch), bind(self.tangent(moving), [*primals, *given], n_batch)

    def transposed(self, cotangents: list[Any], arguments: list[Any], n_batch: int) -> list[Any]:
        """The cotangents of the arguments that are linear, None for others."""
        linear = tuple(ad.is_undefined_primal(x) for x in arguments)
        at = [zeros(x.aval) if is_linear else x for x, is_linear in zip(arguments, linear, strict=True)]
        return _placed(linear, bind(self.pullback(linear), [*at, *cotangents], n_batch))


class Derived(Differentiable):
    """Of another program, with respect to the arguments that `moving` tells."""

    def __init__(self, of: Differentiable, moving: Moving):
        self.of, self.moving = of, moving

    @property
    def is_wide(self):
        return self.of.is_wide

    @property
    def block(self):
        return min(self.of.block, 512)

    def from_outside(self, x: jax.Array) -> jax.Array:
        return self.of.from_outside(x)

    def takes_cotangent(self, i: int):
        n = len(self.moving)
        return self.of.takes_cotangent(i if i < n else self.places[i - n])

    def needs_own(self, i: int):
        return i < len(self.moving) and self.of.needs_own(i)

    @functools.cached_property
    def places(self):
        """Which arguments move."""
        return [i for i, yes in enumerate(self.moving) if yes]

    def _split(self, arrays: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """(the arguments of the program, what comes behind them)."""
        n = len(self.moving)
        return list(arrays[:n]), list(arrays[n:])

    def _at_one_state(
        self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int
    ) -> tuple[list[jax.Array], list[jax.Array]] | None:
        """(the Jacobians, what is mapped over, with the new axis in front), of arguments that are not; None else."""
        at, others = self._split(arrays)
        of = None if any(a is not None for a in axes[: len(at)]) else self.of.jacobians(self.moving, size)
        if of is None:
            return None
        both = zip(others, axes[len(at) :], strict=True)
        return bind(of, at, n_batch), [batch_axis_first(x, axis, size, False) for x, axis in both]

    def _chosen(self, arguments: Sequence[Any]) -> list[Any]:
        return [x for x, yes in zip(arguments, self.moving, strict=True) if yes]

    def _of_chosen(self, arguments: Sequence[Any]) -> Callable[..., list[jax.Array]]:
        """The program as a function of the arguments that move."""

        def run(*chosen: jax.Array):
            found = iter(chosen)
            return self.of.evaluate(*(next(found) if yes else x for x, yes in zip(arguments, self.moving, strict=True)))

        return run


class Tangent(Derived):
    """(arguments, tangents of those that move) -> the tangents of the results: linear in the latter."""

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        arguments, tangents = self._split(arrays)
        both = [_alike(x, t) for x, t in zip(self._chosen(arguments), tangents, strict=True)]
        at, along = zip(*both, strict=True)
        return jax.jvp(self._of_chosen(arguments), at, along)[1]

    def outputs(self, avals: Sequence[Aval], sizes: Sequence[int]) -> list[Result]:
        n = len(self.moving)
        return self.of.outputs(avals[:n], sizes[:n])

    def owner(self, i: int):
        return self.of.owner(i)

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int):
        found = self._at_one_state(arrays, axes, size, n_batch)
        if found is None:
            return None
        matrices, tangents = found
        return [times_columns(jnp.concatenate(matrices, -1), _concatenated(tangents))]

    def transposed(self, cotangents: list[Any], arguments: list[Any], n_batch: int) -> list[Any]:
        at, tangents = self._split(arguments)
        linear = [ad.is_undefined_primal(t) for t in tangents]
        moving = tuple(i in [p for p, yes in zip(self.places, linear, strict=True) if yes] for i in range(len(at)))
        at = [
            _over(x, tangents[self.places.index(i)].aval, n_batch) if yes else x
            for i, (x, yes) in enumerate(zip(at, moving, strict=True))
        ]
        found = bind(self.of.pullback(moving), [*at, *cotangents], n_batch)
        return [*[None] * len(at), *_placed(linear, found)]


class Pullback(Derived):
    """(arguments, cotangents of the results) -> the cotangents of the arguments that move."""

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        arguments, cotangents = self._split(arrays)
        run = self._of_chosen(arguments)
        n = max((x.shape[0] for x in arrays), default=1)

        def over_all(*chosen: jax.Array):
            # What is itself a cotangent, of an argument that all states share, is one for all.
            found = enumerate(run(*chosen))
            return [jnp.broadcast_to(y, (n, *y.shape[1:])) if self.of.owner(i) is None else y for i, y in found]

        found, back = _with_pullback(over_all, *self._chosen(arguments))
        cotangents = map(self.from_outside, cotangents)
        return list(back([jnp.broadcast_to(c, y.shape) for c, y in zip(cotangents, found, strict=True)]))

    def outputs(self, avals: Sequence[Aval], sizes: Sequence[int]) -> list[Result]:
        return [(a.shape, a.dtype) for a in self._chosen(avals[: len(self.moving)])]

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int):
        found = self._at_one_state(arrays, axes, size, n_batch)
        if found is None:
            return None
        matrices, (cotangents,) = found
        pulled = (times_columns(jnp.swapaxes(J, -1, -2), cotangents) for J in matrices)
        like = (jax.ShapeDtypeStruct((size, *x.shape), x.dtype) for x in self._chosen(self._split(arrays)[0]))
        return [over_own(y, x) for x, y in zip(like, pulled, strict=True)]

    def owner(self, i: int) -> int | None:
        return self.places[i]

    def takes_cotangent(self, i: int):
        return i >= len(self.moving) or self.of.takes_cotangent(i)

    def needs_own(self, i: int):
        return i < len(self.moving) and (self.moving[i] or self.of.needs_own(i))


def pullback(function: Callable[..., Any], *at: Any):
    return _with_pullback(function, *at)[1]


def _with_pullback(function: Callable[..., Any], *at: Any):
    return cast(tuple[Any, Callable[[Any], tuple[Any, ...]]], jax.vjp(function, *at))


def times_columns(matrix: jax.Array, columns: jax.Array):
    """(k, *batch, n) of a matrix (*batch, n, m) and k columns (k, *batch, m): rounded once more where these are no unit
    vectors."""
    shape = np.broadcast_shapes(matrix.shape[:-2], columns.shape[1:-1])
    wide = np.dtype(np.float32) if matrix.dtype.itemsize == 2 else matrix.dtype
    found = jnp.einsum(
        "...ij,k...j->k...i", matrix, columns, precision="highest", preferred_element_type=wide, optimize=False
    )
    return jnp.broadcast_to(found, (columns.shape[0], *shape, matrix.shape[-2])).astype(matrix.dtype)


def _concatenated(columns: Sequence[jax.Array]):
    shape = np.broadcast_shapes(*(x.shape[:-1] for x in columns))
    return jnp.concatenate([jnp.broadcast_to(x, (*shape, x.shape[-1])) for x in columns], -1)


def _placed(linear: Sequence[bool], found: Iterable[Any]) -> list[Any]:
    found = iter(found)
    return [next(found) if yes else None for yes in linear]


def _alike(x: jax.Array, t: jax.Array):
    shape = np.broadcast_shapes(x.shape, t.shape)
    return jnp.broadcast_to(x, shape), jnp.broadcast_to(t, shape)


def _over(x: jax.Array, aval: Aval, n_batch: int):
    """x over the batch of its tangent."""
    shape = np.broadcast_shapes(x.shape[:n_batch], aval.shape[:n_batch])
    return jnp.broadcast_to(x, (*shape, *x.shape[n_batch:]))

"""Derivatives of programs, which are programs again: the tangent, and its transpose, the pull-back.

Both run the formula again and store nothing but its arguments. They have tangents and pull-backs themselves, to any
order.
"""

import functools
import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.engine.program import (
    Aval,
    Program,
    Traced,
    batch_axis_first,
    bind,
    n_states,
    program_p,
    summed_like,
    zeros,
)
from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree.primitives import is_zero, no_tangent
from jaxspatial.numerics.jax_internals import ad, partial_eval

T = TypeVar("T")
Moving = tuple[bool, ...]


class Differentiable(Program):
    """A program with a tangent and a pull-back."""

    def tangent_program(self, moving: Moving) -> "Differentiable":
        return self.cached(("tangent", moving), lambda: Tangent(self, moving))

    def pullback_program(self, moving: Moving, given: Moving | None = None) -> "Differentiable":
        """given: whether the cotangent of each result that has one is not known to be zero; None for all."""
        given = None if given is None or all(given) else given
        return self.cached(("pullback", moving, given), lambda: Pullback(self, moving, given))

    def jacobians(self, moving: Moving, n_columns: int) -> "Differentiable | None":
        """The program of the Jacobians of the one result with respect to the arguments that move.

        None if there is none, or if n_columns tangents or cotangents at one state are too few for it to pay.
        """
        return None

    # Whether `rule` says what tangents are; if not, they are those of the formula.
    has_rule = False

    def rule(self, primals: list, tangents: list, n_batch: int) -> list:
        """The tangents of the results, made of other programs. Tangents that are zero are known to be."""
        raise NotImplementedError

    def jvp(self, primals: list, tangents: list, n_batch: int) -> tuple[list, list]:
        """(results, their tangents)."""
        moving = tuple(not is_zero(t) for t in tangents)
        of_moving = [t for t in tangents if not is_zero(t)]
        results = bind(self, primals, n_batch)
        rest = iter(bind(self.tangent_program(moving), [*primals, *of_moving], n_batch))
        return results, [next(rest) if is_differentiable(y) else no_tangent(y) for y in results]

    def transposed(self, cotangents: list, arguments: list, n_batch: int) -> list:
        """The cotangents of the linear arguments, None for the others."""
        linear = tuple(ad.is_undefined_primal(x) for x in arguments)
        at = [zeros(x.aval) if is_linear else x for x, is_linear in zip(arguments, linear, strict=True)]
        return _placed(linear, self.pulled_back(linear, at, cotangents, n_batch))

    def pulled_back(self, moving: Moving, at: list, cotangents: list, n_batch: int) -> list:
        """The cotangents of the arguments that move, None if those of all results are known to be zero."""
        given = tuple(not is_zero(c) for c in cotangents)
        if not any(given):
            return [None] * sum(moving)
        return bind(self.pullback_program(moving, given), [*at, *itertools.compress(cotangents, given)], n_batch)


class OfProgram(Differentiable):
    """A program that is made of another one, and computes as that does."""

    def __init__(self, program: Differentiable):
        self.program, self.is_wide, self.has_plain_products = program, program.is_wide, program.has_plain_products

    def from_outside(self, x: jax.Array) -> jax.Array:
        return self.program.from_outside(x)


class Derived(OfProgram):
    """The derivative of another program with respect to the arguments marked in `moving`."""

    def __init__(self, program: Differentiable, moving: Moving):
        super().__init__(program)
        self.moving = moving

    def needs_all_states(self, i: int):
        return i < len(self.moving) and self.program.needs_all_states(i)

    @functools.cached_property
    def places(self):
        """The indices of the arguments that move."""
        return [i for i, yes in enumerate(self.moving) if yes]

    def _parted(self, arrays: Sequence) -> tuple[list, list]:
        """(the arguments of the program, its tangents or cotangents)."""
        n = len(self.moving)
        return list(arrays[:n]), list(arrays[n:])

    def _at_one_state(
        self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int
    ) -> tuple[list[jax.Array], list[jax.Array]] | None:
        """(the Jacobians, the tangents or cotangents with a new axis in front) if only these are mapped; else None."""
        at, others = self._parted(arrays)
        is_at_one_state = all(a is None for a in axes[: len(at)])
        jacobians = self.program.jacobians(self.moving, size) if is_at_one_state else None
        if jacobians is None:
            return None
        both = zip(others, axes[len(at) :], strict=True)
        return bind(jacobians, at, n_batch), [batch_axis_first(x, axis, size, False) for x, axis in both]

    def _by_rule_at_one_state(
        self, run: Callable, arrays: Sequence[jax.Array], axes: Sequence[int | None], n_batch: int
    ) -> list[jax.Array] | None:
        """`run`, over mapped tangents or cotangents, if only these are mapped: the programs that the rule is made of
        share what does not depend on them."""
        at, others = self._parted(arrays)
        if any(axis is not None for axis in axes[: len(at)]):
            return None
        return jax.vmap(functools.partial(run, at, n_batch), axes[len(at) :])(*others)

    def _tangents_by_rule(self, at: list, n_batch: int, *tangents) -> list:
        """The tangents of the results, by the program's own rule, at those of the arguments that move."""
        rest = iter(tangents)
        every = [next(rest) if yes else no_tangent(x) for x, yes in zip(at, self.moving, strict=True)]
        return [zeros(t.aval) if is_zero(t) else t for t in self.program.rule(at, every, n_batch)]

    def _results(self, at: list, *moved: jax.Array) -> list[jax.Array]:
        """The results that have derivatives, with others in place of the arguments that move."""
        rest = iter(moved)
        arguments = (next(rest) if yes else x for x, yes in zip(at, self.moving, strict=True))
        return [y for y in self.program.evaluate(*arguments) if is_differentiable(y)]


class Tangent(Derived):
    """(arguments, tangents of those that move) -> the tangents of the results: linear in the latter."""

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        arguments, tangents = self._parted(arrays)
        if self.program.has_rule:
            return self._tangents_by_rule(arguments, 1, *tangents)
        at, along = list[jax.Array](), list[jax.Array]()
        for x, t in zip(itertools.compress(arguments, self.moving), tangents, strict=True):
            shape = floats.broadcast_shapes(x.shape, t.shape)
            at.append(jnp.broadcast_to(x, shape))
            along.append(jnp.broadcast_to(t, shape))
        return jax.jvp(functools.partial(self._results, arguments), at, along)[1]

    def outputs(self, avals: Sequence[Aval]) -> list[Aval]:
        return list(filter(is_differentiable, self.program.outputs(avals[: len(self.moving)])))

    def primal_of(self, i: int):
        return self.program.primal_of(i)

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int):
        if self.program.has_rule:
            return self._by_rule_at_one_state(self._tangents_by_rule, arrays, axes, n_batch)
        at_one_state = self._at_one_state(arrays, axes, size, n_batch)
        if at_one_state is None:
            return None
        matrices, tangents = at_one_state
        batch = floats.broadcast_shapes(*(x.shape[:-1] for x in tangents))
        columns = jnp.concatenate([jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in tangents], -1)
        return [times_columns(jnp.concatenate(matrices, -1), columns)]

    def transposed(self, cotangents: list, arguments: list, n_batch: int) -> list:
        at, tangents = self._parted(arguments)
        linear = [ad.is_undefined_primal(t) for t in tangents]
        moving = tuple(i in [p for p, yes in zip(self.places, linear, strict=True) if yes] for i in range(len(at)))
        for i in itertools.compress(range(len(at)), moving):
            # Over the batch of its tangent.
            x, of_tangent = at[i], tangents[self.places.index(i)].aval.shape
            shape = floats.broadcast_shapes(x.shape[:n_batch], of_tangent[:n_batch])
            at[i] = jnp.broadcast_to(x, (*shape, *x.shape[n_batch:]))
        of_linear = self.program.pulled_back(moving, at, cotangents, n_batch)
        return [*[None] * len(at), *_placed(linear, of_linear)]


class Pullback(Derived):
    """(arguments, cotangents of the results) -> the cotangents of the arguments that move.

    given: the results whose cotangents are given, None for all; those of others are zero.
    """

    def __init__(self, program: Differentiable, moving: Moving, given: Moving | None):
        super().__init__(program, moving)
        self.given = given

    def _with_cotangents(self, results: Sequence) -> list:
        """Those whose cotangents are given."""
        return list(results if self.given is None else itertools.compress(results, self.given))

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        arguments, cotangents = self._parted(arrays)
        if self.program.has_rule:
            return self._cotangents_by_rule(arguments, 1, *map(self.from_outside, cotangents))
        n = n_states(arrays)

        def over_all(*moved: jax.Array):
            # What all states share is repeated first, so that its cotangents are added up once, at the end. A result
            # that is itself the cotangent of a shared argument is shared by all states.
            repeated = (jnp.broadcast_to(x, (n, *x.shape[1:])) for x in moved)
            results = self._with_cotangents(self._results(arguments, *repeated))
            places = self._with_cotangents(range(len(results) if self.given is None else len(self.given)))
            primals = ((self.program.primal_of(i), y) for i, y in zip(places, results, strict=True))
            return [jnp.broadcast_to(y, (n, *y.shape[1:])) if primal is None else y for primal, y in primals]

        results, back = jax.vjp(over_all, *itertools.compress(arguments, self.moving))
        cotangents = map(self.from_outside, cotangents)
        return list(back([jnp.broadcast_to(c, y.shape) for c, y in zip(cotangents, results, strict=True)]))

    def _cotangents_by_rule(self, at: list, n_batch: int, *cotangents) -> list:
        """The cotangents of the arguments that move, by the program's own rule, at those of results."""
        moved = (jax.ShapeDtypeStruct(x.shape, x.dtype) for x in itertools.compress(at, self.moving))
        transposed = jax.linear_transpose(
            lambda *t: self._with_cotangents(self._tangents_by_rule(at, n_batch, *t)), *moved
        )
        return list(transposed(list(cotangents)))

    def outputs(self, avals: Sequence[Aval]) -> list[Aval]:
        return [*itertools.compress(avals, self.moving)]

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int):
        if self.program.has_rule:
            return self._by_rule_at_one_state(self._cotangents_by_rule, arrays, axes, n_batch)
        at_one_state = self._at_one_state(arrays, axes, size, n_batch)
        if at_one_state is None:
            return None
        matrices, (cotangents,) = at_one_state
        pulled = (times_columns(jnp.swapaxes(J, -1, -2), cotangents) for J in matrices)
        like = (jax.ShapeDtypeStruct((size, *x.shape), x.dtype) for x in itertools.compress(arrays, self.moving))
        return [summed_like(y, x) for x, y in zip(like, pulled, strict=True)]

    def primal_of(self, i: int) -> int | None:
        return self.places[i]

    def needs_all_states(self, i: int):
        return i < len(self.moving) and (self.moving[i] or self.program.needs_all_states(i))


class Selection(OfProgram):
    """A program that leaves out the results which nobody reads. wanted: whether each result is read."""

    def __init__(self, program: Differentiable, wanted: Moving):
        super().__init__(program)
        self.wanted = wanted

    def traced(self, avals: Sequence[Aval]) -> Traced:
        """The trace of the whole program, without what is dead now."""
        return self.program.traced(avals).selected(self.wanted)

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        return [*itertools.compress(self.program.evaluate(*arrays), self.wanted)]

    def outputs(self, avals: Sequence[Aval]) -> list[Aval]:
        return [*itertools.compress(self.program.outputs(avals), self.wanted)]

    def primal_of(self, i: int) -> int | None:
        return self.program.primal_of([*itertools.compress(itertools.count(), self.wanted)][i])

    def needs_all_states(self, i: int) -> bool:
        return self.program.needs_all_states(i)

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int):
        results = self.program.batched(arrays, axes, size, n_batch)
        return None if results is None else [*itertools.compress(results, self.wanted)]

    def jvp(self, primals: list, tangents: list, n_batch: int) -> tuple[list, list]:
        results, rates = (itertools.compress(x, self.wanted) for x in self.program.jvp(primals, tangents, n_batch))
        return [*results], [*rates]

    def transposed(self, cotangents: list, arguments: list, n_batch: int) -> list:
        rest = iter(cotangents)
        return self.program.transposed(
            [next(rest) if yes else ad.Zero(cast(Any, None)) for yes in self.wanted], arguments, n_batch
        )


def _without_unread(wanted: list[bool], *others) -> tuple[list[bool], Any]:
    """Leaves out what nobody reads of a program: JAX asks for it where it takes dead code out of a trace.

    others: the operation is the last; JAX 0.12 hands on before it which references it may look at."""
    eqn = others[-1]
    whole = eqn.params["program"]
    if not any(wanted):
        return [False] * len(eqn.invars), None
    if all(wanted) or getattr(whole, "has_rule", False):
        return [True] * len(eqn.invars), eqn
    selected = whole.cached(("selection", *wanted), lambda: Selection(whole, tuple(wanted)))
    outvars = list(itertools.compress(eqn.outvars, wanted))
    return [True] * len(eqn.invars), eqn.replace(outvars=outvars, params={**eqn.params, "program": selected})


partial_eval.dce_rules[program_p] = _without_unread


def is_differentiable(x) -> bool:
    """Whether an array has derivatives, which integers have not."""
    return bool(jnp.issubdtype(x.dtype, jnp.floating))


def fixed(tree: T) -> T:
    """The tree as constants of derivatives; NumPy numbers are so already, and stay known."""
    return jax.tree.map(lambda x: lax.stop_gradient(x) if isinstance(x, jax.Array) else x, tree)


@jax.custom_jvp
def valued(x: jax.Array, value: jax.Array) -> jax.Array:
    """`value`, with the derivatives of x."""
    return value


@valued.defjvp
def _(primals, tangents):
    # Not the number itself, which is a constant: its derivatives of the next order would be lost.
    return valued(*primals), tangents[0]


def times_columns(matrix: jax.Array, columns: jax.Array):
    """A matrix (*batch, n, m) times k columns (k, *batch, m): (k, *batch, n). Exact for unit vectors."""
    shape = floats.broadcast_shapes(matrix.shape[:-2], columns.shape[1:-1])
    wide = np.dtype(np.float32) if matrix.dtype.itemsize == 2 else matrix.dtype
    products = jnp.einsum(
        "...ij,k...j->k...i", matrix, columns, precision="highest", preferred_element_type=wide, optimize=False
    )
    return jnp.broadcast_to(products, (columns.shape[0], *shape, matrix.shape[-2])).astype(matrix.dtype)


def _placed(linear: Sequence[bool], of_linear: Iterable) -> list:
    """The cotangents of linear arguments in the places of these, None elsewhere."""
    rest = iter(of_linear)
    return [next(rest) if yes else None for yes in linear]

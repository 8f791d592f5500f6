"""How an algorithm is called: a formula over a MechanismState becomes a function of a mechanism and arrays.

What is NumPy in the mechanism is part of the program, which is compiled once for these values; while tracing, so are
NumPy arrays of coordinates. Of the mechanism a program has only the fields that its formula reads. All is evaluated in
what the precision asks for, see `numbers`, and rounded once at the end.
"""

import dataclasses
import functools
import inspect
import warnings
import weakref
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxspatial.arithmetic import numbers
from jaxspatial.arithmetic.errorfree.barrier import proving_barrier
from jaxspatial.arithmetic.numbers import stacking
from jaxspatial.arithmetic.precision import Precision, resolve
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.dynamics import primitive, program
from jaxspatial.dynamics.along import PyTreeDef, tuple_of
from jaxspatial.dynamics.arguments import checked
from jaxspatial.dynamics.program import Aval, Result
from jaxspatial.dynamics.results import is_tuple
from jaxspatial.dynamics.state import MechanismState
from jaxspatial.dynamics.tangents import Differentiable
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.leaves import ByContents
from jaxspatial.mechanism.topology import Topology

# What an algorithm reads of a mechanism, by what it is about.
JOINTS = ("axes", "second_axes", "pitches", "parameters", "mimics")
GEOMETRY = ("placements", *JOINTS)
BODIES = (*GEOMETRY, "inertias")
DYNAMICS = (*BODIES, "armature", "gravity")
FRAMES = ("child_placements", "frame_placements")

Static = tuple[tuple[str, Any], ...]  # arguments that are no arrays, by name


class Known(ByContents):
    """A NumPy array as part of a program."""

    def __init__(self, array: np.ndarray):
        self.array, self.contents = array, (array.dtype.str, array.shape, array.tobytes())


@dataclasses.dataclass(eq=False)
class Algorithm(Differentiable, ByContents):
    """A formula for one structure, with the numbers that are known. tree: of (fields by name, arrays)."""

    formula: Any
    precision: Precision
    topology: Topology
    tree: PyTreeDef
    known: tuple[Known | None, ...]
    static: Static
    dtype: np.dtype
    out_tree: Any = None

    @property
    def contents(self) -> tuple[Any, ...]:
        return type(self), self.formula, self.precision, self.topology, self.tree, self.known, self.static, self.dtype

    @property
    def is_wide(self):
        return self.precision.sees_whole_sums

    def from_outside(self, x: jax.Array) -> jax.Array:
        return proving_barrier(x) if self.is_wide else stacking.from_outside(x, self.precision)

    @property
    def block(self):
        """Fewer states where the results of one are many numbers, or numbers wide."""
        entries = self.formula.entries
        # Half as many numbers of 64 bits, or of two words: the cache has room for bytes.
        largest = program.LARGEST_BLOCK // (max(self.dtype.itemsize, 4) // 4 * (2 if self.is_wide else 1))
        if entries is None:
            return largest
        return min(max(program.NUMBERS // max(entries(self.topology), 1), program.SMALLEST_BLOCK), largest)

    def merged(self, data: Iterable[Any]):
        """All leaves of the tree."""
        data = iter(data)
        return [next(data) if k is None else k.array for k in self.known]

    def evaluate(self, *arrays: jax.Array):
        n = max((x.shape[0] for x in arrays), default=1)
        leaves = self.merged(jnp.moveaxis(self.from_outside(x), 0, -1) for x in arrays)
        fields, others = jax.tree.unflatten(self.tree, leaves)
        state = MechanismState(self.topology, fields, others[0], n, self.precision, self.dtype)
        found = self.formula(state, *others[1:], **dict(self.static))
        results, self.out_tree = jax.tree.flatten(jax.tree.map(state.rounded, found, is_leaf=_is_result))
        return [jnp.moveaxis(y, -1, 0) for y in results]

    def outputs(self, avals: Sequence[Aval], sizes: Sequence[int]) -> list[Result]:
        if self.formula.result is not None:
            self.out_tree = jax.tree.structure(0)
            return [(self.formula.result(self.topology), self.dtype)]

        def found():
            given = [jax.ShapeDtypeStruct((n, *a.shape), a.dtype) for a, n in zip(avals, sizes, strict=True)]
            return [(y.shape[1:], y.dtype) for y in self.traced(given).out_avals]

        return self.made(("outputs", *((a.shape, np.dtype(a.dtype).name) for a in avals)), found)

    # -- of one program another ---------------------------------------------------------------------------------------

    @property
    def n_fields(self):
        return self.tree.children()[0].num_leaves

    def sibling(self, call: Any, at: int | None = None, arrays: int | None = None, **more: Any) -> "Algorithm":
        """The program of another algorithm, with the same fields, and the same arrays, of which the one at a leaf is
        data; or with so many arrays, of which the first is the same, and others are data. more: static arguments."""
        known, tree, static = list(self.known), self.tree, self.static
        if at is not None:
            known[at] = None
        if arrays is not None:
            tree = tuple_of(tree.children()[0], tuple_of(*[jax.tree.structure(0)] * arrays))
            known, static = [*known[: self.n_fields + 1], *[None] * (arrays - 1)], ()
        static = tuple(sorted((*static, *more.items())))
        own = self.precision, self.topology, tree, tuple(known), static, self.dtype
        return self.made((call, at, arrays, static), lambda: interned(call.kind(call.formula, *own)))

    def place(self, leaf: int):
        """Where in the data a leaf is."""
        return sum(k is None for k in self.known[:leaf])

    def leaf(self, tangents: Sequence[Any], leaf: int) -> jax.Array | None:
        """The tangent of a leaf, None for zero."""
        found = None if self.known[leaf] is not None else tangents[self.place(leaf)]
        return None if found is None or primitive.is_zero(found) else found

    def with_leaf(self, data: Sequence[Any], leaf: int, x: Any) -> list[Any]:
        """The data with x in the place of a leaf, that may have been known."""
        place = self.place(leaf)
        return [*data[:place], x, *data[place + (self.known[leaf] is None) :]]

    def tangents(self, primals: Sequence[Any], tangents: Sequence[Any], n_batch: int) -> list[Any]:
        """Those of the results, of tangents of which zero and None are none; None for zero."""
        moving = tuple(t is not None and not primitive.is_zero(t) for t in tangents)
        if not any(moving):
            return [None]
        given = [t for t, yes in zip(tangents, moving, strict=True) if yes]
        return primitive.bind(self.tangent(moving), [*primals, *given], n_batch)

    def __call__(self, data: Sequence[jax.Array], n_batch: int):
        found = primitive.bind(self, data, n_batch)
        return jax.tree.unflatten(self.out_tree, found)


def _is_result(x: object):
    return numbers.is_number(x) or (is_tuple(x) and all(map(numbers.is_number, x)))


# -- programs that are there ------------------------------------------------------------------------------------------


class ManyProgramsWarning(UserWarning):
    """One algorithm was compiled for the numbers of many mechanisms of one structure."""


class _Kept:
    """A program, and its call outside of any transformation. The program does not know the call, which JAX's caches
    would then keep for good."""

    def __init__(self, own: Algorithm):
        def call(n_batch: int, data: list[jax.Array]) -> Any:
            return own(data, n_batch)

        self.program = own
        self.call: Callable[[int, list[Any]], Any] = jax.jit(call, static_argnums=0)


# Equal programs are one. Those of known numbers live as long as a mechanism that they were made for.
_PROGRAMS: weakref.WeakValueDictionary[Any, Algorithm] = weakref.WeakValueDictionary()
_KEPT: weakref.WeakValueDictionary[Any, _Kept] = weakref.WeakValueDictionary()
_OF_DATA: dict[Any, _Kept] = {}
_OF_MECHANISM: weakref.WeakKeyDictionary[Mechanism, dict[Any, _Kept]] = weakref.WeakKeyDictionary()
# Those that were called outside of any transformation, by what they have in common but for numbers.
_CALLED: dict[Any, weakref.WeakSet[Algorithm]] = {}


def interned(own: Algorithm) -> Algorithm:
    """The one program that is equal to this."""
    return _PROGRAMS.setdefault(own.contents, own)


class _Given:
    """What a program is called with: the leaves of (fields of a mechanism by name, arrays), and which are known."""

    def __init__(self, fields: dict[str, Any], arrays: tuple[Any, ...]):
        self.tree: PyTreeDef
        self.leaves, self.tree = jax.tree.flatten((fields, arrays))
        self.n_own = len(self.leaves) - len(jax.tree.leaves(arrays))
        self.dtype = np.dtype(arrays[0].dtype)
        self.tracing = any(isinstance(x, Tracer) for x in self.leaves)
        self.is_known = tuple(
            isinstance(x, np.ndarray) and (i < self.n_own or (self.tracing and x.ndim == 1))
            for i, x in enumerate(self.leaves)
        )

    def is_fixed(self):
        """Whether all that is known is the mechanism's, and nobody can write to it."""
        known = (x for x, k in zip(self.leaves, self.is_known, strict=True) if k)
        return not any(self.is_known[self.n_own :]) and all(x.base is None and not x.flags.writeable for x in known)

    def data(self) -> tuple[list[Any], int]:
        """(what is not known, with batch axes in front, how many these are)."""
        n_batch = len(np.broadcast_shapes((), *(x.shape[:-1] for x in self.leaves[self.n_own :])))
        leaves = enumerate(zip(self.leaves, self.is_known, strict=True))
        return [_over(x, i < self.n_own, n_batch) for i, (x, k) in leaves if not k], n_batch


def _over(x: Any, is_own: bool, n_batch: int) -> Any:
    """With as many batch axes in front: of size 1 where there are less."""
    shape = (1,) * n_batch + x.shape if is_own else (1,) * (n_batch - x.ndim + 1) + x.shape
    return x.reshape(shape) if shape != x.shape else x


def _program(
    kind: type[Algorithm], formula: Any, precision: Precision, static: Static, mechanism: Mechanism, given: _Given
) -> _Kept:
    """That of the numbers that are known. Of those that nobody can write to, it is found without looking at them."""
    key, is_fixed = (formula, precision, static, given.tree, given.is_known, given.dtype), given.is_fixed()
    mine = _OF_MECHANISM.setdefault(mechanism, {})
    if is_fixed and key in mine:
        return mine[key]
    known = tuple(Known(x) if k else None for x, k in zip(given.leaves, given.is_known, strict=True))
    own = kind(formula, precision, mechanism.topology.skeleton, given.tree, known, static, given.dtype)
    kept = _KEPT.setdefault(own.contents, _Kept(interned(own)))
    if not any(known):
        _OF_DATA[own.contents] = kept
    mine[key if is_fixed else kept.program] = kept
    return kept


def _count(own: Algorithm):
    """Warns once for programs of one structure that are more than three at a time."""
    alike = _CALLED.setdefault((own.formula, own.topology, own.tree, own.static, own.dtype), weakref.WeakSet())
    if own not in alike:
        alike.add(own)
        if any(own.known) and len(alike) == 4:
            name = own.formula.__name__.lstrip("_")
            warnings.warn(
                f"{name}: compiled for the fourth mechanism of one structure, each for its own numbers. One program "
                "for all of them: mechanism.as_data(), or a jitted function that takes the mechanism as an argument.",
                ManyProgramsWarning,
                stacklevel=4,
            )


def of_rates(topology: Topology):
    return (topology.nv,)


def algorithm(
    *reads: str,
    kind: type[Algorithm] = Algorithm,
    entries: Callable[[Topology], int] | None = None,
    result: Callable[[Topology], tuple[int, ...]] | None = None,
    at: str = "q",
) -> Any:
    """Makes of `formula(state, *arrays, **static)` a function of (precision, mechanism, q, *arrays, **static).

    What it is called with is checked by the names that the formula has for it, see `checked`; messages begin with its
    own name, or that of another `operation`.

    reads: the fields of a Mechanism that the formula uses. q and the arrays are (*batch, n), with batch shapes that
    broadcast, or trees of such arrays. kind: of program. entries: of a Topology, how many numbers the results have,
    where these are matrices. result: of a Topology, the shape of the result without its batch, where it is one array:
    it is known then without a trace. at: the name of q.
    """

    def decorated(formula: Any) -> Any:
        formula.entries, formula.result = entries, result
        names, name = [at, *list(inspect.signature(formula).parameters)[1:]], formula.__name__.lstrip("_")

        @functools.wraps(formula)
        def call(
            precision: PrecisionName, mechanism: Mechanism, *arrays: Any, operation: str = name, **static: Any
        ) -> Any:
            found = checked(operation, mechanism, **dict(zip(names, arrays, strict=False)), **static)
            options = tuple(sorted(zip(static, found[len(arrays) :], strict=True)))
            given = _Given({name: getattr(mechanism, name) for name in reads}, found[: len(arrays)])
            kept = _program(kind, formula, resolve(precision), options, mechanism, given)
            data, n_batch = given.data()
            if given.tracing:
                return kept.program(data, n_batch)
            _count(kept.program)
            return kept.call(n_batch, data)

        vars(call).update(formula=formula, kind=kind)
        return call

    return decorated

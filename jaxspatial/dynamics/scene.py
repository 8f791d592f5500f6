"""One evaluation of an algorithm: the numbers of a mechanism and its state, for one item, as numbers to compute with.

`algorithm` makes of a formula over a Scene a function of a mechanism and arrays. What is NumPy in the mechanism is part
of the program, which is compiled once for these values; while tracing, so are NumPy arrays of coordinates. Batches are
vmapped over, so that every number is one array over the batch. All is evaluated in what the precision asks for, see
`numbers`, and rounded once at the end.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, numbers, vectors
from jaxspatial.arithmetic.functions import cosine_sine
from jaxspatial.arithmetic.lanes import is_known
from jaxspatial.arithmetic.numbers import Lane
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.dynamics import recursion
from jaxspatial.inertia.reduction import summed
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.joints import Axes


class Scene:
    """A mechanism and its coordinates. Everything is asked for by segment: one body, or a long chain, whose numbers
    are arrays along it."""

    def __init__(self, mechanism, q, precision, twice):
        self.mechanism, self.precision, self.twice = mechanism, precision, twice
        self.topology = mechanism.topology
        self.q = q

    @property
    def segments(self):
        return self.topology.segments

    def numbers(self, array):
        """The numbers of an array along its last axis; of the axis before it, one array each."""
        return numbers.of_array(array, self.precision, self.twice, self.q.dtype)

    def of(self, segment, array):
        """The numbers of a segment in an array (n, k) over all bodies."""
        return self.numbers(array[segment.start : segment.stop] if segment.is_chain else array[segment.start])

    def coordinates(self, segment, array, of_rates=False):
        """The numbers of a segment in q, or in an array over rates."""
        t, i = self.topology, segment.start
        size = t.kind(i).nv if of_rates else t.kind(i).nq
        start = (t.v_starts if of_rates else t.q_starts)[i]
        stop = start + size * (segment.stop - segment.start)
        own = array[start:stop]
        found = self.numbers(own.reshape((-1, size)) if segment.is_chain else own)
        return self._followed(i, found, of_rates) if t.is_mimic(i) else found

    def rates(self, segment, array):
        """The numbers of a segment in an array over rates; known zeros for None."""
        kind = self.topology.kind(segment.start)
        if array is None:
            return self.numbers(np.zeros(kind.nv, np.float32)) if kind.nv else ()
        return self.coordinates(segment, array, of_rates=True)

    def known(self, number):
        """A number that is known while tracing."""
        return self.numbers(np.array([number]))[0]

    # -- segments and bodies ------------------------------------------------------------------------------------------

    def size(self, segment):
        """How many rates the joints of a segment have, those of a mimic counted."""
        return self.topology.kind(segment.start).nv * (segment.stop - segment.start)

    def place(self, body):
        """(the number of the segment that a body is in, where in it)."""
        return next((k, body - s.start) for k, s in enumerate(self.segments) if s.start <= body < s.stop)

    def at(self, segment, place, x):
        """A number of a segment, of one of its bodies."""
        return numbers.mapped(lambda word: word[place], x) if self._is_along(segment, x) else x

    def of_body(self, segment, place, tree):
        """A tree of numbers of a segment, of one of its bodies."""
        return jax.tree.map(lambda x: self.at(segment, place, x), tree, is_leaf=numbers.is_number)

    def _is_along(self, segment, x):
        return self.segments[segment].is_chain and not is_known(numbers.high(x))

    def spread(self, segment, x):
        """A number as that of every body of a segment."""
        return recursion.repeated_along(x, segment.stop - segment.start) if segment.is_chain else x

    def up_to(self, segment, body, x):
        """A number of a segment, 0 for bodies behind the one given."""
        if not segment.is_chain:
            return x
        is_behind = np.arange(segment.start, segment.stop) > body
        return numbers.where(jnp.asarray(is_behind), 0.0, x)

    # -- results ------------------------------------------------------------------------------------------------------

    def by_rate(self, found):
        """(nv,) of one number per rate, (nv, k) of k, in a tuple for each segment; what a mimic feels, its master
        does."""
        pieces = {}
        for segment, parts in zip(self.segments, found, strict=True):
            i = segment.start
            if self.topology.is_mimic(i):
                i, parts = self.topology.masters[i], self._felt_by_master(i, parts)
            pieces[i] = _sum(pieces[i], parts) if i in pieces else parts
        width = next(len(parts[0]) if isinstance(parts[0], tuple) else 0 for parts in pieces.values() if parts)
        shape = (-1, width) if width else (-1,)
        return jnp.concatenate([self._interleaved(pieces[i]).reshape(shape) for i in sorted(pieces)])

    def by_coordinate(self, found):
        """(nq,) of one number per coordinate, in a tuple for each segment; none for a mimic."""
        return jnp.concatenate([jnp.ravel(self._interleaved(parts)) for parts in found if parts])

    def _felt_by_master(self, i, parts):
        factor = self.numbers(self.mechanism.mimics[i])[0]
        return jax.tree.map(lambda x: factor * x, parts, is_leaf=numbers.is_number)

    def _interleaved(self, parts):
        """The rates of one body after those of the one before."""
        arrays = [self.rounded(x) for x in parts]
        ranks = [jnp.ndim(x) - isinstance(p, tuple) for x, p in zip(arrays, parts, strict=True)]
        return jnp.stack(arrays, max(ranks))

    def total(self, found):
        """The sum of numbers, one for every segment, over all bodies."""
        return vectors.total([self._summed(s, x) for s, x in zip(self.segments, found, strict=True)])

    def _summed(self, segment, x):
        n = segment.stop - segment.start
        if n == 1:
            return x
        (whole,) = summed((self.spread(segment, x),), n)
        return numbers.mapped(lambda word: word[0], whole)

    def stacked(self, found):
        """(n, k) over all bodies of tuples of numbers, one for every segment."""
        return jnp.concatenate([jnp.atleast_2d(self.rounded(x)) for x in found])

    def rounded(self, x):
        """A number, or a tuple of them, as an array: rounded once, to the dtype of q."""
        parts = jax.tree.leaves(x, is_leaf=numbers.is_number)
        shape = np.broadcast_shapes(*(np.shape(numbers.high(c)) for c in parts))
        return numbers.rounded(shape, np.dtype(self.q.dtype), False, False, x)

    def _followed(self, i, found, of_rates):
        multiplier, offset = self.numbers(self.mechanism.mimics[i])
        return tuple(multiplier * x if of_rates else multiplier * x + offset for x in found)

    def axes(self, segment):
        m = self.mechanism
        return Axes(self.of(segment, m.axes), self.of(segment, m.second_axes), self.of(segment, m.pitches[:, None])[0])

    def placement(self, segment):
        return self._transform(segment, self.mechanism.placements)

    def child_placement(self, segment):
        return self._transform(segment, self.mechanism.child_placements)

    def frame_placement(self, frame):
        """X_JF of one of the named frames."""
        X = self.mechanism.frame_placements
        entries = self._without_dust(X.rotation.entries[frame])
        return Pose(vectors.rows(self.numbers(entries)), self.numbers(X.translation[frame]))

    def _transform(self, segment, transforms):
        entries = self.of(segment, self._without_dust(transforms.rotation.entries))
        return Pose(vectors.rows(entries), self.of(segment, transforms.translation))

    def _without_dust(self, entries):
        """Known entries that are no zeros only by the digits of a file (of quarter turns, 5e-12) are, where q has so
        few digits that it makes no difference in any precision: 2^-12 u."""
        if not isinstance(entries, np.ndarray):
            return entries
        return np.where(abs(entries) < float(jnp.finfo(self.q.dtype).eps) * 2.0**-13, 0, entries).astype(entries.dtype)

    def inertia(self, segment):
        M = self.mechanism.inertias
        return Inertia(self.of(segment, M.mass[:, None])[0], self.of(segment, M.com), self.of(segment, M.central))

    def links(self, v, vdot):
        """The Link of every segment."""
        return [
            Link(self.placement(s), hinge, self.inertia(s), self.rates(s, v), self.rates(s, vdot), self.armature(s))
            for s, hinge in zip(self.segments, self.joints, strict=True)
        ]

    def armature(self, segment):
        """Known zeros for a mimic: its share is its master's, see `mechanism.assembly`."""
        if self.topology.is_mimic(segment.start):
            return (self.known(0.0),) * self.topology.kind(segment.start).nv
        return self.coordinates(segment, self.mechanism.armature, of_rates=True)

    @functools.cached_property
    def joints(self):
        """The Hinge of every segment, with the cosines and sines of all angles computed in one call."""
        q = [self.coordinates(s, self.q) for s in self.segments]
        kinds = [self.topology.kind(s.start) for s in self.segments]
        turned = self._turned([x[k] for x, kind in zip(q, kinds, strict=True) for k in kind.angles])
        return [
            Hinge(kind, self.axes(s), x, {k: next(turned) for k in kind.angles})
            for s, kind, x in zip(self.segments, kinds, q, strict=True)
        ]

    def _turned(self, angles):
        """(cosine, sine) of each, those of data in one call: within other formulas they would keep XLA CPU from
        vectorising these."""
        data = [x for x in angles if not _is_known(x)]
        sizes = [np.shape(numbers.high(x)) for x in data]
        found = iter(())
        if data:
            both = cosine_sine(recursion.concatenated([(recursion.raveled(x),) for x in data])[0])
            ends = np.cumsum([int(np.prod(size)) for size in sizes])
            found = iter(
                [tuple(recursion.part(x, end, size) for x in both) for end, size in zip(ends, sizes, strict=True)]
            )
        return (cosine_sine(x) if _is_known(x) else next(found) for x in angles)


def _is_known(x):
    return isinstance(x, Lane) and is_known(x.value)


def _sum(a, b):
    return jax.tree.map(lambda x, y: x + y, a, b, is_leaf=numbers.is_number)


class Pose(NamedTuple):
    """(R by its rows, p)."""

    rows: Any
    p: Any


class Inertia(NamedTuple):
    mass: Any
    com: Any
    central: Any


class Link(NamedTuple):
    """A body and the joint that carries it. v: rates of the joint; vdot: their derivatives, or the forces tau."""

    placement: Any
    hinge: Any
    inertia: Any
    v: Any
    vdot: Any
    armature: Any


class Hinge(NamedTuple):
    """A joint at its coordinates."""

    kind: Any
    axes: Any
    q: Any
    turned: Any

    @property
    def transform(self):
        return Pose(*self.kind.transform(self.axes, self.q, self.turned))

    @property
    def subspace(self):
        return self.kind.subspace(self.axes, self.turned)

    def subspace_rate(self, v):
        return self.kind.subspace_rate(self.axes, self.turned, v)


# -- programs ---------------------------------------------------------------------------------------------------------


class _Known:
    """A NumPy array as part of a program."""

    def __init__(self, array):
        self.array = array
        self._key = array.dtype.str, array.shape, array.tobytes()
        self._hash = hash(self._key)

    def __hash__(self):
        return self._hash

    def __eq__(self, other):
        return self._key == other._key


def algorithm(formula) -> Any:
    """Makes of `formula(scene, *arrays, **static)` a function of (precision, mechanism, q, *arrays, **static).

    q and the arrays are (*batch, n), with batch shapes that broadcast, or trees of such arrays. The formula sees one
    item, and returns tuples of numbers (which become arrays with a last axis), numbers, or trees of these.
    """

    @functools.wraps(formula)
    def call(precision, mechanism, *arrays, **static):
        leaves, tree = jax.tree.flatten((mechanism, arrays))
        n_own = len(jax.tree.leaves(mechanism))
        tracing = any(isinstance(x, jax.core.Tracer) for x in leaves)
        is_known = [isinstance(x, np.ndarray) and (i < n_own or tracing) for i, x in enumerate(leaves)]
        known = tuple(_Known(x) if k else None for x, k in zip(leaves, is_known, strict=True))
        data = [x for x, k in zip(leaves, is_known, strict=True) if not k]
        return _compiled(formula, resolve(precision), tree, known, n_own, tuple(sorted(static.items())), data)

    return call


def _run(formula, precision, tree, known, n_own, static, data):
    """Vmapped over what has a batch."""
    leaves = _merged(known, data)
    batch = np.broadcast_shapes(*(jnp.shape(x)[:-1] for x in leaves[n_own:]))
    item = functools.partial(_item, formula, precision, tree, static)
    known = [
        k is not None and (i < n_own or jnp.ndim(x) == 1) for i, (k, x) in enumerate(zip(known, leaves, strict=True))
    ]
    return _over(batch, item, leaves, known, n_own)


def _merged(known, data):
    remaining = iter(data)
    return [k.array if k is not None else next(remaining) for k in known]


def _over(batch, item, leaves, known, n_own):
    """The item function, vmapped over each axis of the batch, innermost last."""
    if not batch:
        return item(leaves)
    leaves = [
        x if i < n_own or is_known else _broadcast(x, batch)
        for i, (x, is_known) in enumerate(zip(leaves, known, strict=True))
    ]
    is_batched = [not (i < n_own or is_known) for i, is_known in enumerate(known)]

    def of_batched(batched):
        found = iter(batched)
        return item([next(found) if b else x for x, b in zip(leaves, is_batched, strict=True)])

    function = of_batched
    for _ in batch:
        function = jax.vmap(function)
    return function([x for x, b in zip(leaves, is_batched, strict=True) if b])


def _broadcast(x, batch):
    return jnp.broadcast_to(jnp.asarray(x), (*batch, *x.shape[x.ndim - 1 :]))


def _item(formula, precision, tree, static, leaves):
    """The formula for one item, in the format that the precision asks for."""
    mechanism, (q, *others) = jax.tree.unflatten(tree, leaves)
    twice = precision.sees_whole_sums
    with jax.enable_x64(bool(jax.config.jax_enable_x64) or twice):
        scene = Scene(mechanism, q, precision, twice)
        found = formula(scene, *others, **dict(static))
        return jax.tree.map(scene.rounded, found, is_leaf=_is_result) if _has_numbers(found) else found


def _is_result(x):
    return numbers.is_number(x) or (type(x) is tuple and all(map(numbers.is_number, x)))


def _has_numbers(found):
    return any(map(numbers.is_number, jax.tree.leaves(found, is_leaf=numbers.is_number)))


_compiled = jax.jit(_run, static_argnums=(0, 1, 2, 3, 4, 5), inline=True)


# -- what a caller passes ---------------------------------------------------------------------------------------------


def checked(operation, mechanism, **arrays):
    """The arrays of coordinates, (*batch, nq) for q and (*batch, nv) for all others, with a dtype in common."""
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"{operation}: expected a Mechanism first, got {type(mechanism).__name__}")
    sizes = {name: mechanism.nq if name.startswith("q") else mechanism.nv for name in arrays}
    given = {name: check.as_vectors(x, f"{operation}: {name}", None, sizes[name]) for name, x in arrays.items()}
    data = [x for x in jax.tree.leaves(mechanism) if not isinstance(x, np.ndarray)]
    check.require_same_dtype(**given, **({"mechanism": data[0]} if data else {}))
    check.common_batch_shape(**{name: x.shape[:-1] for name, x in given.items()})
    return tuple(given.values())

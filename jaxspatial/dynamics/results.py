"""What was found bundle by bundle, put in the order of bodies, rates and coordinates, and rounded."""

from collections.abc import Iterable, Sequence
from typing import Any, TypeGuard, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import numbers
from jaxspatial.arithmetic.numbers import Number, Numbers, stacking
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.dynamics import alignment, along
from jaxspatial.dynamics.along import Array
from jaxspatial.mechanism.topology import Bundle, Topology

T = TypeVar("T")


def is_tuple(x: object) -> TypeGuard[tuple[Any, ...]]:
    """Whether x is a plain tuple: neither a named one nor a list."""
    return type(x) is tuple


class Results:
    """n states of a topology: its fields by name, as numbers, and numbers rounded to dtype, as arrays. A part of
    `MechanismState`."""

    def __init__(self, topology: Topology, fields: dict[str, Any], n: int, precision: Precision, dtype: DTypeLike):
        self.topology, self.n, self.precision, self.dtype = topology, n, precision, np.dtype(dtype)
        self.fields, self._turns = alignment.aligned(topology, fields)

    @property
    def bundles(self) -> tuple[Bundle, ...]:
        return self.topology.bundles

    def numbers(self, array: Array) -> Numbers:
        """The numbers of NumPy (..., k) or data (..., k, B)."""
        array = array[..., None, :] if isinstance(array, np.ndarray) else jnp.moveaxis(array, -2, -1)
        return stacking.of_terms(array, self.precision, self.dtype)

    def known(self, number: float) -> Number:
        """A number that is known while tracing."""
        return self.numbers(np.array([number]))[0]

    # -- bodies -------------------------------------------------------------------------------------------------------

    def of_body(self, body: int, found: Sequence[T], at_world: T) -> T:
        """What was found for all bundles, of one body: numbers (1, B). Of the world for -1."""
        if body < 0:
            return at_world
        k, j, c = self.topology.places[body]
        # Of what is the same for all chains there is one.
        return along.mapped_tree(lambda word: word[j, min(c, word.shape[1] - 1)][None], found[k])

    def by_body(self, found: Sequence[Numbers]) -> jax.Array:
        """(n, k, B) of tuples of k numbers, one for every bundle, in the order of bodies."""
        pieces = [self._rows(b, parts, 3) for b, parts in zip(self.bundles, found, strict=True)]
        places = np.concatenate([b.own_bodies for b in self.bundles])
        return self.rounded(along.mapped(lambda w: along.rows(w, np.argsort(places)), along.joined(pieces)))

    def _rows(self, bundle: Bundle, parts: Numbers, rank: int) -> Number:
        """(rows, B), or (bodies, k, B), of numbers of a bundle, those of a chain one behind the other."""
        count = bundle.length * bundle.width
        whole = along.stacked(parts, (bundle.length, bundle.width, self.n), 2)
        whole = along.mapped(lambda w: jnp.swapaxes(w, 0, 1).reshape((count, len(parts), self.n)), whole)
        if len(bundle.own_rows) < count:
            whole = along.mapped(lambda w: along.rows(w, bundle.own_rows), whole)
        return along.mapped(lambda w: w.reshape((-1, self.n)), whole) if rank == 2 else whole

    # -- results ------------------------------------------------------------------------------------------------------

    def rounded(self, x: object) -> Any:
        """A number, or a tuple of them, as an array (..., B): rounded once, to the dtype of q. Arrays as they are."""
        if numbers.is_number(x):
            array = jnp.asarray(stacking.as_array(x, self.dtype))
            return jnp.broadcast_to(array, (*array.shape[:-1], self.n))
        if is_tuple(x):
            return jnp.stack([self.rounded(c).reshape((self.n,)) for c in x])
        return x

    def by_rate(self, found: Sequence[Numbers], bundles: Sequence[Bundle] | None = None) -> jax.Array:
        """(nv, B) of one number per rate, in a tuple for each bundle: what acts on a mimic acts, times its multiplier,
        on the joint that it follows."""
        return self.rounded(self.numbers_by_rate(found, bundles))

    def numbers_by_rate(self, found: Sequence[Numbers], bundles: Sequence[Bundle] | None = None) -> Number:
        """The same, as one number over the rates."""
        return self.following(*self._gathered(found, bundles or self.bundles, of_rates=True))

    def following(self, whole: Number, places: np.ndarray, bodies: np.ndarray) -> Number:
        """Of numbers (rows, ..., B) of bodies those that are no mimics', in order, with theirs added."""
        own = self._own_rows(whole, places, bodies)
        for row in np.flatnonzero(self._follows(bodies)).tolist():
            factor = self.numbers(along.rows(self.fields["mimics"], bodies[row]))[0]
            own = along.added_at(own, places[row], factor * along.mapped(lambda w, k=row: w[k], whole))
        return own

    def own_rates(self, found: Sequence[Numbers]) -> Number:
        """Of the same those of joints that are no mimics, with nothing added."""
        return self._own_rows(*self._gathered(found, self.bundles, of_rates=True))

    def by_coordinate(self, found: Sequence[Numbers], bundles: Sequence[Bundle] | None = None) -> jax.Array:
        """(nq, B) of one number per coordinate, in a tuple for each bundle; those of mimics are no coordinates."""
        return self.rounded(self._own_rows(*self._gathered(found, bundles or self.bundles, of_rates=False)))

    def matrix_by_rate(self, found: Sequence[Sequence[Numbers]]) -> jax.Array:
        """(k, nv, B) of a tuple of k numbers per rate, in a tuple for each bundle."""
        k = next(len(parts[0]) for parts in found if parts)
        return jnp.stack([self.by_rate([tuple(column[i] for column in parts) for parts in found]) for i in range(k)])

    def _gathered(
        self, found: Sequence[Numbers], bundles: Sequence[Bundle], of_rates: bool
    ) -> tuple[Number, np.ndarray, np.ndarray]:
        """(numbers (rows, B), where each row belongs, the body that each is of)."""
        starts = np.array(self.topology.v_starts if of_rates else self.topology.q_starts)
        pieces, places, bodies = list[Number](), list[np.ndarray](), list[np.ndarray]()
        for b, parts in zip(bundles, found, strict=True):
            if parts:
                pieces.append(self._rows(b, parts, 2))
                places.append(starts[b.own_bodies][:, None] + np.arange(len(parts)))
                bodies.append(np.broadcast_to(b.own_bodies[:, None], places[-1].shape))
        places, bodies = (np.concatenate([x.ravel() for x in y]) for y in (places, bodies))
        return along.joined(pieces), places, bodies

    def _own_rows(self, whole: Number, places: np.ndarray, bodies: np.ndarray) -> Number:
        own = np.flatnonzero(~self._follows(bodies))
        order = own[np.argsort(places[own])]
        return along.mapped(lambda w: along.rows(w, order), whole)

    def _follows(self, bodies: np.ndarray):
        return np.array([self.topology.is_mimic(i) for i in bodies], bool)

    def in_given_axes(self, Y: jax.Array) -> jax.Array:
        """A matrix (rows, 10 n, B) over dynamic parameters, of those that a mechanism is given with."""
        if self._turns is None:
            return Y
        which, sign = alignment.of_parameters(self._turns)
        back = np.argsort(which, 1)
        places = (10 * np.arange(len(back))[:, None] + back).ravel()
        sign = jnp.asarray(np.take_along_axis(sign, back, 1).ravel().astype(self.dtype))
        return jnp.take(Y, jnp.asarray(places, np.int32), axis=1) * sign[None, :, None]

    # -- numbers kept from one program for another --------------------------------------------------------------------

    def words(self, found: Sequence[Any]) -> list[jax.Array]:
        """The arrays (..., B) that trees of numbers of bundles consist of, not rounded."""
        full: list[Number] = []
        for b, tree in zip(self.bundles, found, strict=True):
            shape = b.length, b.width, self.n
            leaves = numbers.flattened(tree)[0]
            own = (shape if numbers.is_constant(x) else (*numbers.shape_of(x)[:-1], self.n) for x in leaves)
            full += map(along.spread, leaves, own)
        return numbers.data_of(map(numbers.as_data, full))

    def of_words(self, arrays: Iterable[Array], form: Any) -> Any:
        """The tree of numbers that consists of these arrays, in the form of another."""
        leaves, tree = numbers.flattened(form)
        like, found = self.known(0.0), iter(arrays)
        return jax.tree.unflatten(tree, [like.with_words(next(found) for _ in like.words) for _ in leaves])

    def sum_over_bodies(self, found: Sequence[Number]) -> Number:
        """The sum of numbers, one for every bundle, over all bodies: (B,)."""
        return along.pairwise_sum(
            along.joined([self._rows(b, (x,), 2) for b, x in zip(self.bundles, found, strict=True)])
        )

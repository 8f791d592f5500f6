"""The state of a mechanism: its numbers, bundle by bundle, and the order of results.

A number of a bundle is either known, and the same for all its bodies, or an array (L, W, B): L bodies along each of W
chains, for B states, of size 1 where it is the same for all. Joint axes along an axis of their frame are turned to z,
and frames, inertias and placements with them; this is exact, see `alignment`.
"""

import copy
import functools
import itertools
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.engine import alignment, stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.mechanism.joints import CosSin, JointKind, Parameter
from jaxspatial.mechanism.topology import Bundle, Topology
from jaxspatial.numerics import floats, linear, numbers
from jaxspatial.numerics.formula import converted, of_terms
from jaxspatial.numerics.functions import cosine_sine
from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Pose, Symmetric, Vector
from jaxspatial.numerics.numbers import Number, Numbers, where
from jaxspatial.numerics.precision import Precision
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.spatial.algebra import composed

T = TypeVar("T")


class JointState(NamedTuple):
    """A joint at its coordinates."""

    kind: JointKind
    q: Numbers
    cos_sin: CosSin

    @property
    def transform(self) -> Pose:
        return self.kind.transform(self.q, self.cos_sin)

    @property
    def subspace(self) -> tuple[Motion, ...]:
        """The columns of S."""
        return self.kind.motion_subspace(*self._subspace_arguments)

    def subspace_rate(self, v: Numbers) -> tuple[Motion, ...]:
        """The columns of dS/dt."""
        return self.kind.motion_subspace_rate(*[*self._subspace_arguments, v])

    @property
    def _subspace_arguments(self) -> tuple:
        """What S depends on."""
        return (self.q, self.cos_sin) if self.kind.subspace_needs_q else (self.cos_sin,)


def across(placement: Pose, joint: JointState) -> Pose:
    """X_PB, the pose of a body in its parent, across the joint."""
    return composed(placement, joint.transform)


class Link(NamedTuple):
    """A body and the joint that carries it. v, vdot, tau and armature belong to the joint."""

    placement: Pose
    joint: JointState
    inertia: Inertia
    v: Numbers
    vdot: Numbers
    tau: Numbers
    armature: Numbers

    @property
    def X_PB(self) -> Pose:
        """The pose of the body in its parent."""
        return across(self.placement, self.joint)

    @property
    def rotor_forces(self) -> Numbers:
        """The forces that move the armature: armature times the rates of v, of linear velocities in the axes of the
        parent."""
        turning = self.joint.kind.transport(self.v, self.v)
        return tuple(i * (x + y) for i, x, y in zip(self.armature, self.vdot, turning, strict=True))


class MechanismState:
    """A mechanism of some topology in B states; its methods give the numbers of one bundle.

    fields: those of the mechanism by name, NumPy arrays or data (bodies, ..., B). q: (nq, B). n: the number of states.
    dtype: results are rounded to it.
    """

    def __init__(
        self, topology: Topology, fields: dict[str, Any], q: Array, n: int, precision: Precision, dtype: DTypeLike
    ):
        self.topology, self.q, self.n, self.precision, self.dtype = topology, q, n, precision, np.dtype(dtype)
        self.fields, self._permutations = alignment.aligned(topology, fields)

    def carrying(self, frames: int | Iterable[int] | None) -> "MechanismState":
        """The same, for recursions that compute only the bodies which carry some frames; as it is for None."""
        if frames is None:
            return self
        other, bodies = copy.copy(self), self.topology.bodies_of([frames] if isinstance(frames, int) else frames)
        other.topology = self.topology.carrying(bodies)
        other.__dict__.pop("joints", None)
        return other

    @property
    def bundles(self) -> tuple[Bundle, ...]:
        return self.topology.bundles

    @property
    def independent_joints(self) -> "list[JointsOfKind]":
        """The joints that are no mimics, one item for each kind."""
        return [JointsOfKind(self, bundle) for bundle in self.topology.joints_by_kind]

    # -- numbers ------------------------------------------------------------------------------------------------------

    def numbers(self, array: Array) -> Numbers:
        """The k numbers of a NumPy array (..., k), or of data (..., k, B)."""
        if isinstance(array, np.ndarray):
            array = array[..., None, :]
        else:
            n = array.ndim
            array = lax.transpose(array, (*range(n - 2), n - 1, n - 2))
        return of_terms(array, self.precision, self.dtype)

    def vectors(self, array: Array | None) -> Vector:
        """n vectors, of an array (..., 3 n) or (..., 3 n, B), as numbers (n, B); the known zero vector for None."""
        if array is None:
            return self.zero_vector
        return Vector(*self.numbers(array.reshape((-1, 3, *array.shape[1:]))))

    def known(self, number: float) -> Number:
        """A number that is known while tracing."""
        return self.numbers(np.array([number]))[0]

    def zeros(self, *shape: int) -> Number:
        """A number (*shape, B) that is zero, as data."""
        return stacking.spread(self.known(0.0), (*shape, self.n))

    @property
    def zero_vector(self) -> Vector:
        return Vector(*[self.known(0.0)] * 3)

    @property
    def zero_inertia(self) -> Inertia:
        zero = self.known(0.0)
        return Inertia(zero, Vector(*[zero] * 3), Symmetric(*[zero] * 6))

    @property
    def world(self) -> Pose:
        zero, one = (self.known(x) for x in (0.0, 1.0))
        return Pose(Matrix(Vector(one, zero, zero), Vector(zero, one, zero), Vector(zero, zero, one)), self.zero_vector)

    @property
    def minus_gravity(self) -> Vector:
        """-g: gravity as an upward acceleration of the world."""
        return -Vector(*self.numbers(self.fields["gravity"]))

    # -- coordinates and velocities -----------------------------------------------------------------------------------

    def coordinates(self, bundle: Bundle, array: Array) -> Numbers:
        """The numbers of a bundle in an array over coordinates. A mimic has those of the joint that it follows."""
        return self._of_joints(bundle, array, self.topology.q_starts, bundle.kind.nq, has_offset=True)

    def velocities(self, bundle: Bundle, array: Array | None) -> Numbers:
        """The numbers of a bundle in an array over velocities; known zeros for None."""
        if array is None:
            return (self.known(0.0),) * bundle.kind.nv
        return self._of_joints(bundle, array, self.topology.v_starts, bundle.kind.nv, has_offset=False)

    def _of_joints(self, bundle: Bundle, array: Array, starts, size: int, has_offset: bool) -> Numbers:
        if not size:
            return ()
        x = self.numbers(stacking.rows(array, bundle.places(starts, size)))
        if not self.topology.has_mimics_in(bundle):
            return x
        multiplier, offset = self.mimics(bundle)
        return tuple(multiplier * c + offset if has_offset else multiplier * c for c in x)

    def mimics(self, bundle: Bundle) -> Numbers:
        """(multiplier, offset) of the coordinates of a bundle: 1 and 0 for those that follow no others."""
        return self.numbers(stacking.rows(self.fields["mimics"], bundle.bodies))

    def configuration(self, bundle: Bundle, q: Array) -> Numbers:
        """The numbers of a bundle in q, with quaternions normalised: NaN for length 0.

        Known quaternions of unit length, to rounding, are used as they are: rotations depend on their direction only,
        see `quaternion.to_matrix`.
        """
        x, n = self.coordinates(bundle, q), bundle.kind.sphere[0]
        return x if not n or self._has_unit_lengths(bundle, q) else (*linear.unit(x[:n]), *x[n:])

    def _has_unit_lengths(self, bundle: Bundle, q: Array) -> bool:
        if not isinstance(q, np.ndarray):
            return False
        on_sphere = q[bundle.places(self.topology.q_starts, bundle.kind.sphere[0])].astype(np.float64)
        with np.errstate(over="ignore"):
            return bool((abs((on_sphere**2).sum(-1) - 1) <= 2 * floats.eps(self.dtype)).all())

    # -- bodies and joints of a bundle --------------------------------------------------------------------------------

    def joint(self, bundle: Bundle) -> JointKind:
        """The JointKind of a bundle, with the parameters of its joints."""

        def numbers_of(p: Parameter):
            of_all = self.fields[p.field] if p.field else self.fields["parameters"][p.name]
            x = self.numbers(stacking.rows(of_all, bundle.bodies))
            return x if p.size > 1 else x[0]

        return bundle.kind(numbers_of, self.known(0.0))

    def placement(self, bundle: Bundle) -> Pose:
        return self._pose(self.fields["placements"], bundle.bodies)

    def child_placement(self, bundle: Bundle) -> Pose:
        return self._pose(self.fields["child_placements"], bundle.bodies)

    def frame_placements(self, frames: Sequence[int]) -> Pose:
        """X_JF of n of the named frames, as numbers (n, B)."""
        return self._pose(self.fields["frame_placements"], np.array(frames))

    def _pose(self, transforms: tuple[Array, Array], places: np.ndarray) -> Pose:
        entries, p = (stacking.rows(x, places) for x in transforms)
        if isinstance(entries, np.ndarray):
            # Files write pi/2 with few digits, which leaves 5e-12 where a rotation by 90 degrees has zeros. Without
            # what is below 2^-12 u no result changes, in any precision.
            is_dust = abs(entries) < floats.eps(self.dtype) * 2.0**-13
            entries = np.where(is_dust, 0, entries).astype(entries.dtype)
        return Pose(Matrix.of_entries(self.numbers(entries)), Vector(*self.numbers(p)))

    def inertia(self, bundle: Bundle) -> Inertia:
        return self.inertia_at("inertias", bundle.bodies)

    def inertia_at(self, field: str, places: np.ndarray) -> Inertia:
        """The inertias at these places of a field."""
        (mass,), com, central = (self.numbers(stacking.rows(x, places)) for x in self.fields[field])
        return Inertia(mass, Vector(*com), Symmetric(*central))

    def own(self, bundle: Bundle, array: Array) -> Numbers:
        """The numbers of a bundle in an array over velocities, such as armature. Mimics have zeros:
        `mechanism.assembly` adds what they have to the joint that they follow."""
        t, n = self.topology, bundle.kind.nv
        if not n:
            return ()
        x = stacking.rows(array, bundle.places(t.v_starts, n))
        if t.has_mimics_in(bundle):
            is_independent = ~np.vectorize(t.is_mimic)(bundle.bodies)
            x = x * is_independent.reshape((*is_independent.shape, 1, *[1] * (x.ndim - 3))).astype(x.dtype)
        return self.numbers(x)

    def links(self, v: Array | None = None, vdot: Array | None = None, tau: Array | None = None) -> list[Link]:
        """The Link of every bundle, with known zeros for None and for fields that the algorithm does not read."""
        return [
            Link(
                self.placement(b),
                joint,
                self.inertia(b) if "inertias" in self.fields else self.zero_inertia,
                self.velocities(b, v),
                self.velocities(b, vdot),
                self.velocities(b, tau),
                self.own(b, self.fields["armature"]) if "armature" in self.fields else self.velocities(b, None),
            )
            for b, joint in zip(self.bundles, self.joints, strict=True)
        ]

    @functools.cached_property
    def joints(self) -> list[JointState]:
        """The JointState of every bundle."""
        q = [self.configuration(b, self.q) for b in self.bundles]
        return [
            JointState(self.joint(b), x, {k: cosine_sine(x[k]) for k in b.kind.angles})
            for b, x in zip(self.bundles, q, strict=True)
        ]

    # -- results ------------------------------------------------------------------------------------------------------

    def rounded(self, x) -> Any:
        """Rounds a number, or a tuple of numbers, to an array (..., B) of the dtype of q. Arrays pass unchanged."""
        if numbers.is_number(x):
            array = jnp.asarray(converted(numbers.high(x), self.dtype))
            return jnp.broadcast_to(array, (*array.shape[:-1], self.n))
        if is_vector(x):
            return jnp.stack([self.rounded(c).reshape((self.n,)) for c in x])
        return x

    def of_bodies(self, bodies: Sequence[int], results: Sequence[T], at_world: T) -> T:
        """The results for n bodies, numbers (n, B), from those for all bundles; at_world for body -1.

        A number has one row where it is the same for all of them.
        """
        places = [self.topology.places[body] if body >= 0 else (-1, 0, 0) for body in bodies]
        pieces, counts = list[Any](), list[int]()
        for k, run in itertools.groupby(places, lambda place: place[0]):
            at = [place[1:] for place in run]

            def rows_at(word: jax.Array, at: list[tuple[int, int]] = at) -> Array:
                """The rows (n, B) at (row, chain) of an array (L, W, B), of size 1 where all rows or chains agree."""
                L, W = word.shape[:2]
                flat = np.array([min(j, L - 1) * W + min(c, W - 1) for j, c in at])
                return stacking.rows(word.reshape((L * W, -1)), flat[:1] if (flat == flat[0]).all() else flat)

            counts.append(len(at))
            pieces.append(at_world if k < 0 else stacking.mapped(rows_at, results[k]))
        return pieces[0] if len(pieces) == 1 else stacking.concatenated_trees(pieces, self.n, counts)

    def by_body(self, results: Sequence[Numbers], k: int) -> jax.Array:
        """Results by body, (n, k, B), from a tuple of k numbers for every bundle."""
        if not self.bundles:
            return self.rounded(self.zeros(0, k))
        pieces = [self._of_own_bodies(b, parts, 3) for b, parts in zip(self.bundles, results, strict=True)]
        places = np.concatenate([b.own_bodies for b in self.bundles])
        return self.rounded(
            stacking.mapped(lambda w: stacking.rows(w, np.argsort(places)), stacking.concatenated(pieces))
        )

    def by_row(self, parts: Numbers, n: int) -> jax.Array:
        """An array (n, k, B) of k numbers (n, B), or of one row where all rows are the same."""
        return jnp.stack([jnp.broadcast_to(self.rounded(x).reshape((-1, self.n)), (n, self.n)) for x in parts], 1)

    def sum_over_bodies(self, results: Sequence[Number]) -> Number:
        """The sum over all bodies, (B,), of a number for every bundle."""
        if not self.bundles:
            return self.known(0.0)
        rows = [self._of_own_bodies(b, (x,), 2) for b, x in zip(self.bundles, results, strict=True)]
        return stacking.pairwise_sum(stacking.concatenated(rows))

    def by_velocity(self, results: Sequence[Numbers], bundles: Sequence[Bundle] | None = None) -> jax.Array:
        """Generalized forces (nv, B), from one number per velocity in a tuple for each bundle.

        The force on a mimic acts, times its multiplier, on the joint that it follows.
        """
        return self.rounded(self.numbers_by_velocity(results, bundles))

    def numbers_by_velocity(self, results: Sequence[Numbers], bundles: Sequence[Bundle] | None = None) -> Number:
        """`by_velocity`, not rounded."""
        return self.fold_mimics(*self._gathered(results, bundles or self.bundles, self.topology.v_starts))

    def fold_mimics(self, whole: Number, places: np.ndarray, bodies: np.ndarray) -> Number:
        """Adds the rows of mimics, times their multipliers, to those of the joints that they follow.

        whole: (rows, ..., B). places: the place of each row in the result. bodies: the body that each row belongs to.
        """
        result = self._independent_rows(whole, places, bodies)
        for row in np.flatnonzero(self._are_mimics(bodies)).tolist():
            factor = self.numbers(stacking.rows(self.fields["mimics"], bodies[row]))[0]
            followed, shape = factor * stacking.mapped(lambda w, k=row: w[k], whole), numbers.shape_of(result)
            here = jnp.asarray(np.arange(shape[0]) == places[row]).reshape((-1, *[1] * (len(shape) - 1)))
            result = where(jnp.broadcast_to(here, shape), result + stacking.spread(followed, shape), result)
        return result

    def of_independent_joints(self, results: Sequence[Numbers]) -> Number:
        """Numbers by velocity, (nv, B), from a tuple for each bundle; those of mimics are left out."""
        return self._independent_rows(*self._gathered(results, self.bundles, self.topology.v_starts))

    def by_coordinate(self, results: Sequence[Numbers], bundles: Sequence[Bundle] | None = None) -> jax.Array:
        """Results by coordinate, (nq, B), from a tuple for each bundle; those of mimics are left out."""
        gathered = self._gathered(results, bundles or self.bundles, self.topology.q_starts)
        return self.rounded(self._independent_rows(*gathered))

    def matrix_by_velocity(self, results: Sequence[Sequence[Numbers]], k: int) -> jax.Array:
        """A matrix (k, nv, B), from its columns: a tuple of k numbers per velocity, in a tuple for each bundle.

        Columns of joints that recursions do not compute are zero.
        """
        rows = ([tuple(column[i] for column in parts) for parts in results] for i in range(k))
        return jnp.stack([self.by_all_velocities(row) for row in rows])

    def by_all_velocities(self, results: Sequence[Numbers]) -> jax.Array:
        """`by_velocity`, zero for joints that recursions do not compute."""
        others = self.topology.not_computed
        zeros = [(self.known(0.0),) * b.kind.nv for b in others]
        return self.by_velocity([*results, *zeros], (*self.bundles, *others))

    def _of_own_bodies(self, bundle: Bundle, parts: Numbers, rank: int) -> Number:
        """The numbers of a bundle, chain after chain: (rows, B) for rank 2, (bodies, k, B) for rank 3."""
        count = bundle.length * bundle.width
        whole = stacking.stacked(parts, (bundle.length, bundle.width, self.n), 2)
        whole = stacking.mapped(lambda w: jnp.swapaxes(w, 0, 1).reshape((count, len(parts), self.n)), whole)
        if len(bundle.own_rows) < count:
            whole = stacking.mapped(lambda w: stacking.rows(w, bundle.own_rows), whole)
        return stacking.mapped(lambda w: w.reshape((-1, self.n)), whole) if rank == 2 else whole

    def _gathered(
        self, results: Sequence[Numbers], bundles: Sequence[Bundle], starts: Sequence[int]
    ) -> tuple[Number, np.ndarray, np.ndarray]:
        """(whole, places, bodies) as in `fold_mimics`, from a tuple for each bundle."""
        pieces, places, bodies = list[Number](), list[np.ndarray](), list[np.ndarray]()
        for b, parts in zip(bundles, results, strict=True):
            if parts:
                pieces.append(self._of_own_bodies(b, parts, 2))
                places.append(np.array(starts)[b.own_bodies][:, None] + np.arange(len(parts)))
                bodies.append(np.broadcast_to(b.own_bodies[:, None], places[-1].shape))
        if not pieces:
            return self.zeros(0), np.zeros(0, int), np.zeros(0, int)
        places, bodies = (np.concatenate([x.ravel() for x in y]) for y in (places, bodies))
        return stacking.concatenated(pieces), places, bodies

    def _independent_rows(self, whole: Number, places: np.ndarray, bodies: np.ndarray) -> Number:
        """The rows of joints that are no mimics, in the order of their places."""
        rows = np.flatnonzero(~self._are_mimics(bodies))
        order = rows[np.argsort(places[rows])]
        return stacking.mapped(lambda w: stacking.rows(w, order), whole)

    def _are_mimics(self, bodies: np.ndarray) -> np.ndarray:
        return np.array([self.topology.is_mimic(i) for i in bodies], bool)

    def in_callers_axes(self, Y: jax.Array) -> jax.Array:
        """A matrix (rows, 10 n, B) over dynamic parameters in aligned axes, as one over those in the caller's axes."""
        if self._permutations is None:
            return Y
        which, sign = alignment.of_parameters(self._permutations)
        back = np.argsort(which, 1)
        places = (10 * np.arange(len(back))[:, None] + back).ravel()
        sign = jnp.asarray(np.take_along_axis(sign, back, 1).ravel().astype(self.dtype))
        return jnp.take(Y, jnp.asarray(places, np.int32), axis=1) * sign[None, :, None]

    # -- unrounded numbers as arrays, passed from one program to another ----------------------------------------------

    def words(self, results: Sequence) -> list[jax.Array]:
        """The limbs of trees of numbers, one tree for every bundle, as arrays (..., B)."""
        full: list[Number] = []
        for b, tree in zip(self.bundles, results, strict=True):
            shape = b.length, b.width, self.n
            for x in jax.tree.leaves(tree, is_leaf=numbers.is_number):
                over = shape if numbers.is_constant(x) else (*numbers.shape_of(x)[:-1], self.n)
                full.append(numbers.as_data(stacking.spread(x, over)))
        return numbers.data_of(full)

    def of_words(self, words: Iterable[Array], form):
        """The inverse of `words`: numbers made of these arrays, in trees of the structure of `form`."""
        like, rest = self.known(0.0), iter(words)
        return jax.tree.map(lambda _: like.with_limbs(next(rest) for _ in like.limbs), form, is_leaf=numbers.is_number)


def is_vector(x: object) -> bool:
    """Whether x is a tuple of numbers that becomes one array, and not a group of results."""
    return isinstance(x, tuple) and type(x) in (tuple, Vector) and all(map(numbers.is_number, x))


class JointsOfKind:
    """All joints of one kind that are no mimics, in a state."""

    def __init__(self, state: MechanismState, bundle: Bundle):
        self.state, self.bundle, self.kind = state, bundle, bundle.kind

    def coordinates(self, array: Array) -> Numbers:
        return self.state.coordinates(self.bundle, array)

    def configuration(self, q: Array) -> Numbers:
        return self.state.configuration(self.bundle, q)

    def velocities(self, array: Array) -> Numbers:
        return self.state.velocities(self.bundle, array)

    def part_of(self, array: Array, over_velocities: bool = True) -> Array:
        """The rows of these joints in an array over velocities, or over coordinates."""
        t = self.state.topology
        slices = ((t.v_slice if over_velocities else t.q_slice)(i) for i in self.bundle.own_bodies)
        return stacking.rows(array, np.concatenate([np.arange(s.start, s.stop) for s in slices]))

    @property
    def joint(self) -> JointKind:
        return self.state.joint(self.bundle)

    def apply(self, method: str, *others):
        """Calls a method of the joint kind with the coordinates and other arguments, such as velocities and a time."""
        q = self.configuration(self.state.q)
        return getattr(self.kind, method)(self.joint, q, *others)

    def cos_sin(self, q: Numbers) -> CosSin:
        """The cosines and sines of its angles, if the rates of its coordinates need them."""
        return {k: cosine_sine(q[k]) for k in self.kind.angles} if self.kind.rates_need_angles else {}

    def dq_dt(self, *velocities: Numbers) -> list[Numbers]:
        """dq/dt at each of several velocities; the rate of a quaternion is proportional to its length."""
        q, n = self.coordinates(self.state.q), self.kind.sphere[0]
        cos_sin = self.cos_sin(q)
        rates = [self.joint.rates(q, cos_sin, v) for v in velocities]
        if not n:
            return rates
        unit = self.configuration(self.state.q)
        return [(*x[:n], *self.joint.rates(unit, cos_sin, v)[n:]) for x, v in zip(rates, velocities, strict=True)]

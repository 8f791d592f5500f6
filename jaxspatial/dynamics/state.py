"""A mechanism at its coordinates: its numbers, bundle by bundle, to compute with.

A number of a bundle is known, the same for all its bodies, or an array (L, W, B): L bodies along each of W chains, for
B states, with size 1 where it is the same for all. Axes along one of their frame's are turned to z here, which is
exact: frames, inertias and placements with them.
"""

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.arithmetic import check, numbers, vectors
from jaxspatial.arithmetic.functions import cosine_sine
from jaxspatial.arithmetic.numbers import Motion, Number, Numbers, Rows, Symmetric, Three
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.dynamics import along
from jaxspatial.dynamics.along import Array, Maybe
from jaxspatial.dynamics.results import Results
from jaxspatial.mechanism.joints import JointKind, Parameter
from jaxspatial.mechanism.joints.form import CosSin
from jaxspatial.mechanism.topology import Bundle, Topology


class Pose(NamedTuple):
    """(R by its rows, p)."""

    rows: Rows
    p: Three


class Inertia(NamedTuple):
    """Of a body about its J, as SpatialInertia has it."""

    mass: Number
    com: Three
    central: Symmetric


class JointState(NamedTuple):
    """A joint at its coordinates."""

    kind: JointKind
    q: Numbers
    cos_sin: CosSin

    @property
    def transform(self):
        return Pose(*self.kind.transform(self.q, self.cos_sin))

    @property
    def subspace(self) -> tuple[Motion, ...]:
        return self.kind.motion_subspace(self.cos_sin)

    def subspace_rate(self, v: Numbers) -> tuple[Motion, ...]:
        return self.kind.motion_subspace_rate(self.cos_sin, v)


class Link(NamedTuple):
    """A body and the joint that carries it. v: rates of the joint; vdot: their derivatives;
    tau: the generalized forces."""

    placement: Pose
    joint: JointState
    inertia: Inertia
    v: Numbers
    vdot: Numbers
    tau: Numbers
    armature: Numbers


# (tau, f) on a body about its J, and what else adds up with these, see `loads`.
Load = tuple[Three, Three, Any]


class MechanismState(Results):
    """The fields of a mechanism by name, NumPy or data (n, ..., B), and q (nq, B)."""

    def __init__(
        self, topology: Topology, fields: dict[str, Any], q: Array, n: int, precision: Precision, dtype: DTypeLike
    ):
        super().__init__(topology, fields, n, precision, dtype)
        self.q = q

    @property
    def kind_states(self):
        """The joints that are no mimics, kind by kind."""
        return [KindState(self, bundle) for bundle in self.topology.joints_by_kind]

    # -- numbers ------------------------------------------------------------------------------------------------------

    @property
    def no_vector(self) -> tuple[Number, Number, Number]:
        zero = self.known(0.0)
        return zero, zero, zero

    @property
    def no_inertia(self):
        return Inertia(self.known(0.0), self.no_vector, self.no_vector * 2)

    def of(self, bundle: Bundle, array: Array):
        """The numbers of a bundle in an array over all bodies: NumPy (n, k), or data (n, k, B)."""
        return self.numbers(along.rows(array, bundle.bodies))

    # -- coordinates --------------------------------------------------------------------------------------------------

    def coordinates(self, bundle: Bundle, array: Array, of_rates: bool = False) -> Numbers:
        """The numbers of a bundle in q, or in an array over rates. Those of mimics follow."""
        t, size = self.topology, bundle.kind.nv if of_rates else bundle.kind.nq
        if not size:
            return ()
        starts = np.array(t.v_starts if of_rates else t.q_starts)[bundle.bodies]
        found = self.numbers(along.rows(array, starts[..., None] + np.arange(size)))
        if not t.has_mimics_in(bundle):
            return found
        multiplier, offset = self.of(bundle, self.fields["mimics"])
        return tuple(multiplier * x if of_rates else multiplier * x + offset for x in found)

    def configuration(self, bundle: Bundle, q: Array) -> Numbers:
        """The numbers of a bundle in q, with those of a sphere at unit length: NaN for length 0.

        Those known to be so, to rounding, stay as they are: rotations are those of their directions all the same, see
        `quaternion.to_matrix`.
        """
        found, n = self.coordinates(bundle, q), bundle.kind.sphere[0]
        if not n or self._has_unit_lengths(bundle, q):
            return found
        return *numbers.noinline(vectors.unit)(found[:n]), *found[n:]

    def _has_unit_lengths(self, bundle: Bundle, q: Array):
        if not isinstance(q, np.ndarray):
            return False
        starts = np.array(self.topology.q_starts)[bundle.bodies]
        on_sphere = q[starts[..., None] + np.arange(bundle.kind.sphere[0])].astype(np.float64)
        with np.errstate(over="ignore"):
            return bool((abs((on_sphere**2).sum(-1) - 1) <= 2 * check.eps(self.dtype)).all())

    def rates(self, bundle: Bundle, array: Maybe) -> Numbers:
        """The numbers of a bundle in an array over rates; known zeros for None."""
        if array is None:
            return (self.known(0.0),) * bundle.kind.nv
        return self.coordinates(bundle, array, of_rates=True)

    def armature(self, bundle: Bundle) -> Numbers:
        """Zeros for mimics: their share is with the joint that they follow, see `mechanism.assembly`."""
        t, n = self.topology, bundle.kind.nv
        if not n:
            return ()
        starts = np.array(t.v_starts)[bundle.bodies]
        own = along.rows(self.fields["armature"], starts[..., None] + np.arange(n))
        if t.has_mimics_in(bundle):
            is_own = ~np.vectorize(t.is_mimic)(bundle.bodies)
            shape = (*is_own.shape, 1, *[1] * (own.ndim - 3))
            own = own * is_own.reshape(shape).astype(own.dtype)
        return self.numbers(own)

    # -- bundles ------------------------------------------------------------------------------------------------------

    def joint(self, bundle: Bundle) -> JointKind:
        """Its joints, with the numbers that they are made with."""

        def numbers_of(p: Parameter):
            found = self.of(bundle, self.fields[p.field] if p.field else self.fields["parameters"][p.name])
            return found if p.size > 1 else found[0]

        return bundle.kind(numbers_of, self.known(0.0))

    def placement(self, bundle: Bundle):
        return self._pose(self.fields["placements"], bundle.bodies)

    def child_placement(self, bundle: Bundle):
        return self._pose(self.fields["child_placements"], bundle.bodies)

    def frame_placement(self, frame: int):
        """X_JF of one of the named frames, as numbers (1, B)."""
        return self._pose(self.fields["frame_placements"], np.array([frame]))

    def _pose(self, transforms: tuple[Array, Array], places: np.ndarray):
        entries, p = (along.rows(x, places) for x in transforms)
        return Pose(vectors.rows(self.numbers(self._without_dust(entries))), self.numbers(p))

    def _without_dust(self, entries: Array) -> Array:
        """Known entries that are no zeros only by the digits of a file (of quarter turns, 5e-12) are, where q has so
        few digits that it makes no difference in any precision: 2^-12 u."""
        if not isinstance(entries, np.ndarray):
            return entries
        is_dust = abs(entries) < check.eps(self.dtype) * 2.0**-13
        return np.where(is_dust, 0, entries).astype(entries.dtype)

    def inertia(self, bundle: Bundle):
        (mass,), com, central = (self.of(bundle, x) for x in self.fields["inertias"])
        return Inertia(mass, com, central)

    def links(self, v: Maybe = None, vdot: Maybe = None, tau: Maybe = None):
        """The Link of every bundle; known zeros for None, and for what the algorithm does not read."""
        return [
            Link(
                self.placement(b),
                joint,
                self.inertia(b) if "inertias" in self.fields else self.no_inertia,
                self.rates(b, v),
                self.rates(b, vdot),
                self.rates(b, tau),
                self.armature(b) if "armature" in self.fields else self.rates(b, None),
            )
            for b, joint in zip(self.bundles, self.joints, strict=True)
        ]

    @functools.cached_property
    def joints(self):
        """The JointState of every bundle, with the cosines and sines of all angles computed in one call."""
        q = [self.configuration(b, self.q) for b in self.bundles]
        found = self._cos_sin([x[k] for x, b in zip(q, self.bundles, strict=True) for k in b.kind.angles])
        return [
            JointState(self.joint(b), x, {k: next(found) for k in b.kind.angles})
            for b, x in zip(self.bundles, q, strict=True)
        ]

    def _cos_sin(self, angles: Numbers) -> Iterator[Any]:
        """(cosine, sine) of each, those of data in one call: within other formulas they would keep XLA CPU from
        vectorising these."""
        data = [x for x in angles if not numbers.is_constant(x)]
        found = iter(along.split(cosine_sine, data) if data else ())
        return (cosine_sine(x) if numbers.is_constant(x) else next(found) for x in angles)


class KindState:
    """The joints of one kind that have coordinates of their own, side by side."""

    def __init__(self, state: MechanismState, bundle: Bundle):
        self.state, self.bundle, self.kind = state, bundle, bundle.kind

    def coordinates(self, array: Array):
        return self.state.coordinates(self.bundle, array)

    def configuration(self, q: Array):
        return self.state.configuration(self.bundle, q)

    def rates(self, array: Array):
        return self.state.coordinates(self.bundle, array, of_rates=True)

    def rows(self, array: Array, of_rates: bool = True):
        """What an array over rates, or coordinates, has for them: to see what is known of it."""
        t = self.state.topology
        slices = ((t.v_slice if of_rates else t.q_slice)(i) for i in self.bundle.own_bodies)
        return along.rows(array, np.concatenate([np.arange(s.start, s.stop) for s in slices]))

    @property
    def joint(self):
        return self.state.joint(self.bundle)

    def apply(self, verb: str, *others: Any) -> Any:
        """A verb of the kind, of its coordinates and others, a step, or rates and a time."""
        q = self.configuration(self.state.q)
        return numbers.noinline(getattr(self.kind, verb))(self.joint, q, *others)

    def cos_sin(self, q: Numbers) -> CosSin:
        """Of its angles, for the rates of its coordinates."""
        return {k: cosine_sine(q[k]) for k in self.kind.angles} if self.kind.rates_need_angles else {}

    @property
    def has_rates_of_coordinates(self):
        """Whether rates are the coordinates' own."""
        return self.kind.nq == self.kind.nv and not self.kind.rates_need_angles

    def dq_dt(self, *rates: Numbers) -> list[Numbers]:
        """dq/dt of each of several rates: of a quaternion in proportion to its length."""
        q, n = self.coordinates(self.state.q), self.kind.sphere[0]
        cos_sin = self.cos_sin(q)
        found = [self.joint.rates(q, cos_sin, v) for v in rates]
        if not n:
            return found
        unit = self.configuration(self.state.q)
        return [(*x[:n], *self.joint.rates(unit, cos_sin, v)[n:]) for x, v in zip(found, rates, strict=True)]

    def dq_dt_of_units(self):
        """dq/dt of each rate alone, at one."""
        n = range(self.kind.nv)
        return self.dq_dt(*(tuple(self.state.known(float(i == k)) for i in n) for k in n))

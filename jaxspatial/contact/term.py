"""What a term of the convex step is: a law of impulses, and where these act on a mechanism.

    v+ = argmin |v - v*|^2_A / 2 + sum l_i(J_i v)

A Term is one family of the l_i, such as all contacts. It stands for m impulses gamma = -dl/du at the velocities
u = J v, and for their derivative G = -dgamma/du, which is never negative. `newton` solves the problem for a tuple of
Terms, of which it knows what this file says and nothing else.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.numerics.linear import Motion, Wrench
from jaxspatial.numerics.numbers import Mask, Number, high, where
from jaxspatial.spatial import SpatialForce

if TYPE_CHECKING:
    from jaxspatial.contact.world import World

T = TypeVar("T")
# Velocities, and impulses, of a term: trees of numbers (m, B), one number or a Vector for each; and its G.
U = TypeVar("U")
GType = TypeVar("GType")

# Drake's numbers: how much softer than rigid terms are in the near-rigid regime, in units of the Delassus operator
# J D^-1 J^T, with D the diagonal of A: contacts along the normal, what sticks, and limits and closures.
NEAR_RIGID, STICKING, NEAR_RIGID_LIMIT = 1.0 / (4 * np.pi**2), 1e-3, 0.1**2 / (4 * np.pi**2)


class StepData(NamedTuple):
    """What programs read of a step, as arrays. v0 (*batch, nv): the velocities at its start, along axes that do not
    turn. y_free (*batch, nv): by which they change without impulses. dt (*batch, 1). term_data: one for each Term."""

    v0: Array
    y_free: Array
    dt: Array
    term_data: tuple["TermData", ...]


class TermData:
    """The arrays (*batch, k) of a term. Subclasses are pytrees, in which the numbers of frames are static."""

    @property
    def result_size(self) -> int:
        """How many numbers of impulses the step returns; 0 for a term that is no part of its result."""
        return 0

    def to_term(self, world: "World", step: StepData) -> "Term":
        """The Term of all states of a program, in which the mechanism is the world."""
        raise NotImplementedError

    def wrenches(self, forces: jax.Array) -> SpatialForce:
        """What the step returns: of impulses over dt (*batch, size)."""
        raise NotImplementedError


class OnBodies(NamedTuple):
    """Wrenches (n, B), or other trees of numbers, of n bodies, about their origins in world axes; -1 is the world."""

    bodies: tuple[int, ...]
    numbers: Any


class Columns(NamedTuple):
    """k rows of L^T J, with G = L L^T: the wrenches (k, B) that they put on bodies b and a, about the origins of these
    in world axes, and the forces (k, nv, B) on generalized velocities, None for none."""

    b: tuple[int, ...]
    a: tuple[int, ...]
    on_b: Wrench
    on_a: Wrench
    on_joints: Number | None = None


class Term(Generic[U, GType]):
    """m impulses on a mechanism. Subclasses are pytrees of numbers (m, B).

    A velocity u, and an impulse, is a tree of numbers (m, B): one number for each, or a Vector. G is what `times_G`
    takes.

    J^T G J is added to A, and how depends on where a term acts. On one body it is an inertia, see `inertia`. On the
    velocity of one joint it is an armature, see `single_velocities`. Between bodies or joints it is
    equations that are solved beside the tree, see `columns`. A subclass writes those of the three that it needs.

    is_stiff: whether G is so large that impulse - G J x, for a direction x, would be a difference of large numbers.
    Newton's method then finds it in another way. It is for `Rows` alone, whose G is diagonal.
    throws: whether impulses may throw bodies far in the first direction. No contact is then taken to stick there.
    rounding_share: rounding errors, in eps, of what the law is given, see `rounding`.
    """

    is_stiff = throws = False
    rounding_share = 0.0

    @property
    def count(self) -> int:
        """m."""
        raise NotImplementedError

    def each(self, function: Callable[..., T], *numbers) -> T:
        """function(self, *numbers), whose results are trees of numbers (m, B): how Newton's method calls what follows.

        Contacts call it for those between the same two bodies at a time, and skip those of which none touches: their
        results are zero."""
        return function(self, *numbers)

    # -- the law ------------------------------------------------------------------------------------------------------

    def law(self, u: U, held: Mask | None = None) -> tuple[U, GType]:
        """(the impulses at velocities u, G there). held: impulses whose law is taken for linear, wherever u is."""
        raise NotImplementedError

    def times_G(self, G: GType, u: U) -> U:
        """G u."""
        raise NotImplementedError

    def product(self, impulse: U, u: U) -> Number:
        """impulse . u of each, (m, B)."""
        raise NotImplementedError

    def bound(self, G: GType, x: U) -> Number:
        """At least x . G^-1 x of impulses x; infinite where x has a part in which G is zero."""
        raise NotImplementedError

    def magnitude(self, u: U) -> U:
        """How large the velocities are that the law at u takes differences of: the size of its rounding errors."""
        raise NotImplementedError

    def acts(self) -> jax.Array:
        """Which impulses may be other than zero, (m, B) or (1, 1)."""
        raise NotImplementedError

    def held(self, *velocities: U) -> Mask:
        """Which laws the first direction takes for linear, from the velocities J v0 and J y_free."""
        return jnp.zeros((1, 1), bool)

    def rounding(self, G: GType, u: U) -> Number:
        """What an error of 1 in what the law is given, such as distances, adds to g^T H^-1 g, with g the gradient. For
        a `rounding_share` above 0."""
        raise NotImplementedError

    # -- the mechanism ------------------------------------------------------------------------------------------------

    def velocities(self, world: "World", motions: list[Motion], v: Number) -> U:
        """J v, of generalized velocities v (nv, B), at which the bodies of every bundle have these motions."""
        raise NotImplementedError

    def on_bodies(self, impulse: U) -> list[OnBodies]:
        """The wrenches of J^T impulse."""
        return []

    def on_joints(self, world: "World", impulse: U) -> Number | None:
        """The generalized forces (nv, B) of J^T impulse beside these wrenches."""
        return None

    def inertia(self, G: GType) -> list[OnBodies]:
        """J^T G J of what acts on single bodies, as Articulated inertias."""
        return []

    def single_velocities(self) -> np.ndarray | None:
        """The numbers (m,) of the velocities on which the impulses act, each on one: G adds to its armature. No two
        terms may act on one velocity in this way. None for a term that acts in another."""
        return None

    def columns(self, world: "World", G: GType) -> list[Columns]:
        """L^T J of what acts between bodies; of a term that is_stiff, those of all impulses in their order."""
        return []

    # -- results ------------------------------------------------------------------------------------------------------

    def results(self, state: MechanismState, impulse: U) -> list[jax.Array]:
        """The impulses as arrays (k, B), of a term whose impulses are part of what the step returns."""
        return []


class Rows(Term[Number, Number]):
    """A Term whose velocities and impulses are numbers (m, B), each on a row of J of its own: G is diagonal.

    One that has columns declares R, how much an impulse changes its velocity: 1 / G where G is not zero.
    """

    is_stiff = True
    R: Number

    def times_G(self, G: Number, u: Number) -> Number:
        return G * u

    def product(self, impulse: Number, u: Number) -> Number:
        return impulse * u

    def bound(self, G: Number, x: Number) -> Number:
        has_G = high(G) > 0
        return where(has_G | (high(x) == 0), x * x / where(has_G, G, 1.0), np.inf)

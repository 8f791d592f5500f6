"""A step in time with contact, friction, limits and closed loops: one convex problem, solved by articulated bodies.

What acts is a tuple of terms: contacts, what stands in the mechanism (`OF_MECHANISM`), and closures.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.contact import newton
from jaxspatial.contact.closures import are_of_one_body, checked_closures, closure_data, require_closable
from jaxspatial.contact.geometry import (
    Ground,
    Pairs,
    calls_functions,
    carriers,
    checked_contacts,
    checked_ground,
    checked_pairs,
)
from jaxspatial.contact.joints import joint_data
from jaxspatial.contact.points import contact_data
from jaxspatial.contact.tendons import ball_data, tendon_data
from jaxspatial.contact.term import StepData, TermData
from jaxspatial.dynamics import steps
from jaxspatial.engine.algorithm import ExternalForces, checked
from jaxspatial.engine.composite import composite
from jaxspatial.engine.derivatives import valued
from jaxspatial.engine.stacking import Array
from jaxspatial.mechanism import LoopClosure, Mechanism, PointContacts, ShapeContacts
from jaxspatial.mechanism.shapes import Shape
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.errorfree.barrier import quotient
from jaxspatial.numerics.floats import is_nothing
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce

T = TypeVar("T")
State = tuple[jax.Array, jax.Array, jax.Array]  # q, v, tau


@exported
class ConvexStep(NamedTuple):
    """The state after a `convex_step`, and how it was found.

    q: (*batch, nq), quaternions of unit length. v: (*batch, nv).
    contact_forces: SpatialForce (*batch, n), on the body of each contact, about the contact point C, in world axes:
        impulse over dt, N; None without contacts. Those of `contacts` come first, then those of `pairs` (a, b),
        on the bodies of b.
    loop_wrenches: SpatialForce (*batch, number of closures), of each closure on the body of its frame B, about the
        origin of B, in world axes: impulse over dt, N m and N; None without closures.
    residual: (*batch,) how far v is from the optimum: the decrement sqrt(g^T H^-1 g), with g the gradient and H the
        Hessian of the cost, relative to the momenta sqrt(v^T A v + y^T A y), with y the change of v without contact.
        Both are evaluated anew at the v that is returned, g by Newton and Euler from tau, the external forces and the
        impulses. Added is what rounding errors make of it: eps / 4 of velocities, eps / 8 of the positions along the
        chain of bodies that carries a contact, eps of those of a closure, and 4 eps of the momenta. 0 where nothing
        acts. It costs about an iteration; in a jitted function that does not return it, nothing.
        Of random mechanisms with contacts, limits, dry friction and closures, in float32 and in float64, the true
        decrement, by dense matrices in float64, was at most twice the residual, if that is below 1. Above 1 a step is
        nowhere near the optimum. Masses or stiffnesses that lie six decades apart are too much for the digits of
        float32. Of such states the residual is above 2e-4 in one of five, and in one of three if there are limits, too.
        For one in five of them the true decrement is more than twice the residual: whether a contact touches is a
        matter of rounding, for example.
    iterations: (*batch,) of Newton's method, at most 60; 0 where nothing acts.

    Example:
        >>> after = js.convex_step(arm, q, v, tau, 1e-3)
        >>> print(after.q, after.v, after.contact_forces)
        [ 0.501  -0.1995] [0.9955 0.5101] None
    """

    q: jax.Array
    v: jax.Array
    contact_forces: SpatialForce | None
    loop_wrenches: SpatialForce | None
    residual: jax.Array
    iterations: jax.Array


@promises(bound=steps.SEMI_IMPLICIT)
def convex_step(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    contacts: PointContacts | None = None,
    ground: Ground | None = None,
    pairs: Pairs | None = None,
    loops: Iterable[LoopClosure] = (),
    precision: PrecisionName = None,
) -> ConvexStep:
    """A step of semi-implicit Euler with contact, dry friction, limits of joints and closed loops, as a convex problem.

        v' = argmin |v' - v*|^2_A / 2 + sum l_i(J_i v')        q' = integrate(q, v', dt)

    A is the mass matrix with implicit damping, v* the velocities of `semi_implicit_step` without contact. Each contact
    inside the ground, each limit nearby and each dry friction adds a convex term l_i, whose derivative is its impulse.
    Contact i pushes along the normal with k (x' - tau_d v_n'), never below zero: a spring and a damper at the depth x'
    and the velocity v_n' after the step. Its friction is inside the cone |f_t| <= mu f_n.

    What is not contact acts as in `semi_implicit_step`, without its regularised friction; where nothing touches, the
    result has its bits, and without contacts, limits and dry friction it is that step. Limits act on joints of one
    coordinate, on the lengths of tendons, and on the angles of "ball" joints. Two equal limits hold a number from both
    sides: each step halves what it is off. Limits and dry friction are as hard as the time step allows: a joint at rest
    under less than its friction creeps by at most 1e-3 of the velocity that its impulse would cause alone.

    How hard contacts are is a share of w, the size of the operator J D^-1 J^T of their points, with D the diagonal of
    A. It depends on the axes of velocities: those of a floating root are taken along the axes of the world, as in
    Drake.

    Friction that slides lifts a body by dt' mu |v_t|, with dt' = dt + tau_d, if that is more than its depth: an
    artefact of convexity. Contacts that are found outside of the ground do nothing in this step, however fast they
    approach.

    Loop closures are as stiff as the time step allows, too: each is an impulse (v_c - v_i) / R, with v_c the velocity
    that closes it within this step, and R a share of 2.5e-4 of what an impulse moves. Start with closed loops, see
    `close_loops`. Closures may be redundant. One between frames of the same body, or of the world, asks for nothing,
    and its wrench is zero; open ones, which can never close, are refused where their numbers are known while tracing,
    and `constraint_error` tells of others. Closures, contacts between two bodies, and limits of tendons
    and of balls cost a system of as many unknowns as they have rows, 3 for a contact. With mimics each iteration solves
    one system of all velocities and of the rows of limits, dry friction and closures.

    Derivatives of any order are those of the optimum, by the implicit function theorem: with the same solver, through
    sticking, sliding and flight. Where a contact begins to touch, stick or slide, they are those of one side.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints, which do not change within the step: N m, N. A damper -c v
            in tau is stable only while dt c is below twice the inertia that the joint moves. As the `damping` of the
            joint it is stable for every c.
        dt: the time, s: a number or (*batch,).
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        contacts: PointContacts on frames of moving bodies; None for none.
        ground: HalfSpace, HeightField or another shape, whose normals and distances count; or a function f from a point
            (3,) in world axes to a number (): zero on the surface of the ground, above zero outside. Its gradient is
            the direction out of the ground, and the distance is f / |grad f|: a height z - h(x, y) does. That is exact
            for planes of any slope and for signed distances, and else to first order. Where the gradient is zero or not
            finite there is no normal, and the result is NaN, outside of the ground too. None is the plane z = 0.
        pairs: (a, b): two PointContacts, of which sphere i of one touches sphere i of the other, on another body; or
            ShapeContacts and PointContacts, of which sphere i touches the shape on frame i. One of the two frames may
            be of the world, such as that of a table that is welded to it. None for none. Both surfaces give way:
            stiffnesses act in series, relaxation times add up, and friction is 2 mu mu' / (mu + mu'). The contact point
            is between the surfaces, as far from each as it gives way. Of spheres with one centre that of b is pushed
            along z of the world, with the derivatives of a plane across z; inside a shape along its normal, see there.
        loops: LoopClosures, such as `mechanism.loops`.
        precision: name of a precision; None takes the default.

    Returns:
        ConvexStep over the common batch. What turns by more than some 1 / u rad in the step is NaN, see `integrate`.

    Raises:
        ValueError: a closure between frames of the same body, or of the world, is open, by numbers that are known while
            tracing.

    Error: of v at most 2 u (|v| + dt |vdot|) and dt times that of `forward_dynamics`, and what the residual says: the
        distance from the optimum, in the norm of A, is about residual^2 of sqrt(v^T A v + y^T A y), see `ConvexStep`.
        The iteration has the precision of the dtype: what touches is rounded as in "reproducible" in every precision.
        Where impulses work against one another, such as those of a closure and a limit, momenta have in addition errors
        of 10^4 u of the largest impulse. Of those of closures the residual has an estimate, of others it has not. If
        anything may act, float16 and bfloat16 are computed by way of float32, and rounded once; a function for the
        ground sees points of 16 bits.
    Source: Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant contact; Featherstone 2008,
        table 7.1; Drake 1.51, SapDriver, whose numbers these are.

    Example:
        >>> tip = js.PointContacts(["hand"], stiffness=1e4, relaxation_time=0.01, friction=0.8)
        >>> floor = js.HalfSpace(jnp.array([0.0, 0.0, 1.0]), jnp.array(-1.96875))  # 1/32 m above the hand
        >>> after = js.convex_step(arm, 0 * q, 0 * v, tau, 1e-3, contacts=tip, ground=floor)
        >>> print(after.contact_forces.f)
        [[  0.6074   0.     312.5   ]]
    """
    at_q, at_v, at_tau, h, forces = checked(
        "convex_step", mechanism, q=q, v=v, tau=tau, dt=dt, external_forces=external_forces
    )
    at, dtype = (at_q, at_v, at_tau), at_q.dtype
    given = _checked(mechanism, at_q, contacts, ground, pairs, loops)
    is_free = given.contacts is None and given.pairs is None and not given.movable(mechanism)
    if not is_free or _of_mechanism(mechanism, dtype):
        return _step(mechanism, at, h, forces, given, precision)
    batch = floats.broadcast_shapes(*(x.shape[:-1] for x in (*at, h, *jax.tree.leaves(forces))), given.batch_shape)
    next_q, next_v = steps.semi_implicit_step(mechanism, *at, dt, forces, precision=precision)
    # Known zeros leave no operation behind.
    zeros = floats.numpy_for(batch).zeros
    residual, iterations = cast(Any, (zeros(batch, dtype), zeros(batch, np.int32)))
    wrenches = given.loop_wrenches(mechanism, None, batch, dtype)
    return ConvexStep(next_q, next_v, None, wrenches, residual, iterations)


class _ContactsAndLoops(NamedTuple):
    """What acts on a mechanism beside its own limits, as a caller passes it, checked; None or empty where there is
    nothing. distances: (*batch, 1) of closures."""

    contacts: PointContacts | None
    ground: Ground
    pairs: Pairs | None
    closures: tuple[LoopClosure, ...]
    distances: Sequence[Array | None]

    @property
    def batch_shape(self) -> tuple[int, ...]:
        ground = self.ground if isinstance(self.ground, Shape) else None
        of_contacts = [x.batch_shape for x in (self.contacts, ground, *(self.pairs or ())) if x is not None]
        return floats.broadcast_shapes(*of_contacts, *(d.shape[:-1] for d in self.distances if d is not None))

    @property
    def calls_functions(self) -> bool:
        """Whether a caller's function is a part of the ground or of a shape."""
        of_pairs = (x.shape.calls_functions for x in self.pairs or () if isinstance(x, ShapeContacts))
        return calls_functions(self.ground) or any(of_pairs)

    def movable(self, mechanism: Mechanism) -> list[int]:
        """The closures that something can move."""
        return [k for k, x in enumerate(self.closures) if not are_of_one_body(mechanism, x)]

    def term_data(self, mechanism: Mechanism, q: jax.Array, precision: PrecisionName) -> dict[str, TermData]:
        """The data of all terms that may act, by name, those of the mechanism among them."""
        found, movable = dict[str, TermData](), self.movable(mechanism)
        contacts = contact_data(mechanism, q, self.contacts, self.ground, self.pairs, precision)
        if contacts is not None:
            found["contacts"] = contacts
        found |= _of_mechanism(mechanism, q.dtype)
        if movable:
            closures, distances = tuple(self.closures[k] for k in movable), [self.distances[k] for k in movable]
            found["closures"] = closure_data(mechanism, q, closures, distances, precision)
        return found

    def loop_wrenches(
        self, mechanism: Mechanism, of_movable: SpatialForce | None, batch: tuple[int, ...], dtype: np.dtype
    ) -> SpatialForce | None:
        """Those of all closures: zero where nothing moves; None without closures."""
        movable, n = self.movable(mechanism), len(self.closures)
        if len(movable) == n:
            return of_movable
        zero = jnp.zeros((*batch, n, 3), dtype)
        if of_movable is None:
            return SpatialForce(zero, zero)
        return SpatialForce(*(zero.at[..., np.array(movable), :].set(x) for x in (of_movable.tau, of_movable.f)))


# The data of terms that stand in a mechanism, by name: functions of the mechanism and of a dtype, None where nothing
# acts. A new entry is read by the next program that is made. Rounding errors depend on the order.
OF_MECHANISM: dict[str, Callable[[Mechanism, np.dtype], TermData | None]] = {
    "joints": joint_data,
    "tendons": tendon_data,
    "balls": ball_data,
}


def _of_mechanism(mechanism: Mechanism, dtype: np.dtype) -> dict[str, TermData]:
    found = ((name, data(mechanism, dtype)) for name, data in OF_MECHANISM.items())
    return {name: x for name, x in found if x is not None}


def _checked(
    mechanism: Mechanism,
    q: jax.Array,
    contacts: PointContacts | None,
    ground: Ground | None,
    pairs: Pairs | None,
    loops: Iterable[LoopClosure],
) -> _ContactsAndLoops:
    what = "convex_step"
    ground = checked_ground(what, ground, q)
    if contacts is not None:
        contacts = checked_contacts(what, contacts)
        check.require_same_dtype(q=q, contacts=contacts)
        bodies = carriers(f"{what}: contacts: frames", mechanism, contacts)
        for frame, body in zip(contacts.frames, bodies, strict=True):
            if body < 0:
                got = f"{frame!r}, of the world, which pairs may have"
                raise ValueError(f"{what}: contacts: expected frames of moving bodies, got {got}")
    pairs = None if pairs is None else checked_pairs(what, mechanism, q, pairs)
    closures, distances = checked_closures(what, mechanism, loops, q.dtype)
    require_closable(what, mechanism, closures, distances, q.dtype)
    contacts = contacts if contacts is not None and contacts.frames else None
    return _ContactsAndLoops(contacts, ground, pairs, closures, distances)


def _step(
    mechanism: Mechanism,
    at: State,
    h: jax.Array,
    forces: ExternalForces,
    given: _ContactsAndLoops,
    precision: PrecisionName,
) -> ConvexStep:
    """`convex_step` of checked arguments, where something may act. h: dt as (*batch, 1)."""
    if at[0].dtype.itemsize == 2:
        return _by_way_of_float32(mechanism, at, h, forces, given, precision)
    return _convex_step(resolve(precision), (mechanism, given), at, h, forces)


@composite
def _convex_step(
    precision: Precision,
    scene: tuple[Mechanism, _ContactsAndLoops],
    at: State,
    h: jax.Array,
    forces: ExternalForces,
) -> ConvexStep:
    """`_step` of numbers of 32 or 64 bits."""
    (mechanism, given), (q, v, tau) = scene, at
    batch = floats.broadcast_shapes(*(x.shape[:-1] for x in (*at, h, *jax.tree.leaves(forces))), given.batch_shape)
    c = None if is_nothing(mechanism.damping) else jnp.asarray(mechanism.damping, q.dtype)
    v_free, turning, vdot, tau = steps.stepped_velocities(mechanism, at, h, c, forces, None, precision)
    v0 = steps.without_accelerations(precision, v, h, turning)

    v_free, v0, vdot, wide_h = (jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in (v_free, v0, vdot, h))
    data = given.term_data(mechanism, q, precision)
    step = StepData(v0, lax.stop_gradient(wide_h * vdot), wide_h, tuple(data.values()))
    problem = _Problem(mechanism, q, step, v, tau, forces)
    # The iteration has numbers of one limb.
    narrow = precision.of_one_limb
    y, residual, iterations = problem.at_optimum(narrow)
    acts = jnp.broadcast_to((iterations > 0)[..., None], y.shape)
    after = valued(v0 + y, lax.stop_gradient(jnp.where(acts, v0 + y, v_free)))
    forces_of = dict(zip(data, problem.wrenches(narrow, y), strict=True))
    next_q, next_v = steps.moved(mechanism, q, after, h[..., 0], precision)
    wrenches = given.loop_wrenches(mechanism, forces_of.get("closures"), batch, q.dtype)
    return ConvexStep(next_q, next_v, forces_of.get("contacts"), wrenches, residual, iterations)


def _by_way_of_float32(
    mechanism: Mechanism,
    at: State,
    h: jax.Array,
    forces: ExternalForces,
    given: _ContactsAndLoops,
    precision: PrecisionName,
) -> ConvexStep:
    """`_step` of 16 bits. A function for the ground sees points of 16 bits, and returns them."""
    narrow, wide, ground = at[0].dtype, np.dtype(np.float32), given.ground
    at, h, forces, given = _with_dtype((at, h, forces, given), narrow, wide)
    mechanism = mechanism.in_float32
    if not isinstance(ground, Shape):
        given = given._replace(ground=lambda p: jnp.asarray(ground(p.astype(narrow))).astype(wide))
    return _with_dtype(_step(mechanism, at, h, forces, given, precision), wide, narrow)


def _with_dtype(tree: T, old: np.dtype, new: np.dtype) -> T:
    """The tree with its arrays of one dtype rounded to another. NumPy stays NumPy."""
    return jax.tree.map(lambda x: x.astype(new) if getattr(x, "dtype", None) == old else x, tree)


class _Problem(NamedTuple):
    """What the programs of `newton` take."""

    mechanism: Mechanism
    q: jax.Array
    step: StepData
    v: jax.Array
    tau: jax.Array
    forces: ExternalForces

    def at_optimum(self, precision: Precision) -> tuple[jax.Array, jax.Array, jax.Array]:
        """(the change of velocities, the residual, the iterations); derivatives by the implicit function theorem."""

        # JAX keeps the rule below with the caller's trace, so it holds no array: those of this trace would leak.
        known = self._with_data(lambda _: object())

        def problem_of(data: Sequence[jax.Array]) -> "_Problem":
            rest = iter(data)
            return known._with_data(lambda _: next(rest))

        # A function of the numbers that are not known alone: what JAX calls with them, it makes data of.
        @jax.custom_jvp
        def optimum(*data: jax.Array) -> tuple[jax.Array, jax.Array]:
            own = problem_of(data)._with_data(lax.stop_gradient)
            return newton.solve(precision, own.mechanism, own.q, own.step)

        @optimum.defjvp
        def _(primals, tangents) -> Any:
            y, iterations = optimum(*primals)
            _, force = jax.jvp(lambda *data: problem_of(data)._imbalance(precision, y), primals, tangents)
            change = problem_of(primals)._times_inverse(precision, y, -force)
            return (y, iterations), (change, np.zeros(iterations.shape, jax.dtypes.float0))

        y, iterations = optimum(*filter(_is_data, jax.tree.leaves(self)))
        fixed = self._with_data(lax.stop_gradient)
        residual = newton.residual(precision, *fixed._compared(lax.stop_gradient(y)))
        return y, residual[..., 0], iterations[..., 0]

    def _with_data(self, function: Callable[[Any], Any]) -> "_Problem":
        """With function(x) in place of each array x that is not known.

        A field that is known stays the object it is: with a mechanism live the programs that were made for it.
        """

        fields = list[Any](self)
        for k, tree in enumerate(fields):
            if any(map(_is_data, jax.tree.leaves(tree))):
                fields[k] = jax.tree.map(lambda x: function(x) if _is_data(x) else x, tree)
        return _Problem(*fields)

    def _compared(self, y: jax.Array) -> tuple[Any, ...]:
        """What programs take that compare forces, for a change y of the velocities."""
        vdot = quotient(y, jnp.broadcast_to(self.step.dt, y.shape))
        return self.mechanism, self.q, self.step, y, self.v, vdot, self.tau, self.forces

    def _imbalance(self, precision: Precision, y: jax.Array) -> jax.Array:
        return newton.imbalance(precision, *self._compared(y))

    def _times_inverse(self, precision: Precision, y: jax.Array, force: jax.Array) -> jax.Array:
        """H^-1 times a force, with H the derivative of the imbalance by y: with the factors of the iteration."""
        fixed = self._with_data(lax.stop_gradient)

        return lax.custom_linear_solve(
            lambda x: jax.jvp(lambda y: self._imbalance(precision, y), (y,), (x,))[1],
            force,
            lambda _, b: newton.solve_at(precision, fixed.mechanism, fixed.q, fixed.step, lax.stop_gradient(y), b),
            symmetric=True,
        )

    def wrenches(self, precision: Precision, y: jax.Array) -> list[SpatialForce | None]:
        """What the step returns of each term, for a change y of the velocities; None of those of which it has none."""
        data = self.step.term_data
        sizes = tuple(x.result_size for x in data if x.result_size)
        if not sizes:
            return [None] * len(data)
        impulses = newton.returned_impulses(precision, self.mechanism, self.q, self.step, y, sizes=sizes)
        forces = iter([quotient(x, jnp.broadcast_to(self.step.dt, x.shape)) for x in impulses])
        return [x.wrenches(next(forces)) if x.result_size else None for x in data]


def _is_data(x) -> bool:
    return not isinstance(x, np.ndarray)

"""Newton's method for the convex problem of a step, whatever its terms are.

With y = v - v0 the change of the velocities, y* = v* - v0 that without impulses, and y = (1 - r) y* + x, the gradient
is

    g = A (x - r y*) - sum J_i^T gamma_i,               r = 1, x = 0 at first

so that a direction d = r y* + e has the right side H e = sum J_i^T (gamma_i - r G_i J_i y*) - A x, and a step of length
a along it is r -> (1 - a) r, x -> x + a e. A x is summed from the momenta of bodies, which move at the velocities x, in
the pass that finds e: rounding errors of one direction are corrected by the next. A line search sees nothing but the
velocities of terms. [Castro, Permenter, Han 2022, 4]

The first direction is that of a linear problem: contacts that push at the velocities v0, or at y*, stick, even against
a pull and outside of the cone of friction. Its whole step is taken. Most often feet do stick, and the iteration ends; a
search from v0 would stop at the kink of each foot.
"""

import functools
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.contact.hessian import ByTerm, System, forces_on_joints, solve_hessian, system_of, wrenches_on_bodies
from jaxspatial.contact.term import StepData, Term
from jaxspatial.contact.world import Forces
from jaxspatial.dynamics.external_forces import loads
from jaxspatial.dynamics.newton_euler import forces_of
from jaxspatial.engine import stacking
from jaxspatial.engine.algorithm import DYNAMICS, FRAMES, Wrenches, algorithm, velocity_shape
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.numerics import floats
from jaxspatial.numerics.floats import is_nothing
from jaxspatial.numerics.linear import Motion, Vector, Wrench
from jaxspatial.numerics.numbers import Mask, Number, as_data, constant, data_of, high, is_number, where, with_data

T = TypeVar("T")
# How small, in the norm of H^-1, the gradient is beside the momenta, where Newton's method stops.
TOLERANCES = {4: 2e-6, 8: 1e-10}
MOST_ITERATIONS, MOST_TRIALS = 60, 20
# A line search stops where the slope is this share of the first one; it tries no step longer than this.
SLOPE, LONGEST = 0.1, 1.5
# Rounding errors of a derivative along a direction, in eps of the sum of the sizes of its summands.
NOISE = 8
# Rounding errors of velocities, in eps of the sizes of what they are sums of; and those of momenta.
OF_VELOCITIES, OF_MOMENTA = 0.25, 4.0
# The iteration also ends where the square of a decrement is more than STALLED times that of the last one, if it is
# within NEAR times the tolerance's, or NOISY times that of velocities' rounding errors: nothing else is left.
NEAR, NOISY, STALLED = 100, 10, 0.25
FIELDS = (*DYNAMICS, *FRAMES, "damping", "friction_loss", "lower", "upper", "turn_limits")


def _of_each(function: Callable[..., tuple[Any, ...]], terms: Sequence[Term], *numbers: ByTerm, **shared):
    """function(term, its numbers, **shared) of all terms: for each of the results a tuple over the terms."""
    function = functools.partial(function, **shared)
    found = [term.each(function, *own) for term, *own in zip(terms, *numbers, strict=True)]
    return zip(*found, strict=True)


def _sum_of(parts: Iterable[Number]) -> Number:
    """The sum of all numbers (rows, B), (1, B)."""
    return stacking.mapped(lambda w: w[None], functools.reduce(operator.add, map(stacking.pairwise_sum, parts)))


def _velocities(system: System, motions: list[Motion], v: Number) -> ByTerm:
    """J v of all terms."""
    return tuple(term.each(lambda own: own.velocities(system.world, motions, v)) for term in system.terms)


# -- programs ---------------------------------------------------------------------------------------------------------


class Free(NamedTuple):
    """Of y*: J y* of each term, and y* . A y*."""

    u_y: ByTerm
    energy: Number


class Scalars(NamedTuple):
    """Of an Iterate: over_free: y* . A x. lacking: r. decrement: g^T H^-1 g before the last step, or a bound of it
    after that. noise: what rounding errors of velocities make of it. Numbers (1, B)."""

    over_free: Number
    lacking: Number
    decrement: Number
    noise: Number


class Iterate(NamedTuple):
    """x: (nv, B), and the Motions of bodies that have these velocities. u: velocities of terms."""

    x: Number
    motions: list[Motion]
    u: ByTerm
    scalars: Scalars


class Constants(NamedTuple):
    """What all iterations read. smallest: the square of the gradient at which they end. held: see `Term`."""

    system: System
    free: Free
    smallest: Number
    held: tuple[Mask, ...]


@algorithm(*FIELDS)
def solve(state: MechanismState, step: StepData):
    """(y, iterations): the change of the velocities from `v0`, with y* = `y_free`.

    Where nothing acts there are no iterations, and y is `y_free`.
    """
    system = system_of(state, step)
    world, terms = system.world, system.terms
    v0, y_free = world.velocity_numbers(step.v0, step.y_free)
    motions = world.motions(v0, y_free)
    u, u_y = (_velocities(system, V, x) for V, x in zip(motions, (v0, y_free), strict=True))
    energy_v0, energy = (world.twice_energy(V, x) for V, x in zip(motions, (v0, y_free), strict=True))
    # One row for each velocity, also where all are the same.
    u = tuple(
        jax.tree.map(lambda x, m=term.count: as_data(x, (m, state.n)), own, is_leaf=is_number)
        for term, own in zip(terms, u, strict=True)
    )
    held = tuple(
        jnp.zeros((1, 1), bool) if any(x.throws for x in terms) else term.each(type(term).held, *own)
        for term, *own in zip(terms, u, u_y, strict=True)
    )
    smallest = (energy_v0 + energy) * TOLERANCES[state.dtype.itemsize] ** 2
    constants = Constants(system, Free(u_y, energy), smallest, held)

    zero = state.known(0.0)
    zeros = [as_data(zero, (*b.bodies.shape, state.n)) for b in state.bundles]
    at_rest = [Motion(Vector(x, x, x), Vector(x, x, x)) for x in zeros]
    nothing, one = (as_data(state.known(x), (1, state.n)) for x in (0.0, 1.0))
    x = as_data(zero, (state.topology.nv, state.n))
    start = Iterate(x, at_rest, u, Scalars(nothing, one, nothing, nothing))
    acts_at_all = _anything_acts(system)

    def iterate(carry):
        data, is_done, count, k = carry
        new, is_small = _iterated(constants, with_data(start, data), is_done, k == 0)
        return data_of(new), is_done | is_small, count + (~is_done).astype(np.int32), k + 1

    at_first = data_of(start), ~acts_at_all, jnp.zeros((1, state.n), np.int32), np.int32(0)
    data, _, count, _ = lax.while_loop(lambda x: (x[3] < MOST_ITERATIONS) & ~x[1].all(), iterate, at_first)
    last: Iterate = with_data(start, data)
    found = world.turned((1 - last.scalars.lacking) * y_free + last.x, to_world=False)
    y = where(acts_at_all, found, state.numbers(step.y_free[:, None])[0])
    return high(y), count


@algorithm(*FIELDS, result_shape=velocity_shape)
def solve_at(state: MechanismState, step: StepData, y: Array, force: Array):
    """H^-1 times a force, with H at the velocities `v0` + y."""
    system = system_of(state, step)
    _, impulses, G = _laws_at(system, step, y)
    x, _ = _times_inverse(system, impulses, G, state.numbers(force[:, None])[0])
    return high(system.world.turned(x, to_world=False))


def _laws_at(system: System, step: StepData, y: Array) -> tuple[ByTerm, ...]:
    """(velocities of terms at the velocities `v0` + y, the impulses and G there)."""
    v0, change = system.world.velocity_numbers(step.v0, y)
    v = v0 + change
    u = _velocities(system, system.world.motions(v)[0], v)
    return u, *_of_each(lambda term, own: term.law(own), system.terms, u)


def _times_inverse(system: System, impulses: ByTerm, G: ByTerm, force: Number) -> tuple[Number, list[Motion]]:
    """H^-1 times a force (nv, B), in world axes; and the Motions of bodies that have these velocities."""
    world = system.world
    right = world.turned(force, to_world=True)
    forces = [Forces(world.no_wrench, x) for x in world.by_bundle(right)]
    nothing = jax.tree.map(lambda x: constant(x, 0), impulses, is_leaf=is_number)
    solution = solve_hessian(system, G, *_balanced_and_applied(system.terms, nothing), forces)
    return solution.x, solution.motions


def _balanced_and_applied(
    terms: Sequence[Term], impulses: ByTerm, is_first: jax.Array | None = None
) -> tuple[ByTerm, ByTerm]:
    """(the impulses that G x balances, those that forces balance), see `solve_hessian`.

    In the first direction, and for None, G x balances what closes a loop. Later the momenta A x do: the impulse of a
    closure that cannot close, or works against a limit, is large.
    """
    balanced, applied = list[Any](impulses), list[Any]([None] * len(terms))
    for k, (term, impulse) in enumerate(zip(terms, impulses, strict=True)):
        if not term.is_stiff:
            balanced[k], applied[k] = None, impulse
        elif term.single_velocities() is None and is_first is not None:
            zero = constant(impulse, 0)
            balanced[k], applied[k] = where(is_first, impulse, zero), where(is_first, zero, impulse)
    return balanced, applied


@algorithm(*FIELDS, result_shape=velocity_shape)
def imbalance(
    state: MechanismState, step: StepData, y: Array, v: Array, vdot: Array, tau: Array, external_forces: Wrenches
):
    """The gradient of the cost at y = dt vdot: by Newton and Euler, with the impulses of terms as forces.

    v: the velocities of joints at the start, along axes that turn; v0 is along axes that do not."""
    system = system_of(state, step)
    _, impulses, _ = _laws_at(system, step, y)
    return high(_gradient(system, impulses, step.v0, y, v, vdot, tau, external_forces))


def _gradient(
    system: System,
    impulses: ByTerm,
    v0: Array,
    y: Array,
    v: Array,
    vdot: Array,
    tau: Array,
    external_forces: Wrenches,
) -> Number:
    """`imbalance` (nv, B)."""
    world, state, dt = system.world, system.world.state, system.world.dt
    body_loads = list[Any]()
    for (torque, f, more), body, F in zip(
        loads(state, external_forces), world.bodies, wrenches_on_bodies(system, impulses), strict=True
    ):
        own = Wrench(*(body.R.T @ (x / dt) for x in F))
        body_loads.append((torque + own.tau, f + own.f, more))
    forces = state.numbers_by_velocity(forces_of(state, v, vdot, body_loads, state.minus_gravity))
    gradient = dt * (forces - state.numbers(tau[:, None])[0])
    if not is_nothing(state.fields["damping"]):
        at_start, change, c = (state.numbers(x[:, None])[0] for x in (v0, y, state.fields["damping"]))
        gradient = gradient + dt * (c * (at_start + change))
    on_joints = forces_on_joints(system, impulses)
    return gradient if on_joints is None else gradient - on_joints


@algorithm(*FIELDS, result_shape=lambda *_: (1,))
def residual(
    state: MechanismState, step: StepData, y: Array, v: Array, vdot: Array, tau: Array, external_forces: Wrenches
):
    """sqrt(g^T H^-1 g) at y = dt vdot, with g the `imbalance` and what rounding errors make of it, relative to the
    momenta, (1, B). 0 where nothing touches."""
    system = system_of(state, step)
    world, terms = system.world, system.terms
    u, impulses, G = _laws_at(system, step, y)
    g = _gradient(system, impulses, step.v0, y, v, vdot, tau, external_forces)
    d, motions = _times_inverse(system, impulses, G, g)
    squares = [
        term.product(u_d, term.times_G(own, u_d))
        for term, own, u_d in zip(terms, G, _velocities(system, motions, d), strict=True)
    ]
    noise = [_rounding_of_velocities(*x) for x in zip(terms, u, G, strict=True)]
    left = world.twice_energy(motions, d) + _sum_of(squares) + _sum_of(noise)
    for term, own, u_own in zip(terms, G, u, strict=True):
        if term.rounding_share:
            total = _sum_of([term.rounding(own, u_own)])
            left = left + (term.rounding_share * floats.eps(high(total).dtype)) ** 2 * total
    both = world.velocity_numbers(step.v0, step.y_free)
    energies = (world.twice_energy(V, x) for V, x in zip(world.motions(*both), both, strict=True))
    scale, least = high(functools.reduce(operator.add, energies)), (OF_MOMENTA * floats.eps(state.dtype)) ** 2
    acts_at_all = _anything_acts(system)
    share = jnp.where(acts_at_all, high(left), 0) / jnp.where(scale <= 0, 1, scale)
    return jnp.sqrt(share + jnp.where(acts_at_all, least, 0))


@algorithm(*FIELDS, result_shape=lambda _, static: [(n,) for n in static["sizes"]])
def returned_impulses(state: MechanismState, step: StepData, y: Array, *, sizes: tuple[int, ...]):
    """The impulses that terms return, (k, B) each, at the velocities `v0` + y. sizes: their k."""
    system = system_of(state, step)
    _, found, _ = _laws_at(system, step, y)
    return tuple(x for term, own in zip(system.terms, found, strict=True) for x in term.results(state, own))


def _anything_acts(system: System) -> jax.Array:
    """Whether any term acts at all, (1, B)."""
    acts = (term.acts().any(0, keepdims=True) for term in system.terms)
    return functools.reduce(operator.or_, acts, jnp.zeros((1, system.world.state.n), bool))


# -- one iteration ----------------------------------------------------------------------------------------------------


class Slopes(NamedTuple):
    """Along a direction d. slope: the derivative of |v - v*|^2_A / 2. curvature: d . A d. decrement: d . H d. rounding:
    the size of rounding errors of the decrement. Numbers (1, B)."""

    slope: Number
    curvature: Number
    decrement: Number
    rounding: Number


class Products(NamedTuple):
    """Products of impulses at an Iterate, and of G d, with the velocities y* (`free`) and d.

    noise: impulse_d, of the sizes of its factors. Numbers (n, B) of n impulses, or their sums (1, B).
    """

    impulse_free: Number
    free_G_d: Number
    impulse_d: Number
    d_G_d: Number
    noise: Number


def _iterated(constants: Constants, at: Iterate, is_done: jax.Array, is_first: jax.Array) -> tuple[Iterate, jax.Array]:
    """(the next Iterate, whether the gradient of this one was small, or that of the next is). What is done stays.

    The step of the first iteration, in which terms are held, is not searched.
    """
    system, free, smallest = constants.system, constants.free, constants.smallest
    world, terms, lacking = system.world, system.terms, at.scalars.lacking

    # The direction e.
    def pushed(term: Term, u, u_y, held: Mask):
        """(impulse, G, the impulse of the right side of a direction)."""
        impulse, G = term.law(u, held & is_first)
        return impulse, G, impulse - lacking * term.times_G(G, u_y)

    impulse, G, right = _of_each(pushed, terms, at.u, free.u_y, constants.held)
    forces = jax.tree.map(operator.neg, world.momenta(at.motions, at.x), is_leaf=is_number)
    e, motions, remainders = solve_hessian(system, G, *_balanced_and_applied(terms, right, is_first), forces)

    # How far along it: d = r y* + e.
    def along(term: Term, G, impulse, u_y) -> tuple[Any, Any, Products]:
        """(the velocity along a direction, the impulse at the end of the direction if it were linear, Products)."""
        u_d = term.velocities(world, motions, e) + lacking * u_y
        G_d = term.times_G(G, u_d)
        products = Products(
            impulse_free=term.product(impulse, u_y),
            free_G_d=term.product(u_y, G_d),
            impulse_d=term.product(impulse, u_d),
            d_G_d=term.product(u_d, G_d),
            noise=term.product(*(jax.tree.map(abs, x, is_leaf=is_number) for x in (impulse, u_d))),
        )
        return u_d, impulse - G_d, products

    u_d, linear, products = _of_each(along, terms, G, impulse, free.u_y)
    sums, energy = Products(*map(_sum_of, zip(*products, strict=True))), world.twice_energy(motions, e)
    slopes, free_e, is_small = _slopes_and_size(at.scalars, free.energy, sums, energy, smallest, is_first)
    length = _searched(constants, at.u, u_d, slopes, is_small | is_done | is_first)
    linear = [x if own is None else own for x, own in zip(linear, remainders, strict=True)]

    # Where it leads to.
    def moved(x: T, d: T) -> T:
        """Numbers after a step along others; where it is done, those before."""
        return jax.tree.map(lambda x, d: where(is_done, x, x + length * d), x, d, is_leaf=is_number)

    def after(term: Term, u, u_d, linear) -> tuple[Any, Number, Number]:
        """(the velocity after a step, what is at least the term's share of g^T H^-1 g there, and what errors of
        rounding the velocity make of that).

        linear: the impulse phi that the step took, by G. The gradient is J^T x, with x = phi - gamma. As H is at least
        J^T G J, g^T H^-1 g is at most the sum of x_i^T G_i^-1 x_i, where no x_i has a part in which G_i is zero. And x
        is zero, but for rounding errors, where laws are linear: where contacts stick, or do nothing, as before the
        step. So no pass over the tree is needed there; elsewhere the bound is infinite.
        """
        u = moved(u, u_d)
        impulse, G = term.law(u)
        return u, term.bound(G, linear - impulse), _rounding_of_velocities(term, u, G)

    u, bounds, noise = _of_each(after, terms, at.u, u_d, linear)
    x, motions = moved((at.x, at.motions), (e, motions))
    bound = where(high(length) == 1, _sum_of(bounds), np.inf)
    is_settled = high(bound) <= high(smallest)
    decrement = where(is_settled, bound, where(is_first, 0.0, slopes.decrement))
    new = Scalars(at.scalars.over_free + length * free_e, (1 - length) * lacking, decrement, _sum_of(noise))
    scalars = Scalars(*(where(is_done, x, y) for x, y in zip(at.scalars, new, strict=True)))
    return Iterate(x, motions, u, scalars), is_small | is_settled


def _rounding_of_velocities(term: Term, u, G) -> Number:
    """What rounding errors of velocities make of g^T H^-1 g."""
    size = term.magnitude(u)
    rounding = floats.eps(high(term.product(size, size)).dtype) * OF_VELOCITIES * size
    return term.product(rounding, term.times_G(G, rounding))


def _slopes_and_size(
    at: Scalars, free_energy: Number, sums: Products, energy: Number, smallest: Number, is_first: jax.Array
) -> tuple[Slopes, Number, jax.Array]:
    """(the Slopes, y* . A e, whether the gradient is small). sums: over all terms. energy: e . A e.

    The decrement is d . H d, a sum of squares: d . g is the same, but a difference of products of impulses, of which
    rounding may leave anything, also what is below zero.
    """
    # y* . A e, by the equation of d.
    free_e = sums.impulse_free - sums.free_G_d - at.over_free
    curvature = energy + at.lacking * (2 * free_e + at.lacking * free_energy)
    decrement = curvature + sums.d_G_d
    slope = sums.impulse_d - decrement
    noise = sums.noise + abs(slope) + abs(curvature)
    # Below what rounding errors make of it, no direction goes down.
    rounding = NOISE * floats.eps(high(noise).dtype) * noise
    is_small = ~(high(decrement) > high(where(high(rounding) > high(smallest), rounding, smallest)))
    is_near = (high(decrement) < high(NEAR**2 * smallest)) | (high(decrement) < high(NOISY**2 * at.noise))
    is_small = is_small | (is_near & (high(decrement) > high(STALLED * at.decrement)) & (high(at.decrement) > 0))
    # The first decrement is of another problem.
    return Slopes(slope, curvature, decrement, rounding), free_e, is_small & ~is_first


# -- the length of a step ---------------------------------------------------------------------------------------------


class Search(NamedTuple):
    """low, up: the ends of the interval that holds the length. f, rate: the first two derivatives of the cost at the
    length; f is 0 where the search is over. Numbers (1, B)."""

    low: Number
    up: Number
    length: Number
    f: Number
    rate: Number


def _searched(constants: Constants, u: ByTerm, u_d: ByTerm, slopes: Slopes, is_whole: jax.Array) -> Number:
    """The length (1, B) of a step at which the derivative of the cost along it is small, by safeguarded Newton.

    u_d: the velocities of the direction. is_whole: states for which a whole step is taken.
    """
    state, terms = constants.system.world.state, constants.system.terms
    goal = SLOPE * abs(slopes.decrement) + slopes.rounding
    # The first length is 1, whose derivative is not known before the loop: it is evaluated in one place.
    low, one, up, unknown = (as_data(state.known(x), (1, state.n)) for x in (0.0, 1.0, LONGEST, np.inf))
    start = Search(low, up, one, where(is_whole, 0.0, unknown), one)

    def slope(term: Term, u, d, length: Number) -> tuple[Number, Number]:
        """(d . impulses, d . G d) at u + length d."""
        impulse, G = term.law(u + length * d)
        return term.product(impulse, d), term.product(term.times_G(G, d), d)

    def trial(carry):
        data, k = carry
        at: Search = with_data(start, data)
        is_over = is_whole | ~(high(abs(at.f)) > high(goal))
        # The next length to try.
        is_short = high(at.f) < 0
        low, up = where(is_short, at.length, at.low), where(is_short, at.up, at.length)
        newton = at.length - at.f / where(high(at.rate) > 0, at.rate, 1.0)
        is_inside = (high(newton) > high(low)) & (high(newton) < high(up))
        after = low, up, where(is_inside, newton, (low + up) * 0.5)
        stays = is_over | (k == 0)
        low, up, length = (where(stays, x, y) for x, y in zip(at[:3], after, strict=True))
        of_terms, rate = map(_sum_of, _of_each(slope, terms, u, u_d, length=length))
        f = slopes.slope + length * slopes.curvature - of_terms
        return data_of(Search(low, up, length, where(is_over, 0.0, f), slopes.curvature + rate)), k + 1

    data, _ = lax.while_loop(
        lambda x: (x[1] <= MOST_TRIALS) & (high(abs(with_data(start, x[0]).f)) > high(goal)).any(),
        trial,
        (data_of(start), np.int32(0)),
    )
    return with_data(start, data).length

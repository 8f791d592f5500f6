"""Whole algorithms in the trade-off: dynamics of a robot, precision against time against error; and what applications
lose in float32, in their own units: a long chain, a far offset, light bodies and heavy ones."""

import functools
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.command.trade import STREAMED, Case
from jaxspatial.dynamics.configuration import random_configuration
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.dynamics.steps import semi_implicit_step
from jaxspatial.inertia import SpatialInertia
from jaxspatial.measure import error, timing
from jaxspatial.measure.timing import Advance, compiled, reference
from jaxspatial.mechanism import Body, Frame, Joint, Mechanism
from jaxspatial.numerics.precision import DEFAULT, OF_ALGORITHMS, OF_REFERENCES
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialForce, shift

# What all others are compared with: its result is as if of twice the digits of float64, rounded once.
REFERENCE = ("float64", OF_REFERENCES)
STATES = 500
_ROUNDS, _LIMIT = 11, 3.0
_ROTATING = {"revolute", "continuous", "helical", "universal", "ball"}


class Algorithm(NamedTuple):
    """One algorithm: of q, v and, per coordinate, vdot or tau; the unit is that of joints that rotate."""

    name: str
    function: Callable[..., jax.Array]
    rotating: str

    @property
    def title(self):
        return self.name.replace("_", " ")

    def unit(self, mechanism: Mechanism):
        """Of the numbers of its results."""
        return self.rotating if set(mechanism.topology.kinds) <= _ROTATING else "SI"


ALGORITHMS = {
    "inverse_dynamics": Algorithm("inverse_dynamics", inverse_dynamics, "N m"),
    "forward_dynamics": Algorithm("forward_dynamics", forward_dynamics, "rad/s²"),
}


class Evaluated(NamedTuple):
    """What was measured for an algorithm in one dtype and precision. Errors of the reference are not known: NaN."""

    case: Case
    seconds: np.ndarray  # per evaluation (rounds,)
    compile_seconds: float
    ulps: np.ndarray  # of each state the largest error, in ulps of the largest number of its result
    worst_in_units: float
    unit: str

    @property
    def worst_ulps(self):
        return float(np.max(self.ulps))


def cases(algorithms: Iterable[str] = tuple(ALGORITHMS), dtypes: Iterable[str] = STREAMED):
    """All that is measured."""
    return [Case(a, d, str(p)) for a in algorithms for d in dtypes if d in STREAMED for p in OF_ALGORITHMS]


def steps(lines: Sequence[Case]):
    """How often `measure` calls `advance`."""
    names = {case.operation for case in lines}
    needed = {*lines, *(Case(name, *map(str, REFERENCE)) for name in names)}
    return len(needed) + len(names) * _ROUNDS


def measure(mechanism: Mechanism, lines: Sequence[Case], states: int = STATES, advance: Advance = lambda: None):
    """What `cases` cost for random states of a Mechanism, all of them in one call, and how far off they are."""
    mechanism, groups = mechanism.astype(np.float32), dict[str, list]()
    for name, *key in lines:
        groups.setdefault(name, []).append(tuple(key))
    return [
        row for name in groups for row in _rows_of_algorithm(ALGORITHMS[name], mechanism, groups[name], states, advance)
    ]


def _rows_of_algorithm(algorithm, mechanism, keys, states, advance):
    """One algorithm in these dtypes and precisions, timed alternately; all in numbers of float32, which every dtype
    holds."""
    state = _state(algorithm, mechanism, states)
    programs = {key: _Program(algorithm, mechanism, state, key, advance) for key in dict.fromkeys([*keys, REFERENCE])}
    seconds = timing.interleaved({key: programs[key] for key in keys}, _ROUNDS, advance, _LIMIT)
    expected, unit = error.rationals(programs[REFERENCE]()), algorithm.unit(mechanism)
    for key in keys:
        ulps, worst = np.full(states, np.nan), np.nan
        if key != REFERENCE:
            computed = programs[key]()
            ulps, worst = error.in_ulps_of_norm(computed, expected), error.in_units_of(1, computed, expected).max()
        case = Case(algorithm.name, *key)
        yield Evaluated(case, seconds[key] / states, programs[key].compile_seconds, ulps, float(worst), unit)


def _state(algorithm, mechanism, n):
    """q, v and vdot (n, ...) of random motions; or q, v and the generalized forces that they need."""
    rng, q = np.random.default_rng(0), random_configuration(mechanism, jax.random.key(0), (n,), jnp.float32)
    v, vdot = (jnp.asarray(x) for x in rng.standard_normal((2, n, mechanism.nv)).astype(np.float32))
    if algorithm.function is inverse_dynamics:
        return q, v, vdot
    return q, v, jax.jit(jax.vmap(functools.partial(inverse_dynamics, mechanism)))(q, v, vdot)


class _Program:
    """An algorithm for all states at once, compiled in a dtype and precision."""

    def __init__(self, algorithm, mechanism, state, key, advance):
        dtype, precision = key
        mechanism, self._is_wide = mechanism.astype(np.dtype(dtype)), dtype == "float64"
        with jax.enable_x64(self._is_wide):
            arrays = [jnp.asarray(np.asarray(x), dtype) for x in state]
            start = time.perf_counter()
            self._call = compiled(jax.vmap(lambda *x: algorithm.function(mechanism, *x)), precision, arrays)
            self.compile_seconds = time.perf_counter() - start
        advance()

    def __call__(self):
        with jax.enable_x64(self._is_wide):
            return self._call()


# -- the robots, in float32 --------------------------------------------------------------------------------------------

_UPRIGHT = np.eye(3)
# Quarter turns about x, of rotations by 90 and by -90 degrees.
_LEFT, _RIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
# Of each link: rotation and position of its joint's frame in the frame before, kg, and the length along the arm, m.
_LINKS = (
    (_UPRIGHT, (0.0, 0.0, 0.333), 4.0, 0.3),
    (_RIGHT, (0.0, 0.0, 0.0), 4.0, 0.3),
    (_LEFT, (0.0, -0.316, 0.0), 3.0, 0.3),
    (_LEFT, (0.0825, 0.0, 0.0), 3.0, 0.3),
    (_RIGHT, (-0.0825, 0.384, 0.0), 2.5, 0.3),
    (_LEFT, (0.0, 0.0, 0.0), 1.5, 0.1),
    (_LEFT, (0.088, 0.0, 0.0), 1.0, 0.2),
)


def _built(parts: Callable[..., tuple]) -> Callable[..., Mechanism]:
    """Builds a Mechanism of bodies, joints, frames; its numbers are float32, so that it is the same in every dtype."""

    @functools.wraps(parts)
    def build(*numbers):
        with jax.enable_x64(True):
            return Mechanism.build(*parts(*numbers), dtype=np.float64).astype(np.float32)

    return build


@_built
def arm():
    """An arm of seven revolute joints and 19 kg that reaches 0.86 m, of the measures of Franka's Panda."""
    names, bodies, joints = ["world", *(f"link{i + 1}" for i in range(7))], [], []
    for i, (rotation, position, mass, length) in enumerate(_LINKS):
        cylinder = SpatialInertia.solid_cylinder(np.float64(0.06), np.float64(length), mass=np.float64(mass))
        bodies.append(Body(names[i + 1], shift(cylinder, np.array([0.0, 0.02, -length / 4]))))
        joints.append(_hinge(i, names, (0, 0, 1), _at(position, rotation)))
    return bodies, joints


def _hinge(i, names, axis, placement):
    return Joint(f"joint{i + 1}", "revolute", names[i], names[i + 1], axis=axis, placement=placement)


@_built
def chain(n: int, length: float = 0.1, mass: float = 0.2):
    """n rods in series along z, m and kg each, hinged about x and y alternately; the frame "tip" at the end."""
    rod = SpatialInertia.thin_rod(np.float64(length), np.array([0.0, 0.0, 1.0]), mass=np.float64(mass))
    rod = shift(rod, np.array([0.0, 0.0, -length / 2]))
    names = ["world", *(f"rod{i + 1}" for i in range(n))]
    joints = [_hinge(i, names, np.eye(3)[i % 2], _at((0, 0, i and length))) for i in range(n)]
    return [Body(name, rod) for name in names[1:]], joints, [Frame("tip", names[-1], _at((0.0, 0.0, length)))]


@_built
def trolley(mass: float, load: float):
    """A trolley (kg) on a rail along x, from which a load (kg) hangs by a metre."""
    ball = SpatialInertia.solid_sphere(np.float64(0.01), mass=np.float64(load))
    body = SpatialInertia.point_mass(np.zeros(3), mass=np.float64(mass))
    rail = Joint("rail", "prismatic", "world", "trolley", axis=(1, 0, 0))
    rope = Joint("rope", "revolute", "trolley", "load", axis=(0, 1, 0))
    return [Body("trolley", body), Body("load", shift(ball, np.array([0, 0, 1.0])))], [rail, rope]


def _at(position, rotation=_UPRIGHT):
    return RigidTransform(Rotation.from_matrix(rotation), np.array(position, np.float64))


@_built
def satellite():
    """A box of 4 kg that floats, without gravity."""
    box = SpatialInertia.solid_box(np.array([0.3, 0.2, 0.1]), mass=np.float64(4.0))
    return [Body("satellite", box)], [Joint("floating", "free", "world", "satellite")]


# -- applications ------------------------------------------------------------------------------------------------------

# What applications are measured in, in how many states, and the links of the long chain.
LOSSY = "float32"
_SAMPLE, _LONG = 200, 100


class Application(NamedTuple):
    """function(the robot, *arguments) is that of one item; arguments(rng, n) are n items of float32, `states` unless
    told."""

    name: str
    unit: str
    function: Callable[..., jax.Array]
    arguments: Callable[[np.random.Generator, int], list[np.ndarray]]
    robot: Callable[[], Mechanism | None] = lambda: None
    states: int = _SAMPLE


class Loss(NamedTuple):
    """The largest number of many results, and in each precision the largest error, both in the unit."""

    name: str
    unit: str
    size: float
    errors: dict[str, float]
    states: int = _SAMPLE


def application_steps():
    """How often `losses` calls `advance`."""
    return len(APPLICATIONS) * (len(OF_ALGORITHMS) + 1)


def losses(advance: Advance = lambda: None, states: int | None = None):
    """The Loss of each application."""
    return [loss(application, advance, states) for application in APPLICATIONS]


def loss(application: Application, advance: Advance = lambda: None, states: int | None = None) -> Loss:
    """Of one application, against float64, whose own error is smaller by 2^29."""
    n = application.states if states is None else states
    arguments = application.arguments(np.random.default_rng(0), n)
    function = jax.vmap(functools.partial(application.function, application.robot()))
    (expected,) = reference(function, arguments, DEFAULT)
    advance()
    errors = {}
    for precision in OF_ALGORITHMS:
        computed = np.asarray(compiled(function, precision, arguments)(), np.float64)
        errors[str(precision)] = float(abs(computed - expected).max())
        advance()
    return Loss(application.name, application.unit, float(abs(expected).max()), errors, n)


def _moving(rng, n):
    """q, v, vdot of all joints of the chain."""
    return list(rng.uniform(-0.3, 0.3, (3, n, _LONG)).astype(np.float32))


def _left_alone(rng, n):
    """q, v of a trolley and its load, and no forces."""
    return [*rng.uniform(-0.5, 0.5, (2, n, 2)).astype(np.float32), np.zeros((n, 2), np.float32)]


def _levers(rng, n, newton=1000.0, away=1000.0):
    """Wrenches known far away from a point, where torques of about 1 N m are left."""
    f = rng.normal(0.0, newton, (n, 3)).astype(np.float32)
    p = (away * _unit(rng.standard_normal((n, 3)))).astype(np.float32)
    rest = _unit(rng.standard_normal((n, 3)))
    return [(rest + np.cross(p.astype(np.float64), f.astype(np.float64))).astype(np.float32), f, p]


def _unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def _far_torque(_, tau, f, p):
    return shift(SpatialForce(tau, f), p).tau


def _tip(mech, q):
    return forward_kinematics(mech.astype(q.dtype), q, frames="tip").translation


def _tumbling(rng, n):
    """q, v of a satellite that tumbles at 1 rad/s and drifts at 0.3 m/s."""
    w, v = _unit(rng.standard_normal((n, 3))), 0.3 * _unit(rng.standard_normal((n, 3)))
    return [np.tile(np.eye(7, dtype=np.float32)[0], (n, 1)), np.concatenate([w, v], axis=1).astype(np.float32)]


def _swinging(rng, n):
    """q, v of a pendulum of two links that hangs."""
    q = rng.uniform(-0.5, 0.5, (n, 2)) + [np.pi, 0]
    return [q.astype(np.float32), rng.uniform(-0.5, 0.5, (n, 2)).astype(np.float32)]


def _after(mech, q, v, steps, dt):
    """q after so many steps without forces of joints."""
    mech, tau = mech.astype(q.dtype), jnp.zeros(mech.nv, q.dtype)

    def step(state, _):
        at, moving = state
        return semi_implicit_step(mech, at, moving, tau, np.asarray(dt, q.dtype)), None

    return lax.scan(step, (q, v), None, steps)[0][0]


APPLICATIONS = (
    Application(
        "end of a chain of 100 links, 10 m",
        "m",
        lambda mech, q, v, vdot: _tip(mech, q),
        _moving,
        functools.partial(chain, _LONG),
    ),
    Application(
        "torque that holds its base",
        "N m",
        lambda mech, q, v, vdot: inverse_dynamics(mech.astype(q.dtype), q, v, vdot)[0],
        _moving,
        functools.partial(chain, _LONG),
    ),
    Application("torque of a force of 1 kN, moved by 1 km", "N m", _far_torque, _levers),
    Application(
        "10 g hanging on 1 t: the light body",
        "rad/s²",
        lambda mech, q, v, tau: forward_dynamics(mech.astype(q.dtype), q, v, tau)[1],
        _left_alone,
        functools.partial(trolley, 1e3, 1e-2),
    ),
    Application(
        "1 t hanging on 10 g: the light body",
        "m/s²",
        lambda mech, q, v, tau: forward_dynamics(mech.astype(q.dtype), q, v, tau)[0],
        _left_alone,
        functools.partial(trolley, 1e-2, 1e3),
    ),
)

# What the first look shows: where a precision decides, and where it does not.
FIRST_LOOK = (
    Application(
        "a torque, of a force 5 km away", "N m", _far_torque, functools.partial(_levers, newton=300.0, away=5e3)
    ),
    APPLICATIONS[-1],
    Application(
        "a satellite after ten minutes",
        "m",
        lambda mech, q, v: _after(mech, q, v, 150_000, 4e-3)[4:],
        _tumbling,
        lambda: satellite().replace(gravity=np.zeros(3, np.float32)),
        8,
    ),
    Application(
        "a gradient through 500 steps",
        "m s",
        lambda mech, q, v: jax.grad(lambda v: _tip(mech, _after(mech, q, v, 500, 2e-3))[0])(v),
        _swinging,
        functools.partial(chain, 2, 0.3, 0.5),
        64,
    ),
)

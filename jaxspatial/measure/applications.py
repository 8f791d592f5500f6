"""What an application loses in float32, in its own units: a long chain, a far offset, light bodies and heavy ones."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxspatial.arithmetic.precision import DEFAULT, OF_ALGORITHMS
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.measure import scene
from jaxspatial.measure.recommend import compiled, reference
from jaxspatial.measure.timing import Advance
from jaxspatial.spatial import SpatialForce, shift

DTYPE = "float32"
STATES = 200

Program = Callable[[jax.Array, jax.Array, jax.Array], jax.Array]


class Application(NamedTuple):
    """program() is the function of one item; arguments(rng, n) are n items of float32."""

    name: str
    unit: str
    program: Callable[[], Program]
    arguments: Callable[[np.random.Generator, int], list[np.ndarray]]


class Loss(NamedTuple):
    """The largest number of many results, and in each precision the largest error, both in the unit."""

    name: str
    unit: str
    size: float
    errors: dict[str, float]


def steps():
    """How often `measure` calls `advance`."""
    return len(APPLICATIONS) * (len(OF_ALGORITHMS) + 1)


def measure(advance: Advance = lambda: None, states: int = STATES):
    """The Loss of each application, against float64, whose own error is smaller by 2^29."""
    return [_loss(application, states, advance) for application in APPLICATIONS]


def _loss(application: Application, n: int, advance: Advance):
    arguments = application.arguments(np.random.default_rng(0), n)
    function = jax.vmap(application.program())
    (expected,) = reference(function, arguments, DEFAULT)
    advance()
    errors = {}
    for precision in OF_ALGORITHMS:
        computed = np.asarray(compiled(function, precision, arguments)(), np.float64)
        errors[str(precision)] = float(abs(computed - expected).max())
        advance()
    return Loss(application.name, application.unit, float(abs(expected).max()), errors)


def _moving(rng: np.random.Generator, n: int):
    """q, v, vdot of all joints of the chain."""
    return list(rng.uniform(-0.3, 0.3, (3, n, _LINKS)).astype(np.float32))


def _left_alone(rng: np.random.Generator, n: int) -> list[Any]:
    """q, v of a trolley and its load, and no forces."""
    return [*rng.uniform(-0.5, 0.5, (2, n, 2)).astype(np.float32), np.zeros((n, 2), np.float32)]


_LINKS = 100


def _tip() -> Program:
    mech = scene.chain(_LINKS)
    return lambda q, v, vdot: forward_kinematics(mech.astype(q.dtype), q, frames="tip").translation


def _torque_at_the_base() -> Program:
    mech = scene.chain(_LINKS)
    return lambda q, v, vdot: inverse_dynamics(mech.astype(q.dtype), q, v, vdot)[0]


def _acceleration(mass: float, load: float, rate: int) -> Program:
    mech = scene.trolley(mass, load)
    return lambda q, v, tau: forward_dynamics(mech.astype(q.dtype), q, v, tau)[rate]


def _levers(rng: np.random.Generator, n: int) -> list[Any]:
    """Wrenches that read nearly the same a kilometre away, where torques of about 1 N m are left."""
    f = rng.normal(0.0, 1000.0, (n, 3)).astype(np.float32)
    p = (1000 * _unit(rng.standard_normal((n, 3)))).astype(np.float32)
    rest = _unit(rng.standard_normal((n, 3)))
    return [(rest + np.cross(p.astype(np.float64), f.astype(np.float64))).astype(np.float32), f, p]


def _unit(x: np.ndarray):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def _far_torque() -> Program:
    return lambda tau, f, p: shift(SpatialForce(tau, f), p).tau


APPLICATIONS = (
    Application("end of a chain of 100 links, 10 m", "m", _tip, _moving),
    Application("torque that holds its base", "N m", _torque_at_the_base, _moving),
    Application("torque of a force of 1 kN, moved by 1 km", "N m", _far_torque, _levers),
    Application("10 g hanging on 1 t: the light body", "rad/s²", partial(_acceleration, 1e3, 1e-2, 1), _left_alone),
    Application("1 t hanging on 10 g: the light body", "m/s²", partial(_acceleration, 1e-2, 1e3, 0), _left_alone),
)

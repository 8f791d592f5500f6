"""Newton, the simulator on Warp: `State.body_f`, of one world or of many copies of it.

Since Newton 0.2.2 all its solvers read body_f alike: [f; tau] on each body, about its centre of mass, in world axes.
Before Newton 0.1.2 the torque came first, as in warp.sim; until 0.2.2 solvers differed in the point. Nothing here needs
the package: models are read by their attributes, and arrays of Warp by their method `numpy`. Many worlds are rows one
world after the other there, and the first axis of a batch here.

Read: newton 1.8, its docs/concepts/conventions.rst and the kernels of its solvers.
"""

import jax
import numpy as np

from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.interop import bodies
from jaxspatial.mechanism import AppliedForces, Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.check import require_kind
from jaxspatial.numerics.types import ArrayLike, PrecisionName


def to_body_f(
    model, mechanism: Mechanism, q: ArrayLike, forces: ExternalForces, *, precision: PrecisionName = None
) -> jax.Array:
    """Makes State.body_f: [f; tau] on each body, about its centre of mass, in world axes.

        tau_Bcm = tau_Bo - R_WB body_com x f

    A body welded to another is a frame of that body here, and the wrench acts on that body. The motion is the same.

    Args:
        model: a newton.Model, whose bodies have the names of the bodies of the mechanism: the whole label
            ("robot/worldbody/base") or what comes behind its last "/".
        mechanism: with the joints of one world of the model, read from the same file or from another one of the robot.
        q: (*batch, nq) our coordinates; of a model with many worlds the last axis of the batch is that of worlds.
        forces: as `external_forces` of `forward_dynamics`: a dict of SpatialForces by name of a frame, or
            AppliedForces.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, n, 6) [f; tau] on the n bodies of a world, N, N m; zeros of bodies without a wrench. As Newton has it:
        `state.body_f.assign(numpy.asarray(x).reshape(-1, 6))`.

    Raises:
        KeyError: there is no such frame, or Newton has no body with the name of the body that carries it.
        ValueError: worlds have different bodies, or several bodies of a world have that name.

    Error: as of `applied_wrenches`, then of a rotation and of `shift`.

    Example:
        >>> from types import SimpleNamespace  # what is read of a newton.Model
        >>> com = np.float32([[0, 0, -0.5], [0, 0, -0.5]])
        >>> model = SimpleNamespace(body_label=["arm/upper", "arm/lower"], body_com=com, world_count=1)
        >>> push = js.SpatialForce(f=[1.0, 0.0, 0.0])  # at the elbow, 0.5 m above the centre of mass
        >>> print(js.interop.newton.to_body_f(model, arm, arm.neutral(), {"lower": push})[1])
        [1.  0.  0.  0.  0.5 0. ]
    """
    require_kind(mechanism, Mechanism, "newton.to_body_f", " second")
    labels, centers = _bodies("newton.to_body_f", model)

    def row(name: str) -> int:
        found = [i for i, label in enumerate(labels) if label == name or label.endswith(f"/{name}")]
        if not found:
            near = check.did_you_mean(name, _names(labels))
            raise KeyError(f"newton.to_body_f: the model has no body {name!r}{near}")
        if len(found) > 1:
            raise ValueError(f"newton.to_body_f: {name!r} names several bodies: {[labels[i] for i in found]}")
        return found[0]

    return bodies.to_rows(mechanism, q, forces, row, centers, precision)


def from_body_f(model, body_f) -> AppliedForces:
    """Reads State.body_f as `external_forces`, exactly.

    Args:
        model: a newton.Model.
        body_f: (body_count, 6), an array of Warp or of numbers, or (*batch, n, 6) on the n bodies of a world: [f; tau]
            about centres of mass, in world axes, N, N m.

    Returns:
        AppliedForces on all bodies of a world, each at its centre of mass, in world axes, by what comes behind the last
        "/" of their labels; of a model with many worlds a batch of as many.

    Example:
        >>> from types import SimpleNamespace  # what is read of a newton.Model
        >>> com = np.float32([[0, 0, -0.5], [0, 0, -0.5]])
        >>> model = SimpleNamespace(body_label=["arm/upper", "arm/lower"], body_com=com, world_count=1)
        >>> forces = js.interop.newton.from_body_f(model, np.eye(2, 6, dtype=np.float32))
        >>> print(forces.frames, forces.wrenches.f[1])
        ('upper', 'lower') [0. 1. 0.]
    """
    labels, centers = _bodies("newton.from_body_f", model)
    x = floats.as_vectors(_array(body_f), "newton.from_body_f: body_f", size=6, many=["n"], keep_dtype=True)
    if model.world_count > 1 and x.ndim == 2:
        x = x.reshape((model.world_count, -1, 6))
    if x.shape[-2] != len(labels):
        raise ValueError(f"newton.from_body_f: expected shape (*batch, {len(labels)}, 6), got {x.shape}")
    return bodies.from_rows(_names(labels), x, centers)


def _bodies(operation: str, model) -> tuple[list[str], np.ndarray]:
    """(labels of the bodies of a world, (n, 3) or (worlds, n, 3) their centres of mass from their origins)."""
    worlds, labels = max(model.world_count, 1), list(model.body_label)
    n = len(labels) // worlds
    if labels[:n] * worlds != labels:
        raise ValueError(f"{operation}: expected the same bodies in each of {worlds} worlds, got {labels}")
    centers = np.asarray(_array(model.body_com)).reshape((worlds, n, 3))
    return labels[:n], centers if worlds > 1 else centers[0]


def _names(labels: list[str]) -> tuple[str, ...]:
    return tuple(label.rpartition("/")[2] for label in labels)


def _array(x):
    """The numbers of an array of Warp; other arrays as they are."""
    return x.numpy() if hasattr(x, "numpy") else x

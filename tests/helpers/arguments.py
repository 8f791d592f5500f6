"""The kinds of arguments that operations take: how random ones are drawn over a batch, and what their arrays make."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import jaxspatial as js
from jaxspatial.numerics import eigen
from tests.helpers import formulas

N_POINTS = 5
_OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


class Kind(NamedTuple):
    """Of arguments, components of size 1, well conditioned, none of them zero."""

    # (rng, batch shape) -> the arrays that one consists of, in float64.
    draw: Callable
    make: Callable = lambda x: x

    @property
    def shapes(self):
        """Of one item, the shapes of its arrays."""
        return [x.shape for x in self.draw(np.random.default_rng(0), ())]


def _normal(*item):
    return lambda rng, batch: [rng.standard_normal((*batch, *item))]


def _positive(*item, above=0.5):
    return lambda rng, batch: [above + rng.uniform(0, 1, (*batch, *item))]


def _motion(rng, batch):
    return [rng.standard_normal((*batch, 3)) for _ in range(2)]


def _matrix(rng, batch):
    """Rotation matrices, from quaternions."""
    q = rng.standard_normal((*batch, 4))
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    skew = np.stack([0 * w, -z, y, z, 0 * w, -x, -y, x, 0 * w], -1).reshape((*batch, 3, 3))
    return np.eye(3) + 2 * (w[..., None, None] * skew + skew @ skew)


def _entries(rng, batch):
    return [_matrix(rng, batch).reshape((*batch, 9))]


def _near_a_rotation(rng, batch):
    return [_matrix(rng, batch) + 0.1 * rng.standard_normal((*batch, 3, 3))]


def _inertia(smallest=0.3, size=1.0):
    """Bodies with second moments about the centre of mass from `smallest` to 1."""

    def arrays(rng, batch):
        q = _matrix(rng, batch)
        moments = rng.uniform((smallest, 0.4, 0.7), (smallest + 0.1, 0.6, 1.0), (*batch, 3))
        seconds = q @ (size * moments[..., None] * np.swapaxes(q, -1, -2))
        central = np.trace(seconds, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - seconds
        return [size * rng.uniform(1, 2, batch), rng.standard_normal((*batch, 3)), eigen.six_of_matrix(central)]

    return arrays


def _every_other(good, bad):
    """Those with odd numbers are of the second kind."""

    def arrays(rng, batch):
        odd = (np.arange(np.prod(batch, dtype=int)) % 2 == 1).reshape(batch)
        pairs = zip(good(rng, batch), bad(rng, batch), strict=True)
        return [np.where(odd.reshape((*batch, *[1] * (a.ndim - len(batch)))), b, a) for a, b in pairs]

    return arrays


def _in_other_words(formula, factor=1.0):
    """What a formula makes of inertias, in float64."""
    return lambda rng, batch: [factor * formula(*_inertia()(rng, batch))[0]]


def _articulated(smallest=0.5):
    def arrays(rng, batch):
        a = rng.standard_normal((*batch, 6, 6))
        p = a @ np.swapaxes(a, -1, -2) / 2 + smallest * np.eye(6)
        j, m = (eigen.six_of_matrix(x) for x in (p[..., :3, :3], p[..., 3:, 3:]))
        return [j, p[..., :3, 3:].reshape((*batch, 9)), m]

    return arrays


def _corners(points):
    return lambda rng, batch: [points + 0.2 * rng.standard_normal((*batch, *points.shape))]


def _transform(entries, p):
    return js.RigidTransform(js.Rotation(entries), p)


KINDS = {
    "F": Kind(_motion, js.SpatialForce),
    "L": Kind(_motion, js.SpatialMomentum),
    "V": Kind(_motion, js.SpatialVelocity),
    "A": Kind(_motion, js.SpatialAcceleration),
    "R": Kind(_entries, js.Rotation),
    "X": Kind(lambda rng, batch: [*_entries(rng, batch), rng.standard_normal((*batch, 3))], _transform),
    "M": Kind(_inertia(), js.SpatialInertia),
    "part": Kind(_inertia(size=0.2), js.SpatialInertia),
    "bodies": Kind(lambda rng, batch: _inertia()(rng, (*batch, N_POINTS)), js.SpatialInertia),
    # Every other inertia is one that no body can have.
    "doubtful": Kind(_every_other(_inertia(), _inertia(-0.4)), js.SpatialInertia),
    "P": Kind(_articulated(), js.ArticulatedInertia),
    "doubtful_P": Kind(_every_other(_articulated(), _articulated(-2.0)), js.ArticulatedInertia),
    "vector": Kind(_normal(3)),
    "scalar": Kind(_normal()),
    "coefficients": Kind(_normal(6)),
    "quaternion": Kind(_normal(4)),
    "theta10": Kind(lambda rng, batch: [0.5 * rng.standard_normal((*batch, 10))]),
    "positive": Kind(_positive()),
    "larger": Kind(_positive(above=2.0)),
    "edges": Kind(_positive(3)),
    "matrix": Kind(_near_a_rotation),
    "pi10": Kind(_in_other_words(formulas.dynamic_parameters)),
    "pseudo": Kind(_in_other_words(formulas.twice_pseudo_inertia, 0.5)),
    "six": Kind(_in_other_words(formulas.six_by_six)),
    "points": Kind(_normal(N_POINTS, 3)),
    "forces": Kind(lambda rng, batch: _motion(rng, (*batch, N_POINTS)), js.SpatialForce),
    "tetrahedron": Kind(_corners(np.concatenate((np.zeros((1, 3)), np.eye(3))))),
    "octahedron": Kind(_corners(_OCTAHEDRON)),
}

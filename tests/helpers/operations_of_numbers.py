"""The table of operations over numbers: what takes quotients, roots, angles or decisions. A new one is one line.

Beside `operations`, whose formulas are sums of products: these have no naive formula of one line to compare bits with.
What they are compared with is themselves, run one primitive after another, where no compiler has anything to rewrite.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js
from jaxspatial.arithmetic import symmetric
from jaxspatial.inertia import SpatialInertia, joint_projection

N_BODIES = 5
_OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
# Indices of 32 bits: those of 64, first used while 64-bit types are off, fail op by op once they are on (jax 0.10).
_TRIANGLES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.int32
)


# -- arguments: random arrays of one kind over a batch, of size 1 and well conditioned --------------------------------


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
        return [size * rng.uniform(1, 2, batch), rng.standard_normal((*batch, 3)), symmetric.from_matrix(central)]

    return arrays


def _bodies(rng, batch):
    return _inertia()(rng, (*batch, N_BODIES))


def _doubtful(rng, batch):
    """Every other inertia is one that no body can have."""
    good, bad = _inertia()(rng, batch), _inertia(-0.4)(rng, batch)
    odd = (np.arange(np.prod(batch, dtype=int)) % 2 == 1).reshape(batch)
    return [np.where(odd.reshape((*batch, *[1] * (a.ndim - len(batch)))), b, a) for a, b in zip(good, bad, strict=True)]


def _about_origin(to, *item):
    """Inertias said another way, in float64."""

    def arrays(rng, batch):
        mass, com, central = _inertia()(rng, batch)
        arm = np.einsum("...,...k,...k", mass, com, com)[..., None, None] * np.eye(3)
        squares = mass[..., None, None] * com[..., :, None] * com[..., None, :]
        about = np.asarray(symmetric.to_matrix(central)) + arm - squares
        return [to(mass, com, about).reshape((*batch, *item))]

    return arrays


def _ten(mass, com, about):
    return np.concatenate([mass[..., None], mass[..., None] * com, symmetric.from_matrix(about)], -1)


def _pseudo(mass, com, about):
    seconds = np.trace(about, axis1=-2, axis2=-1)[..., None, None] / 2 * np.eye(3) - about
    moment = (mass[..., None] * com)[..., None]
    return np.block([[seconds, moment], [np.swapaxes(moment, -1, -2), mass[..., None, None]]])


def _six_by_six(mass, com, about):
    x, y, z = np.moveaxis(mass[..., None] * com, -1, 0)
    arm = np.stack([0 * x, -z, y, z, 0 * x, -x, -y, x, 0 * x], -1).reshape(about.shape)
    return np.block([[about, arm], [-arm, mass[..., None, None] * np.eye(3)]])


def _articulated(smallest=0.5):
    def arrays(rng, batch):
        a = rng.standard_normal((*batch, 6, 6))
        p = a @ np.swapaxes(a, -1, -2) / 2 + smallest * np.eye(6)
        j, m = (symmetric.from_matrix(x) for x in (p[..., :3, :3], p[..., 3:, 3:]))
        return [j, p[..., :3, 3:].reshape((*batch, 9)), m]

    return arrays


def _doubtful_articulated(rng, batch):
    good, bad = _articulated()(rng, batch), _articulated(-2.0)(rng, batch)
    odd = (np.arange(np.prod(batch, dtype=int)) % 2 == 1).reshape((*batch, 1))
    return [np.where(odd, b, a) for a, b in zip(good, bad, strict=True)]


def _corners(points):
    return lambda rng, batch: [points + 0.2 * rng.standard_normal((*batch, *points.shape))]


def _plain(x):
    return x


def _transform(entries, p):
    return js.RigidTransform(js.Rotation(entries), p)


# What an operation may take: its arrays over a batch, and what they are made into.
_ARGUMENTS: dict[str, tuple[Callable, Callable]] = {
    "R": (_entries, js.Rotation),
    "X": (lambda rng, batch: [*_entries(rng, batch), rng.standard_normal((*batch, 3))], _transform),
    "V": (_motion, js.SpatialVelocity),
    "A": (_motion, js.SpatialAcceleration),
    "M": (_inertia(), SpatialInertia),
    "part": (_inertia(size=0.2), SpatialInertia),
    "bodies": (_bodies, SpatialInertia),
    "doubtful": (_doubtful, SpatialInertia),
    "P": (_articulated(), js.ArticulatedInertia),
    "doubtful_P": (_doubtful_articulated, js.ArticulatedInertia),
    "vector": (_normal(3), _plain),
    "scalar": (_normal(), _plain),
    "positive": (_positive(), _plain),
    "larger": (_positive(above=2.0), _plain),
    "edges": (_positive(3), _plain),
    "quaternion": (_normal(4), _plain),
    "matrix": (_near_a_rotation, _plain),
    "pi10": (_about_origin(_ten, 10), _plain),
    "pseudo": (_about_origin(_pseudo, 4, 4), _plain),
    "six": (_about_origin(_six_by_six, 6, 6), _plain),
    "theta10": (lambda rng, batch: [0.5 * rng.standard_normal((*batch, 10))], _plain),
    "tetrahedron": (_corners(np.concatenate((np.zeros((1, 3)), np.eye(3)))), _plain),
    "octahedron": (_corners(_OCTAHEDRON), _plain),
}


# -- the table --------------------------------------------------------------------------------------------------------


class Operation(NamedTuple):
    """One line of the table."""

    name: str
    arguments: str
    function: Callable
    differentiable: bool = True
    takes_precision: bool = True
    # Evaluated as a whole in the wider format, if in one, and rounded once; else results of one formula enter another.
    is_one_formula: bool = True
    # What comes is True for the items with even numbers, False for the others.
    is_mask: bool = False
    # The operation that runs the same formula: what is told of that one need not be told again.
    twin: str | None = None

    def build(self, arrays):
        """The arguments that consist of these arrays."""
        remaining = iter(arrays)
        kinds = (_ARGUMENTS[argument] for argument in self.arguments.split())
        return tuple(make(*(next(remaining) for _ in _arrays(draw))) for draw, make in kinds)

    def places(self):
        """For each of the arrays, which argument it belongs to."""
        return [i for i, kind in enumerate(self.arguments.split()) for _ in _arrays(_ARGUMENTS[kind][0])]

    def arrays(self, batch_shape, dtype, seed=0):
        """Random arrays that the arguments consist of, as NumPy arrays."""
        rng = np.random.default_rng(seed)
        drawn = [x for kind in self.arguments.split() for x in _ARGUMENTS[kind][0](rng, batch_shape)]
        return [x.astype(jnp.dtype(dtype)) for x in drawn]

    def on_arrays(self, precision=None):
        """The operation as a function of arrays that gives a list of arrays."""
        given = {"precision": precision} if precision and self.takes_precision else {}
        return lambda *arrays: jax.tree.leaves(self.function(*self.build(arrays), **given))


def _arrays(draw):
    return draw(np.random.default_rng(0), ())


def _shape(shape, arguments, by="density", name=None, **options):
    """A body of uniform density; its mass or density comes after its lengths."""

    def function(*lengths_and_amount, precision=None):
        *lengths, amount = lengths_and_amount
        return getattr(SpatialInertia, shape)(*lengths, **{by: amount}, precision=precision)

    return Operation(name or shape, arguments, function, **options)


def _without_two(P, S, T, armature, precision=None):
    return joint_projection(P, [S, T], armature, precision=precision)


def _sum(M, precision=None):
    return M.sum(-1, precision=precision)


def _mesh(vertices, density, precision=None):
    return SpatialInertia.triangle_mesh(vertices, _TRIANGLES, density=density, precision=precision)


OPERATIONS = {
    operation.name: operation
    for operation in (
        # rotations
        Operation("exp", "vector", js.Rotation.exp),
        Operation("log", "R", js.Rotation.log),
        Operation("from_quaternion", "quaternion", js.Rotation.from_quaternion),
        Operation("to_quaternion", "R", js.Rotation.to_quaternion),
        Operation("about_x", "scalar", js.Rotation.about_x),
        Operation("about_y", "scalar", js.Rotation.about_y, twin="about_x"),
        Operation("about_z", "scalar", js.Rotation.about_z, twin="about_x"),
        Operation("from_axis_angle", "vector scalar", js.Rotation.from_axis_angle),
        Operation("to_axis_angle", "R", js.Rotation.to_axis_angle),
        Operation("from_roll_pitch_yaw", "vector", js.Rotation.from_roll_pitch_yaw),
        Operation("to_roll_pitch_yaw", "R", js.Rotation.to_roll_pitch_yaw),
        Operation("from_one_vector", "vector", js.Rotation.from_one_vector),
        Operation("from_two_vectors", "vector vector", js.Rotation.from_two_vectors),
        Operation("between", "vector vector", js.Rotation.between),
        Operation("nearest", "matrix", js.Rotation.nearest),
        Operation("interpolate", "R R scalar", js.Rotation.interpolate),
        Operation("left_jacobian", "vector", js.Rotation.left_jacobian),
        Operation("left_jacobian_inverse", "vector", js.Rotation.left_jacobian_inverse),
        # rigid transforms; `inverse_times` is a sum of products
        Operation("exp_of_motion", "V", js.RigidTransform.exp),
        Operation("log_of_motion", "X", js.RigidTransform.log),
        Operation("interpolate_motion", "X X scalar", js.RigidTransform.interpolate),
        Operation("left_jacobian_of_motion", "V", js.RigidTransform.left_jacobian),
        Operation("left_jacobian_inverse_of_motion", "V", js.RigidTransform.left_jacobian_inverse),
        Operation("to_matrix", "X", js.RigidTransform.to_matrix, takes_precision=False),
        # inertia
        Operation("combine", "M M", SpatialInertia.combine),
        Operation("add", "M M", lambda M, N: M + N, takes_precision=False, twin="combine"),
        Operation("remove", "M part", SpatialInertia.remove),
        Operation("subtract", "M part", lambda M, N: M - N, takes_precision=False, twin="remove"),
        Operation("sum", "bodies", _sum),
        Operation("from_dynamic_parameters", "pi10", SpatialInertia.from_dynamic_parameters),
        Operation("from_six_by_six", "six", SpatialInertia.from_matrix, twin="from_dynamic_parameters"),
        Operation("from_pseudo_inertia", "pseudo", SpatialInertia.from_pseudo_inertia),
        Operation("from_log_cholesky", "theta10", SpatialInertia.from_log_cholesky),
        Operation("to_log_cholesky", "M", SpatialInertia.to_log_cholesky),
        Operation("principal_moments", "M", SpatialInertia.principal_moments, twin="principal_moments_and_axes"),
        Operation("principal_moments_and_axes", "M", SpatialInertia.principal_moments_and_axes),
        Operation("validity_slack", "doubtful", SpatialInertia.validity_slack, is_one_formula=False),
        Operation("is_physically_valid", "doubtful", SpatialInertia.is_physically_valid, differentiable=False,
                  is_mask=True),
        Operation("nearest_valid", "doubtful", SpatialInertia.nearest_valid, is_one_formula=False),
        Operation("equivalent_ellipsoid", "M", SpatialInertia.equivalent_ellipsoid, is_one_formula=False),
        Operation("equivalent_box", "M", SpatialInertia.equivalent_box, is_one_formula=False,
                  twin="equivalent_ellipsoid"),
        Operation("minimum_length", "M", SpatialInertia.minimum_length),
        # shapes
        _shape("solid_box", "edges positive"),
        _shape("solid_cube", "positive positive", twin="solid_box"),
        _shape("solid_sphere", "positive positive", twin="solid_ellipsoid"),
        _shape("hollow_sphere", "positive positive"),
        _shape("solid_ellipsoid", "edges positive"),
        _shape("solid_cylinder", "positive positive vector positive", twin="solid_cylinder_about_end"),
        _shape("solid_cylinder_about_end", "positive positive vector positive"),
        _shape("solid_capsule", "positive positive vector positive"),
        _shape("solid_cone", "positive positive vector positive", twin="solid_cylinder_about_end"),
        _shape("solid_tetrahedron", "tetrahedron positive"),
        _shape("hollow_cylinder", "positive larger positive vector positive"),
        _shape("thin_rod", "positive vector positive", by="mass", twin="solid_cylinder_about_end"),
        _shape("solid_box", "edges positive", by="mass", name="solid_box_by_mass", twin="solid_box"),
        Operation("point_mass", "vector positive", lambda com, mass: SpatialInertia.point_mass(com, mass=mass),
                  takes_precision=False),
        Operation("triangle_mesh", "octahedron positive", _mesh),
        # articulated inertia and the motion of one body
        Operation("rotate_articulated", "R P", js.rotate, twin="act_articulated"),
        Operation("act_articulated", "X P", js.act),
        Operation("act_inverse_articulated", "X P", js.act_inverse),
        Operation("project_out", "P V positive", js.ArticulatedInertia.project_out),
        Operation("project_out_two", "P V V positive", _without_two),
        Operation("is_valid_articulated", "doubtful_P", lambda P: P.is_physically_valid(2.0**-7),
                  differentiable=False, takes_precision=False, is_mask=True),
        Operation("newton_euler", "M A vector", js.newton_euler),
    )
}  # fmt: skip
FORMULAS = [name for name, operation in OPERATIONS.items() if not operation.twin]
# Of each kind of arithmetic one: series, angles, directions, quotients, loops, shapes, products.
REPRESENTATIVES = (
    "left_jacobian_inverse",
    "to_axis_angle",
    "from_one_vector",
    "combine",
    "principal_moments_and_axes",
    "solid_capsule",
    "newton_euler",
)

"""The table of operations over which every transformation and every law is tested: a new operation is one line.

Of sums of products there are naive formulas, and the bounds of the docstrings; of those that are measured both stand in
`jaxspatial.measure`. What takes quotients, roots, angles or decisions has no formula of one line to compare bits with:
it is compared with itself, run one primitive after another, where no compiler has anything to rewrite.
"""

import functools

import numpy as np

import jaxspatial as js
from jaxspatial.inertia import joint_projection
from jaxspatial.inertia.articulated import ACT as ARTICULATED_ACT
from jaxspatial.inertia.articulated import ROTATED as ARTICULATED_ROTATED
from jaxspatial.inertia.articulated import SHIFT as ARTICULATED_SHIFT
from jaxspatial.inertia.articulated import TIMES as ARTICULATED_TIMES
from jaxspatial.inertia.inertia import ABOUT, ENERGY, FORCE, TORQUE
from jaxspatial.inertia.newton_euler import NEWTON_EULER
from jaxspatial.inertia.regressors import ENERGY_REGRESSOR, NEWTON_EULER_REGRESSOR
from jaxspatial.measure.operation import OPERATIONS as MEASURED
from jaxspatial.numerics.promise import EXACT, Promise
from jaxspatial.rotation.rotation import ROTATED, composed
from jaxspatial.spatial.operations import ACT, ACT_ACCELERATION, CROSS_ONE, ROTATED_INERTIA, SHIFT
from jaxspatial.spatial.transform import POINT, transformed
from jaxspatial.spatial.vectors import COMPOSED, COMPOSED_ACCELERATION
from jaxspatial.spatial.wrench import CENTRAL_AXIS, PRESSED
from tests.helpers import formulas as naive
from tests.helpers.arguments import N_POINTS
from tests.helpers.operation import Operation


def of_sum(n: int, function) -> Promise:
    """Of n items, by halving: what the docstring of the function says of n."""
    rounds = function.promises["bound"].factor(n)
    return Promise(u=rounds, u2=2 * rounds**2, u3=n**2)


DTYPES = ("float16", "bfloat16", "float32", "float64")
SUMMED, PLAIN_SUM = of_sum(N_POINTS, js.wrench_from_point_forces), of_sum(N_POINTS, js.SpatialForce.sum)
ROUNDED_ONCE = Promise(u=1)
_ACTED = (ARTICULATED_ACT, ARTICULATED_ACT, ARTICULATED_ROTATED)
# Indices of 32 bits: those of 64, first used while 64-bit types are off, fail op by op once they are on (jax 0.10).
_TRIANGLES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.int32
)
_plain = functools.partial(Operation, takes_precision=False)


def _measured(name, arguments, function, of, kept=None, swaps=False, **options):
    """An operation whose formulas and bounds `measure` has; `kept`: the array that is passed on as it is, and where.

    `swaps`: the arrays of the second argument come first there.
    """
    parts, bounds = list(MEASURED[of].formulas), list(MEASURED[of].bounds)
    if kept is not None:
        parts.insert(kept, lambda *arrays: arrays[kept])
        bounds.insert(kept, EXACT)

    def formula(*arrays):
        given = arrays[2:] + arrays[:2] if swaps else arrays
        return tuple(part(*given) for part in parts)

    return Operation(name, arguments, function, formula, tuple(bounds), **options)


def _shape(shape, arguments, by="density", name=None, **options):
    """A body of uniform density; its mass or density comes after its lengths."""

    def function(*lengths_and_amount, precision=None):
        *lengths, amount = lengths_and_amount
        return getattr(js.SpatialInertia, shape)(*lengths, **{by: amount}, precision=precision)

    return Operation(name or shape, arguments, function, **options)


def _from_origin(M, precision=None):
    return js.SpatialInertia.from_origin(M.mass, M.com, M.central, precision=precision)


def _without_two(P, S, T, armature, precision=None):
    return joint_projection(P, [S, T], armature, precision=precision)


def _mesh(vertices, density, precision=None):
    return js.SpatialInertia.triangle_mesh(vertices, _TRIANGLES, density=density, precision=precision)


OPERATIONS = {
    operation.name: operation
    for operation in (
        # measured
        _measured("shift_force", "F vector", js.shift, "shift_force", kept=1),
        _measured("shift_momentum", "L vector", js.shift, "shift_force", kept=1, twin="shift_force"),
        _measured("shift_velocity", "V vector", js.shift, "shift_velocity", kept=0),
        _measured("shift_acceleration", "A vector vector", js.shift, "shift_acceleration", kept=0),
        _measured("dot_force_velocity", "F V", js.dot, "dot"),
        _measured("dot_velocity_force", "V F", js.dot, "dot", swaps=True, twin="dot_force_velocity"),
        _measured("dot_momentum_velocity", "L V", js.dot, "dot", twin="dot_force_velocity"),
        _measured("dot_velocity_momentum", "V L", js.dot, "dot", swaps=True, twin="dot_force_velocity"),
        _measured("cross_velocity", "V V", js.cross, "cross_motion"),
        _measured("cross_acceleration", "V A", js.cross, "cross_motion", twin="cross_velocity"),
        _measured("cross_force", "V F", js.cross, "cross_force"),
        _measured("cross_momentum", "V L", js.cross, "cross_force", twin="cross_force"),
        # sums of products
        Operation("rotate", "R F", js.rotate, naive.rotated, (ROTATED, ROTATED)),
        Operation("compose_rotations", "R R", lambda R, S, precision=None: composed(R, S, precision=precision),
                  lambda *entries: (naive.product(*entries),), (ROTATED,)),
        Operation("transform_point", "X vector", lambda X, p, precision=None: transformed(X, p, precision=precision),
                  naive.transformed, (POINT,)),
        Operation("compose_transforms", "X X", lambda X, Y, precision=None: transformed(X, Y, precision=precision),
                  naive.transforms, (ROTATED, POINT), twin="transform_point"),
        Operation("inverse_times", "X X", js.RigidTransform.inverse_times, naive.inverse_times, (ROTATED, ACT)),
        Operation("act_velocity", "X V", js.act, naive.moved, (ROTATED, ACT)),
        Operation("act_force", "X F", js.act, naive.swapped(naive.moved), (ACT, ROTATED), twin="act_velocity"),
        Operation("act_inverse_velocity", "X V", js.act_inverse, naive.moved_back, (ROTATED, ACT)),
        Operation("act_inverse_momentum", "X L", js.act_inverse, naive.swapped(naive.moved_back), (ACT, ROTATED),
                  twin="act_inverse_velocity"),
        Operation("act_acceleration", "X A vector", js.act, naive.moved_acceleration,
                  (ROTATED, ACT_ACCELERATION), is_long=True),
        Operation("act_inverse_acceleration", "X A vector", js.act_inverse, naive.acceleration_moved_back,
                  (ROTATED, ACT_ACCELERATION), is_long=True),
        Operation("compose_velocity", "V vector V", js.SpatialVelocity.compose_with_moving_frame,
                  naive.composed_velocity, (CROSS_ONE, COMPOSED)),
        Operation("compose_acceleration", "A vector vector V A", js.SpatialAcceleration.compose_with_moving_frame,
                  naive.composed_acceleration, (COMPOSED, COMPOSED_ACCELERATION), is_long=True),
        Operation("to_featherstone", "A V", js.SpatialAcceleration.to_featherstone,
                  lambda alpha, a, w, v: (np.concatenate((alpha, a - np.cross(w, v)), -1),), (SHIFT,),
                  twin="shift_force"),
        Operation("shift_inertia", "M vector", js.shift, lambda m, c, i, p: (m, c - p, i),
                  (EXACT, ROUNDED_ONCE, EXACT)),
        Operation("rotate_inertia", "R M", js.rotate, naive.rotated_inertia, (EXACT, ROTATED, ROTATED_INERTIA)),
        Operation("act_inertia", "X M", js.act, naive.acted_inertia, (EXACT, POINT, ROTATED_INERTIA),
                  twin="rotate_inertia"),
        Operation("act_inverse_inertia", "X M", js.act_inverse, naive.inertia_acted_back, (EXACT, ACT, ROTATED_INERTIA),
                  twin="rotate_inertia"),
        Operation("apply_acceleration", "M A", js.SpatialInertia.apply, naive.applied, (TORQUE, FORCE), is_long=True),
        Operation("apply_velocity", "M V", js.SpatialInertia.apply, naive.applied, (TORQUE, FORCE),
                  twin="apply_acceleration"),
        Operation("kinetic_energy", "M V", lambda M, V, precision=None: M.kinetic_energy(V, precision=precision) * 2,
                  naive.twice_energy, (ENERGY,), is_long=True),
        Operation("from_origin", "M", _from_origin, lambda m, c, i: (m, c, i - naive.steiner(m, c)),
                  (EXACT, EXACT, ABOUT)),
        Operation("inertia_about_origin", "M", js.SpatialInertia.inertia_about_origin,
                  naive.moments_about_origin, (ABOUT,), twin="from_origin"),
        Operation("to_matrix", "M", js.SpatialInertia.to_matrix, naive.six_by_six, (ABOUT,)),
        Operation("to_dynamic_parameters", "M", js.SpatialInertia.to_dynamic_parameters, naive.dynamic_parameters,
                  (ABOUT,), twin="to_matrix"),
        Operation("to_pseudo_inertia", "M",
                  lambda M, precision=None: M.to_pseudo_inertia(precision=precision) * 2, naive.twice_pseudo_inertia,
                  (ABOUT,), twin="to_matrix"),
        Operation("newton_euler_regressor", "A vector", js.regressors.newton_euler_regressor, naive.regressor,
                  (NEWTON_EULER_REGRESSOR,), is_long=True),
        Operation("kinetic_energy_regressor", "V", js.regressors.kinetic_energy_regressor,
                  bounds=(ENERGY_REGRESSOR,)),
        Operation("inverse_transform", "X", js.RigidTransform.inverse, naive.inverse, (EXACT, ROTATED)),
        Operation("to_articulated", "M", js.ArticulatedInertia.from_spatial_inertia, naive.articulated,
                  (ABOUT, CROSS_ONE, EXACT), twin="to_matrix"),
        Operation("articulated_times", "P A", js.ArticulatedInertia.times, naive.articulated_times,
                  (ARTICULATED_TIMES, ARTICULATED_TIMES), is_long=True),
        Operation("articulated_shift", "P vector", js.ArticulatedInertia.shift, naive.articulated_shifted,
                  (ARTICULATED_SHIFT, ARTICULATED_SHIFT, EXACT), is_long=True),
        Operation("wrench_from_point_forces", "points points", js.wrench_from_point_forces, naive.wrench,
                  (SUMMED, SUMMED)),
        Operation("sum", "forces", lambda F, precision=None: F.sum(-1, precision=precision),
                  lambda tau, f: (naive.sum_of_points(tau), naive.sum_of_points(f)), (PLAIN_SUM, PLAIN_SUM)),
        Operation("central_axis", "F", js.central_axis, naive.axis, (CENTRAL_AXIS, CENTRAL_AXIS)),
        Operation("center_of_pressure", "F vector", js.center_of_pressure, naive.pressed, (PRESSED,)),
        # what has no precision
        _plain("motion_matrix", "X", js.RigidTransform.to_motion_matrix, naive.motion_matrix),
        _plain("add", "F F", lambda F, G: F + G, lambda tau, f, tau2, f2: (tau + tau2, f + f2)),
        _plain("subtract", "V V", lambda V, W: V - W, lambda w, v, w2, v2: (w - w2, v - v2)),
        _plain("negate", "L", lambda L: -L, lambda *parts: tuple(-x for x in parts)),
        _plain("multiply", "F scalar", lambda F, s: F * s, naive.scaled_force),
        _plain("multiply_from_left", "scalar F", lambda s, F: s * F,
               lambda s, tau, f: naive.scaled_force(tau, f, s)),
        _plain("divide", "A scalar", lambda A, s: A / s,
               lambda alpha, a, s: (alpha / s[..., None], a / s[..., None])),
        _plain("at_batch", "forces", lambda F: F.at_batch((..., 2)), lambda tau, f: (tau[..., 2, :], f[..., 2, :])),
        _plain("stack", "X", lambda X: js.stack([X, X], -1), naive.twice),
        _plain("equal", "L L", lambda L, L2: L == L2,
               lambda *parts: (np.all(np.equal(parts[:2], parts[2:]), (0, -1)),), differentiable=False),
        _plain("to_array", "V", js.SpatialVelocity.to_array, lambda w, v: (np.concatenate((w, v), -1),)),
        _plain("from_array", "coefficients", js.SpatialMomentum.from_array, lambda x: (x[..., :3], x[..., 3:])),
        _plain("maximum_absolute_differences", "F F",
               js.SpatialForce.get_maximum_absolute_differences, naive.differences),
        _plain("is_nearly_equal", "A A", lambda A, B: A.is_nearly_equal_within_absolute_tolerance(B, 2.0, 1.5),
               lambda *parts: naive.near(2.0, 1.5, *parts), differentiable=False),
        _plain("is_approx", "V V", lambda V, W: V.is_approx(W, 2.0),
               lambda *parts: naive.near(2.0, 2.0, *parts), differentiable=False),
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
        _plain("transform_to_matrix", "X", js.RigidTransform.to_matrix),
        # inertia
        Operation("combine", "M M", js.SpatialInertia.combine),
        _plain("add_inertias", "M M", lambda M, N: M + N, twin="combine"),
        Operation("remove", "M part", js.SpatialInertia.remove),
        _plain("subtract_inertia", "M part", lambda M, N: M - N, twin="remove"),
        Operation("sum_of_inertias", "bodies", lambda M, precision=None: M.sum(-1, precision=precision)),
        Operation("from_dynamic_parameters", "pi10", js.SpatialInertia.from_dynamic_parameters),
        Operation("from_six_by_six", "six", js.SpatialInertia.from_matrix, twin="from_dynamic_parameters"),
        Operation("from_pseudo_inertia", "pseudo", js.SpatialInertia.from_pseudo_inertia),
        Operation("from_log_cholesky", "theta10", js.SpatialInertia.from_log_cholesky),
        Operation("to_log_cholesky", "M", js.SpatialInertia.to_log_cholesky),
        Operation("principal_moments", "M", js.SpatialInertia.principal_moments, twin="principal_moments_and_axes"),
        Operation("principal_moments_and_axes", "M", js.SpatialInertia.principal_moments_and_axes),
        Operation("validity_slack", "doubtful", js.SpatialInertia.validity_slack, is_one_formula=False),
        Operation("is_physically_valid", "doubtful", js.SpatialInertia.is_physically_valid, differentiable=False,
                  is_mask=True),
        Operation("nearest_valid", "doubtful", js.SpatialInertia.nearest_valid, is_one_formula=False),
        Operation("equivalent_ellipsoid", "M", js.SpatialInertia.equivalent_ellipsoid, is_one_formula=False),
        Operation("equivalent_box", "M", js.SpatialInertia.equivalent_box, is_one_formula=False,
                  twin="equivalent_ellipsoid"),
        Operation("minimum_length", "M", js.SpatialInertia.minimum_length),
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
        _plain("point_mass", "vector positive", lambda com, mass: js.SpatialInertia.point_mass(com, mass=mass)),
        Operation("triangle_mesh", "octahedron positive", _mesh),
        # articulated inertia and the motion of one body
        Operation("rotate_articulated", "R P", js.rotate, bounds=(ARTICULATED_ROTATED,) * 3, is_of_sums=False,
                  twin="act_articulated"),
        Operation("act_articulated", "X P", js.act, bounds=_ACTED, is_of_sums=False),
        Operation("act_inverse_articulated", "X P", js.act_inverse, bounds=_ACTED, is_of_sums=False),
        Operation("project_out", "P V positive", js.ArticulatedInertia.project_out),
        Operation("project_out_two", "P V V positive", _without_two),
        _plain("is_valid_articulated", "doubtful_P", lambda P: P.is_physically_valid(2.0**-7),
               differentiable=False, is_mask=True),
        Operation("newton_euler", "M A vector", js.newton_euler, bounds=(NEWTON_EULER, NEWTON_EULER),
                  is_of_sums=False),
        Operation("bregman_divergence", "M M", js.bregman_divergence),
    )
}  # fmt: skip

# -- groups of operations ---------------------------------------------------------------------------------------------

# Operations with a naive formula, and those of them that have a precision to choose: sums of products.
NAIVE = [name for name, operation in OPERATIONS.items() if operation.formula]
SUMS = [name for name in NAIVE if OPERATIONS[name].bounds]
# One operation of each formula: the others run the same one on other types.
DISTINCT = [name for name, operation in OPERATIONS.items() if not operation.twin]
DISTINCT_SUMS = [name for name in SUMS if name in DISTINCT]
# Operations whose bounds are those of numbers, with a formula or without.
BOUNDED = [name for name, operation in OPERATIONS.items() if operation.bounds]
DISTINCT_BOUNDED = [name for name in BOUNDED if name in DISTINCT]
# One operation of each kind of sum of products.
REPRESENTATIVES = (
    "shift_force",
    "shift_acceleration",
    "dot_force_velocity",
    "cross_velocity",
    "act_velocity",
    "wrench_from_point_forces",
)
# One operation of each other kind of arithmetic: series, angles, directions, quotients, loops, shapes, products.
OTHER_REPRESENTATIVES = (
    "left_jacobian_inverse",
    "to_axis_angle",
    "from_one_vector",
    "combine",
    "principal_moments_and_axes",
    "solid_capsule",
    "newton_euler",
)

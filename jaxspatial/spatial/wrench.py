"""The wrench of point forces, and the central axis and centre of pressure of a wrench."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxspatial.numerics import floats
from jaxspatial.numerics.check import require_kind
from jaxspatial.numerics.errorfree.primitives import choice, of_any_mesh
from jaxspatial.numerics.errorfree.scaling import exponent, times_power_of_two
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Summed, Wrench, cross, dot
from jaxspatial.numerics.numbers.components import as_array, is_zero
from jaxspatial.numerics.numbers.layout import unstack
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.promise import OfSum, Promise, promises
from jaxspatial.numerics.quantity import exported, require_compatible
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial.vectors import SpatialForce

# Error bounds, see `numerics.promise`.
CENTRAL_AXIS = Promise(7, 32, mag="the sum of the absolute values of the numerator's terms over f . f")
# Where the denominator is least known, what the numerator is off by grows to 8 / 7, twice as precise to 24 / 17.
PRESSED = Promise(3.5, 5, u_of_result=4, u2_of_result=32)


@promises(bound=OfSum(2))
def wrench_from_point_forces(points: ArrayLike, forces: ArrayLike, *, precision: PrecisionName = None) -> SpatialForce:
    """The wrench of forces that act at points, about the origin P of the points.

        tau = sum p_i x f_i       f = sum f_i

    Summation is pairwise, always in the same order. In "faithful" moments, forces and partial sums may overflow without
    harm.

    Args:
        points: (*batch, n, 3) positions p_PQi_E, m, of the points from P, expressed in frame E.
        forces: (*batch, n, 3) forces f_Qi_E, N, in the same frame.
        precision: name of a precision; None takes the default.

    Returns:
        The SpatialForce about P, in E, over the common batch; zero for n = 0.

    Raises:
        TypeError: dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: per component, L = ceil(log2 n), mag the sum of the absolute values of the terms: at most (2 + L) u mag in
        "fast" and "reproducible", u |r| + 2 (2 + L)^2 u^2 mag in "compensated", 1 ulp of r in "faithful" while |r| >=
        n^2 u^2 mag (a sum in three times the precision), while nothing over- or underflows. For the edges, and for
        derivatives, see `jaxspatial.spatial.operations`.
    Source: Higham 2002, 4.2: pairwise summation.

    Example:
        >>> points = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        >>> forces = [[0.0, 2.0, 0.0], [3.0, 0.0, 0.0]]
        >>> js.wrench_from_point_forces(points, forces)
        SpatialForce(tau=[0.0, 0.0, -1.0], f=[3.0, 2.0, 0.0])
    """
    points = floats.as_vectors(points, "wrench_from_point_forces: points", many=["n"])
    forces = floats.as_vectors(forces, "wrench_from_point_forces: forces", points.dtype, many=["n"])
    require_compatible(points=points, forces=forces)
    return SpatialForce(*_sum_of_moments(precision, points, forces))


_sum_of_moments = formula(lambda p, f: [Summed(cross(p, f)), Summed(f)], of_sums=True)


@exported
class CentralAxis(NamedTuple):
    """The line about which a wrench is a force along it and a couple about it."""

    pitch: jax.Array
    point: jax.Array


@promises(bound=CENTRAL_AXIS)
def central_axis(F_P_E: SpatialForce, *, precision: PrecisionName = None) -> CentralAxis:
    """The central (Poinsot) axis of a wrench, as its pitch and its point nearest to P.

        pitch = f . tau / f . f                   p_PA = f x tau / f . f

    The direction of the axis is that of f; about any of its points the wrench is (pitch f, f). A couple (f = 0) has no
    axis: its pitch is infinite, with a sign that means nothing, and its point and all derivatives are NaN. For a zero
    wrench all are NaN; under `jax_debug_nans` both raise JAX's FloatingPointError. Both parts are scaled by powers of
    two first, so that nothing over- or underflows before the result does.

    Args:
        F_P_E: SpatialForce (*batch,) about P, expressed in frame E.
        precision: name of a precision; None takes the default.

    Returns:
        CentralAxis(pitch (*batch,), m; point (*batch, 3), m, from P, in E).

    Raises:
        TypeError: F_P_E is no SpatialForce.
        ValueError: the precision has no such name.

    Error: per component, mag the sum of the absolute values of the numerator's terms over f . f: at most 7 u mag in
        "fast" and "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp of r in "faithful"; plus a few finfo.tiny
        where subnormals are flushed. Derivatives in the last two are as accurate as in "reproducible" only.
    Source: Featherstone 2008, 2.5; Ball 1900, A Treatise on the Theory of Screws.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 1.0, 4.0], f=[0.0, 0.0, 2.0])
        >>> axis = js.central_axis(F)
        >>> print(axis.pitch, axis.point)
        2.0 [-0.5  0.   0. ]
    """
    require_kind(F_P_E, SpatialForce, "central_axis")
    parts = (as_array(part, F_P_E.batch_shape) for part in floats.narrowed_each(F_P_E._vectors))
    return CentralAxis(*_central_axis(resolve(precision), *parts))


@functools.partial(jax.jit, static_argnums=0, inline=True)
@of_any_mesh
def _central_axis(precision: Precision, tau, f) -> tuple:
    """(pitch, point), computed with parts scaled to about 1: nothing over- or underflows before the result does."""
    tau_high, f_high = (unstack(jnp.asarray(jax.tree.leaves(x)[0])) for x in (tau, f))
    tau_exponent, f_exponent = exponent(tau_high), exponent(f_high)
    scaled = _scaled(tau, -tau_exponent[..., None]), _scaled(f, -f_exponent[..., None])
    pitch, point = _axis_of_scaled(precision, Wrench(*scaled))
    back = tau_exponent - f_exponent
    pitch, point = _scaled(pitch, back), _scaled(point, back[..., None])
    return _infinite_where(_is_zero(f_high) & ~_is_zero(tau_high), pitch), point


def _scaled(x, e: jax.Array):
    return jax.tree.map(lambda word: times_power_of_two(jnp.asarray(word), e), x)


def _is_zero(components: Sequence[jax.Array]) -> jax.Array:
    x, y, z = components
    return (x == 0) & (y == 0) & (z == 0)


def _infinite_where(condition: jax.Array, x):
    """x, or infinity where the condition holds; a double word takes it in its first word."""
    words, structure = jax.tree.flatten(x)
    infinite = choice(jnp.inf, words[0].shape, words[0].dtype)
    fill = [infinite, *map(jnp.zeros_like, words[1:])]
    filled = [jnp.where(condition, v, w) for w, v in zip(words, fill, strict=True)]
    return jax.tree.unflatten(structure, filled)


@formula(of_sums=True, layout=(None, 1))
def _axis_of_scaled(F: Wrench) -> list:
    squared = dot(F.f, F.f)
    return [dot(F.f, F.tau) / squared, cross(F.f, F.tau) / squared]


@promises(bound=PRESSED)
def center_of_pressure(
    F_P_E: SpatialForce, normal: ArrayLike = (0.0, 0.0, 1.0), *, precision: PrecisionName = None
) -> jax.Array:
    """The centre of pressure in the plane through P: the point about which the torque has only a normal component.

        p_PC = normal x tau / (normal . f)

    It is the zero-moment point if F is the wrench of the contacts.

    Args:
        F_P_E: SpatialForce (*batch,) about P, a point of the plane, expressed in frame E.
        normal: (*batch, 3), of any length, in E. Floats in a list take the dtype of F.
        precision: name of a precision; None takes the default.

    Returns:
        p_PC (*batch, 3), m, in E, over the common batch. Where the normal force is zero, components are infinite or
            NaN, and `jax_debug_nans` raises JAX's FloatingPointError.

    Raises:
        TypeError: F_P_E is no SpatialForce, or dtypes differ.
        ValueError: shapes do not fit.

    Error: let mag be the sum of the absolute values of the numerator's terms over |normal . f|, and c = sum |normal_i
        f_i| / |normal . f| the condition of the denominator, which is 1 for a normal along an axis. The error of a
        component r of p_PC is at most 3.5 u mag + 4 u |r| c in "fast" and "reproducible", u |r| + 5 u^2 mag + 32 u^2
        |r| c in "compensated", 1 ulp of r in "faithful". This holds while 24 u c <= 1, in "compensated" 24 u^2 c <= 1,
        and nothing over- or underflows. Where subnormals are flushed, a few finfo.tiny are added. Derivatives in the
        last two are as accurate as in "reproducible" only.
    Source: Vukobratovic and Borovac 2004, Zero-moment point - thirty five years of its life.

    Example:
        >>> F = js.SpatialForce(tau=[1.0, -2.0, 0.0], f=[0.0, 0.0, 10.0])
        >>> print(js.center_of_pressure(F, [0.0, 0.0, 1.0])[:2])
        [0.2 0.1]
    """
    require_kind(F_P_E, SpatialForce, "center_of_pressure")
    normal = floats.as_vectors(normal, "center_of_pressure: normal", F_P_E.dtype)
    batch = require_compatible(SpatialForce=F_P_E, normal=normal)
    point = _center_of_pressure(precision, Wrench(*F_P_E._vectors), normal)
    return as_array(point, batch) if is_zero(point) else point


_center_of_pressure = formula(lambda F, normal: cross(normal, F.tau) / dot(normal, F.f), of_sums=True)

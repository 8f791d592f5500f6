"""Wrenches and points: from point forces to a wrench, and from a wrench to its axis and its centre of pressure."""

# Of `jax.jit`, `jax.tree` and `jnp.asarray` the stubs say only a part.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false
# pyright: reportUnknownLambdaType=false

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.errorfree.scaling import exponent, times_power_of_two
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Three, folding
from jaxspatial.arithmetic.numbers.components import as_array, is_zero
from jaxspatial.arithmetic.numbers.stacking import Summed
from jaxspatial.arithmetic.precision import Precision, resolve
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.types import PrecisionName, Vector, Vector3
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.force import SpatialForce


def wrench_from_point_forces(points: Vector, forces: Vector, *, precision: PrecisionName = None) -> SpatialForce:
    """The wrench of forces that act at points, about the origin P of the points.

        tau = sum p_i x f_i       f = sum f_i

    Summed by halving, always in the same order. In "faithful" no moment, force or partial sum that overflows on the way
    matters.

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
    """
    points = check.as_vectors(points, "wrench_from_point_forces: points", many=["n"])
    forces = check.as_vectors(forces, "wrench_from_point_forces: forces", points.dtype, many=["n"])
    require_alike(points=points, forces=forces)
    return SpatialForce(*_sum_of_moments(precision, points, forces))


@formula(of_sums=True)
def _sum_of_moments(p: Three, f: Three) -> list[Summed]:
    return [vectors.summed(vectors.cross(p, f)), vectors.summed(f)]


class CentralAxis(NamedTuple):
    """The line about which a wrench is a force along it and a couple about it."""

    pitch: jax.Array
    point: jax.Array


def central_axis(F_P_E: SpatialForce, *, precision: PrecisionName = None) -> CentralAxis:
    """The central (Poinsot) axis of a wrench, as its pitch and its point nearest to P.

        pitch = f . tau / f . f                   p_PA = f x tau / f . f

    The direction of the axis is that of f; about any of its points the wrench is (pitch f, f). A couple (f = 0) has no
    axis: pitch is an infinity of no meaning in its sign, point is NaN, and so are derivatives; for a zero wrench all
    are NaN. Both parts are scaled by powers of two first, so that nothing over- or underflows before the result does.

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
    """
    require_kind(F_P_E, SpatialForce, "central_axis")
    parts = (as_array(part, F_P_E.batch_shape) for part in check.narrowed_each(F_P_E.vectors))
    return CentralAxis(*_central_axis(resolve(precision), *parts))


@functools.partial(jax.jit, static_argnums=0, inline=True)
def _central_axis(precision: Precision, tau: Any, f: Any) -> tuple[Any, Any]:
    """On vectors scaled to about 1: nothing over- or underflows before the result does."""
    tau_high, f_high = (folding.unstack(jnp.asarray(jax.tree.leaves(x)[0])) for x in (tau, f))
    tau_exponent, f_exponent = exponent(tau_high), exponent(f_high)
    scaled = _scaled(tau, -tau_exponent[..., None]), _scaled(f, -f_exponent[..., None])
    pitch, point = _axis_of_scaled(precision, *scaled)
    back = tau_exponent - f_exponent
    pitch, point = _scaled(pitch, back), _scaled(point, back[..., None])
    return _infinite_where(_is_zero(f_high) & ~_is_zero(tau_high), pitch), point


def _scaled(x: Any, e: jax.Array) -> Any:
    return jax.tree.map(lambda word: times_power_of_two(jnp.asarray(word), e), x)


def _is_zero(components: Sequence[jax.Array]) -> jax.Array:
    x, y, z = components
    return (x == 0) & (y == 0) & (z == 0)


def _infinite_where(condition: jax.Array, x: Any) -> Any:
    """x, or an infinity: of a double word in its first word."""
    words, structure = jax.tree.flatten(x)
    fill = [jnp.inf] + [0.0] * (len(words) - 1)
    filled = [jnp.where(condition, jnp.full_like(w, v), w) for w, v in zip(words, fill, strict=True)]
    return jax.tree.unflatten(structure, filled)


@formula(of_sums=True)
def _axis_of_scaled(tau: Three, f: Three) -> list[Number | Three]:
    squared = vectors.dot(f, f)
    point = [c / squared for c in vectors.cross(f, tau)]
    return [vectors.dot(f, tau) / squared, vectors.laid_out_as(f, point)]


def center_of_pressure(
    F_P_E: SpatialForce, normal: Vector3 = (0.0, 0.0, 1.0), *, precision: PrecisionName = None
) -> jax.Array:
    """Where the plane through P with that normal is pressed: the point about which the torque has only a normal part.

        p_PC = normal x tau / (normal . f)

    It is the zero-moment point, if F is the wrench of the contacts.

    Args:
        F_P_E: SpatialForce (*batch,) about P, a point of the plane, expressed in frame E.
        normal: (*batch, 3), of any length, in E. Floats in a list take the dtype of F.
        precision: name of a precision; None takes the default.

    Returns:
        p_PC (*batch, 3), m, in E, over the common batch. Where nothing presses (normal . f = 0) components are infinite
            or NaN.

    Raises:
        TypeError: F_P_E is no SpatialForce, or dtypes differ.
        ValueError: shapes do not fit.

    Error: per component, mag the sum of the absolute values of the numerator's terms over |normal . f|,
        c = |normal . f| / sum |normal_i f_i| (1 for a normal along an axis): at most 3.5 u mag + 4 u |p_PC| / c in
        "fast" and "reproducible" while c >= 24 u, u |r| + 32 u^2 (mag + |p_PC| / c) in "compensated" while c >= 24 u^2,
        1 ulp of p_PC in "faithful"; while nothing over- or underflows, plus a few finfo.tiny where subnormals are
        flushed. Derivatives in the last two are as accurate as in "reproducible" only.
    Source: Vukobratovic and Borovac 2004, Zero-moment point - thirty five years of its life.
    """
    require_kind(F_P_E, SpatialForce, "center_of_pressure")
    normal = check.as_vectors(normal, "center_of_pressure: normal", F_P_E.dtype)
    batch = require_alike(SpatialForce=F_P_E, normal=normal)
    found = _center_of_pressure(precision, *F_P_E.vectors, normal)
    return as_array(found, batch) if is_zero(found) else found


@formula(of_sums=True)
def _center_of_pressure(tau: Three, f: Three, normal: Three) -> Three:
    pressing = vectors.dot(normal, f)
    return tuple(c / pressing for c in vectors.cross(normal, tau))

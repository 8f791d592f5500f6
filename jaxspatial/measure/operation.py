"""The operations that are measured: all that timing, exact references and promises need to know of one, in one table.

A new operation is one record. Arguments are named after arrays (n, 3): those of `scene.Wrenches`, the offset p, and
the accelerations alpha, a (see `trade.arguments`).
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import jax
import numpy as np
import numpy.typing as npt
from jax.typing import ArrayLike

from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.promise import Promise
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.measure import error, exact
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialVelocity, cross, dot, shift
from jaxspatial.spatial.promises import CROSS_ONE, CROSS_TWO, DOT, SHIFT, SHIFT_ACCELERATION

# The arrays that an operation computes, and of one of them the exact numbers and mag.
Parts = tuple[jax.Array, ...]
Exactly = tuple[np.ndarray, np.ndarray]


class Operation(NamedTuple):
    """One operation; what it computes is given as a tuple of parts, without those that it passes on as they are."""

    name: str
    arguments: tuple[str, ...]  # names of the arrays it takes
    function: Callable[..., Parts]  # (precision, *arguments of one item) -> parts
    formulas: tuple[Callable[..., Any], ...]  # the same over numbers of any kind, per part
    units: tuple[str, ...]  # per part
    bounds: tuple[Promise, ...]  # per part a Promise
    flushed: int  # so many finfo.tiny are forgiven: one for each product, its error, and each sum of a component
    size: int  # numbers in all parts of one item
    turned: tuple[int, ...]  # arguments that change sign from step to step of a loop, and all parts with them
    replaced: int | None = None  # the argument whose place the only part takes when it is done in place

    @property
    def title(self):
        return self.name.replace("_", " ")

    @property
    def words(self):
        """Numbers read and written per item."""
        return 3 * len(self.arguments) + self.size

    def batched(self, precision: Precision | str) -> Callable[..., Parts]:
        """The operation on arrays (n, 3)."""
        return jax.vmap(lambda *arrays: self.function(str(precision), *arrays))

    def exactly(self, *arrays: npt.ArrayLike) -> list[Exactly]:
        """[(exact value, mag)] per part."""
        return [exact.evaluate(formula, *arrays) for formula in self.formulas]

    def promise(self, precision: Precision | str):
        """The bound on the error of a component in words."""
        return " or ".join(dict.fromkeys(promise.words(precision) for promise in self.bounds))

    def allowed(self, precision: Precision | str, part: int, value: np.ndarray, mag: np.ndarray, dtype: DTypeLike):
        """The bound on the error of each component of a part, as Fractions."""
        return error.allowed(self.bounds[part], precision, value, mag, dtype)

    @staticmethod
    def in_units(computed: Sequence[ArrayLike], exactly: Sequence[Exactly]):
        """The largest error of each part in its SI unit, as floats; inf for NaN."""
        pairs = zip(computed, exactly, strict=True)
        errors = [error.in_units_of(Fraction(1), x, value) for x, (value, _) in pairs]
        return tuple(float(x.max()) if x.size else np.nan for x in errors)

    def of_promise(self, precision: Precision | str, computed: Sequence[ArrayLike], exactly: Sequence[Exactly]):
        """The largest error over the bound promised, and all errors in ulps (both float64, inf for NaN)."""
        dtype = np.asarray(computed[0]).dtype
        worst, ulps = 0.0, list[np.ndarray]()
        for part, (x, (value, mag)) in enumerate(zip(computed, exactly, strict=True)):
            bound = self.allowed(precision, part, value, mag, dtype)
            worst = max(worst, float(np.max(error.in_units_of(bound, x, value, self.flushed), initial=0.0)))
            ulps.append(error.in_ulps(x, value).ravel())
        return worst, np.concatenate(ulps)


def _shift_force(precision: str, tau: jax.Array, f: jax.Array, p: jax.Array):
    return (shift(SpatialForce(tau, f), p, precision=precision).tau,)


def _shift_velocity(precision: str, w: jax.Array, v: jax.Array, p: jax.Array):
    return (shift(SpatialVelocity(w, v), p, precision=precision).v,)


def _shift_acceleration(precision: str, alpha: jax.Array, a: jax.Array, p: jax.Array, w: jax.Array):
    return (shift(SpatialAcceleration(alpha, a), p, w, precision=precision).a,)


def _cross_motion(precision: str, w: jax.Array, v: jax.Array, alpha: jax.Array, a: jax.Array):
    rate = cross(SpatialVelocity(w, v), SpatialAcceleration(alpha, a), precision=precision)
    return rate.alpha, rate.a


def _cross_force(precision: str, w: jax.Array, v: jax.Array, tau: jax.Array, f: jax.Array):
    rate = cross(SpatialVelocity(w, v), SpatialForce(tau, f), precision=precision)
    return rate.tau, rate.f


def _dot(precision: str, tau: jax.Array, f: jax.Array, w: jax.Array, v: jax.Array):
    return (dot(SpatialForce(tau, f), SpatialVelocity(w, v), precision=precision),)


def _torque(tau: np.ndarray, f: np.ndarray, p: np.ndarray):
    return tau - np.cross(p, f)


def _velocity(w: np.ndarray, v: np.ndarray, p: np.ndarray):
    return v + np.cross(w, p)


def _acceleration(alpha: np.ndarray, a: np.ndarray, p: np.ndarray, w: np.ndarray):
    return a + np.cross(alpha, p) + np.cross(w, np.cross(w, p))


def _single(w: np.ndarray, v: np.ndarray, x: np.ndarray, y: np.ndarray):
    return np.cross(w, x)


def _double(w: np.ndarray, v: np.ndarray, x: np.ndarray, y: np.ndarray):
    return np.cross(w, y) + np.cross(v, x)


def _torque_rate(w: np.ndarray, v: np.ndarray, tau: np.ndarray, f: np.ndarray):
    return _double(w, v, f, tau)


def _force_rate(w: np.ndarray, v: np.ndarray, tau: np.ndarray, f: np.ndarray):
    return _single(w, v, f, tau)


def _power(tau: np.ndarray, f: np.ndarray, w: np.ndarray, v: np.ndarray):
    """Added one after another: NumPy's `sum` of numbers of 16 bits rounds once."""
    x, y = tau * w, f * v
    return (x[..., 0] + x[..., 1] + x[..., 2]) + (y[..., 0] + y[..., 1] + y[..., 2])


OPERATIONS = {
    operation.name: operation
    for operation in (
        Operation(
            "shift_force", ("tau", "f", "p"), _shift_force, (_torque,),
            units=("N m",), bounds=(SHIFT,), flushed=6, size=3, turned=(2,), replaced=0,
        ),
        Operation(
            "shift_velocity", ("w", "v", "p"), _shift_velocity, (_velocity,),
            units=("m/s",), bounds=(SHIFT,), flushed=6, size=3, turned=(2,), replaced=1,
        ),
        Operation(
            "shift_acceleration", ("alpha", "a", "p", "w"), _shift_acceleration, (_acceleration,),
            units=("m/s²",), bounds=(SHIFT_ACCELERATION,), flushed=32, size=3, turned=(2,), replaced=1,
        ),
        Operation(
            "cross_motion", ("w", "v", "alpha", "a"), _cross_motion, (_single, _double),
            units=("rad/s³", "m/s³"), bounds=(CROSS_ONE, CROSS_TWO), flushed=12, size=6, turned=(0, 1),
        ),
        Operation(
            "cross_force", ("w", "v", "tau", "f"), _cross_force, (_torque_rate, _force_rate),
            units=("N m/s", "N/s"), bounds=(CROSS_TWO, CROSS_ONE), flushed=12, size=6, turned=(0, 1),
        ),
        Operation(
            "dot", ("tau", "f", "w", "v"), _dot, (_power,),
            units=("W",), bounds=(DOT,), flushed=17, size=1, turned=(2, 3),
        ),
    )
}  # fmt: skip

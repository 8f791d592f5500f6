"""The operations that are measured, and the wrenches that they are measured on.

`OPERATIONS` is one table of all that timing, exact references and promises need to know: a new operation is one record.
Its arguments are named after arrays (n, 3): those of `Wrenches`, the offset p, and the accelerations alpha, a.
"""

import functools
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from numpy.typing import ArrayLike

from jaxspatial.measure import error
from jaxspatial.numerics.precision import Precision
from jaxspatial.numerics.promise import Promise
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialVelocity, cross, dot, shift
from jaxspatial.spatial.operations import CROSS_ONE, CROSS_TWO, DOT, SHIFT, SHIFT_ACCELERATION


class Wrenches(NamedTuple):
    """Wrenches on a body about points P, with the motion of the body there, None where it is not known; all (n, 3), one
    frame, SI units."""

    tau: np.ndarray
    f: np.ndarray
    w: np.ndarray | None
    v: np.ndarray | None


def rotating_body(n: int, seed: int = 0):
    """n wrenches at instants of one turn of a body that spins about a tilted axis while its centre moves on.

    Each acts about its own contact point P on the body, at most 0.5 m from the centre: forces of about 100 N, friction
    torques of about 1 N m, 3 rad/s, 1 m/s.
    """
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2 * np.pi, n, endpoint=False)
    p_CP_B = rng.uniform(-0.5, 0.5, (n, 3))
    f_P_B = rng.normal(0.0, 100.0, (n, 3))
    axis = np.array([0.6, 0.0, 0.8])
    w = np.broadcast_to(3.0 * axis, (n, 3)).copy()
    v = np.array([1.0, 0.0, 0.2]) + np.cross(w, _rotated(axis, angle, p_CP_B))
    return Wrenches(rng.normal(0.0, 1.0, (n, 3)), _rotated(axis, angle, f_P_B), w, v)


def _rotated(axis, angle, x):
    """x rotated by angle about axis. [Rodrigues 1840]"""
    parallel = (x @ axis)[:, None] * axis
    return parallel + np.cos(angle)[:, None] * (x - parallel) + np.sin(angle)[:, None] * np.cross(axis, x)


class Operation(NamedTuple):
    """One operation; what it computes is given as a tuple of parts, without those that it passes on as they are."""

    name: str
    arguments: tuple[str, ...]  # names of the arrays it takes
    function: Callable[..., tuple[jax.Array, ...]]  # (precision, *arguments of one item) -> parts
    formulas: tuple[Callable, ...]  # the same over numbers of any kind, per part
    units: tuple[str, ...]  # per part
    bounds: tuple[Promise, ...]  # per part
    flushed: int  # so many finfo.tiny are forgiven: one for each product, its error, and each sum of a component
    size: int  # numbers in all parts of one item
    flipped: tuple[int, ...]  # arguments that change sign from step to step of a loop, and all parts with them
    in_place: int | None = None  # the argument whose place the only part takes when it is done in place

    @property
    def title(self):
        return self.name.replace("_", " ")

    @property
    def words(self):
        """Numbers read and written per item."""
        return 3 * len(self.arguments) + self.size

    def drawn(self, wrenches: Wrenches, offset: ArrayLike, n: int, dtype: DTypeLike):
        """The arguments for n of the wrenches, evenly spread, or repeated as often as needed.

        Accelerations are those of a body of 1 kg and 1 kg m2 under the wrench.
        """
        count = len(wrenches.tau)
        index = np.linspace(0, count - 1, n).astype(int) if n < count else np.arange(n) % count
        offsets = np.broadcast_to(np.asarray(offset, np.float64), wrenches.tau.shape)
        arrays = {**wrenches._asdict(), "alpha": wrenches.tau, "a": wrenches.f, "p": offsets}
        with np.errstate(over="ignore"):
            return [jnp.asarray(arrays[name][index].astype(jnp.dtype(dtype))) for name in self.arguments]

    def batched(self, precision: Precision | str) -> Callable[..., tuple[jax.Array, ...]]:
        """The operation on arrays (n, 3)."""
        return jax.vmap(lambda *arrays: self.function(str(precision), *arrays))

    def exactly(self, *arrays: ArrayLike):
        """[(exact value, mag)] per part."""
        return [error.evaluate(formula, *arrays) for formula in self.formulas]

    def promise(self, precision: Precision | str):
        """The bound on the error of a component in words."""
        return " or ".join(dict.fromkeys(promise.words(precision) for promise in self.bounds))

    def allowed(self, precision: Precision | str, part: int, value: np.ndarray, mag: np.ndarray, dtype: DTypeLike):
        """The bound on the error of each component of a part, as Fractions."""
        return error.allowed(self.bounds[part], precision, value, mag, dtype)

    @staticmethod
    def in_units(computed: Sequence[ArrayLike], exactly: Sequence[tuple[np.ndarray, np.ndarray]]):
        """The largest error of each part in its SI unit, as floats; inf for NaN."""
        pairs = zip(computed, exactly, strict=True)
        errors = [error.in_units_of(Fraction(1), x, value) for x, (value, _) in pairs]
        return tuple(float(x.max()) if x.size else np.nan for x in errors)

    def of_promise(self, precision, computed: Sequence[ArrayLike], exactly: Sequence[tuple[np.ndarray, np.ndarray]]):
        """The largest error over the bound promised, and all errors in ulps (both float64, inf for NaN)."""
        worst, ulps = 0.0, list[np.ndarray]()
        for part, (x, (value, mag)) in enumerate(zip(computed, exactly, strict=True)):
            bound = self.allowed(precision, part, value, mag, np.asarray(x).dtype)
            worst = max(worst, float(np.max(error.in_units_of(bound, x, value, self.flushed), initial=0.0)))
            ulps.append(error.in_ulps(x, value).ravel())
        return worst, np.concatenate(ulps)


def _crossed(kind, precision, w, v, rotational, translational):
    rate = cross(SpatialVelocity(w, v), kind(rotational, translational), precision=precision)
    return rate.rotational, rate.translational


def _power(tau, f, w, v):
    """Added one after another: NumPy's `sum` of numbers of 16 bits rounds once."""
    x, y = tau * w, f * v
    return (x[..., 0] + x[..., 1] + x[..., 2]) + (y[..., 0] + y[..., 1] + y[..., 2])


OPERATIONS = {
    operation.name: operation
    for operation in (
        Operation(
            "shift_force", ("tau", "f", "p"),
            lambda precision, tau, f, p: (shift(SpatialForce(tau, f), p, precision=precision).tau,),
            (lambda tau, f, p: tau - np.cross(p, f),),
            units=("N m",), bounds=(SHIFT,), flushed=6, size=3, flipped=(2,), in_place=0,
        ),
        Operation(
            "shift_velocity", ("w", "v", "p"),
            lambda precision, w, v, p: (shift(SpatialVelocity(w, v), p, precision=precision).v,),
            (lambda w, v, p: v + np.cross(w, p),),
            units=("m/s",), bounds=(SHIFT,), flushed=6, size=3, flipped=(2,), in_place=1,
        ),
        Operation(
            "shift_acceleration", ("alpha", "a", "p", "w"),
            lambda precision, alpha, a, p, w: (shift(SpatialAcceleration(alpha, a), p, w, precision=precision).a,),
            (lambda alpha, a, p, w: a + np.cross(alpha, p) + np.cross(w, np.cross(w, p)),),
            units=("m/s²",), bounds=(SHIFT_ACCELERATION,), flushed=32, size=3, flipped=(2,), in_place=1,
        ),
        Operation(
            "cross_motion", ("w", "v", "alpha", "a"), functools.partial(_crossed, SpatialAcceleration),
            (lambda w, v, alpha, a: np.cross(w, alpha), lambda w, v, alpha, a: np.cross(w, a) + np.cross(v, alpha)),
            units=("rad/s³", "m/s³"), bounds=(CROSS_ONE, CROSS_TWO), flushed=12, size=6, flipped=(0, 1),
        ),
        Operation(
            "cross_force", ("w", "v", "tau", "f"), functools.partial(_crossed, SpatialForce),
            (lambda w, v, tau, f: np.cross(w, tau) + np.cross(v, f), lambda w, v, tau, f: np.cross(w, f)),
            units=("N m/s", "N/s"), bounds=(CROSS_TWO, CROSS_ONE), flushed=12, size=6, flipped=(0, 1),
        ),
        Operation(
            "dot", ("tau", "f", "w", "v"),
            lambda precision, tau, f, w, v: (dot(SpatialForce(tau, f), SpatialVelocity(w, v), precision=precision),),
            (_power,), units=("W",), bounds=(DOT,), flushed=17, size=1, flipped=(2, 3),
        ),
    )
}  # fmt: skip

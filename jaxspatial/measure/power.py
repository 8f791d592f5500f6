"""Power before and after a shift: the same number, as far as numbers go."""

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.measure import error, exact
from jaxspatial.measure.operation import Parts
from jaxspatial.measure.scene import Wrenches
from jaxspatial.spatial import SpatialForce, SpatialVelocity, dot, shift
from jaxspatial.spatial.promises import DOT, SHIFT

# Two shifts and two pairings, on terms whose sizes add up to mag (see `compare`).
BOUND = 2.0 * (SHIFT.u + DOT.u)


class Power(NamedTuple):
    """Total power in watts about P and about Q, and the largest difference for one wrench, over u mag."""

    before: float
    after: float
    difference: float


def compare(wrenches: Wrenches, offset: npt.ArrayLike, dtype: str, sample: int = 2_000):
    """Power of all wrenches about P and, force and velocity shifted, about Q; the difference over a sample of them."""
    with jax.enable_x64(dtype == "float64"):
        tau, f, w, v = (jnp.asarray(x, dtype) for x in wrenches)
        F, V, p = SpatialForce(tau, f), SpatialVelocity(w, v), jnp.asarray(offset, dtype)
        before, after = (np.asarray(x) for x in cast(Parts, jax.jit(_both)(F, V, p)))
    some = np.linspace(0, len(before) - 1, min(sample, len(before))).astype(int)
    _, moved = exact.evaluate(_power_about_Q, *(np.asarray(x)[some] for x in (F.tau, F.f, V.w, V.v)), np.asarray(p))
    difference = error.in_u_of(after[some], exact.rationals(before[some]), moved, flushed=30).max()
    return Power(float(before.astype(np.float64).sum()), float(after.astype(np.float64).sum()), float(difference))


def fits(wrenches: Wrenches, offset: npt.ArrayLike, dtype: DTypeLike):
    """Whether the terms of torques about Q and, where the motion is known, of power are within the range of a dtype."""
    tau, f, w, v = wrenches
    with np.errstate(over="ignore", invalid="ignore"):
        p, tau, f = abs(np.asarray(offset, np.float64)), abs(tau), abs(f)
        sizes = _sizes(p, tau, f, *(None if x is None else abs(x) for x in (w, v)))
    return bool(np.max(sizes) < float(check.finfo(dtype).max))


def _sizes(p: np.ndarray, tau: np.ndarray, f: np.ndarray, w: np.ndarray | None, v: np.ndarray | None):
    """The largest of a few sums of absolute values; NaN or infinite beyond float64."""
    torque = tau + _cross_of_sizes(p, f)
    if w is None or v is None:
        return [torque.max(), f.max()]
    powers = (torque * w + f * (v + _cross_of_sizes(w, p))).sum(-1)
    # The total is added up in float64, whatever the dtype: NaN where it is beyond that.
    return [torque.max(), f.max(), w.max(), v.max(), powers.max(), 0 * powers.sum()]


def _cross_of_sizes(a: np.ndarray, b: np.ndarray):
    return np.roll(a, -1, -1) * np.roll(b, 1, -1) + np.roll(a, 1, -1) * np.roll(b, -1, -1)


def _both(F: SpatialForce, V: SpatialVelocity, p: jax.Array):
    return dot(F, V), dot(jax.vmap(shift, in_axes=(0, None))(F, p), jax.vmap(shift, in_axes=(0, None))(V, p))


def _power_about_Q(tau: np.ndarray, f: np.ndarray, w: np.ndarray, v: np.ndarray, p: np.ndarray):
    return ((tau - np.cross(p, f)) * w).sum(-1) + (f * (v + np.cross(w, p))).sum(-1)

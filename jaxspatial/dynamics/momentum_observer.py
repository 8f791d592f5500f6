"""The generalized-momentum observer: external generalized forces from measured q, v and tau, without accelerations.

[De Luca, Mattone 2005; De Luca, Albu-Schaeffer, Haddadin, Hirzinger 2006]
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.kinematics import velocity_step
from jaxspatial.engine import recursion
from jaxspatial.engine.algorithm import BODIES, algorithm, checked
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Motion, Vector, Wrench, cross
from jaxspatial.numerics.numbers import Number, halved
from jaxspatial.numerics.promise import Normwise, promises
from jaxspatial.numerics.quantity import tree
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import algebra

# Error bounds of p and beta, for n links in the longest chain, and of what an update does with them.
MOMENTUM, UPDATE = Normwise(4, "mag", per="n", u2=32), Normwise(8, "s", rounded=8)


@tree
class MomentumObserver:
    """Estimates external generalized forces from measured q, v and tau. It needs no accelerations.

        p = M(q) v        dp/dt = tau + tau_ext - beta        d residual/dt = gain (tau_ext - residual)

    The residual follows the external forces tau_ext = J^T F with a first-order lag of the time 1 / gain, each velocity
    by itself:

        observer = js.MomentumObserver.start(mechanism, q, v)
        observer = observer.update(mechanism, q, v, tau, dt, gain)      # once per sample; then read observer.residual

    residual: (*batch, nv), the estimate of tau_ext, N m or N.
    momentum: (*batch, nv), p at the last sample.
    beta: (*batch, nv), at the last sample: g(q) - C(q, v)^T v, with dM/dt - 2 C skew; for velocities along axes that
        turn, `bias_forces` - dM/dt v.

    Example:
        >>> observer = js.MomentumObserver.start(arm, q, v)
        >>> print(observer.residual)
        [0. 0.]
    """

    residual: jax.Array
    momentum: jax.Array
    beta: jax.Array

    @classmethod
    @promises(momentum=MOMENTUM)
    def start(
        cls, mechanism: Mechanism, q: ArrayLike, v: ArrayLike, *, precision: PrecisionName = None
    ) -> "MomentumObserver":
        """An observer at its first sample. The residual is zero.

        Args:
            mechanism: the mechanism, with payload and tools. Its errors appear in the residual.
            q: (*batch, nq) measured coordinates: rad, m, quaternions (read normalised).
            v: (*batch, nv) measured generalized velocities: rad/s, m/s.
            precision: name of a precision; None takes the default.

        Returns:
            MomentumObserver (*batch,), over the common batch.

        Raises:
            TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
            ValueError: shapes do not fit.

        Error: of every number of the momentum and of beta at most 4 n u mag in "fast" and "reproducible",
            1.01 u |r| + 32 n u^2 mag in the other two; n, r and mag as in `jaxspatial.dynamics.bounds`.
        Source: as of `update`.

        Example:
            >>> observer = js.MomentumObserver.start(arm, q, v)
            >>> print(observer.momentum, js.mass_matrix(arm, q) @ v)
            [6.1168 1.9801] [6.1168 1.9801]
        """
        p, beta = momentum_and_beta(precision, mechanism, q, v, operation="MomentumObserver.start")
        return cls(jnp.zeros_like(p), p, beta)

    @promises(bound=UPDATE)
    def update(
        self,
        mechanism: Mechanism,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        dt: ArrayLike,
        gain: ArrayLike,
        *,
        precision: PrecisionName = None,
    ) -> "MomentumObserver":
        """The observer at the next sample, k, from the one at the sample before, k - 1.

            r_k = r_(k-1) + b ((p_k - p_(k-1)) / dt - tau + (beta_k + beta_(k-1)) / 2 - r_(k-1))
            b = 1 - exp(-gain dt)

        This is the lag itself for external forces that are constant between samples, and stable for every gain. The
        mean of both betas leaves an error of second order in dt, and costs nothing, as each update evaluates p and beta
        once, at its own sample. White noise of standard deviation s_p in p (M times that of v), and s_tau in tau, gives
        the residual noise of standard deviation

            s_p (b / dt) sqrt(2 / (2 - b))        s_tau sqrt(b / (2 - b))

        For small gain dt these are s_p gain and s_tau sqrt(gain dt / 2): a higher gain is faster, and noisier.

        Args:
            mechanism: the same as at the sample before.
            q: (*batch, nq) measured coordinates: rad, m, quaternions (read normalised).
            v: (*batch, nv) measured generalized velocities: rad/s, m/s.
            tau: (*batch, nv) the known generalized forces between the two samples: N m, N. The forces of the motors,
                and `passive_forces` where its friction is trusted; of what varies, the mean at both samples. What is
                left out appears in the residual.
            dt: the time between the two samples, s: a number or (*batch,), above zero.
            gain: the reciprocal time constant, 1/s: a number, one per velocity (nv,), or (*batch, nv).
            precision: name of a precision; None takes the default.

        Returns:
            MomentumObserver (*batch,), over the common batch.

        Raises:
            TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
            ValueError: shapes do not fit.

        Error: of rounding, in every number of the residual and in every precision: at most 8 u s, with
            s = |r_(k-1)| + b (|p_k| + |p_(k-1)|) / dt + b (|tau| + |beta_k| + |beta_(k-1)|), in addition to b / dt
            times the errors of both p, b times that of beta, and that of r_(k-1).
        Source: De Luca, Mattone 2005, Sensorless robot collision detection and hybrid force/motion control; De Luca,
            Albu-Schaeffer, Haddadin, Hirzinger 2006, Collision detection and safe reaction with the DLR-III lightweight
            manipulator arm.

        Example:
            >>> observer = js.MomentumObserver.start(arm, 0 * q, 0 * v)
            >>> held = observer.update(arm, 0 * q, 0 * v, tau, dt=0.01, gain=1e4)  # at rest under tau
            >>> print(held.residual)
            [-10.  -2.]
        """
        name = "MomentumObserver.update"
        q, v, tau, h = checked(name, mechanism, q=q, v=v, tau=tau, dt=dt)
        rate = _per_velocity(mechanism, gain, f"{name}: gain", self.residual.dtype)
        check.require_same_dtype(observer=self.residual, q=q, gain=rate)
        time, rate = floats.broadcast_batch(floats.broadcast_shapes(h.shape[:-1], rate.shape[:-1]), h, rate)
        x = -time * rate
        b = -(np if isinstance(x, np.ndarray) else jnp).expm1(x)  # 1 - exp(-gain dt)
        p, beta = momentum_and_beta(precision, mechanism, q, v, operation=name)
        residual = _updated(precision, self.residual, self.momentum, p, self.beta, beta, tau, h, b)
        return MomentumObserver(residual, *(jnp.broadcast_to(x, residual.shape) for x in (p, beta)))


def _per_velocity(mechanism: Mechanism, x: ArrayLike, name: str, dtype: np.dtype) -> Array:
    """A number, or one for each velocity, as an array (*batch, nv)."""
    array = floats.as_float_array(x, name, dtype)
    if array.ndim and array.shape[-1] != mechanism.nv:
        raise ValueError(f"{name}: expected a number or shape (*batch, {mechanism.nv}), got {array.shape}")
    known = isinstance(array, np.ndarray)
    return array if array.ndim else (np if known else jnp).broadcast_to(array, (mechanism.nv,))


@formula(by_number=True)
def _updated(
    residual: Number, p0: Number, p1: Number, beta0: Number, beta1: Number, tau: Number, dt: Number, share: Number
):
    return residual + share * (((p1 - p0) / dt + (halved(beta0 + beta1) - tau)) - residual)


# -- momentum and beta ------------------------------------------------------------------------------------------------


class _Subtree(NamedTuple):
    """The momentum of a body and all that it carries, and the wrench that holds their weight, about one point."""

    momentum: Wrench
    weight: Wrench


class _Base(NamedTuple):
    """The velocity of a body, and the upward acceleration that stands for gravity, in its axes."""

    V: Motion
    gravity: Vector


@algorithm(*BODIES, "armature", "gravity")
def momentum_and_beta(state: MechanismState, v: Array) -> tuple[jax.Array, jax.Array]:
    """(p, beta): the generalized momenta M v, and what they lose per time without joint and external forces.

    Let H_j be the momentum of the bodies that joint j carries, and W_j the wrench that holds their weight, about the
    origin of its child frame, in its axes. That frame has the velocity V_j. The columns S_j of the motion subspace are
    fixed in it, but for a rate S_j' where they depend on q. Then

        p_j = S_j . H_j + armature v_j
        dp_j/dt = S_j . dH_j/dt + (V_j x S_j + S_j') . H_j        S_j . dH_j/dt = tau_j + tau_ext_j - S_j . W_j

    without the rotor, of which tau_j turns the rest. So

        beta_j = S_j . (W_j + V_j x* H_j) - S_j' . H_j

    and of linear velocities along axes that the joint turns, armature (w x v)_j more.

    One sweep outward and one inward give both, without the terms of `bias_forces` and dM/dt v that cancel.
    """
    links = state.links(v)
    start = _Base(Motion(state.zero_vector, state.zero_vector), state.minus_gravity)
    bodies = recursion.outward(state, _body, start, links)
    nothing = _Subtree(*[Wrench(state.zero_vector, state.zero_vector)] * 2)
    both = recursion.inward(state, _at_joint, nothing, list(zip(links, bodies, strict=True)))
    return state.by_velocity([p for p, _ in both]), state.by_velocity([beta for _, beta in both])


def _body(link: Link, parent: _Base) -> tuple[tuple[Motion, _Subtree], _Base]:
    """((V, momentum and weight of a body), what its children start from)."""
    V, _ = velocity_step(link, parent.V)
    gravity = link.X_PB.R.T @ parent.gravity
    f = link.inertia.mass * gravity
    weight = Wrench(cross(link.inertia.com, f), f)
    return (V, _Subtree(algebra.apply_inertia(link.inertia, V), weight)), _Base(V, gravity)


def _at_joint(body: tuple[Link, tuple[Motion, _Subtree]], of_children: _Subtree) -> tuple[tuple, _Subtree]:
    link, (V, (H, W)) = body
    H, W = H + of_children.momentum, W + of_children.weight
    of_rotors = [i * x for i, x in zip(link.armature, link.v, strict=True)]
    turning = link.rotor_forces  # without accelerations
    S, rates = link.joint.subspace, link.joint.subspace_rate(link.v)
    p = tuple(algebra.power(H, s) + x for s, x in zip(S, of_rotors, strict=True))
    loss = W + algebra.cross_force(V, H)
    beta = tuple(
        algebra.power(loss, s) - algebra.power(H, rate) + x for s, rate, x in zip(S, rates, turning, strict=True)
    )
    X = link.X_PB
    return (p, beta), _Subtree(algebra.acted_wrench(X, H), algebra.acted_wrench(X, W))

"""States of a whole Mechanism to and from MuJoCo's: qpos, qvel, qacc and generalized forces, of its joints in order."""

import itertools
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Coordinates, Forces, PrecisionName, Rates, Vector
from jaxspatial.mechanism import Mechanism
from jaxspatial.rotation import Rotation
from jaxspatial.rotation.rotation import rotated
from jaxspatial.spatial import SpatialAcceleration, SpatialVelocity
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.parts import joined


def to_qpos(mechanism: Mechanism, q: Coordinates) -> jax.Array:
    """Makes mjData.qpos.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.

    Returns:
        (*batch, model.nq). Exact but for mimics.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.
    """
    pieces, at = _state("mujoco.to_qpos", mechanism, q=q)
    return _joined(at.q, [_rolled(p, p.followed(at.q[..., p.q])) for p in pieces])


def from_qpos(mechanism: Mechanism, qpos: Vector) -> jax.Array:
    """Reads mjData.qpos.

    What is in it of mimics is left out.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        qpos: (*batch, model.nq).

    Returns:
        q (*batch, nq). Exact.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.
    """
    pieces, at = _state("mujoco.from_qpos", mechanism, qpos=qpos)
    return _joined(at.qpos, [_rolled(p, at.qpos[..., p.qpos], back=True) for p in pieces if not p.is_mimic])


def to_qvel(mechanism: Mechanism, q: Coordinates, v: Rates, *, precision: PrecisionName = None) -> jax.Array:
    """Makes mjData.qvel.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        v: (*batch, nv) our rates.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, model.nv).

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.

    Error: of a free joint as of `rotate`; else exact but for mimics.
    """
    pieces, at = _state("mujoco.to_qvel", mechanism, q=q, v=v)
    return _joined(at.q, [p.in_world(at.q, p.followed(at.v[..., p.v], of_rates=True), precision) for p in pieces])


def from_qvel(mechanism: Mechanism, q: Coordinates, qvel: Vector, *, precision: PrecisionName = None) -> jax.Array:
    """Reads mjData.qvel.

    What is in it of mimics is left out.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        qvel: (*batch, model.nv).
        precision: name of a precision; None takes the default.

    Returns:
        v (*batch, nv).

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.

    Error: of a free joint as of `rotate`; else exact.
    """
    pieces, at = _state("mujoco.from_qvel", mechanism, q=q, qvel=qvel)
    return _joined(at.q, [p.in_body(at.q, at.qvel[..., p.qvel], precision) for p in pieces if not p.is_mimic])


def to_qacc(
    mechanism: Mechanism, q: Coordinates, v: Rates, vdot: Rates, *, precision: PrecisionName = None
) -> jax.Array:
    """Makes mjData.qacc.

    MuJoCo's linear acceleration of a free joint is that of the body's origin in world axes, R (dv/dt + w x v).

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        v: (*batch, nv) our rates.
        vdot: (*batch, nv), the derivatives of v.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, model.nv).

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.

    Error: of a free joint as of `SpatialAcceleration.from_featherstone` and `rotate`; else exact but for mimics.
    """
    pieces, at = _state("mujoco.to_qacc", mechanism, q=q, v=v, vdot=vdot)
    found = [p.classical(p.followed(at.vdot[..., p.v], of_rates=True), at.v[..., p.v], precision) for p in pieces]
    return _joined(at.q, [p.in_world(at.q, x, precision) for p, x in zip(pieces, found, strict=True)])


def from_qacc(
    mechanism: Mechanism, q: Coordinates, v: Rates, qacc: Vector, *, precision: PrecisionName = None
) -> jax.Array:
    """Reads mjData.qacc.

    What is in it of mimics is left out.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        v: (*batch, nv) our rates.
        qacc: (*batch, model.nv).
        precision: name of a precision; None takes the default.

    Returns:
        vdot (*batch, nv), the derivatives of v.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.

    Error: of a free joint as of `rotate` and `SpatialAcceleration.to_featherstone`; else exact.
    """
    pieces, at = _state("mujoco.from_qacc", mechanism, q=q, v=v, qacc=qacc)
    own = [p for p in pieces if not p.is_mimic]
    found = [p.in_body(at.q, at.qacc[..., p.qvel], precision) for p in own]
    return _joined(at.q, [p.derivative(x, at.v[..., p.v], precision) for p, x in zip(own, found, strict=True)])


def to_qfrc(mechanism: Mechanism, q: Coordinates, tau: Forces, *, precision: PrecisionName = None) -> jax.Array:
    """Makes generalized forces of MuJoCo, such as qfrc_applied, with the same power.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        tau: (*batch, nv) our generalized forces, N m or N.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, model.nv), zero on mimics.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.

    Error: of a free joint as of `rotate`; else exact.
    """
    pieces, at = _state("mujoco.to_qfrc", mechanism, q=q, tau=tau)
    return _joined(
        at.q, [0 * at.tau[..., p.v] if p.is_mimic else p.in_world(at.q, at.tau[..., p.v], precision) for p in pieces]
    )


def from_qfrc(mechanism: Mechanism, q: Coordinates, qfrc: Vector, *, precision: PrecisionName = None) -> jax.Array:
    """Reads generalized forces of MuJoCo, such as qfrc_inverse or qfrc_bias, with the same power.

    What acts on a mimic acts, times its multiplier, on the joint that it follows.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        qfrc: (*batch, model.nv), N m or N.
        precision: name of a precision; None takes the default.

    Returns:
        tau (*batch, nv).

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ.
        ValueError: a shape does not fit, or MuJoCo has no joints of a kind.

    Error: of a free joint as of `rotate`; else exact but for mimics.
    """
    pieces, at = _state("mujoco.from_qfrc", mechanism, q=q, qfrc=qfrc)
    tau = {p.v.start: p.in_body(at.q, at.qfrc[..., p.qvel], precision) for p in pieces if not p.is_mimic}
    for p in (p for p in pieces if p.is_mimic):
        tau[p.v.start] = tau[p.v.start] + p.followed(at.qfrc[..., p.qvel], of_rates=True)
    return _joined(at.q, [tau[start] for start in sorted(tau)])


class _Piece:
    """The part of a joint in all these arrays: in ours, q and v, and in MuJoCo's, qpos and qvel."""

    def __init__(self, mechanism: Mechanism, i: int, qpos: slice, qvel: slice, dtype: np.dtype[Any]):
        t = mechanism.topology
        if t.kinds[i] not in ("free", "ball", "prismatic", "revolute", "continuous"):
            raise ValueError(f"mujoco: MuJoCo has no joints like {t.joint_names[i]!r}: {t.kinds[i]}")
        self.q, self.v, self.qpos, self.qvel = t.q_slice(i), t.v_slice(i), qpos, qvel
        self.is_free, self.is_mimic = t.kinds[i] == "free", t.is_mimic(i)
        self.multiplier, self.offset = (mechanism.mimics[i, k : k + 1].astype(dtype) for k in (0, 1))

    def followed(self, x: jax.Array, of_rates: bool = False) -> jax.Array:
        """Of the part of the joint that it follows."""
        if not self.is_mimic:
            return x
        multiplier, offset = (jnp.broadcast_to(y, x.shape) for y in (self.multiplier, self.offset))
        return multiplier * x if of_rates else multiplier * x + offset

    def in_world(self, q: jax.Array, x: jax.Array, precision: PrecisionName) -> jax.Array:
        """(linear in world axes, angular) of (angular, linear) in the body's; of a free joint."""
        if not self.is_free:
            return x
        return joined(rotated(self._R(q, precision), x[..., 3:], precision=precision), x[..., :3])

    def in_body(self, q: jax.Array, x: jax.Array, precision: PrecisionName) -> jax.Array:
        if not self.is_free:
            return x
        return joined(x[..., 3:], rotated(self._R(q, precision).inverse(), x[..., :3], precision=precision))

    def _R(self, q: jax.Array, precision: PrecisionName) -> Rotation:
        return Rotation.from_quaternion(q[..., self.q][..., :4], precision=precision)

    def classical(self, vdot: jax.Array, v: jax.Array, precision: PrecisionName) -> jax.Array:
        """Of a free joint: vdot is the acceleration of Featherstone."""
        if not self.is_free:
            return vdot
        V = SpatialVelocity.from_array(v)
        return SpatialAcceleration.from_featherstone(vdot, V, precision=precision).to_array()

    def derivative(self, acceleration: jax.Array, v: jax.Array, precision: PrecisionName) -> jax.Array:
        if not self.is_free:
            return acceleration
        A = SpatialAcceleration.from_array(acceleration)
        return A.to_featherstone(SpatialVelocity.from_array(v), precision=precision)


def _rolled(piece: _Piece, x: jax.Array, back: bool = False) -> jax.Array:
    """The position of a free joint before its quaternion, or back."""
    n = 3 if back else 4
    return jnp.concatenate([x[..., n:], x[..., :n]], -1) if piece.is_free else x


def _state(operation: str, mechanism: Mechanism, **arrays: Vector) -> tuple[list[_Piece], SimpleNamespace]:
    """(the pieces of all joints, the arrays by name, over one batch shape)."""
    require_kind(mechanism, Mechanism, operation, " first")
    kinds = [mechanism.topology.kind(i) for i in range(len(mechanism.topology))]
    ends = [[0, *itertools.accumulate(sizes)] for sizes in ([k.nq for k in kinds], [k.nv for k in kinds])]
    sizes = {"q": mechanism.nq, "qpos": ends[0][-1]} | dict.fromkeys(("qvel", "qacc", "qfrc"), ends[1][-1])
    named = ((name, f"{operation}: {name}", sizes.get(name, mechanism.nv)) for name in arrays)
    given = {name: check.as_vectors(arrays[name], shown, size=n) for name, shown, n in named}
    check.require_same_dtype(**given)
    batch = check.common_batch_shape(**{name: x.shape[:-1] for name, x in given.items()})
    dtype = next(iter(given.values())).dtype
    places = ([slice(a, b) for a, b in itertools.pairwise(e)] for e in ends)
    pieces = [_Piece(mechanism, i, qpos, qvel, dtype) for i, (qpos, qvel) in enumerate(zip(*places, strict=True))]
    return pieces, SimpleNamespace(**dict(zip(given, check.broadcast_batch(batch, *given.values()), strict=True)))


def _joined(like: jax.Array, parts: list[jax.Array]) -> jax.Array:
    return jnp.concatenate([like[..., :0], *parts], -1)

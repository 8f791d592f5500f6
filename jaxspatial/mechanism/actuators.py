"""Actuators: motors with linear gains and limits, and how they pull at joints."""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula, plus
from jaxspatial.numerics.numbers import Number, where
from jaxspatial.numerics.quantity import OfOneDtype, exported_tree_of, require_compatible
from jaxspatial.numerics.sums.pairwise import of_neighbours
from jaxspatial.numerics.types import ArrayLike, PrecisionName

if TYPE_CHECKING:
    from jaxspatial.mechanism.mechanism import Mechanism

_LIMITS = {"lower": -np.inf, "upper": np.inf, "ctrl_lower": -np.inf, "ctrl_upper": np.inf}
_NUMBERS = "gain", "bias", "stiffness", "damping", *_LIMITS


@exported_tree_of("names", "joints")
class Actuators(OfOneDtype):
    """Motors that pull at joints: servos, speed controllers, motors of a torque.

        force = clip(gain ctrl + bias - stiffness L - damping dL/dt, lower, upper)        L = sum gears q
        tau = sum gears force, clipped to the effort limits of the mechanism

    ctrl is clipped to its own limits first. A servo has gain = stiffness = kp and damping = kv, and ctrl is where it is
    to go; a speed controller has gain = damping = kv, a motor its gain alone.

    Args:
        names: names of the actuators, n of them, in the order of ctrl; static.
        joints: for each actuator the joint of one coordinate that it pulls at, or a sequence of such; static. None
            for the joints with the names of the actuators. Those of mimics pull at the joint that they follow.
        gears: one number for each joint of each actuator, (k,) in their order, or one for all: how far L moves as
            the coordinate does, m/rad or 1.
        gain: force per ctrl: a number, (n,) or (*batch, n), as all that follow.
        bias: N, or N m.
        stiffness: N/m, or N m/rad.
        damping: N s/m, or N m s/rad. `torques` has it explicitly: steps are stable for dt gears^2 damping below the
            inertia of the joint. Damping of joints is implicit in steps.
        lower, upper: limits of the force.
        ctrl_lower, ctrl_upper: limits of ctrl.

    Raises:
        TypeError: names are no text, or numbers none of floating point; dtypes differ.
        ValueError: shapes do not fit, or of numbers known while tracing one is NaN, or a lower limit above the upper.

    Error: none, nothing is computed.

    Example:
        >>> kp = 60.0
        >>> servos = js.Actuators(["shoulder", "elbow"], gain=kp, stiffness=kp, damping=2.0, lower=-10.0, upper=10.0)
        >>> print(servos.torques(arm, q, v, jnp.array([0.6, 0.0])))
        [ 4. 10.]
    """

    names: tuple[str, ...]
    joints: tuple[tuple[str, ...], ...] = None  # pyright: ignore[reportAssignmentType]
    gears: jax.Array = 1.0  # pyright: ignore[reportAssignmentType]
    _: KW_ONLY
    gain: jax.Array = 1.0  # pyright: ignore[reportAssignmentType]
    bias: jax.Array = 0.0  # pyright: ignore[reportAssignmentType]
    stiffness: jax.Array = 0.0  # pyright: ignore[reportAssignmentType]
    damping: jax.Array = 0.0  # pyright: ignore[reportAssignmentType]
    lower: jax.Array = -np.inf  # pyright: ignore[reportAssignmentType]
    upper: jax.Array = np.inf  # pyright: ignore[reportAssignmentType]
    ctrl_lower: jax.Array = -np.inf  # pyright: ignore[reportAssignmentType]
    ctrl_upper: jax.Array = np.inf  # pyright: ignore[reportAssignmentType]

    if TYPE_CHECKING:

        def __init__(
            self,
            names: Iterable[str],
            joints: Iterable[str | Sequence[str]] | None = None,
            gears: ArrayLike = 1.0,
            *,
            gain: ArrayLike = 1.0,
            bias: ArrayLike = 0.0,
            stiffness: ArrayLike = 0.0,
            damping: ArrayLike = 0.0,
            lower: ArrayLike = -np.inf,
            upper: ArrayLike = np.inf,
            ctrl_lower: ArrayLike = -np.inf,
            ctrl_upper: ArrayLike = np.inf,
        ): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; the placeholders in trees of axes or specs pass unchecked."""
        names = check.as_tuple(self.names, str, "Actuators: names", "names")
        joints = [(name,) for name in names] if self.joints is None else self.joints
        if isinstance(joints, str) or not isinstance(joints, Iterable):
            raise TypeError(f"Actuators: joints: expected a sequence of names, or of sequences of them, got {joints!r}")
        joints = tuple(
            (x,) if isinstance(x, str) else check.as_tuple(x, str, "Actuators: joints", "names") for x in joints
        )
        if len(joints) != len(names) or not all(joints):
            raise ValueError(f"Actuators: joints: expected one or more for each of {len(names)} names, got {joints}")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "joints", joints)
        given = {name: getattr(self, name) for name in ("gears", *_NUMBERS)}
        if all(map(check.is_tree_mark, given.values())):
            return
        dtype, arrays = floats.floating_dtype(*given.values()), dict[str, Any]()
        for name, x in given.items():
            size = sum(map(len, joints)) if name == "gears" else len(names)
            array = floats.as_float_array(x, f"Actuators: {name}", dtype, keep_dtype=True)
            if array.shape[-1:] not in ((), (size,)):
                raise ValueError(f"Actuators: {name}: expected a number, or shape (*batch, {size}), got {array.shape}")
            if isinstance(array, np.ndarray) and np.isnan(array).any():
                raise ValueError(f"Actuators: {name}: expected numbers, got {x}")
            arrays[name] = array
        require_compatible(**arrays)
        for lower, upper in (("lower", "upper"), ("ctrl_lower", "ctrl_upper")):
            limits = arrays[lower], arrays[upper]
            if all(isinstance(x, np.ndarray) for x in limits) and (limits[0] > limits[1]).any():
                expected = f"expected at most {upper}, {given[upper]}"
                raise ValueError(f"Actuators: {lower}: {expected}, got {given[lower]}")
        for name, x in arrays.items():
            object.__setattr__(self, name, floats.owned(x))

    @classmethod
    def from_mjcf(cls, mech: "Mechanism", path_or_text: Any, *, assets: Mapping[str, bytes] | None = None) -> Self:
        """Reads the actuators of an MJCF that are plain: `position`, `velocity`, `motor` and such of `general`.

        These have fixed gains and no activation, and pull at a hinge or a slide, or at a fixed tendon over such. Their
        gears, gains, biases and ranges are those that MuJoCo compiles, with default classes. Springs, damping and
        armature beside them are the mechanism's. `interop.mujoco.key_frames` reads the key frames of the file.

        Args:
            mech: the mechanism that was read from the file.
            path_or_text: a path; the text itself; a mujoco.MjSpec, or a mujoco.MjModel.
            assets: files that the text names, by their names.

        Returns:
            The actuators in the order of the file, with NumPy numbers in the dtype of the mechanism. One without a
            name is "actuator_<id>".

        Raises:
            FileNotFoundError: there is no such file.
            ImportError: mujoco or lxml is missing.
            KeyError: the mechanism has no such joint; lists those there are.
            ValueError: MuJoCo does not compile the file.

        Warns:
            ModelFileWarning: names the actuators that are left out, by what of them is not plain: activation, muscles,
                a delay, sites, balls and free joints, others than fixed gains; and limits that are not those of the
                mechanism.

        Error: none but that of the dtype.

        Example:
            >>> part = '<body><joint name="knee" axis="0 1 0"/><geom size="0.1"/></body>'
            >>> motor = '<motor name="motor" joint="knee" gear="3" ctrlrange="-1 1"/>'
            >>> text = f"<mujoco><worldbody>{part}</worldbody><actuator>{motor}</actuator></mujoco>"
            >>> knee = js.Mechanism.from_mjcf(text)
            >>> print(js.Actuators.from_mjcf(knee, text).torques(knee, jnp.zeros(1), jnp.zeros(1), jnp.array([2.0])))
            [3.]
        """
        from jaxspatial.mechanism.formats import mjcf

        parts = mjcf.read_actuators(path_or_text, assets)
        names, joints = [part.name for part in parts], [part.joints for part in parts]
        for name in (name for some in joints for name in some):
            mech.topology.index(mech.joint_names, name, "Actuators.from_mjcf: a joint of the file")
        gears = np.array([x for part in parts for x in part.gears], mech.dtype)
        numbers = {name: np.array([part.numbers[name] for part in parts], mech.dtype) for name in _NUMBERS}
        return cls(names, joints, gears, **numbers)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape, without the axis over actuators."""
        return floats.broadcast_shapes(*(getattr(self, name).shape[:-1] for name in ("gears", *_NUMBERS)))

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(self.gain.dtype)

    def torques(
        self,
        mech: "Mechanism",
        q: ArrayLike,
        v: ArrayLike,
        ctrl: ArrayLike,
        *,
        precision: PrecisionName = None,
    ) -> jax.Array:
        """Computes the generalized forces of the actuators, which the steps take as `tau`.

        Args:
            mech: with the joints of the actuators; `effort_limit` clips the sums.
            q: (*batch, nq) coordinates.
            v: (*batch, nv) generalized velocities.
            ctrl: (*batch, n) one number for each of `names`. Batch shapes broadcast.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, nv), N m or N; zero where nothing pulls. Beyond a limit the gradient is zero.

        Raises:
            KeyError: the mechanism has no such joint; lists those there are.
            TypeError: dtypes differ.
            ValueError: shapes do not fit, or a joint has more than one coordinate.

        Error: for actuators of one joint each 8 u of the sum of the sizes of the terms.

        Example:
            >>> motors = js.Actuators(["shoulder", "elbow"], gears=50.0, ctrl_lower=-0.2, ctrl_upper=0.2)
            >>> print(motors.torques(arm, q, v, jnp.array([0.1, 0.5])))
            [ 5. 10.]
        """
        what, n = "Actuators.torques", len(self.names)
        sizes = {"q": (q, mech.nq), "v": (v, mech.nv), "ctrl": (ctrl, n)}
        arrays = {k: floats.as_vectors(x, f"{what}: {k}", self.dtype, size=m) for k, (x, m) in sizes.items()}
        batch = require_compatible(actuators=self, **arrays)
        pulls = _pulls(mech, self.joints)
        dtype, gears = arrays["q"].dtype, self._repeated("gears", len(pulls.actuator))
        coordinate, rate = arrays["q"][..., pulls.q], arrays["v"][..., pulls.v]
        mimics = None if pulls.follows_nothing else mech.mimics[pulls.joint].astype(dtype)
        if mimics is not None:
            coordinate = _followed(precision, coordinate, mimics[:, 0], mimics[:, 1])
            rate = _times(precision, rate, mimics[:, 0])
        length, speed = (_sums(precision, _times(precision, gears, x), pulls.of_actuator) for x in (coordinate, rate))
        limits = {name: self._repeated(name, n) for name in _LIMITS}
        u = _clipped(precision, arrays["ctrl"], limits["ctrl_lower"], limits["ctrl_upper"])
        numbers = (self._repeated(name, n) for name in ("gain", "bias", "stiffness", "damping"))
        force = _clipped(precision, _force(precision, u, length, speed, *numbers), limits["lower"], limits["upper"])
        pulled = _times(precision, gears, force[..., pulls.actuator])
        if mimics is not None:
            pulled = _times(precision, pulled, mimics[:, 0])
        tau = _sums(precision, pulled, pulls.of_velocity)
        tau = jnp.broadcast_to(tau, (*batch, mech.nv))
        limit = mech.effort_limit
        return _clipped(precision, tau, -limit.astype(dtype), limit.astype(dtype))

    def _repeated(self, name: str, n: int):
        """The numbers of a field, one for each of n."""
        x = getattr(self, name)
        xp = np if isinstance(x, np.ndarray) else jnp
        return floats.narrowed(xp.broadcast_to(x, (*x.shape[:-1], n)))

    def __repr__(self) -> str:
        numbers = ", ".join(f"{name}={check.shown(getattr(self, name), 0)}" for name in ("gears", *_NUMBERS[:4]))
        return f"Actuators({list(self.names)}, {numbers})"


# -- where actuators pull ---------------------------------------------------------------------------------------------


class _Pulls(NamedTuple):
    """One for each joint of each actuator, k of them, as integers known while tracing.

    actuator, joint, q, v: (k,) numbers of its actuator, its joint, and the places of the coordinate and the velocity.
    of_actuator, of_velocity: (n, width) and (nv, width) numbers of the pulls of each, filled up with k.
    """

    actuator: np.ndarray
    joint: np.ndarray
    q: np.ndarray
    v: np.ndarray
    of_actuator: np.ndarray
    of_velocity: np.ndarray
    follows_nothing: bool


def _pulls(mech: "Mechanism", joints: tuple[tuple[str, ...], ...]) -> _Pulls:
    t, what = mech.topology, "Actuators.torques: joints"
    pairs = [(i, t.index(t.joint_names, name, what)) for i, some in enumerate(joints) for name in some]
    for kind, i in ((t.kind(i), i) for _, i in pairs):
        if (kind.nq, kind.nv) != (1, 1):
            raise ValueError(f"{what}: expected joints of one coordinate, got {t.joint_names[i]!r}, a {kind.name!r}")
    actuator, joint = np.array(pairs, int).reshape(-1, 2).T
    q, v = (np.array([starts[t.followed[i]] for i in joint], int) for starts in (t.q_starts, t.v_starts))
    parts = (_grouped(actuator, len(joints)), _grouped(v, mech.nv))
    return _Pulls(actuator, joint, q, v, *parts, not any(t.is_mimic(i) for i in joint))


def _grouped(of: np.ndarray, n: int) -> np.ndarray:
    """(n, width) the places k of each i where of[k] = i, filled up with len(of)."""
    places = [np.flatnonzero(of == i) for i in range(n)]
    width = max(map(len, places), default=0)
    return np.array([[*x, *[len(of)] * (width - len(x))] for x in places], int).reshape(n, width)


def _sums(precision: PrecisionName, x: jax.Array, groups: np.ndarray) -> jax.Array:
    """The sums (*batch, n) of groups (n, width) of numbers (*batch, k); number k is zero."""
    n, width = groups.shape
    if not width:
        return jnp.zeros((*x.shape[:-1], n), x.dtype)
    if width == 1 and (groups < x.shape[-1]).all():
        return x[..., groups[:, 0]]
    x = jnp.concatenate([x, jnp.zeros((*x.shape[:-1], 1), x.dtype)], -1)
    return of_neighbours(functools.partial(plus, precision), [x[..., groups[:, k]] for k in range(width)])


def _clipped(precision: PrecisionName, x: jax.Array, lower, upper) -> jax.Array:
    """x between limits; those that are known to be infinite cost nothing."""
    for limit, sign in ((lower, -1.0), (upper, 1.0)):
        if not (isinstance(limit, np.ndarray) and np.isinf(limit).all()):
            x = _limited(precision, x, limit, sign=sign)
    return x


@formula(by_number=True)
def _limited(x: Number, limit: Number, *, sign: float) -> Number:
    return where(sign * x > sign * limit, limit, x)


@formula(by_number=True)
def _force(ctrl: Number, length: Number, speed: Number, gain: Number, bias: Number, k: Number, c: Number) -> Number:
    return gain * ctrl + (bias - k * length - c * speed)


@formula(by_number=True)
def _times(a: Number, b: Number) -> Number:
    return a * b


@formula(by_number=True)
def _followed(q: Number, multiplier: Number, offset: Number) -> Number:
    return multiplier * q + offset

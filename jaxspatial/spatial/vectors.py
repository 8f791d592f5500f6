"""Spatial vectors: two 3-vectors, rotational on top of translational, about one point, in one frame.

Names say which point, which body and which frame (monogram notation: `F_Bp_E` acts on body B at point Bp, expressed in
frame E). They are never stored: vectors of different frames can be stacked, scanned and batched.

Each kind implements `shift`, `dot`, `cross`, `rotate`, `act` and `act_inverse` as methods `_shift`, `_dot` and so on.
The generic functions in `operations` document and call them.
"""

import operator
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, NoReturn, Self, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.check import refuse, require_kind
from jaxspatial.numerics.errorfree.barrier import barrier, product, quotient
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Motion, Summed, Vector, Wrench, cross
from jaxspatial.numerics.numbers.components import Components, as_array, is_zero, zero
from jaxspatial.numerics.numbers.double_word import DoubleWord, from_double_word, to_double_word
from jaxspatial.numerics.numbers.rounded import is_known, quietly
from jaxspatial.numerics.promise import OfSum, Promise, promises
from jaxspatial.numerics.quantity import Additive, Quantity, matched, moved_to_last, require_compatible, tree
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation.rotation import Rotation, rotated_together
from jaxspatial.spatial import algebra

if TYPE_CHECKING:
    from jaxspatial.spatial.transform import RigidTransform

_Kind = TypeVar("_Kind", bound=Quantity)
# Default of a part that is left out: a known zero, which takes the dtype of the other part.
LEFT_OUT: Any = Components(0.0, 0.0, 0.0, dtype=np.float32)
# Error bounds of velocity and acceleration in a moving frame, see `numerics.promise`.
COMPOSED, COMPOSED_ACCELERATION = Promise(4, 4), Promise(10, 32)

# -- formulas over arrays; results in the layout of the parts they are added to ---------------------------------------


class _Laws(NamedTuple):
    """How vectors of a kind are moved, and how they change with a body; an acceleration is moved with one more
    argument, the angular velocity of the body."""

    group: type[Motion] | type[Wrench]
    shift: Callable[..., list[jax.Array]]
    act: Callable[..., list[jax.Array]]
    act_inverse: Callable[..., list[jax.Array]]
    cross: Callable[..., list[jax.Array]]


_OF_FORCES, _OF_VELOCITIES, _OF_ACCELERATIONS = (
    _Laws(group, formula(shift, of_sums=True), *(formula(law, of_sums=True, layout=(2, 3)) for law in others))
    for group, shift, *others in (
        (Wrench, algebra.shifted_wrench, algebra.acted_wrench, algebra.inverse_acted_wrench, algebra.cross_force),
        (Motion, algebra.shifted_motion, algebra.acted_motion, algebra.inverse_acted_motion, algebra.cross_motion),
        (
            Motion,
            algebra.shifted_acceleration,
            algebra.acted_acceleration,
            algebra.inverse_acted_acceleration,
            algebra.cross_motion,
        ),
    )
)
_power = formula(algebra.power, of_sums=True)
_to_featherstone = formula(lambda A, V: Motion(A.w, A.v - cross(V.w, V.v)), of_sums=True)
_from_featherstone = formula(lambda A, V: Motion(A.w, A.v + cross(V.w, V.v)), of_sums=True)
_composed_velocity = formula(lambda V, p, V_BC: algebra.shifted_motion(V, p) + V_BC, of_sums=True)
_summed = formula(lambda rotational, translational: [Summed(rotational), Summed(translational)], of_sums=True)


@formula(of_sums=True)
def _composed_acceleration(A: Motion, p: Vector, w: Vector, V_BC: Motion, A_BC: Motion) -> Motion:
    coriolis = cross(w, V_BC.v)
    alpha, a = algebra.shifted_acceleration(A, p, w)
    return Motion(alpha + A_BC.w + cross(w, V_BC.w), a + (coriolis + coriolis) + A_BC.v)


# -- the base of the four kinds ---------------------------------------------------------------------------------------


class SpatialVector(Additive):
    """Base of the four kinds. A subclass is a `tree` of two fields, rotational first, one of which may be left out."""

    _items = (3,), (3,)
    _as_array = "to_array"

    if TYPE_CHECKING:
        _laws: ClassVar[_Laws]

        def __init__(self, rotational: ArrayLike = LEFT_OUT, translational: ArrayLike = LEFT_OUT): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds vectors with any leaves, and without this check."""
        kind, names, left_out = type(self).__name__, self.__match_args__, None
        parts = {f"{kind}: {name}": x for name, x in vars(self).items() if x is not LEFT_OUT}
        if not parts:
            raise TypeError(f"{kind}: expected {', '.join(names)} or both, got neither; zero is {kind}.zero()")
        if not all(map(check.is_tree_mark, parts.values())):
            maker = f"; of six numbers make one with {kind}.from_array"
            for name, x in parts.items():
                parts[name] = floats.owned(floats.as_vectors(x, name, keep_dtype=True, otherwise=maker))
            parts = check.same_dtype(**parts)
            arrays = list(parts.values())
            if arrays[0].shape != arrays[-1].shape:
                _require_one_batch(kind, parts)
            left_out = zero(3, arrays[0].dtype) if len(arrays) == 1 else None
        for name in names:
            vars(self)[name] = parts.get(f"{kind}: {name}", left_out)

    # -- construction and parts ---------------------------------------------------------------------------------------

    @classmethod
    def from_array(cls, x6: ArrayLike) -> Self:
        """From six coefficients, rotational on top.

        Args:
            x6: (*batch, 6).

        Returns:
            The vector (*batch,).

        Raises:
            TypeError: x6 is not of floating point.
            ValueError: the shape does not fit.

        Error: none, it is exact.

        Example:
            >>> js.SpatialForce.from_array([0.0, 0.0, 3.0, 1.0, 2.0, 0.0])
            SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        """
        array = floats.as_vectors(x6, f"{cls.__name__}.from_array: x6", size=6, keep_dtype=True)
        return cls(array[..., :3], array[..., 3:])

    @property
    def _vectors(self) -> tuple:
        """(rotational, translational). A known zero takes the dtype of the other part, even once that is converted."""
        first, second = (parts := vars(self).values())
        if Components in map(type, parts):
            return _zero_like(first, second), _zero_like(second, first)
        return first, second

    @property
    def rotational(self) -> jax.Array:
        """(*batch, 3) the rotational part."""
        return self._vectors[0]

    @property
    def translational(self) -> jax.Array:
        """(*batch, 3) the translational part."""
        return self._vectors[1]

    def to_array(self) -> jax.Array:
        """The coefficients (*batch, 6), rotational on top; as NumPy where JAX would narrow them. Exact.

        Example:
            >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
            >>> print(F.to_array())
            [0. 0. 3. 1. 2. 0.]
        """
        return side_by_side(*self._vectors)

    @property
    def size(self) -> int:
        """6, whatever the batch."""
        return 6

    def __getitem__(self, i: int) -> jax.Array:
        """The i-th of the six components of one vector, rotational first."""
        if self.batch_shape:
            # Not an IndexError: iteration would end silently.
            raise TypeError(
                f"{type(self).__name__}[i] is the i-th component of a single vector, this is a batch of shape "
                f"{self.batch_shape}; component i of all: x.to_array()[..., i], vector i of the batch: x.at_batch(i)"
            )
        i = operator.index(i)
        if not -6 <= i < 6:
            raise IndexError(f"{type(self).__name__}: expected a component index from -6 to 5, got {i}")
        return self._vectors[i % 6 // 3][i % 3]

    def __repr__(self) -> str:
        parts = ", ".join(f"{name}={check.shown(getattr(self, name), 3)}" for name in self.__match_args__)
        return f"{type(self).__name__}({parts})"

    # -- arithmetic ---------------------------------------------------------------------------------------------------

    def __add__(self, other: Self) -> Self:
        """The sum of two vectors about the same point in the same frame: error <= u |x_i + y_i| per component."""
        return self._with(operator.add, other)

    def __sub__(self, other: Self) -> Self:
        """The difference of two about the same point in the same frame: error <= u |x_i - y_i| per component."""
        return self._with(operator.sub, other)

    def __radd__(self, other: int) -> Self:
        """0 + x is x, for Python's `sum`; nothing else adds to a spatial vector."""
        if isinstance(other, int) and other == 0:
            return self
        return self.__rsub__(other)

    def __rsub__(self, other: object) -> NoReturn:
        raise TypeError(f"+ or -: expected two of one kind, got {type(other).__name__} and {type(self).__name__}")

    def __neg__(self) -> Self:
        """The negated vector, exactly."""
        return self._with_vectors(-part for part in self._vectors)

    def __mul__(self, scalar: ArrayLike) -> Self:
        """Times a number, or one number per vector of the batch: error <= u |x_i s| per component.

        The number does not add axes to the batch: three times one vector is `jax.vmap(operator.mul, (None, 0))(x, s)`.
        """
        return self._scaled(product, scalar)

    __rmul__ = __mul__

    def __truediv__(self, scalar: ArrayLike) -> Self:
        """Divided by a number, or by one number per vector of the batch: error <= u |x_i / s| per component."""
        return self._scaled(quotient, scalar)

    def _with(self, operation: Callable, other) -> Any:
        return part_by_part(operation, self, other) if isinstance(other, SpatialVector) else NotImplemented

    def _scaled(self, operation: Callable, scalar) -> Any:
        if isinstance(scalar, SpatialVector):
            return NotImplemented
        x, s = floats.narrowed(self), self._scalar(scalar)
        batch = floats.common_batch_shape(**{type(self).__name__: x.batch_shape, "scalar": s.shape})
        parts = floats.broadcast_batch(batch, *x._vectors)
        factor = s if is_known(s) else floats.broadcast_batch(batch, floats.expanded(s))[0]
        return self._with_vectors(_times(operation, part, factor) for part in parts)

    def _scalar(self, scalar):
        """The checked factor: a NumPy number for a Python number, or an array with one number per vector."""
        kind = type(self).__name__
        dtype = floats.narrowed(self).dtype
        if isinstance(scalar, (int, float)):
            return dtype.type(scalar)
        s = floats.as_float_array(scalar, f"{kind} * or / scalar", dtype)
        check.require_same_dtype(**{kind: self, "scalar": s})
        if len(s.shape) > len(self.batch_shape) and not all(map(floats.goes_with_any_batch, self._vectors)):
            raise ValueError(
                f"{kind} * or / scalar: expected a number, or one per vector of the batch of shape {self.batch_shape}, "
                f"got shape {s.shape}; each of them times all: jax.vmap(operator.mul, in_axes=(None, 0))(x, s)"
            )
        return s

    @promises(bound=OfSum())
    def sum(self, axis: int = 0, *, precision: PrecisionName = None) -> Self:
        """The sum of all vectors along an axis of the batch, about the same point in the same frame.

        Summation is pairwise, always in the same order.

        Args:
            axis: of the batch; negative ones count from its end.
            precision: name of a precision; None takes the default.

        Returns:
            The sum, over the other axes of the batch; zero if there are no vectors.

        Raises:
            ValueError: the batch does not have the axis.

        Error: per component of n vectors, L = ceil(log2 n), mag the sum of the absolute values: at most L u mag in
            "fast" and "reproducible", u |r| + 2 L^2 u^2 mag in "compensated", 1 ulp of r in "faithful" while |r| >= n^2
            u^2 mag (a sum in three times the precision), while nothing over- or underflows; plus a few finfo.tiny where
            subnormals are flushed.
        Source: Higham 2002, 4.2: pairwise summation.

        Example:
            >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
            >>> js.stack([F, F, -3.0 * F]).sum()
            SpatialForce(tau=[0.0, 0.0, -3.0], f=[-1.0, -2.0, 0.0])
        """
        place = floats.batch_axis(axis, self.batch_shape, f"{type(self).__name__}.sum")
        return self._with_vectors(_summed(precision, *moved_to_last(self._vectors, place, self.batch_shape)))

    # -- operations ---------------------------------------------------------------------------------------------------

    def shift(self, p_PQ_E: ArrayLike, w: ArrayLike | None = None, *, precision: PrecisionName = None) -> Self:
        """To another point of the body, see `jaxspatial.shift`.

        Example:
            >>> print(F.shift(p_PQ))
            SpatialForce(tau=[2.0, -1.0, -3.0], f=[1.0, 2.0, 0.0])
        """
        return self._shift(p_PQ_E, w, precision)

    def dot(self, other: "SpatialVector", *, precision: PrecisionName = None) -> jax.Array:
        """The pairing of force and velocity, see `jaxspatial.dot`.

        Example:
            >>> print(F.dot(V), V.dot(F))
            3.5 3.5
        """
        return self._dot(other, precision)

    def __rmatmul__(self, R_AE: Rotation) -> Self:
        """R @ X: see `jaxspatial.rotate`."""
        require_kind(R_AE, Rotation, "rotate", " first")
        return self._rotate(R_AE, None)

    @property
    def _grouped(self):
        """Its arrays as formulas take them: a Motion or a Wrench."""
        return self._laws.group(*self._vectors)

    def _checked_w(self, w: ArrayLike | None, operation: str) -> dict[str, jax.Array]:
        """The angular velocity by its name, where the kind needs it to be moved."""
        require_no_w(self, w, operation)
        return {}

    def _shift(self, p_PQ_E: ArrayLike, w: ArrayLike | None, precision: PrecisionName) -> Self:
        rate = self._checked_w(w, "shift")
        p = offset(self, p_PQ_E, **rate)
        return self._with_vectors(self._laws.shift(precision, self._grouped, p, *rate.values()))

    def _act(self, X_AB: "RigidTransform", w: ArrayLike | None, precision: PrecisionName) -> Self:
        rate = self._checked_w(w, "act")
        return self._with_vectors(self._laws.act(precision, X_AB._pose, self._grouped, *rate.values()))

    def _act_inverse(self, X_AB: "RigidTransform", w: ArrayLike | None, precision: PrecisionName) -> Self:
        rate = self._checked_w(w, "act_inverse")
        return self._with_vectors(self._laws.act_inverse(precision, X_AB._pose, self._grouped, *rate.values()))

    def _cross(self, V_P_E: "SpatialVelocity", precision: PrecisionName) -> Self:
        return self._with_vectors(self._laws.cross(precision, V_P_E._grouped, self._grouped))

    def _dot(self, other, precision: PrecisionName) -> jax.Array:
        refuse("dot", "a SpatialForce or SpatialMomentum and a SpatialVelocity", self)

    def _rotate(self, R_AE: Rotation, precision: PrecisionName) -> Self:
        check.require_same_dtype(Rotation=R_AE, **{type(self).__name__: self})
        return self._with_vectors(rotated_together(R_AE, *self._vectors, precision=precision))

    # -- comparison: masks over the batch; NaN is near nothing --------------------------------------------------------

    def get_maximum_absolute_differences(self, other: Self) -> tuple[jax.Array, jax.Array]:
        """The largest absolute difference of each part, NaN where either has one.

        Args:
            other: the same kind, about the same point, in the same frame.

        Returns:
            (rotational (*batch,), translational (*batch,)), over the common batch.

        Raises:
            TypeError: other is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: that of one rounded difference.

        Example:
            >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
            >>> torque, force = F.get_maximum_absolute_differences(2.0 * F)
            >>> print(torque, force)
            3.0 2.0
        """
        a, b = matched(self, other, "comparison")
        differences = (_skipping_zero(operator.sub, x, y) for x, y in zip(a._vectors, b._vectors, strict=True))
        rotational, translational = (from_double_word(abs(as_array(d, a.batch_shape))) for d in differences)
        return _largest(rotational), _largest(translational)

    def is_nearly_equal_within_absolute_tolerance(
        self, other: Self, rotational_tolerance: ArrayLike, translational_tolerance: ArrayLike
    ) -> jax.Array:
        """True where the largest absolute difference of each part is at most its tolerance.

        Args:
            other: the same kind, about the same point, in the same frame.
            rotational_tolerance: (*batch,), in the units of the rotational part.
            translational_tolerance: (*batch,), in the units of the translational part.

        Returns:
            A mask (*batch,), over the common batch; False where there is a NaN.

        Raises:
            TypeError: other is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `get_maximum_absolute_differences`.

        Example:
            >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
            >>> print(F.is_nearly_equal_within_absolute_tolerance(1.001 * F, 0.1, 0.01))
            True
        """
        rotational, translational = self.get_maximum_absolute_differences(other)
        return (rotational <= _plain(rotational_tolerance)) & (translational <= _plain(translational_tolerance))

    def is_approx(self, other: Self, tolerance: ArrayLike | None = None) -> jax.Array:
        """True where all six absolute differences are at most the tolerance.

        Args:
            other: the same kind, about the same point, in the same frame.
            tolerance: (*batch,); None takes the eps of the dtype.

        Returns:
            A mask (*batch,), over the common batch; False where there is a NaN.

        Raises:
            TypeError: other is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `get_maximum_absolute_differences`.

        Example:
            >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
            >>> print(F.is_approx(1.001 * F), F.is_approx(1.001 * F, 0.01))
            False True
        """
        a, b = matched(self, other, "comparison")
        tolerance = floats.eps(a.dtype) if tolerance is None else tolerance
        return a.is_nearly_equal_within_absolute_tolerance(b, tolerance, tolerance)


# -- the four kinds ---------------------------------------------------------------------------------------------------


@tree
class SpatialForce(SpatialVector):
    """F_Bp_E: a wrench on body B: a torque on top of a force, about point Bp, expressed in frame E.

    The point Bp and the frame E are not stored: you track them, best in the name of the variable. Add only forces on
    the same body, about the same point, in the same frame.

    tau: (*batch, 3) torque about Bp, N m
    f: (*batch, 3) force, N

    A part that is left out is a known zero, with which nothing is computed: `SpatialForce(f=f)` is a pure force,
    `SpatialForce(tau)` a couple.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> 2.0 * F
        SpatialForce(tau=[0.0, 0.0, 6.0], f=[2.0, 4.0, 0.0])
        >>> print(F.f, F[2], F.to_array())
        [1. 2. 0.] 3.0 [0. 0. 3. 1. 2. 0.]
    """

    tau: jax.Array = LEFT_OUT
    f: jax.Array = LEFT_OUT

    _laws = _OF_FORCES

    def _dot(self, other, precision: PrecisionName) -> jax.Array:
        require_kind(other, SpatialVelocity, "dot", f" beside a {type(self).__name__}")
        require_pair(self, other)
        return _power(precision, self._grouped, other._grouped)


@tree
class SpatialMomentum(SpatialVector):
    """L_MSp_E: the momentum of system S in frame M, about point Sp, expressed in frame E.

    The frame M, the point Sp and the frame E are not stored: you track them, see `SpatialForce`.

    h: (*batch, 3) angular momentum about Sp, N m s
    l: (*batch, 3) linear momentum, N s

    A part that is left out is a known zero, see `SpatialForce`.

    Example:
        >>> L = js.SpatialMomentum(h=[0.0, 0.0, 0.1], l=[2.0, 0.0, 0.0])
        >>> js.shift(L, [0.0, 1.0, 0.0])
        SpatialMomentum(h=[0.0, 0.0, 2.1], l=[2.0, 0.0, 0.0])
    """

    h: jax.Array = LEFT_OUT
    l: jax.Array = LEFT_OUT  # noqa: E741 - the field's letter

    # Moved and paired as a force is.
    _laws, _dot = _OF_FORCES, SpatialForce._dot


@tree
class SpatialVelocity(SpatialVector):
    """V_MBp_E: the velocity of body B in frame M, about point Bp, expressed in frame E.

    The frame M, the point Bp and the frame E are not stored: you track them, see `SpatialForce`.

    w: (*batch, 3) angular velocity, rad/s
    v: (*batch, 3) velocity of Bp, m/s

    A part that is left out is a known zero, see `SpatialForce`: `SpatialVelocity(v=v)` is a translation.

    Example:
        >>> V = js.SpatialVelocity(w=[0.0, 0.0, 2.0], v=[1.0, 0.0, 0.0])
        >>> js.shift(V, [0.0, 1.0, 0.0])
        SpatialVelocity(w=[0.0, 0.0, 2.0], v=[-1.0, 0.0, 0.0])
    """

    w: jax.Array = LEFT_OUT
    v: jax.Array = LEFT_OUT

    @promises(bound=COMPOSED)
    def compose_with_moving_frame(
        self, p_BoCo_E: ArrayLike, V_BC_E: "SpatialVelocity", *, precision: PrecisionName = None
    ) -> "SpatialVelocity":
        """Composes velocities: V_MC_E of frame C, which moves at V_BC_E in frame B, which moves at this V_MB_E in M.

            w_MC = w_MB + w_BC            v_MCo = v_MBo + w_MB x p_BoCo + v_BCo

        Composing frame after frame is associative but for rounding.

        Args:
            p_BoCo_E: (*batch, 3) position of Co from Bo, m, expressed in frame E.
            V_BC_E: SpatialVelocity (*batch,) of C in B about Co, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            V_MC_E about Co, over the common batch. 18 flops.

        Raises:
            TypeError: V_BC_E is of another kind, or dtypes differ.
            ValueError: shapes do not fit.

        Error: per component, mag the sum of the absolute values of its terms: at most 4 u mag in "fast" and
            "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful".
        Source: Jain 2010, 1.4.

        Example:
            >>> V_MB = js.SpatialVelocity(w=[0.0, 0.0, 2.0], v=[0.0, 0.0, 0.0])
            >>> V_BC = js.SpatialVelocity(w=[0.0, 0.0, 1.0], v=[0.5, 0.0, 0.0])
            >>> V_MB.compose_with_moving_frame([1.0, 0.0, 0.0], V_BC)
            SpatialVelocity(w=[0.0, 0.0, 3.0], v=[0.5, 2.0, 0.0])
        """
        require_kind(V_BC_E, SpatialVelocity, "compose_with_moving_frame: V_BC_E")
        p = floats.as_vectors(p_BoCo_E, "compose_with_moving_frame: p_BoCo_E", self.dtype)
        require_compatible(V_MB_E=self, p_BoCo_E=p, V_BC_E=V_BC_E)
        return self._with_vectors(_composed_velocity(precision, self._grouped, p, V_BC_E._grouped))

    _laws = _OF_VELOCITIES

    def _dot(self, other, precision: PrecisionName) -> jax.Array:
        if not isinstance(other, (SpatialForce, SpatialMomentum)):
            refuse("dot", "a SpatialForce or SpatialMomentum beside a velocity", other)
        return other._dot(self, precision)


@tree
class SpatialAcceleration(SpatialVector):
    """A_MBp_E: the acceleration of body B in frame M, about point Bp, expressed in frame E.

    The frame M, the point Bp and the frame E are not stored: you track them, see `SpatialForce`.

    alpha: (*batch, 3) angular acceleration, rad/s2
    a: (*batch, 3) classical acceleration of Bp, m/s2: Featherstone's spatial acceleration plus w x v

    A part that is left out is a known zero, see `SpatialForce`.

    Example:
        >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[0.0, 0.0, 0.0])
        >>> js.shift(A, [2.0, 0.0, 0.0], w=[0.0, 0.0, 3.0])
        SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[-18.0, 0.0, 0.0])
    """

    alpha: jax.Array = LEFT_OUT
    a: jax.Array = LEFT_OUT

    @promises(bound=COMPOSED_ACCELERATION)
    def compose_with_moving_frame(
        self,
        p_BoCo_E: ArrayLike,
        w_MB_E: ArrayLike,
        V_BC_E: SpatialVelocity,
        A_BC_E: "SpatialAcceleration",
        *,
        precision: PrecisionName = None,
    ) -> "SpatialAcceleration":
        """Composes accelerations: A_MC_E of frame C, which moves at A_BC_E in frame B, which moves at this A_MB_E in M.

            alpha_MC = alpha_MB + alpha_BC + w_MB x w_BC
            a_MCo = a_MBo + alpha_MB x p + w_MB x (w_MB x p) + 2 w_MB x v_BC + a_BC        p = p_BoCo

        The terms are the tangential, centripetal and Coriolis accelerations.

        Args:
            p_BoCo_E: (*batch, 3) position of Co from Bo, m, expressed in frame E.
            w_MB_E: (*batch, 3) angular velocity of B in M, rad/s, in E.
            V_BC_E: SpatialVelocity (*batch,) of C in B about Co, in E.
            A_BC_E: SpatialAcceleration (*batch,) of C in B about Co, in E.
            precision: name of a precision; None takes the default.

        Returns:
            A_MC_E about Co, over the common batch. 66 flops.

        Raises:
            TypeError: V_BC_E or A_BC_E is of another kind, or dtypes differ.
            ValueError: shapes do not fit.

        Error: per component, mag the sum of the absolute values of its terms, multiplied out: at most 10 u mag in
            "fast" and "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp of r in "faithful".
        Source: Mitiguy 2022, Dynamics of Mechanical, Aerospace, and Biomechanical Systems; Featherstone 2008, 2.11.

        Example:
            >>> A_MB, A_BC = js.SpatialAcceleration.zero(), js.SpatialAcceleration.zero()
            >>> V_BC = js.SpatialVelocity(v=[1.0, 0.0, 0.0])
            >>> A_MB.compose_with_moving_frame([0.0, 0.0, 0.0], [0.0, 0.0, 3.0], V_BC, A_BC)
            SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[0.0, 6.0, 0.0])
        """
        name = "compose_with_moving_frame"
        require_kind(V_BC_E, SpatialVelocity, f"{name}: V_BC_E")
        require_kind(A_BC_E, SpatialAcceleration, f"{name}: A_BC_E")
        p = floats.as_vectors(p_BoCo_E, f"{name}: p_BoCo_E", self.dtype)
        w = floats.as_vectors(w_MB_E, f"{name}: w_MB_E", self.dtype)
        require_compatible(A_MB_E=self, p_BoCo_E=p, w_MB_E=w, V_BC_E=V_BC_E, A_BC_E=A_BC_E)
        moved = _composed_acceleration(precision, self._grouped, p, w, V_BC_E._grouped, A_BC_E._grouped)
        return self._with_vectors(moved)

    def to_featherstone(self, V_MP_E: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
        """Featherstone's spatial acceleration, rotational on top: (alpha, a - w x v).

        It is the rate of the velocity at a fixed point that body points pass, where the classical acceleration follows
        one point of the body. Pinocchio and MuJoCo use it. The result is an array, which nothing can mistake for a
        classical acceleration.

        Args:
            V_MP_E: SpatialVelocity (*batch,) of the same body, about the same point, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6), over the common batch: rad/s2, m/s2.

        Raises:
            TypeError: V_MP_E is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `shift` of a force.
        Source: Featherstone 2008, 2.11.

        Example:
            >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[-9.0, 0.0, 0.0])
            >>> V = js.SpatialVelocity(w=[0.0, 0.0, 3.0], v=[0.0, 2.0, 0.0])
            >>> print(A.to_featherstone(V))
            [ 0.  0.  0. -3.  0.  0.]
        """
        require_kind(V_MP_E, SpatialVelocity, "to_featherstone: V_MP_E")
        require_compatible(A_MP_E=self, V_MP_E=V_MP_E)
        return side_by_side(*_to_featherstone(precision, self._grouped, V_MP_E._grouped))

    @classmethod
    def from_featherstone(cls, x6: ArrayLike, V_MP_E: SpatialVelocity, *, precision: PrecisionName = None) -> Self:
        """The classical acceleration from Featherstone's spatial acceleration: (alpha, a + w x v).

        Args:
            x6: (*batch, 6) Featherstone's spatial acceleration, rotational on top: rad/s2, m/s2.
            V_MP_E: SpatialVelocity (*batch,) of the same body, about the same point, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            The acceleration, over the common batch.

        Raises:
            TypeError: V_MP_E is of another kind, or dtypes differ.
            ValueError: shapes do not fit.

        Error: as of `shift` of a force.
        Source: Featherstone 2008, 2.11.

        Example:
            >>> V = js.SpatialVelocity(w=[0.0, 0.0, 3.0], v=[0.0, 3.0, 0.0])
            >>> A = js.SpatialAcceleration.from_featherstone(jnp.zeros(6), V)
            >>> print(A.a)
            [-9.  0.  0.]
        """
        require_kind(V_MP_E, SpatialVelocity, "from_featherstone: V_MP_E")
        spatial = cls.from_array(x6)
        require_compatible(x6=spatial, V_MP_E=V_MP_E)
        return spatial._with_vectors(_from_featherstone(precision, spatial._grouped, V_MP_E._grouped))

    _laws = _OF_ACCELERATIONS

    def _checked_w(self, w: ArrayLike | None, operation: str) -> dict[str, jax.Array]:
        if w is None:
            raise TypeError(
                f"{operation}: expected w, the angular velocity of the body, (*batch, 3), for a SpatialAcceleration"
            )
        w = floats.as_vectors(w, f"{operation}: w", self.dtype)
        require_compatible(SpatialAcceleration=self, w=w)
        return {"w": w}


# -- arguments --------------------------------------------------------------------------------------------------------


def offset(X_P_E: Quantity, p_PQ_E: ArrayLike, **others: jax.Array) -> jax.Array:
    """The checked offset of `shift`: an array of the dtype of X, whose batch broadcasts with those of X and others."""
    p = floats.as_vectors(p_PQ_E, "shift: p_PQ_E", X_P_E.dtype)
    require_compatible(**{type(X_P_E).__name__: X_P_E}, p_PQ_E=p, **others)
    return p


def require_no_w(X_P_E: Quantity, w: ArrayLike | None, operation: str = "shift") -> None:
    """Refuses an angular velocity, which only a SpatialAcceleration needs."""
    if w is not None:
        raise TypeError(f"{operation}: w is for a SpatialAcceleration, not for a {type(X_P_E).__name__}")


def require_pair(a: SpatialVector, b: SpatialVector) -> None:
    """Checks that two vectors have one dtype, and batches that broadcast."""
    kinds = type(a).__name__, type(b).__name__
    check.require_same_dtype(**dict(zip(kinds if len({*kinds}) == 2 else ("first", "second"), (a, b), strict=True)))
    floats.common_batch_shape(first=a.batch_shape, second=b.batch_shape)


def _require_one_batch(kind: str, arrays: dict) -> None:
    batch_shapes = {name: a.shape[:-1] for name, a in arrays.items() if not floats.goes_with_any_batch(a)}
    if len(set(batch_shapes.values())) > 1:
        came = ", ".join(f"{name}: {shape}" for name, shape in batch_shapes.items())
        raise ValueError(f"{kind}: expected equal batch shapes, got {came}; see jnp.broadcast_to")


# -- parts as arrays --------------------------------------------------------------------------------------------------


def side_by_side(*parts) -> Any:
    """The parts as one array, end to end along the last axis; a NumPy array where JAX would narrow it."""
    arrays = [as_array(part, floats.batch_shape(*parts)) for part in parts]
    if not floats.config.jax_enable_x64 and all(isinstance(x, np.ndarray) and x.dtype == np.float64 for x in arrays):
        return np.concatenate(arrays, axis=-1)
    arrays = to_double_word(arrays) if any(isinstance(x, DoubleWord) for x in arrays) else arrays
    return jax.tree.map(lambda *words: jnp.concatenate(words, axis=-1), *arrays)


def _zero_like(x, other):
    dtype = getattr(other, "dtype", None)
    return zero(3, dtype) if isinstance(x, Components) and is_zero(x) and dtype not in (None, x.dtype) else x


def _times(operation: Callable, part, s):
    """operation(part, s), `product` or `quotient`, for s (*batch, 1) or a number.

    Double words and Components have operators for it.
    """
    factor = s
    x = to_double_word(part) if isinstance(s, DoubleWord) and not isinstance(part, Components) else part
    if isinstance(x, floats.StandIn):
        return x * factor if operation is product else x / factor
    return operation(barrier(x), barrier(jnp.broadcast_to(factor, x.shape)))


def part_by_part(operation: Callable, x: _Kind, y: _Kind) -> _Kind:
    """x + y or x - y, of one kind."""
    a, b = matched(x, y, operation.__name__)
    return a._with_vectors(_skipping_zero(operation, *parts) for parts in zip(a._vectors, b._vectors, strict=True))


def _skipping_zero(operation: Callable, x, y):
    """x + y or x - y, without an operation for known zeros."""
    if is_zero(y):
        return x
    if is_zero(x):
        return y if operation is operator.add else -y
    return quietly(operation, barrier(x), barrier(y))


def _largest(x) -> jax.Array:
    # Written out, as XLA CPU reduces an axis of length 3 in a library call. Both maxima propagate NaN.
    maximum: Any = np.maximum if isinstance(x, np.ndarray) else jnp.maximum
    return maximum(maximum(x[..., 0], x[..., 1]), x[..., 2])


def _plain(number: ArrayLike) -> Any:
    """np.float64 as a Python float, which takes the dtype of what it is compared with."""
    return float(number) if isinstance(number, float) else number

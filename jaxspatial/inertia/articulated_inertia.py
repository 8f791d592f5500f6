"""Articulated-body inertia: the inertia of a body with others that hang on it by joints; and seen through a joint."""

import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import from_double_word, to_double_word
from jaxspatial.arithmetic.quantity import Additive, require_alike
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.arithmetic.types import Matrix, PrecisionName, Scalar, Vector3
from jaxspatial.inertia import articulated, parameters
from jaxspatial.inertia.inertia import SpatialInertia
from jaxspatial.inertia.parts import as_entries
from jaxspatial.rotation.matrices import as_matrices, expanded
from jaxspatial.rotation.rotation import Rotation
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialVelocity, rotate, shift
from jaxspatial.spatial.arguments import refuse, require_kind
from jaxspatial.spatial.vector import combined

Motions = SpatialVelocity | Sequence[SpatialVelocity]  # of one joint: a list has one for each freedom


@tree
class ArticulatedInertia(Additive):
    """P_BPp_E: the force on body B, with what hangs on it, per spatial acceleration: the part that is linear in it.

        P = [[J, F], [F^T, M]]        tau = J alpha + F a        f = F^T alpha + M a

    rotational: (*batch, 6) J as [xx, xy, yy, xz, yz, zz], kg m2; given so or as (*batch, 3, 3), its lower triangle read
    coupling: (*batch, 9) F, row by row, kg m; given so or as (*batch, 3, 3)
    translational: (*batch, 6) M as J, kg: unlike a mass it may differ with the direction

    About point P, expressed in frame E. Symmetric by construction. The sum of two has a meaning for bodies that are
    welded together, about the same point, in the same frame. Numbers are *unchecked*, see `is_physically_valid`.
    Raises TypeError for dtypes that differ, ValueError for shapes.

    Source: Featherstone 2008, Rigid Body Dynamics Algorithms, 7.1; Jain 2010, 6.1; Drake, ArticulatedBodyInertia.
    """

    rotational: jax.Array
    coupling: jax.Array
    translational: jax.Array

    _items = (6,), (9,), (6,)

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds inertias without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(part) for part in self.vectors):
            return
        named = zip(self.__match_args__, self.vectors, self._items, strict=True)
        parts = check.alike(**{name: as_entries(x, f"ArticulatedInertia: {name}", n) for name, x, (n,) in named})
        batch = check.common_batch_shape(**{name: x.shape[:-1] for name, x in parts.items()})
        for name, part in zip(parts, check.broadcast_batch(batch, *parts.values()), strict=True):
            object.__setattr__(self, name, part)

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def from_spatial_inertia(cls, M_BP_E: SpatialInertia, *, precision: PrecisionName = None) -> Self:
        """The articulated inertia of a single rigid body: J = central + m (c.c 1 - c c^T), F = m [c]x, M = m 1.

        Args:
            M_BP_E: the inertia of the body.
            precision: name of a precision; None takes the default.

        Returns:
            The articulated inertia about the same point in the same frame.

        Raises:
            TypeError: the first argument is no SpatialInertia.

        Error: per entry, mag the sum of the absolute values of its terms: at most 5 u mag in "fast" and
            "reproducible", u |r| + 16 u^2 mag in "compensated", 1 ulp in "faithful".
        """
        require_kind(M_BP_E, SpatialInertia, "from_spatial_inertia")
        m, com, central = expanded(M_BP_E.mass), M_BP_E.com, M_BP_E.central
        parts = parameters.about_origin(precision, m, com, central), *articulated.with_mass(precision, m, com)
        return rebuilt(cls, cls.__match_args__, parts)

    @classmethod
    def from_matrix(cls, m: Matrix) -> Self:
        """From symmetric matrices, of which the lower triangle is read. Exact.

        Args:
            m: (*batch, 6, 6), rotational on top.

        Returns:
            The articulated inertia, over the batch of m.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.
        """
        entries = as_matrices(m, "ArticulatedInertia.from_matrix: m", 6)[..., articulated.OF_MATRIX]
        return cls(entries[..., :6], entries[..., 6:15], entries[..., 15:])

    # -- parts --------------------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The matrix (*batch, 6, 6) [[J, F], [F^T, M]]: symmetric, rotational on top. Exact."""
        parts = to_double_word(self.vectors) if any(isinstance(x, DoubleWord) for x in self.vectors) else self.vectors
        joined = jax.tree.map(lambda *words: jnp.concatenate(words, axis=-1), *parts)
        return joined[..., articulated.TO_MATRIX].reshape((*self.batch_shape, 6, 6))

    def is_physically_valid(self, tolerance: float | None = None) -> jax.Array:
        """Whether no eigenvalue is below -tolerance times the size of the matrix; NaN is never valid.

        The size of J, F and M is measured in units in which J and M are of size 1, so that neither metres nor kilograms
        matter. By Cholesky's decomposition: works under jit.

        Args:
            tolerance: a Python number, by default 64 eps of the dtype.

        Returns:
            (*batch,) of bool.

        Error: that of the eigenvalues is what the tolerance is for.
        """
        P = check.narrowed(self)
        tolerance = 64 * check.eps(P.dtype) if tolerance is None else float(tolerance)
        return articulated.is_valid(None, *from_double_word(P.vectors), tolerance=tolerance)

    # -- operations ---------------------------------------------------------------------------------------------------

    def __add__(self, other: Any) -> Any:
        """Entry by entry, for bodies welded together, about the same point in the same frame: error <= u |x + y|."""
        return self._combined(operator.add, other)

    def __sub__(self, other: Any) -> Any:
        """Entry by entry: the inertia without a body that was welded to it."""
        return self._combined(operator.sub, other)

    def __radd__(self, other: Any) -> Any:
        """0 + P is P, for Python's `sum`; SpatialInertia + P."""
        return self if isinstance(other, int) and other == 0 else self.__add__(other)

    def _combined(self, operation: Callable[..., Any], other: Any) -> Any:
        if isinstance(other, SpatialInertia):
            other = ArticulatedInertia.from_spatial_inertia(other)
        if not isinstance(other, ArticulatedInertia):
            return NotImplemented
        return combined(operation, self, other)

    def __matmul__(self, A_P_E: Any) -> Any:
        """P @ A: see `times`."""
        return self.times(A_P_E) if isinstance(A_P_E, SpatialAcceleration) else NotImplemented

    def times(self, A_P_E: SpatialAcceleration, *, precision: PrecisionName = None) -> SpatialForce:
        """The force P A about the same point: tau = J alpha + F a, f = F^T alpha + M a.

        Featherstone's algorithm takes spatial accelerations: its bias forces say what is missing to classical ones.

        Args:
            A_P_E: the acceleration of P, in the same frame: rad/s^2, m/s^2.
            precision: name of a precision; None takes the default.

        Returns:
            The force, N m, N, over the common batch. 66 flops.

        Raises:
            TypeError: the acceleration is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: per component, mag the sum of the absolute values of its six products: at most 4 u mag in "fast" and
            "reproducible", u |r| + 8 u^2 mag in "compensated", 1 ulp in "faithful".
        """
        require_kind(A_P_E, SpatialAcceleration, "ArticulatedInertia.times")
        require_alike(ArticulatedInertia=self, SpatialAcceleration=A_P_E)
        return SpatialForce(*articulated.times_motion_arrays(precision, *self.vectors, A_P_E.alpha, A_P_E.a))

    def __rmatmul__(self, R_AE: Any) -> Self:
        """R @ P: see `jaxspatial.rotate`."""
        return rotate(R_AE, self)

    def shift(self, p_PQ_E: Vector3, *, precision: PrecisionName = None) -> Self:
        """Moves this inertia to the point Q of the same body; it stays positive semidefinite.

            F_Q = F_P - [p]x M        J_Q = J_P - [p]x F_P^T + F_Q [p]x        M_Q = M_P

        Args:
            p_PQ_E: (*batch, 3) position of Q from P, m, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about Q, over the common batch. 102 flops.

        Raises:
            TypeError: dtypes differ.
            ValueError: shapes do not fit.

        Error: per entry, mag the sum of the absolute values of its terms, multiplied out: at most 8 u mag in "fast" and
            "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp in "faithful"; M_Q exact.
        Source: Drake, ArticulatedBodyInertia::Shift; Jain 2010, 6.3.
        """
        return shift(self, p_PQ_E, precision=precision)

    def rotate(self, R_AE: Rotation, *, precision: PrecisionName = None) -> Self:
        """Re-expresses this inertia in frame A, about the same point: R J R^T, R F R^T, R M R^T.

        Args:
            R_AE: the rotation.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia in frame A, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: per entry, mag the sum of the absolute values of its nine terms: at most 6 u mag in "fast" and
            "reproducible", u |r| + 64 u^2 mag in the other two.
        """
        return rotate(R_AE, self, precision=precision)

    def project_out(
        self, S_P_E: Motions, armature: Scalar = 0.0, *, precision: PrecisionName = None
    ) -> "ArticulatedInertia":
        """What is left of the inertia for a body that holds this one by a joint, see `joint_projection`."""
        return joint_projection(self, S_P_E, armature, precision=precision).inertia


class JointProjection(NamedTuple):
    """What `joint_projection` found; `U` and `D` are lists where several motions were given."""

    inertia: ArticulatedInertia
    U: SpatialForce | list[SpatialForce]
    D: jax.Array | list[jax.Array]


def joint_projection(
    P_P_E: ArticulatedInertia, S_P_E: Motions, armature: Scalar = 0.0, *, precision: PrecisionName = None
) -> JointProjection:
    """The articulated inertia seen through a joint that lets it move freely along S.

        U = P S        D = S^T U + armature        inertia = P - U D^-1 U^T

    For a joint of k freedoms, the inertia left is P - P S (S^T P S + diag(armature))^-1 S^T P, S the 6 x k matrix. It
    is symmetric, and without an armature maps S to 0 but for errors. Where D is 0 or less, by rounding or because
    nothing hangs on the joint, there is nothing to remove: the inertia stays as it is.

    Args:
        P_P_E: the articulated inertia about P, expressed in frame E.
        S_P_E: the motion of a unit of the joint's velocity, about the same point in the same frame. For a joint of k
            freedoms a list of k, removed one after the other.
        armature: inertia of the joint itself (rotors ...), a number or (*batch,); of a list of motions one for all or a
            list of k.
        precision: name of a precision; None takes the default.

    Returns:
        (inertia, U, D), over the common batch. Of a list of motions U and D are lists: those of the i-th are those of
        the inertia left by the ones before, as an articulated-body algorithm needs them that treats the joint as k
        joints between massless bodies. 140 flops per freedom.

    Raises:
        TypeError: an argument is of another kind, or dtypes differ.
        ValueError: shapes do not fit, or there are not as many armatures as motions.

    Error: per entry of the inertia, for one S, with mag_D the sum of the absolute values of the terms of D and
        mag = |P_ij| + mag_U,i mag_U,j / D: at most 16 u mag mag_D / D in "fast" and "reproducible", u |r| + 64 u^2 mag
        mag_D / D in the other two, while mag_D / D <= 1 / (32 u), or 1 / (64 u^2). mag_D / D is 1 for a joint along one
        axis of the frame; it is large where a body is light about an oblique axis: a thin rod about its own.
    Source: Featherstone 2008, 7.2, equations 7.43 and 7.44; Jain 2010, 6.3.
    """
    motions = _motions(P_P_E, S_P_E)
    words = [*_armatures(P_P_E, armature, len(motions)), *(part for s in motions for part in s.vectors)]
    j, f, m, *found = articulated.projected(precision, *P_P_E.vectors, *words, n=len(motions))
    U = [SpatialForce(tau, force) for tau, force in zip(found[::3], found[1::3], strict=True)]
    D = [d.reshape(d.shape[:-1]) for d in found[2::3]]
    left = P_P_E.with_vectors((j, f, m))
    return JointProjection(left, U[0], D[0]) if isinstance(S_P_E, SpatialVelocity) else JointProjection(left, U, D)


def _motions(P: ArticulatedInertia, S: Motions) -> list[SpatialVelocity]:
    motions: list[Any] = list(S) if isinstance(S, (list, tuple)) else [S]
    for s in motions:
        if not isinstance(s, SpatialVelocity):
            refuse("joint_projection: S", "a SpatialVelocity or a list of them", s)
        require_alike(ArticulatedInertia=P, S=s)
    return motions


def _armatures(P: ArticulatedInertia, armature: Scalar | Sequence[Scalar], n: int) -> list[jax.Array]:
    """One (*batch, 1) for each of n motions."""
    given = armature if isinstance(armature, (list, tuple)) else [armature] * n
    if len(given) != n:
        raise ValueError(f"joint_projection: armature: expected {n} numbers, got {len(given)}")
    arms = [expanded(check.as_float_array(x, "joint_projection: armature", P.dtype)) for x in given]
    for arm in arms:
        require_alike(ArticulatedInertia=P, armature=arm)
    return arms

"""Articulated-body inertia: the inertia of a body with others that hang on it by joints, and seen through a joint."""

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import jax
import numpy as np

from jaxspatial.inertia import parameters
from jaxspatial.inertia.composition import steiner
from jaxspatial.inertia.inertia import ABOUT, SpatialInertia, as_entries
from jaxspatial.numerics import check, elimination, floats
from jaxspatial.numerics.check import refuse, require_kind
from jaxspatial.numerics.floats import as_matrices, expanded
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import (
    PLACES,
    WHICH_OF_SIX,
    Articulated,
    Inertia,
    Matrix,
    Motion,
    Pose,
    Symmetric,
    Vector,
    Wrench,
    congruence,
    cross,
    left_sum,
    skew,
)
from jaxspatial.numerics.numbers import Mask, Number, Numbers, high, noinline, noinline_pairs, where
from jaxspatial.numerics.numbers.double_word import from_double_word
from jaxspatial.numerics.promise import Promise, promises
from jaxspatial.numerics.quantity import Additive, rebuilt, require_compatible, tree
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation.rotation import Rotation, is_identity
from jaxspatial.spatial import (
    RigidTransform,
    SpatialAcceleration,
    SpatialForce,
    SpatialVelocity,
    algebra,
    rotate,
    shift,
)
from jaxspatial.spatial.vectors import offset, part_by_part, require_no_w, side_by_side

TIMES, SHIFT, ROTATED, ACT = Promise(4, 8), Promise(8, 32), Promise(6, 64), Promise(16, 128)
# What is left of an articulated inertia beyond a joint: per mag_D / D.
PROJECTED = Promise(16, 64)

Motions = SpatialVelocity | Sequence[SpatialVelocity]  # of one joint: a list has one for each freedom

# Where among the 21 entries those of a 6 x 6 matrix are, and these in it: rotational and translational in the lower
# triangle, the coupling, transposed, in the lower left block.
_ROTATIONAL, _TRANSLATIONAL = (np.array(WHICH_OF_SIX) + first for first in (0, 15))
_COUPLING = np.arange(6, 15).reshape(3, 3)
_TO_MATRIX = np.block([[_ROTATIONAL, _COUPLING], [_COUPLING.T, _TRANSLATIONAL]]).ravel().astype(np.int32)
_OF_MATRIX = np.array([0, 6, 7, 12, 13, 14, 18, 24, 30, 19, 25, 31, 20, 26, 32, 21, 27, 28, 33, 34, 35], np.int32)


@tree
class ArticulatedInertia(Additive):
    """P_BPp_E: the force on body B, with what hangs on it, per spatial acceleration: the part that is linear in it.

        P = [[J, F], [F^T, M]]        tau = J alpha + F a        f = F^T alpha + M a

    rotational: (*batch, 6) J as [xx, xy, yy, xz, yz, zz], kg m2; also accepted as (*batch, 3, 3), of which the lower
        triangle is read
    coupling: (*batch, 9) F, row by row, kg m; also accepted as (*batch, 3, 3)
    translational: (*batch, 6) M as J, kg: unlike a mass it may differ with the direction

    About point P, expressed in frame E. Symmetric by construction. The sum of two has a meaning for bodies that are
    welded together, about the same point, in the same frame. Numbers are *unchecked*, see `is_physically_valid`.
    Raises TypeError for dtypes that differ, ValueError for shapes.

    Source: Featherstone 2008, Rigid Body Dynamics Algorithms, 7.1; Jain 2010, 6.1; Drake, ArticulatedBodyInertia.

    Example:
        >>> rod = js.SpatialInertia.thin_rod(1.0, mass=2.0)
        >>> P = js.ArticulatedInertia.from_spatial_inertia(rod)
        >>> print((P + rod).translational)
        [4. 0. 4. 0. 0. 4.]
    """

    rotational: jax.Array
    coupling: jax.Array
    translational: jax.Array

    _items = (6,), (9,), (6,)

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds inertias without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(part) for part in self._vectors):
            return
        named = zip(self.__match_args__, self._vectors, self._items, strict=True)
        parts = check.same_dtype(**{name: as_entries(x, f"ArticulatedInertia: {name}", n) for name, x, (n,) in named})
        batch = floats.common_batch_shape(**{name: x.shape[:-1] for name, x in parts.items()})
        for name, part in zip(parts, floats.broadcast_batch(batch, *parts.values()), strict=True):
            object.__setattr__(self, name, part)

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    @promises(bound=ABOUT)
    def from_spatial_inertia(cls, M_BP_E: SpatialInertia, *, precision: PrecisionName = None) -> Self:
        """The articulated inertia of a single rigid body: J = central + m (c.c 1 - c c^T), F = m [c]x, M = m 1.

        Args:
            M_BP_E: the inertia of the body.
            precision: name of a precision; None takes the default.

        Returns:
            The articulated inertia about the same point in the same frame.

        Raises:
            TypeError: the first argument is no SpatialInertia.

        Error: per entry, mag the sum of the absolute values of its terms: at most 5 u mag in "fast" and "reproducible",
            u |r| + 16 u^2 mag in "compensated", 1 ulp of r in "faithful".

        Example:
            >>> rod = js.SpatialInertia.thin_rod(1.0, mass=2.0)
            >>> print(js.ArticulatedInertia.from_spatial_inertia(rod).translational)
            [2. 0. 2. 0. 0. 2.]
        """
        require_kind(M_BP_E, SpatialInertia, "from_spatial_inertia")
        m, com, central = M_BP_E._vectors
        J = parameters.about_origin(precision, Inertia(m, com, central))
        return rebuilt(cls, cls.__match_args__, (J, *_coupling_and_translational(precision, m, com)))

    @classmethod
    def from_matrix(cls, m: ArrayLike) -> Self:
        """From symmetric matrices, of which the lower triangle is read. Exact.

        Args:
            m: (*batch, 6, 6), rotational on top.

        Returns:
            The articulated inertia, over the batch of m.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.

        Example:
            >>> P = js.ArticulatedInertia.from_matrix(np.eye(6, dtype=np.float32))
            >>> print(P.rotational, P.translational)
            [1. 0. 1. 0. 0. 1.] [1. 0. 1. 0. 0. 1.]
        """
        entries = as_matrices(m, "ArticulatedInertia.from_matrix: m", 6)[..., _OF_MATRIX]
        return cls(entries[..., :6], entries[..., 6:15], entries[..., 15:])

    @property
    def _grouped(self) -> Articulated:
        """Its arrays as formulas take them."""
        return Articulated(*self._vectors)

    # -- parts --------------------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The matrix (*batch, 6, 6) [[J, F], [F^T, M]]: symmetric, rotational on top. Exact.

        As NumPy where JAX would narrow it.

        Example:
            >>> P = js.ArticulatedInertia.from_matrix(np.eye(6, dtype=np.float32))
            >>> print(P.to_matrix()[3])
            [0. 0. 0. 1. 0. 0.]
        """
        return side_by_side(*self._vectors)[..., _TO_MATRIX].reshape((*self.batch_shape, 6, 6))

    def is_physically_valid(self, tolerance: float | None = None) -> jax.Array:
        """Whether no eigenvalue is below -tolerance times the size of the matrix; NaN is never valid.

        The size of J, F and M is measured in units in which J and M are of size 1, so that neither metres nor kilograms
        matter. By Cholesky's decomposition: works under jit.

        Args:
            tolerance: a Python number, by default 64 eps of the dtype.

        Returns:
            (*batch,) of bool.

        Error: that of the eigenvalues is what the tolerance is for.

        Example:
            >>> P = js.ArticulatedInertia.from_matrix(np.diag(np.float32([1, 1, 1, 2, 2, -2])))
            >>> print(P.is_physically_valid())
            False
        """
        P = floats.narrowed(self)
        tolerance = 64 * floats.eps(P.dtype) if tolerance is None else float(tolerance)
        return _is_valid(None, from_double_word(P._grouped), tolerance=tolerance)

    # -- operations ---------------------------------------------------------------------------------------------------

    def __add__(self, other: "ArticulatedInertia | SpatialInertia") -> Self:
        """Entry by entry, for bodies welded together, about the same point in the same frame: error <= u |x + y|."""
        return self._with(operator.add, other)

    def __sub__(self, other: "ArticulatedInertia | SpatialInertia") -> Self:
        """Entry by entry: the inertia without a body that was welded to it."""
        return self._with(operator.sub, other)

    def __radd__(self, other: SpatialInertia | int) -> Self:
        """0 + P is P, for Python's `sum`; SpatialInertia + P."""
        return self if isinstance(other, int) and other == 0 else self._with(operator.add, other)

    def _with(self, operation: Callable, other) -> Any:
        if isinstance(other, SpatialInertia):
            other = ArticulatedInertia.from_spatial_inertia(other)
        if not isinstance(other, ArticulatedInertia):
            return NotImplemented
        return part_by_part(operation, self, other)

    def __matmul__(self, A_P_E: SpatialAcceleration) -> SpatialForce:
        """P @ A: see `times`."""
        return self.times(A_P_E) if isinstance(A_P_E, SpatialAcceleration) else NotImplemented

    @promises(bound=TIMES)
    def times(self, A_P_E: SpatialAcceleration, *, precision: PrecisionName = None) -> SpatialForce:
        """The force P A about the same point: tau = J alpha + F a, f = F^T alpha + M a.

        Featherstone's algorithm takes spatial accelerations; for classical ones its bias forces have the terms that are
        missing here.

        Args:
            A_P_E: the acceleration of P, in the same frame: rad/s^2, m/s^2.
            precision: name of a precision; None takes the default.

        Returns:
            The force, N m, N, over the common batch. 66 flops.

        Raises:
            TypeError: the acceleration is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: per component, mag the sum of the absolute values of its six products: at most 4 u mag in "fast" and
            "reproducible", u |r| + 8 u^2 mag in "compensated", 1 ulp of r in "faithful".

        Example:
            >>> P = js.ArticulatedInertia.from_matrix(jnp.diag(jnp.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])))
            >>> P.times(js.SpatialAcceleration(alpha=[0.0, 0.0, 3.0], a=[1.0, 0.0, 0.0]))
            SpatialForce(tau=[0.0, 0.0, 3.0], f=[2.0, 0.0, 0.0])
        """
        require_kind(A_P_E, SpatialAcceleration, "ArticulatedInertia.times")
        require_compatible(ArticulatedInertia=self, SpatialAcceleration=A_P_E)
        return SpatialForce(*_applied(precision, self._grouped, Motion(*A_P_E._vectors)))

    def __rmatmul__(self, R_AE: Rotation) -> Self:
        """R @ P: see `jaxspatial.rotate`."""
        return rotate(R_AE, self)

    @promises(bound=SHIFT)
    def shift(self, p_PQ_E: ArrayLike, *, precision: PrecisionName = None) -> Self:
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

        Error: M_Q is exact. Per entry of the others, mag the sum of the absolute values of its terms, multiplied out:
            at most 8 u mag in "fast" and "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp of r in "faithful".
        Source: Drake, ArticulatedBodyInertia::Shift; Jain 2010, 6.3.

        Example:
            >>> P = js.ArticulatedInertia.from_matrix(np.diag(np.float32([1, 1, 1, 2, 2, 2])))
            >>> print(P.shift([0.0, 0.0, 1.0]).rotational)
            [3. 0. 3. 0. 0. 1.]
        """
        return shift(self, p_PQ_E, precision=precision)

    @promises(bound=ROTATED)
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

        Example:
            >>> P = js.ArticulatedInertia.from_matrix(jnp.diag(jnp.array([1.0, 2.0, 3.0, 2.0, 2.0, 2.0])))
            >>> print(P.rotate(js.Rotation.about_x(np.pi / 2)).to_matrix().diagonal())
            [1. 3. 2. 2. 2. 2.]
        """
        return rotate(R_AE, self, precision=precision)

    def _shift(self, p_PQ_E: ArrayLike, w: ArrayLike | None, precision: PrecisionName) -> Self:
        require_no_w(self, w)
        return self._with_vectors(_shifted(precision, self._grouped, offset(self, p_PQ_E)))

    def _rotate(self, R_AE: Rotation, precision: PrecisionName) -> Self:
        require_compatible(Rotation=R_AE, ArticulatedInertia=self)
        if is_identity(R_AE):
            return self
        return self._with_vectors(_rotated(precision, self._grouped, R_AE.entries))

    def _act(self, X_AB: RigidTransform, w: ArrayLike | None, precision: PrecisionName) -> Self:
        """Rotated and shifted in one formula; errors as of the record ACT."""
        require_no_w(self, w, "act")
        return self._with_vectors(_acted(precision, self._grouped, X_AB._pose))

    def _act_inverse(self, X_AB: RigidTransform, w: ArrayLike | None, precision: PrecisionName) -> Self:
        require_no_w(self, w, "act_inverse")
        return self._with_vectors(_acted_inverse(precision, self._grouped, X_AB._pose))

    def project_out(
        self, S_P_E: Motions, armature: ArrayLike = 0.0, *, precision: PrecisionName = None
    ) -> "ArticulatedInertia":
        """What is left of the inertia for a body that holds this one by a joint, see `joint_projection`.

        Example:
            >>> P = js.ArticulatedInertia.from_spatial_inertia(js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=6.0))
            >>> print(P.project_out(js.SpatialVelocity(v=[0.0, 0.0, 1.0])).to_matrix().diagonal())
            [6.5 5.  2.5 6.  6.  0. ]
        """
        return joint_projection(self, S_P_E, armature, precision=precision).inertia


class JointProjection(NamedTuple):
    """The result of `joint_projection`; `U` and `D` are lists where several motions were passed."""

    inertia: ArticulatedInertia
    U: SpatialForce | list[SpatialForce]
    D: jax.Array | list[jax.Array]


@promises(bound=PROJECTED)
def joint_projection(
    P_P_E: ArticulatedInertia, S_P_E: Motions, armature: ArrayLike = 0.0, *, precision: PrecisionName = None
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

    Error: for one S, let mag_D be the sum of the absolute values of the terms of D, and mag = |P_ij| + mag_U,i mag_U,j
        / D. The error of an entry of the inertia is at most 16 u mag mag_D / D in "fast" and "reproducible" while mag_D
        / D <= 1 / (32 u). In the other two it is at most u |r| + 64 u^2 mag mag_D / D while mag_D / D <= 1 / (64 u^2).
        The ratio mag_D / D is 1 for a joint along one axis of the frame. It is large for a body that is light about an
        oblique axis, such as a thin rod about its own.
    Source: Featherstone 2008, 7.2, equations 7.43 and 7.44; Jain 2010, 6.3.

    Example:
        >>> P = js.ArticulatedInertia.from_matrix(jnp.diag(jnp.array([1.0, 2.0, 3.0, 2.0, 2.0, 2.0])))
        >>> hinge = js.SpatialVelocity(w=[0.0, 0.0, 1.0])
        >>> print(js.inertia.joint_projection(P, hinge).inertia.to_matrix().diagonal())
        [1. 2. 0. 2. 2. 2.]
    """
    motions, armatures = _freedoms(P_P_E, S_P_E, armature)
    J, F, M, *rest = _projected(precision, P_P_E._grouped, *armatures, *(Motion(*s._vectors) for s in motions))
    U = [SpatialForce(tau, f) for tau, f in zip(rest[::3], rest[1::3], strict=True)]
    D = [d.reshape(d.shape[:-1]) for d in rest[2::3]]
    inertia = P_P_E._with_vectors((J, F, M))
    is_one = isinstance(S_P_E, SpatialVelocity)
    return JointProjection(inertia, U[0], D[0]) if is_one else JointProjection(inertia, U, D)


def _freedoms(
    P: ArticulatedInertia, S: Motions, armature: ArrayLike | Sequence[ArrayLike]
) -> tuple[list[SpatialVelocity], list[jax.Array]]:
    """(the motions of a joint, an armature (*batch, 1) for each)."""
    motions: list = list(S) if isinstance(S, (list, tuple)) else [S]
    for s in motions:
        if not isinstance(s, SpatialVelocity):
            refuse("joint_projection: S", "a SpatialVelocity or a list of them", s)
        require_compatible(ArticulatedInertia=P, S=s)
    given = armature if isinstance(armature, (list, tuple)) else [armature] * len(motions)
    if len(given) != len(motions):
        raise ValueError(f"joint_projection: armature: expected {len(motions)} numbers, got {len(given)}")
    armatures = [expanded(floats.as_float_array(x, "joint_projection: armature", P.dtype)) for x in given]
    for x in armatures:
        require_compatible(ArticulatedInertia=P, armature=x)
    return motions, armatures


# -- over numbers -----------------------------------------------------------------------------------------------------


def of_body(M: Inertia) -> Articulated:
    """J = I + m (|c|^2 1 - c c^T), F = m [c]x, M = m 1."""
    return Articulated(M.central + steiner(M.mass, M.com), skew(M.mass * M.com), Symmetric.diagonal(*[M.mass] * 3))


def none(zero: Number) -> Articulated:
    """No inertia at all, of a known zero."""
    return Articulated(Symmetric(*[zero] * 6), Matrix(*[Vector(*[zero] * 3)] * 3), Symmetric(*[zero] * 6))


def six_rows(P: Articulated) -> list[Numbers]:
    """The six rows of six numbers."""
    return [(*a, *b) for a, b in (*zip(P.J.matrix, P.F, strict=True), *zip(P.F.T, P.M.matrix, strict=True))]


def apply(P: Articulated, A: Motion) -> Wrench:
    """(J alpha + F a, F^T alpha + M a)."""
    six = [algebra.power((row[:3], row[3:]), A) for row in six_rows(P)]
    return Wrench(Vector(*six[:3]), Vector(*six[3:]))


def shifted(P: Articulated, p: Vector) -> Articulated:
    """F' = F - [p]x M and J' = J + (F [p]x)^T + F' [p]x: about the point at p."""
    moved = Matrix(*(cross(p, column) for column in P.M.matrix)).T
    F = Matrix.of_entries(list(map(operator.sub, P.F.entries, moved.entries)))
    before, after = ([cross(row, p) for row in m] for m in (P.F, F))
    J = Symmetric(*(x + (before[k][i] + after[i][k]) for x, (i, k) in zip(P.J, PLACES, strict=True)))
    return Articulated(J, F, P.M)


_congruence = noinline(congruence)


@noinline
def _sandwiched(R: Matrix, m: Matrix) -> Matrix:
    return R @ (m @ R.T)


def reexpressed(P: Articulated, R: Matrix) -> Articulated:
    """R J R^T, R F R^T, R M R^T."""
    return Articulated(_congruence(R, P.J), _sandwiched(R, P.F), _congruence(R, P.M))


@noinline
def U_and_D(P: Articulated, S: Motion, armature: Number) -> tuple[Wrench, Number]:
    """U = P S, D = S^T U + armature."""
    U = apply(P, S)
    return U, algebra.power(U, S) + armature


@noinline
def UDinv_of(U: Wrench, D: Number) -> Wrench:
    """U D^-1, 0 where D is not positive."""
    is_none = high(D) <= 0
    divisor = where(is_none, 1.0, D)
    return Wrench(*(Vector(*(where(is_none, 0.0, x / divisor) for x in part)) for part in U))


@noinline
def rank_one_downdate(P: Articulated, U: Wrench, UDinv: Wrench) -> Articulated:
    """P - U D^-1 U^T, with UDinv = U D^-1."""
    J, M = (
        Symmetric(*(x - u[i] * v[k] for x, (i, k) in zip(S, PLACES, strict=True)))
        for S, u, v in ((P.J, U.tau, UDinv.tau), (P.M, U.f, UDinv.f))
    )
    return Articulated(J, Matrix.of_entries([x - U.tau[i // 3] * UDinv.f[i % 3] for i, x in enumerate(P.F.entries)]), M)


# -- over numbers that are arrays -------------------------------------------------------------------------------------


_applied = formula(apply, of_sums=True, layout=(3, 4))
_shifted = formula(shifted, of_sums=True, layout=(0, 1, None))
_rotated = formula(reexpressed)
_coupling_and_translational = formula(lambda m, com: [skew(m[0] * com), Symmetric.diagonal(*[m[0]] * 3)], of_sums=True)


@formula
@noinline
def _acted(P: Articulated, X: Pose) -> Articulated:
    """From frame B at Bo to frame A at Ao: rotated, then shifted."""
    return _shifted_pairs(reexpressed(P, X.R), -X.p)


@formula
@noinline
def _acted_inverse(P: Articulated, X: Pose) -> Articulated:
    """From frame A at Ao to frame B at Bo: shifted, then rotated."""
    return reexpressed(_shifted_pairs(P, X.p), X.R.T)


_shifted_pairs = noinline_pairs(shifted)


@formula
def _projected(P: Articulated, *armatures_and_motions) -> list:
    """[J, F, M] of what is left, and for each motion the parts of U, and (D,)."""
    results, n = [], len(armatures_and_motions) // 2
    for (armature,), S in zip(armatures_and_motions[:n], armatures_and_motions[n:], strict=True):
        U, D = U_and_D(P, S, armature)
        P = rank_one_downdate(P, U, UDinv_of(U, D))
        results += [*U, (D,)]
    return [*P, *results]


@formula
def _is_valid(P: Articulated, tolerance: float) -> Mask:
    """Whether all pivots of P + tolerance 1 are positive, P in units in which J and M are of size 1."""
    J, F, M = P
    size_J, size_M = _size(J), _size(M)
    root = size_J.sqrt() * size_M.sqrt()
    matrix = six_rows(Articulated(J / size_J, Matrix(*(row / root for row in F)), M / size_M))
    lower = [[*row[:i], row[i] + tolerance] for i, row in enumerate(matrix)]
    positive = [~is_none & (high(divisor) > 0) for is_none, divisor, _ in elimination.pivots(lower)]
    return functools.reduce(operator.and_, positive)


def _size(S: Symmetric) -> Number:
    size = left_sum([abs(x) for x in S])
    return where(high(size) == 0, 1.0, size)

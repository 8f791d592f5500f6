"""Articulated-body inertia: what a body feels like when others hang on it by joints."""

import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.arithmetic.double_word import DoubleWord, from_double_word, to_double_word
from jaxspatial.arithmetic.quantity import Quantity
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.inertia import articulated, parameters
from jaxspatial.inertia.inertia import SpatialInertia
from jaxspatial.rotation.matrices import as_matrices, expanded, is_identity
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.force import SpatialForce
from jaxspatial.spatial.operations import acting, acting_inverse, rotate, rotating, shift
from jaxspatial.spatial.transform import require_transform
from jaxspatial.spatial.vector import require_no_w, skipping_zero
from jaxspatial.spatial.velocity import SpatialVelocity

_FIELDS = ("rotational", "coupling", "translational")
# Where among the 21 entries those of a 6 x 6 matrix are, and these in it: rotational and translational in the lower
# triangle, the coupling, transposed, in the lower left block.
_ROTATIONAL, _TRANSLATIONAL = (np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]]) + first for first in (0, 15))
_COUPLING = np.arange(6, 15).reshape(3, 3)
_TO_MATRIX = np.block([[_ROTATIONAL, _COUPLING], [_COUPLING.T, _TRANSLATIONAL]]).ravel().astype(np.int32)
_OF_MATRIX = np.array([0, 6, 7, 12, 13, 14, 18, 24, 30, 19, 25, 31, 20, 26, 32, 21, 27, 28, 33, 34, 35], np.int32)


@tree
class ArticulatedInertia(Quantity):
    """P_BPp_E: the force on body B, with what hangs on it, per spatial acceleration: the part that is linear in it.

        P = [[J, F], [F^T, M]]        tau = J alpha + F a        f = F^T alpha + M a

    rotational: (*batch, 6) J as [xx, xy, yy, xz, yz, zz], kg m2; given so or as (*batch, 3, 3), its lower triangle read
    coupling: (*batch, 9) F, row by row, kg m; given so or as (*batch, 3, 3)
    translational: (*batch, 6) M as J, kg: unlike a mass it may differ with the direction

    About point P, expressed in frame E. Symmetric by construction. The sum of two has a meaning for bodies that are
    welded together, about the same point, in the same frame. Numbers are *unchecked*, see `is_physically_valid`.
    Raises TypeError for dtypes that differ, ValueError for shapes.
    [Featherstone 2008, Rigid Body Dynamics Algorithms, 7.1; Jain 2010, 6.1; Drake, ArticulatedBodyInertia]
    """

    rotational: jax.Array
    coupling: jax.Array
    translational: jax.Array

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    def __post_init__(self):
        """Checks what a caller passes. JAX rebuilds inertias without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(part) for part in self._parts):
            return
        sizes = dict(zip(_FIELDS, (6, 9, 6), strict=True))
        parts = {name: _entries(getattr(self, name), f"ArticulatedInertia: {name}", n) for name, n in sizes.items()}
        parts = check.alike(**parts)
        batch = check.common_batch_shape(**{name: x.shape[:-1] for name, x in parts.items()})
        for name, part in zip(parts, check.broadcast_batch(batch, *parts.values()), strict=True):
            object.__setattr__(self, name, part)

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def zero(cls, batch_shape=(), dtype=None):
        """Nothing, known while tracing: what is added to it leaves no operation behind."""
        dtype = check.as_dtype(dtype)
        return cls(*(np.zeros((*batch_shape, n), dtype) for n in (6, 9, 6)))

    @classmethod
    def from_spatial_inertia(cls, M_BP_E, *, precision=None):
        """Of a single rigid body: J = central + m (c.c 1 - c c^T), F = m [c]x, M = m 1.

        Error per entry, mag the sum of the absolute values of its terms: at most 5 u mag in "fast" and "reproducible",
        u |r| + 16 u^2 mag in "compensated", 1 ulp in "faithful".
        """
        if not isinstance(M_BP_E, SpatialInertia):
            raise TypeError(f"from_spatial_inertia: expected a SpatialInertia, got {type(M_BP_E).__name__}")
        m, com, central = expanded(M_BP_E.mass), M_BP_E.com, M_BP_E.central
        return _like((parameters.about_origin(precision, m, com, central), *articulated.with_mass(precision, m, com)))

    @classmethod
    def from_matrix(cls, m):
        """From symmetric matrices (*batch, 6, 6), rotational on top, of which the lower triangle is read."""
        entries = as_matrices(m, "ArticulatedInertia.from_matrix: m", 6)[..., _OF_MATRIX]
        return cls(entries[..., :6], entries[..., 6:15], entries[..., 15:])

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def _parts(self):
        return self.rotational, self.coupling, self.translational

    @property
    def _vectors(self):
        return self._parts

    def _with_vectors(self, vectors):
        return _like(vectors)

    def to_matrix(self):
        """(*batch, 6, 6), symmetric, rotational on top."""
        parts = to_double_word(self._parts) if any(isinstance(x, DoubleWord) for x in self._parts) else self._parts
        joined = jax.tree.map(lambda *words: jnp.concatenate(words, axis=-1), *parts)
        return joined[..., _TO_MATRIX].reshape((*self.batch_shape, 6, 6))

    @property
    def batch_shape(self):
        return jnp.shape(self.rotational)[:-1]

    @property
    def dtype(self):
        return np.dtype(self.rotational.dtype)

    def is_physically_valid(self, tolerance=None):
        """(*batch,) True where no eigenvalue is below -tolerance times the size of the matrix; NaN is never valid.

        tolerance: a Python number, by default 64 eps of the dtype. The size of J, F and M is measured in units in which
        J and M are of size 1, so that neither metres nor kilograms matter. By Cholesky's decomposition: works under
        jit.
        """
        P = check.narrowed(self)
        tolerance = 64 * float(jnp.finfo(P.dtype).eps) if tolerance is None else float(tolerance)
        return articulated.is_valid(None, *from_double_word(P._parts), tolerance=tolerance)

    # -- operations ---------------------------------------------------------------------------------------------------

    def __add__(self, other):
        """Entry by entry, for bodies welded together, about the same point in the same frame: error <= u |x + y|."""
        return self._combined(operator.add, other)

    def __sub__(self, other):
        """Entry by entry: the inertia without a body that was welded to it."""
        return self._combined(operator.sub, other)

    def __radd__(self, other):
        """0 + P is P, for Python's `sum`; SpatialInertia + P."""
        return self if isinstance(other, int) and other == 0 else self.__add__(other)

    def _combined(self, operation, other):
        if isinstance(other, SpatialInertia):
            other = ArticulatedInertia.from_spatial_inertia(other)
        if not isinstance(other, ArticulatedInertia):
            return NotImplemented
        left, right = check.alike(left=self, right=other).values()
        check.common_batch_shape(left=left.batch_shape, right=right.batch_shape)
        pairs = zip(left._parts, right._parts, strict=True)
        return _like(_combined_part(operation, x, y) for x, y in pairs)

    def __matmul__(self, A_P_E):
        """P @ A: see `times`."""
        return self.times(A_P_E) if isinstance(A_P_E, SpatialAcceleration) else NotImplemented

    def times(self, A_P_E, *, precision=None):
        """The SpatialForce P A about the same point: tau = J alpha + F a, f = F^T alpha + M a.

        A_P_E: SpatialAcceleration. Featherstone's algorithm takes spatial accelerations: its bias forces say what is
        missing to classical ones. Error per component, mag the sum of the absolute values of its six products: at most
        4 u mag in "fast" and "reproducible", u |r| + 8 u^2 mag in "compensated", 1 ulp in "faithful". 66 flops.
        """
        if not isinstance(A_P_E, SpatialAcceleration):
            raise TypeError(f"ArticulatedInertia.times: expected a SpatialAcceleration, got {type(A_P_E).__name__}")
        return _times(self, A_P_E, precision)

    def __rmatmul__(self, R_AE):
        """R @ P: see `jaxspatial.rotate`."""
        return rotate(R_AE, self)

    def shift(self, p_PQ_E, *, precision=None):
        """See `jaxspatial.shift`: moved to the point Q of the same body, positive semidefinite as before.

            F_Q = F_P - [p]x M        J_Q = J_P - [p]x F_P^T + F_Q [p]x        M_Q = M_P

        p_PQ_E: (*batch, 3), metres. Error per entry, mag the sum of the absolute values of its terms, multiplied out:
        at most 8 u mag in "fast" and "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp in "faithful"; M_Q
        exact.
        [Drake, ArticulatedBodyInertia::Shift; Jain 2010, 6.3] 102 flops.
        """
        p = check.as_vectors(p_PQ_E, "shift: p_PQ_E", self.dtype)
        check.require_same_dtype(ArticulatedInertia=self, p_PQ_E=p)
        check.common_batch_shape(ArticulatedInertia=self.batch_shape, p_PQ_E=p.shape[:-1])
        return _like(articulated.shifted_arrays(precision, *self._parts, p))

    def rotate(self, R_AE, *, precision=None):
        """Re-expressed, about the same point: R J R^T, R F R^T, R M R^T.

        Error per entry, mag the sum of the absolute values of its nine terms: at most 6 u mag in "fast" and
        "reproducible", u |r| + 64 u^2 mag in the other two.
        """
        return rotate(R_AE, self, precision=precision)

    def project_out(self, S_P_E, armature=0.0, *, precision=None):
        """What is left of the inertia for a body that holds this one by a joint: `joint_projection(...).inertia`."""
        return joint_projection(self, S_P_E, armature, precision=precision).inertia


class JointProjection(NamedTuple):
    """What `joint_projection` found; `U` and `D` are lists where several motions were given."""

    inertia: ArticulatedInertia
    U: SpatialForce | list[SpatialForce]
    D: jax.Array | list[jax.Array]


def joint_projection(P_P_E, S_P_E, armature=0.0, *, precision=None):
    """The articulated inertia seen through a joint that lets it move freely along S.

        U = P S        D = S^T U + armature        inertia = P - U D^-1 U^T

    P_P_E: ArticulatedInertia.
    S_P_E: SpatialVelocity, the motion of a unit of the joint's velocity, about the same point in the same frame; for a
        joint of k freedoms a list of k, removed one after the other: U and D of the i-th are those of the inertia left
        by the ones before, as an articulated-body algorithm needs them that treats the joint as k joints between
        massless bodies. The inertia left is P - P S (S^T P S + diag(armature))^-1 S^T P, S the 6 x k matrix.
    armature: inertia of the joint itself (rotors ...), a number or (*batch,), of a list one for all or a list of k.

    Returns JointProjection(inertia, U, D), with U SpatialForce. The inertia is symmetric, and without an armature maps
    S to 0 but for errors. Where D is 0 or less, by rounding or because nothing hangs on the joint, there is nothing to
    remove: the inertia stays as it is.

    Error per entry of the inertia, for one S, with mag_D the sum of the absolute values of the terms of D and
    mag = |P_ij| + mag_U,i mag_U,j / D: at most 16 u mag mag_D / D in "fast" and "reproducible", u |r| + 64 u^2 mag
    mag_D / D in the other two, while mag_D / D <= 1 / (32 u), or 1 / (64 u^2). mag_D / D is 1 for a joint along one
    axis of the frame; it is large where a body is light about an oblique axis: a thin rod about its own. Raises
    TypeError for other kinds or dtypes that differ, ValueError for shapes.
    [Featherstone 2008, 7.2, equations 7.43 and 7.44; Jain 2010, 6.3] 140 flops per freedom.
    """
    S, arms = _joint(P_P_E, S_P_E, armature)
    words = [part for s in S for part in (s.w, s.v)]
    j, f, m, *found = articulated.projected(precision, *P_P_E._parts, *arms, *words, n=len(S))
    U = [SpatialForce(tau, force) for tau, force in zip(found[::3], found[1::3], strict=True)]
    D = [d.reshape(d.shape[:-1]) for d in found[2::3]]
    return JointProjection(_like((j, f, m)), *((U[0], D[0]) if isinstance(S_P_E, SpatialVelocity) else (U, D)))


def _joint(P, S, armature):
    """(the SpatialVelocities of the joint, an armature (*batch, 1) for each), checked."""
    several = isinstance(S, (list, tuple))
    S = list(S) if several else [S]
    for s in S:
        if not isinstance(s, SpatialVelocity):
            raise TypeError(
                f"joint_projection: S: expected a SpatialVelocity or a list of them, got {type(s).__name__}"
            )
        check.require_same_dtype(ArticulatedInertia=P, S=s)
        check.common_batch_shape(ArticulatedInertia=P.batch_shape, S=s.batch_shape)
    arms = armature if isinstance(armature, (list, tuple)) else [armature] * len(S)
    if len(arms) != len(S):
        raise ValueError(f"joint_projection: armature: expected {len(S)} numbers, got {len(arms)}")
    return S, [_arm(P, x) for x in arms]


def _arm(P, x):
    x = check.as_float_array(x, "joint_projection: armature", P.dtype)
    check.require_same_dtype(ArticulatedInertia=P, armature=x)
    check.common_batch_shape(ArticulatedInertia=P.batch_shape, armature=x.shape)
    return expanded(x)


# -- the type, to JAX -------------------------------------------------------------------------------------------------


def _like(parts):
    """From parts that are right as they are."""
    return rebuilt(ArticulatedInertia, _FIELDS, parts)


def _entries(x, name, n):
    """Of an array (*batch, n) or matrices (*batch, 3, 3)."""
    x = check.as_float_array(x, name, held=True)
    if x.shape[-1:] == (n,):
        return x
    if x.shape[-2:] != (3, 3):
        raise ValueError(f"{name}: expected shape (*batch, 3, 3) or (*batch, {n}), got {x.shape}")
    return symmetric.from_matrix(x) if n == 6 else x.reshape((*x.shape[:-2], 9))


def _combined_part(operation, x, y):
    batch = np.broadcast_shapes(x.shape[:-1], y.shape[:-1])
    return skipping_zero(operation, *check.broadcast_batch(batch, x, y))


# -- moved ------------------------------------------------------------------------------------------------------------


@shift.register
def _shift_articulated(P_P_E: ArticulatedInertia, p_PQ_E, w=None, *, precision=None):
    require_no_w(P_P_E, w)
    return P_P_E.shift(p_PQ_E, precision=precision)


@rotating.register
def _rotate_articulated(P_P_E: ArticulatedInertia, R_AE, precision):
    check.require_same_dtype(Rotation=R_AE, ArticulatedInertia=P_P_E)
    check.common_batch_shape(Rotation=R_AE.batch_shape, ArticulatedInertia=P_P_E.batch_shape)
    return P_P_E if is_identity(R_AE) else _like(articulated.rotated(precision, *P_P_E._parts, R_AE.entries))


@acting.register
def _act_articulated(P_Bo_B: ArticulatedInertia, X_AB, w, precision):
    require_no_w(P_Bo_B, w, "act")
    return _acted(articulated.moved, P_Bo_B, X_AB, precision)


@acting_inverse.register
def _act_inverse_articulated(P_Ao_A: ArticulatedInertia, X_AB, w, precision):
    require_no_w(P_Ao_A, w, "act_inverse")
    return _acted(articulated.moved_back, P_Ao_A, X_AB, precision)


def _acted(formula, P, X_AB, precision):
    """Rotated and shifted in one formula. Errors: at most 16 u mag, u |r| + 128 u^2 mag in "compensated" and
    "faithful"."""
    require_transform(X_AB)
    check.require_same_dtype(RigidTransform=X_AB, ArticulatedInertia=P)
    check.common_batch_shape(RigidTransform=X_AB.batch_shape, ArticulatedInertia=P.batch_shape)
    return _like(formula(precision, *P._parts, X_AB.rotation.entries, X_AB.translation))


def _times(P, A, precision):
    check.require_same_dtype(ArticulatedInertia=P, SpatialAcceleration=A)
    check.common_batch_shape(ArticulatedInertia=P.batch_shape, SpatialAcceleration=A.batch_shape)
    return SpatialForce(*articulated.product_of_arrays(precision, *P._parts, A.alpha, A.a))

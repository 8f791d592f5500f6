"""Articulated-body inertia: the inertia of a body with others that hang on it by joints."""

import operator
from collections.abc import Callable
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import from_double_word, to_double_word
from jaxspatial.arithmetic.quantity import Additive, require_alike
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.arithmetic.types import Matrix, PrecisionName, Scalar, Vector3
from jaxspatial.inertia import articulated, parameters
from jaxspatial.inertia.arguments import as_entries
from jaxspatial.inertia.inertia import SpatialInertia
from jaxspatial.inertia.joint_projection import Motions, joint_projection
from jaxspatial.rotation.matrices import as_matrices, expanded
from jaxspatial.rotation.rotation import Rotation
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.force import SpatialForce
from jaxspatial.spatial.operations import rotate, shift
from jaxspatial.spatial.vector import combined

# Where among the 21 entries those of a 6 x 6 matrix are, and these in it: rotational and translational in the lower
# triangle, the coupling, transposed, in the lower left block.
_ROTATIONAL, _TRANSLATIONAL = (np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]]) + first for first in (0, 15))
_COUPLING = np.arange(6, 15).reshape(3, 3)
_TO_MATRIX = np.block([[_ROTATIONAL, _COUPLING], [_COUPLING.T, _TRANSLATIONAL]]).ravel().astype(np.int32)
_OF_MATRIX = np.array([0, 6, 7, 12, 13, 14, 18, 24, 30, 19, 25, 31, 20, 26, 32, 21, 27, 28, 33, 34, 35], np.int32)


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
        """From symmetric matrices, of which the lower triangle is read.

        Args:
            m: (*batch, 6, 6), rotational on top.

        Returns:
            The articulated inertia, over the batch of m.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.

        Error: none, it is exact.
        """
        entries = as_matrices(m, "ArticulatedInertia.from_matrix: m", 6)[..., _OF_MATRIX]
        return cls(entries[..., :6], entries[..., 6:15], entries[..., 15:])

    # -- parts --------------------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The matrix [[J, F], [F^T, M]].

        Returns:
            (*batch, 6, 6), symmetric, rotational on top.

        Error: none, it is exact.
        """
        parts = to_double_word(self.vectors) if any(isinstance(x, DoubleWord) for x in self.vectors) else self.vectors
        joined = jax.tree.map(lambda *words: jnp.concatenate(words, axis=-1), *parts)
        return joined[..., _TO_MATRIX].reshape((*self.batch_shape, 6, 6))

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

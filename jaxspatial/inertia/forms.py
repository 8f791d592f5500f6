"""The forms that the ten numbers of an inertia are given in: matrices and vectors of parameters, to and from."""

from typing import Self

import jax

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.arithmetic.types import Matrix, Matrix3, PrecisionName, Scalar, Six, Vector, Vector3
from jaxspatial.inertia import parameters
from jaxspatial.inertia.parts import Parts, checked
from jaxspatial.rotation.matrices import as_matrices, expanded


class Forms(Parts):
    """`SpatialInertia` from its other forms, and to them."""

    @classmethod
    def from_origin(
        cls, mass: Scalar, com: Vector3, about_origin: Six | Matrix3, *, precision: PrecisionName = None
    ) -> Self:
        """From the inertia about P, in place of that about the centre of mass.

            central = I_P - m (|c|^2 1 - c c^T)

        This cancels: of central as many digits are lost as I_P is larger. What P was far away for the caller has lost
        them already; give the central inertia where it is known.

        Args:
            mass: (*batch,) m, kg.
            com: (*batch, 3) c = p_PBcm_E, m.
            about_origin: (*batch, 3, 3) or (*batch, 6) I_P, kg m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the common batch.

        Raises:
            TypeError: dtypes differ or are not floating point.
            ValueError: shapes do not fit.

        Error: per entry, mag = |I_P| + m |c|^2: at most 5 u mag in "fast" and "reproducible", u |r| + 16 u^2 mag in
            "compensated", 1 ulp in "faithful".
        """
        m, c, six = checked("SpatialInertia.from_origin", mass, com, about_origin, "about_origin")
        return cls(m, c, parameters.about_center(precision, expanded(m), c, six))

    @classmethod
    def from_matrix(cls, m: Matrix, *, precision: PrecisionName = None) -> Self:
        """From matrices as those of `to_matrix`; of what stands there more than once, one is read.

        Args:
            m: (*batch, 6, 6), rotational on top.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the batch of m.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.

        Error: as of `from_dynamic_parameters`, and so is what cancels.
        """
        entries = as_matrices(m, "SpatialInertia.from_matrix: m", 6)
        return cls(entries[..., 21], *parameters.from_six_by_six(precision, entries))

    @classmethod
    def from_dynamic_parameters(cls, pi10: Vector, *, precision: PrecisionName = None) -> Self:
        """From m, m c, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about P: Pinocchio's order.

        c = m c / m, 0 for 0 / 0, and central = I_P - m (|c|^2 1 - c c^T), which cancels as in `from_origin`.

        Args:
            pi10: (*batch, 10), kg, kg m, kg m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the batch of pi10.

        Raises:
            TypeError: pi10 is not of floating point.
            ValueError: the shape does not fit.

        Error: of com u |c|, of central at most 6 u mag, mag = |I_P| + m |c|^2; in "compensated" and "faithful" u |r| +
            64 u^2 mag.
        """
        ten = check.as_vectors(pi10, "SpatialInertia.from_dynamic_parameters: pi10", size=10)
        return cls(ten[..., 0], *parameters.from_dynamic_parameters(precision, ten))

    @classmethod
    def from_pseudo_inertia(cls, J: Matrix, *, precision: PrecisionName = None) -> Self:
        """From the pseudo-inertia matrix [[Sigma, m c], [m c^T, m]] about P, Sigma = integral of x x^T dm.

        Args:
            J: (*batch, 4, 4), of which the lower triangle, and m c from the last column, are read.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the batch of J.

        Raises:
            TypeError: J is not of floating point.
            ValueError: the shape does not fit.

        Error: as of `from_dynamic_parameters`, and so is what cancels, mag = |Sigma|.
        """
        entries = as_matrices(J, "SpatialInertia.from_pseudo_inertia: J", 4)
        return cls(entries[..., 15], *parameters.from_pseudo_inertia(precision, entries))

    @classmethod
    def from_log_cholesky(cls, theta10: Vector, *, precision: PrecisionName = None) -> Self:
        """From any ten real numbers alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3: a body that can exist.

            J = U U^T    U = e^alpha [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]]

        Pinocchio's order. mass = e^(2 alpha), com = t, and with L the upper left block of U over e^alpha the second
        moments about the centre of mass are m L L^T: the diagonal of central is a sum of squares.

        Args:
            theta10: (*batch, 10).
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the batch of theta10.

        Raises:
            TypeError: theta10 is not of floating point.
            ValueError: the shape does not fit.

        Error: of mass at most 8 u m, of central 24 u mag; in "compensated" and "faithful" u |r| + 64 u^2 mag.
        Source: Rucker and Wensing 2022, Smooth parameterization of rigid-body inertia, equations 11 and 12.
        """
        theta10 = check.as_vectors(theta10, "SpatialInertia.from_log_cholesky: theta10", size=10)
        return cls(*parameters.from_log_cholesky(precision, theta10))

    # -- to other forms -----------------------------------------------------------------------------------------------

    def central_matrix(self) -> jax.Array:
        """The rotational inertia about the centre of mass.

        Returns:
            (*batch, 3, 3), kg m2.

        Error: none, it is exact.
        """
        return symmetric.to_matrix(self.central)

    def inertia_about_origin(self, *, precision: PrecisionName = None) -> jax.Array:
        """The rotational inertia about P: central + m (|c|^2 1 - c c^T).

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3, 3), kg m2.

        Error: per entry at most 5 u mag in "fast" and "reproducible", u |r| + 16 u^2 mag in "compensated", 1 ulp in
            "faithful".
        Source: Huygens 1673, Steiner 1840.
        """
        return symmetric.to_matrix(parameters.about_origin(precision, *self.vectors))

    def to_matrix(self, *, precision: PrecisionName = None) -> jax.Array:
        """The spatial inertia matrix [[I_P, m [c x]], [-m [c x], m 1]].

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6, 6), rotational on top.

        Error: as of `inertia_about_origin`.
        """
        entries = parameters.six_by_six(precision, *self.vectors)
        return entries.reshape((*entries.shape[:-1], 6, 6))

    def to_dynamic_parameters(self, *, precision: PrecisionName = None) -> jax.Array:
        """The ten dynamic parameters: m, m c, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about P.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 10), kg, kg m, kg m2.

        Error: as of `inertia_about_origin`.
        """
        return parameters.dynamic_parameters(precision, *self.vectors)

    def to_pseudo_inertia(self, *, precision: PrecisionName = None) -> jax.Array:
        """The pseudo-inertia matrix: `from_pseudo_inertia` has its definition.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 4, 4).

        Error: as of `inertia_about_origin`, mag of Sigma = tr(I) / 2 1 - I.
        """
        return parameters.pseudo_inertia(precision, *self.vectors)

    def to_log_cholesky(self, *, precision: PrecisionName = None) -> jax.Array:
        """The inverse of `from_log_cholesky`, by a Cholesky factorisation from the last column on.

        Flat, thin and massless bodies have none: where Sigma is singular, d is -inf and others may be NaN, and NaN
        where no body can have this inertia.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 10) alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3.

        Error: of alpha 4 u |alpha|; all others grow with c = tr(Sigma) / (smallest eigenvalue of Sigma), Sigma the
            second moments about the centre of mass: of the d at most 32 u (c + |d|), of the s 32 u c sqrt(tr(Sigma) /
            m), so that the way there and back costs 64 u c relative to central; in "compensated" and "faithful" u |r|
            and u^2 of that. Derivatives grow alike.
        """
        return parameters.log_cholesky(precision, *self.vectors)

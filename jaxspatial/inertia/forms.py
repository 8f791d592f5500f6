"""The forms that the ten numbers of an inertia are given in: matrices and vectors of parameters, to and from."""

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.inertia import parameters
from jaxspatial.inertia.arguments import checked
from jaxspatial.rotation.matrices import as_matrices, expanded


class Forms:
    """`SpatialInertia` from its other forms, and to them."""

    @classmethod
    def from_origin(cls, mass, com, about_origin, *, precision=None):
        """From the inertia about P, (*batch, 3, 3) or (*batch, 6), in place of that about the centre of mass.

            central = I_P - m (|c|^2 1 - c c^T)

        This cancels: of central as many digits are lost as I_P is larger. What P was far away for the caller has lost
        them already; give the central inertia where it is known. Error per entry, mag = |I_P| + m |c|^2: at most 5 u
        mag in "fast" and "reproducible", u |r| + 16 u^2 mag in "compensated", 1 ulp in "faithful".
        """
        mass, com, about_origin = checked("SpatialInertia.from_origin", mass, com, about_origin, "about_origin")
        return cls(mass, com, parameters.about_center(precision, expanded(mass), com, about_origin))

    @classmethod
    def from_matrix(cls, m, *, precision=None):
        """From matrices (*batch, 6, 6) as of `to_matrix`; of what stands there more than once, one is read.

        Errors and what cancels as for `from_dynamic_parameters`.
        """
        entries = as_matrices(m, "SpatialInertia.from_matrix: m", 6)
        return cls(entries[..., 21], *parameters.from_six_by_six(precision, entries))

    @classmethod
    def from_dynamic_parameters(cls, pi10, *, precision=None):
        """From (*batch, 10) m, m c, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about P: Pinocchio's order.

        c = m c / m, 0 for 0 / 0, and central = I_P - m (|c|^2 1 - c c^T), which cancels as in `from_origin`. Error of
        com u |c|, of central at most 6 u mag, mag = |I_P| + m |c|^2; in "compensated" and "faithful" u |r| + 64 u^2
        mag.
        """
        pi10 = check.as_vectors(pi10, "SpatialInertia.from_dynamic_parameters: pi10", size=10)
        return cls(pi10[..., 0], *parameters.from_dynamic_parameters(precision, pi10))

    @classmethod
    def from_pseudo_inertia(cls, J, *, precision=None):
        """From (*batch, 4, 4) [[Sigma, m c], [m c^T, m]] about P, Sigma = integral of x x^T dm; the lower triangle, and
        m c from the last column, are read. Errors and what cancels as for `from_dynamic_parameters`, mag = |Sigma|."""
        entries = as_matrices(J, "SpatialInertia.from_pseudo_inertia: J", 4)
        return cls(entries[..., 15], *parameters.from_pseudo_inertia(precision, entries))

    @classmethod
    def from_log_cholesky(cls, theta10, *, precision=None):
        """From (*batch, 10) alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3, any real numbers: a body that can exist.

            J = U U^T    U = e^alpha [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]]

        Pinocchio's order. mass = e^(2 alpha), com = t, and with L the upper left block of U over e^alpha the second
        moments about the centre of mass are m L L^T: the diagonal of central is a sum of squares. Error of mass at most
        8 u m, of central 24 u mag; in "compensated" and "faithful" u |r| + 64 u^2 mag.
        [Rucker and Wensing 2022, Smooth parameterization of rigid-body inertia, equations 11 and 12]
        """
        theta10 = check.as_vectors(theta10, "SpatialInertia.from_log_cholesky: theta10", size=10)
        return cls(*parameters.from_log_cholesky(precision, theta10))

    def central_matrix(self):
        """(*batch, 3, 3) the rotational inertia about the centre of mass, kg m2."""
        return symmetric.to_matrix(self.central)

    def inertia_about_origin(self, *, precision=None):
        """(*batch, 3, 3) the rotational inertia about P, central + m (|c|^2 1 - c c^T), kg m2.

        Error per entry at most 5 u mag in "fast" and "reproducible", u |r| + 16 u^2 mag in "compensated", 1 ulp in
        "faithful". [Huygens 1673, Steiner 1840]
        """
        return symmetric.to_matrix(parameters.about_origin(precision, *self._vectors))

    def to_matrix(self, *, precision=None):
        """(*batch, 6, 6) [[I_P, m [c x]], [-m [c x], m 1]], rotational on top. Errors as of `inertia_about_origin`."""
        entries = parameters.six_by_six(precision, *self._vectors)
        return entries.reshape((*entries.shape[:-1], 6, 6))

    def to_dynamic_parameters(self, *, precision=None):
        """(*batch, 10): see `from_dynamic_parameters`. Errors as of `inertia_about_origin`."""
        return parameters.dynamic_parameters(precision, *self._vectors)

    def to_pseudo_inertia(self, *, precision=None):
        """(*batch, 4, 4): see `from_pseudo_inertia`. Errors as of `inertia_about_origin`, mag of Sigma = tr(I) / 2 1 -
        I."""
        return parameters.pseudo_inertia(precision, *self._vectors)

    def to_log_cholesky(self, *, precision=None):
        """(*batch, 10): see `from_log_cholesky`. The inverse of that, by a Cholesky factorisation from the last column
        on.

        Error of alpha 4 u |alpha|; all others grow with c = tr(Sigma) / (smallest eigenvalue of Sigma), Sigma the
        second moments about the centre of mass: of the d at most 32 u (c + |d|), of the s 32 u c sqrt(tr(Sigma) / m),
        so that the way there and back costs 64 u c relative to central; in "compensated" and "faithful" u |r| and u^2
        of that. Flat, thin and massless bodies have none: where Sigma is singular, d is -inf and others may be NaN, and
        NaN where no body can have this inertia. Derivatives grow alike.
        """
        return parameters.log_cholesky(precision, *self._vectors)

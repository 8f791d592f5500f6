"""Spatial inertia: mass, centre of mass and inertia about the centre of mass, and what is done with them.

The mathematics is in the modules beside this one, as functions of arrays.
"""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, symmetric, vectors
from jaxspatial.arithmetic.double_word import DoubleWord
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import halved
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.arithmetic.quantity import Quantity, moved_to_last
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.inertia import addition, parameters, validity
from jaxspatial.inertia.shapes import Shapes
from jaxspatial.rotation.matrices import as_matrices, expanded, is_identity
from jaxspatial.rotation.rotation import Rotation
from jaxspatial.spatial import algebra
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.force import SpatialForce, SpatialMomentum
from jaxspatial.spatial.operations import acting, acting_inverse, rotate, rotating, shift
from jaxspatial.spatial.transform import require_transform
from jaxspatial.spatial.vector import require_no_w
from jaxspatial.spatial.velocity import SpatialVelocity


@tree
class SpatialInertia(Shapes, Quantity):
    """M_BP_E: the inertia of body B about its point P, expressed in frame E.

    mass: (*batch,) kg
    com: (*batch, 3) p_PBcm_E, from P to the centre of mass, m
    central: (*batch, 6) rotational inertia about the centre of mass, kg m2: Ixx, Ixy, Iyy, Ixz, Iyz, Izz, products with
        the sign that they have in the matrix. Given like that or as (*batch, 3, 3), of which the lower triangle is
        read.

    Moving P leaves mass and central as they are, so that no distance takes digits from them. Python floats take the
    dtype of the arrays beside them, batch shapes broadcast. Bodies without mass are inertias too. Nothing is checked of
    the values: see `is_physically_valid`.

    What the error bounds below mean: u is the unit roundoff, r the exact component, mag the sum of the absolute values
    of its terms, multiplied out; for bounds, edges and derivatives of sums of products see
    `jaxspatial.spatial.operations`. What takes quotients and roots as well is evaluated in float64 for "compensated"
    and "faithful", or for float64 in double words, and rounded once; float16 and bfloat16 otherwise in float32.
    """

    mass: jax.Array
    com: jax.Array
    central: jax.Array

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    def __post_init__(self):
        """Checks what a caller passes. JAX rebuilds inertias without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(leaf) for leaf in self._parts):
            return
        for name, array in zip(_NAMES, _checked("SpatialInertia", *self._parts), strict=True):
            object.__setattr__(self, name, _owned(array))

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def zero(cls, batch_shape=(), dtype=None):
        """The inertia of nothing, known while tracing."""
        return cls._filled(0, batch_shape, dtype)

    @classmethod
    def nan(cls, batch_shape=(), dtype=None):
        """Ten NaNs, for what is yet to be set."""
        return cls._filled(np.nan, batch_shape, dtype)

    @classmethod
    def _filled(cls, value, batch_shape, dtype):
        dtype = check.as_dtype(dtype)
        batch_shape = (batch_shape,) if isinstance(batch_shape, int) else tuple(batch_shape)
        return cls(*(np.full((*batch_shape, *item), value, dtype) for item in ((), (3,), (6,))))

    @classmethod
    def from_origin(cls, mass, com, about_origin, *, precision=None):
        """From the inertia about P, (*batch, 3, 3) or (*batch, 6), in place of that about the centre of mass.

            central = I_P - m (|c|^2 1 - c c^T)

        This cancels: of central as many digits are lost as I_P is larger. What P was far away for the caller has lost
        them already; give the central inertia where it is known. Error per entry, mag = |I_P| + m |c|^2: at most 5 u
        mag in "fast" and "reproducible", u |r| + 16 u^2 mag in "compensated", 1 ulp in "faithful".
        """
        mass, com, about_origin = _checked("SpatialInertia.from_origin", mass, com, about_origin, "about_origin")
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

    # -- parts and other forms ----------------------------------------------------------------------------------------

    @property
    def _parts(self):
        return self.mass, self.com, self.central

    @property
    def _vectors(self):
        """The parts as (*batch, n)."""
        return expanded(self.mass), self.com, self.central

    def _with_vectors(self, vectors):
        mass, com, central = vectors
        return _rebuild((mass[..., 0], com, central))

    @property
    def batch_shape(self):
        return jnp.shape(self.mass)

    @property
    def dtype(self):
        return np.dtype(self.mass.dtype)

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

    # -- operations ---------------------------------------------------------------------------------------------------

    def shift(self, p_PQ_E, *, precision=None):
        """See `jaxspatial.shift`."""
        return shift(self, p_PQ_E, precision=precision)

    def __rmatmul__(self, R_AE):
        """R @ M: see `jaxspatial.rotate`."""
        return rotate(R_AE, self)

    def __matmul__(self, motion):
        """M @ A is a SpatialForce, M @ V a SpatialMomentum: see `apply`."""
        return self.apply(motion)

    def apply(self, motion_P_E, *, precision=None):
        """M A, the force of inertia of the body, or M V, its momentum, about P: its 6 x 6 matrix times the motion of P.

            acceleration   f = m (a + alpha x c)    tau = I alpha + c x f    SpatialForce
            velocity       l = m (v + w x c)        h = I w + c x l          SpatialMomentum

        motion_P_E: SpatialAcceleration or SpatialVelocity of P, in the same frame. c is com, I is central. Without the
        terms in w x w that the force on a moving body has as well: those are `newton_euler`'s.

        Error per component: of f and l at most 5 u mag, of tau and h 8 u mag in "fast" and "reproducible", u |r| + 64
        u^2 mag in "compensated", 1 ulp in "faithful". Raises TypeError for other kinds or dtypes that differ.
        [Jain 2010, 2.1; Drake, SpatialInertia::operator*] 45 flops.
        """
        kind = _RESULTS.get(type(motion_P_E))
        if kind is None:
            came = type(motion_P_E).__name__
            raise TypeError(f"SpatialInertia @: expected a SpatialAcceleration or SpatialVelocity, got {came}")
        _require_alike("SpatialInertia @", SpatialInertia=self, motion=motion_P_E)
        return kind(*_applied(precision, *self._vectors, *motion_P_E._parts))

    def kinetic_energy(self, V_MBp_E, *, precision=None):
        """(*batch,) m |v + w x c|^2 / 2 + w . I w / 2, joules, of the body whose point P moves with V in the frame M.

        Not changed by another point or frame. Error at most 12 u mag in "fast" and "reproducible", u |r| + 128 u^2 mag
        in "compensated", 1 ulp in "faithful". Raises TypeError for anything but a SpatialVelocity. [Jain 2010, 2.1]
        """
        if not isinstance(V_MBp_E, SpatialVelocity):
            raise TypeError(f"kinetic_energy: expected a SpatialVelocity, got {type(V_MBp_E).__name__}")
        _require_alike("kinetic_energy", SpatialInertia=self, SpatialVelocity=V_MBp_E)
        energy = _energy_of_float16 if self.dtype == np.float16 else _energy
        return energy(precision, *self._vectors, *V_MBp_E._parts)

    # -- bodies put together ------------------------------------------------------------------------------------------

    def __add__(self, other):
        """Two bodies as one: see `combine`."""
        return self.combine(other) if isinstance(other, SpatialInertia) else NotImplemented

    def __radd__(self, other):
        """0 + M is M, for Python's `sum`; for many bodies `SpatialInertia.sum` is faster and better."""
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def __sub__(self, other):
        """What is left without a part: see `remove`."""
        return self.remove(other) if isinstance(other, SpatialInertia) else NotImplemented

    def combine(self, other, *, precision=None):
        """The inertia of two bodies as one, about the same point in the same frame.

            com = c1 + (m2 / m) d    central = I1 + I2 + (m1 m2 / m) (|d|^2 1 - d d^T)    d = c2 - c1

        The terms are positive semidefinite, so that nothing cancels and nothing turns indefinite but by rounding an
        entry: the validity slack falls by at most 16 u. Where the centres of mass coincide, com is exactly theirs. Two
        bodies without mass have the mean of their com. Error: of mass u m, of com at most 6 u (m1 |c1| + m2 |c2|) / m,
        of central 10 u mag; in "compensated" and "faithful" u |r| + 128 u^2 mag. Derivatives are exact to a few u.
        [Featherstone 2008, 2.13]
        """
        return self._with(addition.combined, "+", other, precision)

    def remove(self, other, *, precision=None):
        """The inertia of what is left of this body without a part of it, about the same point in the same frame.

        This cancels: of mass, com and central as many digits are lost as what is left is smaller. Where no mass is left
        of a body that had some, com and central are infinite or NaN; without mass from the start com stays. Errors as
        of `combine`, with mag of the differences, com's over the mass that is left.
        """
        return self._with(addition.removed, "-", other, precision)

    def _with(self, operation, sign, other, precision):
        if not isinstance(other, SpatialInertia):
            raise TypeError(f"{sign}: expected a SpatialInertia, got {type(other).__name__}")
        _require_alike(sign, left=self, right=other)
        return _rebuild(operation(precision, *self._vectors, *other._vectors))

    def sum(self, axis=0, *, precision=None):
        """The inertia of all bodies along an axis of the batch as one, about the same point in the same frame.

            com = sum m_i c_i / m    central = sum (I_i + m_i (|d_i|^2 1 - d_i d_i^T))    d_i = c_i - com

        axis: an integer. Sums by halving, always in the same order; what com is off counts in central by its square
        only. Without any mass com is the mean; of no bodies at all the result is zero. With L = ceil(log2 n), error of
        mass at most L u m, of com (L + 4) u sum m_i |c_i| / m, of central (L + 10) u mag, mag = sum (|I_i| + m_i
        |d_i|^2) with |d_i|^2 <= |c_i|^2 + |com|^2; in "compensated" and "faithful" u |r| + 64 (L + 4) u^2 mag. Nothing
        turns indefinite but by rounding, as for `combine`. Of double words com and central are good to 64 (L + 4) u^2
        mag.
        """
        place = check.batch_axis(axis, self.batch_shape, "SpatialInertia.sum")
        if not self.batch_shape[place]:
            return SpatialInertia.zero((*self.batch_shape[:place], *self.batch_shape[place + 1 :]), self.dtype)
        moved = moved_to_last(check.narrowed_each(self._vectors), place, self.batch_shape)
        return _rebuild(addition.total(resolve(precision), *moved))

    # -- what a body can be -------------------------------------------------------------------------------------------

    def validity_slack(self, *, precision=None):
        """(*batch,) how far this is from what no body can be: the smallest second moment about the centre of mass over
        the sum of the absolute values of all three.

        Second moments s_i = (l_j + l_k - l_i) / 2, l the principal moments: integrals of x_i^2 dm along the principal
        axes. 1/3 for a ball, 0 for a plate, a rod and a point, negative where the triangle inequality of the principal
        moments does not hold; -1 for a negative mass, NaN where a number is not finite. Error at most 32 u.
        [Wensing, Kim and Slotine 2018]
        """
        return validity.slack(resolve(precision), *check.narrowed_each(self._vectors))

    def is_physically_valid(self, tolerance=None, *, precision=None):
        """(*batch,) True where a body can be like that: all finite, mass >= 0, `validity_slack` >= -tolerance.

        tolerance: relative, as the slack is; 16 eps by default, for what rounding takes from a plate. Of the point
        about which the inertia is nothing depends on it.
        """
        tolerance = validity.default_tolerance(check.narrowed(self).dtype) if tolerance is None else tolerance
        return self.validity_slack(precision=precision) >= -tolerance

    def nearest_valid(self, tolerance=None, *, precision=None):
        """The nearest inertia that a body can have: no mass below 0, second moments about the centre of mass no less
        than 0, the nearest such matrix in the Frobenius norm.

        Mass, or central, that are valid with this tolerance (16 eps by default) stay bit for bit, and so do those that
        are not finite; com always. Error of central at most 32 u times its largest principal moment.
        """
        M = check.narrowed(self)
        tolerance = validity.default_tolerance(M.dtype) if tolerance is None else tolerance
        mass, central = validity.nearest(resolve(precision), *M._vectors, float(tolerance))
        return _rebuild((mass, M.com, central))

    # -- principal axes and equivalent shapes -------------------------------------------------------------------------

    def principal_moments(self, *, precision=None):
        """(*batch, 3) the principal moments about the centre of mass, ascending, kg m2; see
        `principal_moments_and_axes`."""
        return self.principal_moments_and_axes(precision=precision)[0]

    def principal_moments_and_axes(self, *, precision=None):
        """(moments (*batch, 3) ascending, Rotation R_EA with the principal axes as its columns, right-handed).

        Where central is diagonal, up to 2 eps of its trace, axes are exactly coordinate axes, the third one reversed if
        they were left-handed else; where the moments differ by no more than 4 eps of the trace, exactly the identity.
        Error of the moments at most 8 u times the largest, of the axes 32 u times the largest moment over the distance
        to the next; R is orthonormal to 16 u; in "compensated" and "faithful" 2 u.

        Derivatives of the moments are the rates of their matrix along the axes, those of axes divide by the distance of
        moments; of axes with equal moments, which have none, the part within their plane is 0. [Jacobi 1846]
        """
        moments, axes = symmetric.eigen(resolve(precision), check.narrowed(self.central))
        return moments, Rotation(axes)

    def equivalent_ellipsoid(self, *, precision=None):
        """(semi_axes (*batch, 3), R_EA): the solid ellipsoid about the centre of mass with this mass and inertia.

        Descending, along the columns of R_EA, those of `principal_moments_and_axes`: a_i^2 = 5 s_i / m, s_i the second
        moment as of `validity_slack`; 0 where that is not positive, with derivative 0. NaN or inf without mass. Error
        of a_i^2 at most 64 u times the largest: a rod may have 1e-8 (float32: 1e-3) of its length as its thickness.
        """
        return self._equivalent(Fraction(1, 5), precision)

    def equivalent_box(self, *, precision=None):
        """(edges (*batch, 3), R_EA): the solid box with this mass and inertia, edge_i^2 = 12 s_i / m; see
        `equivalent_ellipsoid`."""
        return self._equivalent(Fraction(1, 12), precision)

    def _equivalent(self, factor, precision):
        moments, R_EA = self.principal_moments_and_axes(precision=precision)
        return validity.equivalent_lengths(precision, expanded(self.mass), moments, factor), R_EA

    def minimum_length(self, *, precision=None):
        """(*batch,) sqrt(2 tr(central) / mass), metres: no body with this inertia is shorter than that in its longest
        direction. Error at most 8 u. [Drake, CalcMinimumPhysicalLength]"""
        return validity.minimum_length(precision, expanded(self.mass), self.central)

    def __repr__(self):
        parts = ", ".join(f"{n}={_shown(x, n != 'mass')}" for n, x in zip(_NAMES, self._parts, strict=True))
        return f"SpatialInertia({parts})"


_NAMES = ("mass", "com", "central")
_RESULTS = {SpatialAcceleration: SpatialForce, SpatialVelocity: SpatialMomentum}


def _rebuild(parts):
    return rebuilt(SpatialInertia, _NAMES, parts)


# -- what comes in ----------------------------------------------------------------------------------------------------


def _checked(operation, mass, com, six, name="central"):
    """The three as arrays of one dtype over their common batch, the last by six entries."""
    dtype = next((x.dtype for x in (mass, com, six) if _is_floating(x)), None)
    given = {
        f"{operation}: mass": check.as_float_array(mass, f"{operation}: mass", dtype, held=True),
        f"{operation}: com": check.as_vectors(com, f"{operation}: com", dtype, held=True),
        f"{operation}: {name}": _as_six(six, f"{operation}: {name}", dtype),
    }
    arrays = check.alike(**given)
    items = dict(zip(arrays, ((), (3,), (6,)), strict=True))
    shapes = {key: x.shape[: len(x.shape) - len(items[key])] for key, x in arrays.items()}
    batch = check.common_batch_shape(**shapes)
    return [x if shapes[key] == batch else _broadcast(x, (*batch, *items[key])) for key, x in arrays.items()]


def _is_floating(x):
    return hasattr(x, "dtype") and jnp.issubdtype(x.dtype, jnp.floating) and not isinstance(x, float)


def _as_six(x, name, dtype):
    array = check.as_float_array(x, name, dtype, held=True)
    if array.shape[-1:] == (6,):
        return array
    if array.shape[-2:] != (3, 3):
        raise ValueError(f"{name}: expected shape (*batch, 3, 3) or (*batch, 6), got {array.shape}")
    return symmetric.from_matrix(array)


def _broadcast(array, shape):
    if isinstance(array, DoubleWord):
        return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), array)
    if isinstance(array, check.StandIn):
        return array.over_batch(shape[:-1])
    return (np if isinstance(array, np.ndarray) else jnp).broadcast_to(array, shape)


def _owned(array):
    """A NumPy array as a read-only copy: the caller may write to his own."""
    if isinstance(array, np.ndarray):
        array = array.copy()
        array.setflags(write=False)
    return array


def _shown(part, ndim):
    """The numbers of one inertia, the shape of a batch or of something not computed yet."""
    is_array = isinstance(part, (np.ndarray, jax.Array)) and not isinstance(part, jax.core.Tracer)
    if is_array and part.ndim == ndim:
        return "[" + ", ".join(str(x) for x in np.asarray(part)) + "]" if ndim else str(part)
    is_abstract = hasattr(part, "shape") and not isinstance(part, DoubleWord)
    return f"{np.dtype(part.dtype).name}[{','.join(map(str, part.shape))}]" if is_abstract else repr(part)


def _require_alike(operation, **quantities):
    """Of one dtype, with batches that broadcast."""
    check.require_same_dtype(**quantities)
    check.common_batch_shape(**{name: x.batch_shape for name, x in quantities.items()})


# -- sums of products -------------------------------------------------------------------------------------------------


@shift.register
def _shift_inertia(M_P_E: SpatialInertia, p_PQ_E, w=None, *, precision=None):
    require_no_w(M_P_E, w)
    p = check.as_vectors(p_PQ_E, "shift: p_PQ_E", M_P_E.dtype)
    check.require_same_dtype(SpatialInertia=M_P_E, p_PQ_E=p)
    batch = check.common_batch_shape(SpatialInertia=M_P_E.batch_shape, p_PQ_E=p.shape[:-1])
    M_P_E = check.narrowed(M_P_E)
    com = _shifted(precision, M_P_E.com, p)
    mass, central = check.broadcast_batch(batch, expanded(M_P_E.mass), M_P_E.central)
    return _rebuild((mass[..., 0] if M_P_E.batch_shape != batch else M_P_E.mass, com, central))


@formula(of_sums=True)
def _shifted(com, p):
    return vectors.minus(com, p)


@rotating.register
def _rotate_inertia(M_P_E: SpatialInertia, R_AE, precision):
    _require_alike("rotate", Rotation=R_AE, SpatialInertia=M_P_E)
    return M_P_E if is_identity(R_AE) else _moved(_rotated, precision, M_P_E, R_AE.entries)


@acting.register
def _act_inertia(M_Bo_B: SpatialInertia, X_AB, w, precision):
    require_no_w(M_Bo_B, w, "act")
    return _moved(_acted, precision, M_Bo_B, *_pose(X_AB, M_Bo_B))


@acting_inverse.register
def _act_inverse_inertia(M_Ao_A: SpatialInertia, X_AB, w, precision):
    require_no_w(M_Ao_A, w, "act_inverse")
    return _moved(_acted_back, precision, M_Ao_A, *_pose(X_AB, M_Ao_A))


def _pose(X_AB, M):
    require_transform(X_AB)
    _require_alike("act", RigidTransform=X_AB, SpatialInertia=M)
    return X_AB.rotation.entries, X_AB.translation


def _moved(formula, precision, M, *pose):
    """The formula over com and central; mass stays."""
    M = check.narrowed(M)
    com, central = formula(precision, *pose, M.com, M.central)
    batch = np.broadcast_shapes(M.batch_shape, *(x.shape[:-1] for x in pose))
    (mass,) = check.broadcast_batch(batch, expanded(M.mass))
    return _rebuild((M.mass if M.batch_shape == batch else mass[..., 0], com, central))


@formula(of_sums=True)
def _rotated(entries, com, central):
    rows = vectors.rows(entries)
    turned = vectors.matrix_times(rows, com), algebra.congruent(central, rows)
    return [vectors.laid_out_as(*each) for each in zip((com, central), turned, strict=True)]


@formula(of_sums=True)
def _acted(entries, p, com, central):
    rows = vectors.rows(entries)
    turned = algebra.congruent(central, rows)
    return [vectors.plus(p, vectors.matrix_times(rows, com)), vectors.laid_out_as(central, turned)]


@formula(of_sums=True)
def _acted_back(entries, p, com, central):
    back = vectors.transpose(vectors.rows(entries))
    turned = vectors.matrix_times(back, vectors.minus(com, p)), algebra.congruent(central, back)
    return [vectors.laid_out_as(*each) for each in zip((com, central), turned, strict=True)]


@formula(of_sums=True)
def _applied(mass, com, central, alpha, a):
    wrench = algebra.inertia_times(*mass, com, central, alpha, a)
    return [vectors.laid_out_as(*each) for each in zip((alpha, a), wrench, strict=True)]


@formula(of_sums=True)
def _energy(mass, com, central, w, v):
    return halved(algebra.twice_kinetic_energy(*mass, com, central, w, v))


@formula(of_sums=True)
def _energy_of_float16(mass, com, central, w, v):
    """As `_energy`, to the bit; but the range of float16 ends at 65504: halved are vectors, before they are squared."""
    return algebra.twice_kinetic_energy(*mass, com, central, w, v, half=halved)

"""Spatial inertia: mass, centre of mass and inertia about the centre of mass, and what is done with them.

The formulas over numbers stand beside it, by subject; those of motion are in `spatial.algebra`.
"""

import functools
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Self, overload

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.inertia import composition, parameters, shapes
from jaxspatial.numerics import check, eigen, floats
from jaxspatial.numerics.check import require_kind, shown
from jaxspatial.numerics.floats import as_matrices, expanded, owned
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Inertia, Motion, Pose, Symmetric, Vector, congruence
from jaxspatial.numerics.numbers import Number, halved
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.precision import resolve
from jaxspatial.numerics.promise import Normwise, OfSum, Promise, promises
from jaxspatial.numerics.quantity import Additive, moved_to_last, rebuilt, require_compatible, tree
from jaxspatial.numerics.types import ArrayLike, DTypeLike, PrecisionName
from jaxspatial.rotation.rotation import Rotation, is_identity
from jaxspatial.spatial import (
    RigidTransform,
    SpatialAcceleration,
    SpatialForce,
    SpatialMomentum,
    SpatialVelocity,
    algebra,
)
from jaxspatial.spatial.operations import rotate, shift
from jaxspatial.spatial.vectors import require_no_w

# f = m (a + alpha x c), and tau = I alpha + c x f; twice the kinetic energy.
FORCE, TORQUE, ENERGY = Promise(5, 16), Promise(8, 64), Promise(12, 128)
# The moments about another point than the centre of mass.
ABOUT = Promise(5, 16)
# Central inertias: of two bodies, of moments about another point, of a matrix root; com and mass have less.
COMBINED, FROM_MOMENTS, FROM_ROOT = Promise(10, 128), Promise(6, 64, mag="|I_P| + m |c|^2"), Promise(24, 64)
COMBINED_COM, ROOT_MASS = Normwise(6, "(m1 |c1| + m2 |c2|) / m", u2=128), Normwise(8, "m")
# Of n bodies, L = ceil(log2 n). The mass that com is divided by has the error of a sum, too.
# Central: of d 1 u, of m (|d|^2 1 - d d^T) 5 u, and one sum more; an error of com counts by its square.
SUM_MASS, SUM_COM, SUM_CENTRAL = OfSum(of="m"), OfSum(2, 2, of="sum m_i |c_i| / m", u2=16), OfSum(6, u2=16)
# Of the largest moment.
MOMENTS, AXES = Normwise(8, "times the largest"), Normwise(32, "times the largest moment", rounded=32)
ORTHONORMAL = Normwise(16, "of the identity", rounded=2)
ELLIPSOID = Normwise(64, "times the largest", rounded=64)
NEAREST_VALID = Normwise(32, "times its largest principal moment", rounded=32)
LENGTH, SLACK = Normwise(8, ""), Normwise(32, "", rounded=32)
# c the condition of the second moments.
ALPHA, LOG_CHOLESKY, THERE_AND_BACK = Normwise(4, "|alpha|"), Normwise(32, "(c + |d|)"), Normwise(64, "c", rounded=64)
LOG_CHOLESKY_OFF_DIAGONAL = Normwise(32, "c sqrt(tr(Sigma) / m)")

# Of eps: what rounding an inertia tensor, and finding its moments, can take from a body as flat or thin as can be.
_TOLERANCE = 16
_Z = (0.0, 0.0, 1.0)


@tree
class SpatialInertia(Additive):
    """M_BP_E: the inertia of body B about its point P, expressed in frame E.

    mass: (*batch,) kg
    com: (*batch, 3) p_PBcm_E, from P to the centre of mass, m
    central: (*batch, 6) rotational inertia about the centre of mass, kg m2: Ixx, Ixy, Iyy, Ixz, Iyz, Izz, products with
        the sign that they have in the matrix. Also accepted as (*batch, 3, 3), of which the lower triangle is read.

    Moving P leaves mass and central as they are, so that no distance takes digits from them. Python floats take the
    dtype of the arrays beside them, batch shapes broadcast. Bodies without mass are inertias too. Values are not
    checked: see `is_physically_valid`. Of finite numbers so large that m |c|^2 overflows in the dtype, mass, com and
    central are kept, and moments about P are infinite; what another constructor would take from infinite moments is not
    finite, which `is_physically_valid` finds. `Mechanism.build` and the readers of files refuse such bodies.

    Bodies of uniform density, such as `solid_box`, take either their mass or their density. P is their centre of mass,
    unless said otherwise. Their mass and central inertia are NumPy arrays where all arguments are NumPy arrays or
    Python numbers. These constructors alone check values, those of NumPy and Python numbers: none may be negative, no
    length 0 unless said otherwise, no inner radius above the outer one, and mass and moments may not overflow. Values
    of JAX arrays are *unchecked*: what overflows is infinite or NaN.

    In the error bounds below u is the unit roundoff, r the exact component, and mag the sum of the absolute values of
    its terms, multiplied out; for bounds, edges and derivatives of sums of products see
    `jaxspatial.spatial.operations`. Formulas with quotients and roots are evaluated in float64 for "compensated" and
    "faithful", or for float64 in double words, and rounded once; float16 and bfloat16 otherwise in float32.

    Example:
        >>> M = js.SpatialInertia(mass=2.0, com=[0.0, 0.0, 0.5], central=[0.1, 0.0, 0.1, 0.0, 0.0, 0.2])
        >>> V = js.SpatialVelocity(w=[0.0, 2.0, 0.0], v=[0.0, 0.0, 0.0])
        >>> M @ V
        SpatialMomentum(h=[0.0, 1.2, 0.0], l=[2.0, 0.0, 0.0])
        >>> print(js.shift(M, [0.0, 0.0, 0.5]).com, M.kinetic_energy(V))
        [0. 0. 0.] 1.2
    """

    mass: jax.Array
    com: jax.Array
    central: jax.Array

    _items = (), (3,), (6,)

    if TYPE_CHECKING:

        def __init__(self, mass: ArrayLike, com: ArrayLike, central: ArrayLike): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds inertias without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(leaf) for leaf in self._parts):
            return
        for name, array in zip(self.__match_args__, _checked("SpatialInertia", *self._parts), strict=True):
            object.__setattr__(self, name, owned(array))

    # -- bodies of uniform density ------------------------------------------------------------------------------------

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_box(
        cls,
        size: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A box with edges along x, y and z.

        Args:
            size: (*batch, 3) lengths of the edges, m.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=12.0).central)
            [13.  0. 10.  0.  0.  5.]
        """
        return cls(*shapes.body(shapes.solid_box, mass, density, precision, {"size": size}, n=3))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_cube(
        cls,
        size: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cube.

        Args:
            size: (*batch,) length of an edge, m.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_cube(1.0, density=6.0).central)
            [1. 0. 1. 0. 0. 1.]
        """
        return cls(*shapes.body(shapes.solid_cube, mass, density, precision, {"size": size}))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_sphere(
        cls,
        radius: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A ball.

        Args:
            radius: (*batch,) m.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_sphere(1.0, mass=5.0).central)
            [2. 0. 2. 0. 0. 2.]
        """
        return cls(*shapes.body(shapes.solid_sphere, mass, density, precision, {"radius": radius}))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def hollow_sphere(
        cls,
        radius: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A spherical shell.

        Args:
            radius: (*batch,) m.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.hollow_sphere(1.0, mass=3.0).central)
            [2. 0. 2. 0. 0. 2.]
        """
        return cls(*shapes.body(shapes.hollow_sphere, mass, density, precision, {"radius": radius}))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_ellipsoid(
        cls,
        semi_axes: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """An ellipsoid with its axes along x, y and z.

        Args:
            semi_axes: (*batch, 3) m.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_ellipsoid([1.0, 2.0, 3.0], mass=5.0).central)
            [13.  0. 10.  0.  0.  5.]
        """
        return cls(*shapes.body(shapes.solid_ellipsoid, mass, density, precision, {"semi_axes": semi_axes}, n=3))

    @classmethod
    def point_mass(cls, com: ArrayLike, *, mass: ArrayLike) -> Self:
        """All mass in one point.

        Args:
            com: (*batch, 3) p_PPcm, m.
            mass: (*batch,) kg.

        Returns:
            The inertia about P, over the common batch.

        Raises:
            TypeError: dtypes differ or are not floating point.
            ValueError: a known mass is negative, or shapes do not fit.

        Error: none, it is exact.

        Example:
            >>> js.SpatialInertia.point_mass([0.0, 0.0, 0.5], mass=2.0)
            SpatialInertia(mass=2.0, com=[0.0, 0.0, 0.5], central=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        """
        dtype = shapes.dtype_of(com, mass)
        c = floats.as_vectors(com, "point_mass: com", dtype, keep_dtype=True)
        m = shapes.number(mass, "point_mass: mass", dtype, may_be_zero=True)
        check.require_same_dtype(com=c, mass=m)
        batch = floats.common_batch_shape(com=c.shape[:-1], mass=m.shape)
        m, c = floats.broadcast_batch(batch, expanded(m), c)
        return cls(m.reshape(batch), c, floats.numpy_for(batch).zeros((*batch, 6), c.dtype))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_cylinder(
        cls,
        radius: ArrayLike,
        length: ArrayLike,
        axis: ArrayLike = _Z,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cylinder.

        Args:
            radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_cylinder(1.0, 3.0, mass=4.0).central_matrix().diagonal())
            [4. 4. 2.]
        """
        return cls(
            *shapes.body(shapes.solid_cylinder, mass, density, precision, {"radius": radius, "length": length}, axis)
        )

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_cylinder_about_end(
        cls,
        radius: ArrayLike,
        length: ArrayLike,
        axis: ArrayLike = _Z,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cylinder about the centre of one of its ends: from there axis points to the centre of mass.

        Args:
            radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_cylinder_about_end(1.0, 3.0, mass=4.0).com)
            [0.  0.  1.5]
        """
        lengths = {"radius": radius, "length": length}
        return cls(*shapes.body(shapes.solid_cylinder_about_end, mass, density, precision, lengths, axis))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def hollow_cylinder(
        cls,
        inner_radius: ArrayLike,
        outer_radius: ArrayLike,
        length: ArrayLike,
        axis: ArrayLike = _Z,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A tube: what is between two radii; with equal ones a shell (by mass).

        Args:
            inner_radius: (*batch,) m, from 0 to the outer one.
            outer_radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.hollow_cylinder(1.0, 1.0, 3.0, mass=4.0).central_matrix().diagonal())
            [5. 5. 4.]
        """
        lengths = {"inner_radius": inner_radius, "outer_radius": outer_radius, "length": length}
        return cls(*shapes.body(shapes.hollow_cylinder, mass, density, precision, lengths, axis, ("inner_radius",)))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_capsule(
        cls,
        radius: ArrayLike,
        length: ArrayLike,
        axis: ArrayLike = _Z,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cylinder between two half balls. With length 0 it is a ball, with radius 0 a thin rod.

        Args:
            radius: (*batch,) m.
            length: (*batch,) of the cylinder, m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_capsule(1.0, 3.0, density=1.0).mass)
            13.613568
        """
        lengths = {"radius": radius, "length": length}
        return cls(*shapes.body(shapes.solid_capsule, mass, density, precision, lengths, axis, may_be_zero=lengths))

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def solid_cone(
        cls,
        radius: ArrayLike,
        height: ArrayLike,
        axis: ArrayLike = _Z,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cone: the centre of its base is at -height/4, the apex at 3/4 height along axis.

        Args:
            radius: (*batch,) of the base, m.
            height: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: mag the sum of the absolute values of an entry's terms: of mass at most 12 u mag, of central 20 u mag in
            "fast" and "reproducible", u |r| + 64 u^2 mag in the other two, while nothing over- or underflows.
            Derivatives are exact to a few u.
        Source: Drake, UnitInertia; Mirtich 1996.

        Example:
            >>> print(js.SpatialInertia.solid_cone(1.0, 3.0, mass=10.0).central_matrix().diagonal())
            [4.875 4.875 3.   ]
        """
        return cls(
            *shapes.body(shapes.solid_cone, mass, density, precision, {"radius": radius, "height": height}, axis)
        )

    @classmethod
    @promises(mass=shapes.MASS, central=shapes.CENTRAL)
    def thin_rod(
        cls, length: ArrayLike, axis: ArrayLike = _Z, *, mass: ArrayLike, precision: PrecisionName = None
    ) -> Self:
        """A straight line of mass; without a moment about its axis.

        Args:
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: none of mass, of central at most 20 u mag in "fast" and "reproducible", u |r| + 64 u^2 mag in the other
            two, while nothing over- or underflows.

        Example:
            >>> print(js.SpatialInertia.thin_rod(3.0, mass=4.0).central_matrix().diagonal())
            [3. 3. 0.]
        """
        return cls(*shapes.body(shapes.thin_rod, mass, None, precision, {"length": length}, axis))

    @classmethod
    @promises(central=shapes.CENTRAL, determinant=shapes.DETERMINANT, com=shapes.TETRAHEDRON_COM)
    def solid_tetrahedron(
        cls,
        vertices: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A tetrahedron, about P. By mass it may be flat, or a line.

        Computed from its edges, whose squares are summed: nothing cancels, however far from P it is.

        Args:
            vertices: (*batch, 4, 3) in any order, p_PV, m.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about P, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, or dtypes differ.
            ValueError: a known number is no length or mass, or shapes do not fit, see `SpatialInertia`.

        Error: by mass, of central at most 20 u mag in "fast" and "reproducible", u |r| + 64 u^2 mag in the other two.
            By density mass and central have that of a determinant besides, whose size is the sum of the absolute values
            of its six products over its value: at most 12 u size, in the other two 1.01 u |r| + 64 u^2 size. Error of
            com at most 4 u |vertices|.

        Example:
            >>> M = js.SpatialInertia.solid_tetrahedron([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], density=6.0)
            >>> print(M.mass, M.com)
            1.0 [0.25 0.25 0.25]
        """
        kind, amount = shapes.single_amount("solid_tetrahedron", mass, density)
        dtype = shapes.dtype_of(vertices, amount)
        v = floats.as_vectors(vertices, "solid_tetrahedron: vertices", dtype, many=["4"], keep_dtype=True)
        if v.shape[-2] != 4:
            raise ValueError(f"solid_tetrahedron: vertices: expected shape (*batch, 4, 3), got {v.shape}")
        amount = shapes.number(amount, f"solid_tetrahedron: {kind}", v.dtype, may_be_zero=True)
        arrays = {kind: expanded(amount), "vertices": v.reshape((*v.shape[:-2], 12))}
        return cls(*shapes.computed(shapes.solid_tetrahedron, precision, arrays, by=kind))

    @classmethod
    @promises(volume=shapes.MESH_VOLUME, com=shapes.MESH_COM, central=shapes.MESH_CENTRAL)
    def triangle_mesh(
        cls,
        vertices: ArrayLike,
        triangles: ArrayLike,
        *,
        mass: ArrayLike | None = None,
        density: ArrayLike | None = None,
        precision: PrecisionName = None,
    ) -> Self:
        """The volume that a closed surface of triangles encloses, about P.

        A volume that is not positive (an open or inverted surface, or none) gives NaN for mass, by density, centre of
        mass and central inertia. A sum of signed tetrahedra from the middle of the box around the mesh, by halving: a
        mesh far from P loses nothing but the digits that its vertices do not have. Differentiable in the vertices.

        Args:
            vertices: (*batch, n, 3) positions p_PV, m.
            triangles: (m, 3) integers, m >= 1, the vertices of each, counterclockwise seen from outside. Every edge
                belongs to two triangles, which run along it in opposite directions: a requirement that is *unchecked*
                where triangles are data. Known vertices at the same place are taken for one.
            mass: (*batch,) kg; either this or the density.
            density: (*batch,) kg/m3, of a shell kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about P, over the common batch.

        Raises:
            TypeError: not exactly one of mass and density is passed, triangles are no integers, or dtypes differ.
            ValueError: a known mass is negative, shapes do not fit, or known triangles leave an edge open.

        Error: let L be ceil(log2 m), V the volume, S the sum over triangles of |a| |b - a| |c - a|, where a, b and c
            are the vertices seen from that middle, and r the largest distance of a vertex from it. In "fast" and
            "reproducible" the error is at most (2 + L) u S of the volume, u |com| + (4 + L) u r S / V of com, and (15 +
            L) u mass r^2 S / V of an entry of the central inertia. In the other two it is 8 times these with u^2 in
            place of u, plus 1.01 u of the result. For a body as thick as wide S / V is about 10.
        Source: Mirtich 1996, Fast and accurate computation of polyhedral mass properties; Eberly 2002.

        Example:
            >>> vertices = jnp.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
            >>> triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
            >>> M = js.SpatialInertia.triangle_mesh(vertices, triangles, density=6.0)
            >>> print(M.mass, M.com)
            1.0 [0.25 0.25 0.25]
        """
        kind, amount = shapes.single_amount("triangle_mesh", mass, density)
        dtype = shapes.dtype_of(vertices, amount)
        vertices = floats.as_vectors(vertices, "triangle_mesh: vertices", dtype, many=["n"])
        corners = shapes.corners_of(vertices, triangles)
        amount = shapes.number(amount, f"triangle_mesh: {kind}", corners.dtype, may_be_zero=True)
        check.require_same_dtype(vertices=corners, **{kind: amount})
        floats.common_batch_shape(vertices=corners.shape[:-2], **{kind: amount.shape})
        arrays = amount.reshape((*amount.shape, 1, 1)), corners, shapes.middle_of(corners)
        results = shapes.evaluated(shapes.triangle_mesh, precision, *arrays, by=kind, size=corners.shape[-2])
        shapes.require_finite("triangle_mesh", arrays, *results, nan=True)
        m, com, central = (x[..., 0, :] for x in results)
        return cls(m.reshape(m.shape[:-1]), com, central)

    # -- from other parameters ----------------------------------------------------------------------------------------

    @classmethod
    @promises(bound=ABOUT)
    def from_origin(
        cls, mass: ArrayLike, com: ArrayLike, about_origin: ArrayLike, *, precision: PrecisionName = None
    ) -> Self:
        """From the inertia about P, in place of that about the centre of mass.

            central = I_P - m (|c|^2 1 - c c^T)

        This cancels: central loses as many digits as I_P is larger. Where P is far away, they are lost in I_P already:
        pass the central inertia where it is known.

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
            "compensated", 1 ulp of r in "faithful".

        Example:
            >>> M = js.SpatialInertia.from_origin(2.0, [0.0, 0.0, 0.5], [0.6, 0.0, 0.6, 0.0, 0.0, 0.2])
            >>> print(M.central)
            [0.1 0.  0.1 0.  0.  0.2]
        """
        m, c, six = _checked("SpatialInertia.from_origin", mass, com, about_origin, "about_origin")
        body = Inertia._make([expanded(m), c, six])
        return cls(m, c, parameters.about_center(precision, body))

    @classmethod
    def from_matrix(cls, m: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """From matrices as those of `to_matrix`; of entries that stand there more than once, one is read.

        Args:
            m: (*batch, 6, 6), rotational on top.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the batch of m.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.

        Error: as of `from_dynamic_parameters`, with the same cancellation.

        Example:
            >>> M = js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=6.0)
            >>> print(js.SpatialInertia.from_matrix(M.to_matrix()))
            SpatialInertia(mass=6.0, com=[0.0, 0.0, 0.0], central=[6.5, 0.0, 5.0, 0.0, 0.0, 2.5])
        """
        entries = as_matrices(m, "SpatialInertia.from_matrix: m", 6)
        ten = entries[..., parameters.OF_SIX_BY_SIX]
        return cls(ten[..., 0], *parameters.from_dynamic_parameters(precision, ten))

    @classmethod
    @promises(bound=FROM_MOMENTS)
    def from_dynamic_parameters(cls, pi10: ArrayLike, *, precision: PrecisionName = None) -> Self:
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

        Example:
            >>> pi10 = jnp.array([2.0, 0.0, 0.0, 1.0, 0.6, 0.0, 0.6, 0.0, 0.0, 0.2])
            >>> M = js.SpatialInertia.from_dynamic_parameters(pi10)
            >>> print(M.mass, M.com, M.central)
            2.0 [0.  0.  0.5] [0.1 0.  0.1 0.  0.  0.2]
        """
        ten = floats.as_vectors(pi10, "SpatialInertia.from_dynamic_parameters: pi10", size=10)
        return cls(ten[..., 0], *parameters.from_dynamic_parameters(precision, ten))

    @classmethod
    def from_pseudo_inertia(cls, J: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """From the pseudo-inertia matrix [[Sigma, m c], [m c^T, m]] about P, Sigma = integral of x x^T dm.

        Args:
            J: (*batch, 4, 4), of which the lower triangle, and m c from the last column, are read.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the batch of J.

        Raises:
            TypeError: J is not of floating point.
            ValueError: the shape does not fit.

        Error: as of `from_dynamic_parameters`, with the same cancellation, mag = |Sigma|.

        Example:
            >>> M = js.SpatialInertia.from_pseudo_inertia(jnp.diag(jnp.array([1.0, 1.0, 1.0, 2.0])))
            >>> print(M.mass, M.central_matrix().diagonal())
            2.0 [2. 2. 2.]
        """
        entries = as_matrices(J, "SpatialInertia.from_pseudo_inertia: J", 4)
        ten = entries[..., parameters.OF_PSEUDO]
        return cls(ten[..., 0], *parameters.from_second_moments(precision, ten))

    @classmethod
    @promises(bound=FROM_ROOT, mass=ROOT_MASS)
    def from_log_cholesky(cls, theta10: ArrayLike, *, precision: PrecisionName = None) -> Self:
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

        Example:
            >>> M = js.SpatialInertia.from_log_cholesky(jnp.zeros(10))
            >>> print(M.mass, M.com, M.central_matrix().diagonal())
            1.0 [0. 0. 0.] [2. 2. 2.]
        """
        theta10 = floats.as_vectors(theta10, "SpatialInertia.from_log_cholesky: theta10", size=10)
        return cls(*parameters.from_log_cholesky(precision, theta10))

    # -- to other parameters ------------------------------------------------------------------------------------------

    def central_matrix(self) -> jax.Array:
        """The rotational inertia about the centre of mass.

        Returns:
            (*batch, 3, 3), kg m2.

        Error: none, it is exact.

        Example:
            >>> print(js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=12.0).central_matrix())
            [[13.  0.  0.]
             [ 0. 10.  0.]
             [ 0.  0.  5.]]
        """
        return eigen.matrix_of_six(self.central)

    @promises(bound=ABOUT)
    def inertia_about_origin(self, *, precision: PrecisionName = None) -> jax.Array:
        """The rotational inertia about P: central + m (|c|^2 1 - c c^T).

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3, 3), kg m2.

        Error: per entry at most 5 u mag in "fast" and "reproducible", u |r| + 16 u^2 mag in "compensated", 1 ulp of r
            in "faithful".
        Source: Huygens 1673, Steiner 1840.

        Example:
            >>> M = js.SpatialInertia(2.0, [0.0, 0.0, 0.5], [0.1, 0.0, 0.1, 0.0, 0.0, 0.2])
            >>> print(M.inertia_about_origin())
            [[0.6 0.  0. ]
             [0.  0.6 0. ]
             [0.  0.  0.2]]
        """
        return eigen.matrix_of_six(parameters.about_origin(precision, self._grouped))

    def to_matrix(self, *, precision: PrecisionName = None) -> jax.Array:
        """The spatial inertia matrix [[I_P, m [c x]], [-m [c x], m 1]].

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6, 6), rotational on top.

        Error: as of `inertia_about_origin`.

        Example:
            >>> M = js.SpatialInertia(2.0, [0.0, 0.0, 0.5], [0.1, 0.0, 0.1, 0.0, 0.0, 0.2])
            >>> print(M.to_matrix()[0])
            [ 0.6  0.   0.   0.  -1.   0. ]
        """
        entries = parameters.six_by_six(precision, self._grouped)
        return entries.reshape((*entries.shape[:-1], 6, 6))

    def to_dynamic_parameters(self, *, precision: PrecisionName = None) -> jax.Array:
        """The ten dynamic parameters: m, m c, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about P.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 10), kg, kg m, kg m2.

        Error: as of `inertia_about_origin`.

        Example:
            >>> M = js.SpatialInertia(2.0, [0.0, 0.0, 0.5], [0.1, 0.0, 0.1, 0.0, 0.0, 0.2])
            >>> print(M.to_dynamic_parameters())
            [2.  0.  0.  1.  0.6 0.  0.6 0.  0.  0.2]
        """
        return parameters.dynamic_parameters(precision, self._grouped)

    def to_pseudo_inertia(self, *, precision: PrecisionName = None) -> jax.Array:
        """The pseudo-inertia matrix, defined in `from_pseudo_inertia`.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 4, 4).

        Error: as of `inertia_about_origin`, mag of Sigma = tr(I) / 2 1 - I.

        Example:
            >>> M = js.SpatialInertia(2.0, [0.0, 0.0, 0.5], [2.0, 0.0, 2.0, 0.0, 0.0, 2.0])
            >>> print(M.to_pseudo_inertia()[2:, 2:])
            [[1.5 1. ]
             [1.  2. ]]
        """
        return parameters.pseudo_inertia(precision, self._grouped)

    @promises(alpha=ALPHA, d=LOG_CHOLESKY, s=LOG_CHOLESKY_OFF_DIAGONAL, back=THERE_AND_BACK)
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
            m); in "compensated" and "faithful" 1.01 u |r| and u^2 of that. The way there and back costs 64 u c relative
            to central, in every precision. Derivatives grow in the same way.

        Example:
            >>> M = js.SpatialInertia(1.0, [0.0, 0.0, 0.5], [2.0, 0.0, 2.0, 0.0, 0.0, 2.0])
            >>> print(M.to_log_cholesky()[-3:])
            [0.  0.  0.5]
        """
        return parameters.log_cholesky(precision, self._grouped)

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def _parts(self) -> tuple:
        return self.mass, self.com, self.central

    @property
    def _vectors(self) -> tuple:
        return expanded(self.mass), self.com, self.central

    @property
    def _grouped(self) -> Inertia:
        """Its arrays as formulas take them."""
        return Inertia(*self._vectors)

    def _with_vectors(self, vectors: Iterable) -> Self:
        mass, com, central = vectors
        return self._like(mass[..., 0], com, central)

    @classmethod
    def _like(cls, mass, com, central) -> Self:
        """Of parts that need no check."""
        return rebuilt(cls, cls.__match_args__, (mass, com, central))

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return jnp.shape(self.mass)

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(self.mass.dtype)

    def __repr__(self) -> str:
        named = zip(self.__match_args__, self._parts, (0, 3, 6), strict=True)
        return f"SpatialInertia({', '.join(f'{name}={shown(x, n)}' for name, x, n in named)})"

    # -- about another point, in another frame ------------------------------------------------------------------------

    def shift(self, p_PQ_E: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """About the point Q of the same body, see `jaxspatial.shift`.

        Example:
            >>> M = js.SpatialInertia.solid_sphere(0.5, mass=2.0)
            >>> print(M.shift([1.0, 0.0, 0.0]).com)
            [-1.  0.  0.]
        """
        return shift(self, p_PQ_E, precision=precision)

    def __rmatmul__(self, R_AE: Rotation) -> Self:
        """R @ M: see `jaxspatial.rotate`."""
        return rotate(R_AE, self)

    def _shift(self, p_PQ_E: ArrayLike, w: ArrayLike | None, precision: PrecisionName) -> Self:
        require_no_w(self, w)
        p = floats.as_vectors(p_PQ_E, "shift: p_PQ_E", self.dtype)
        batch = require_compatible(SpatialInertia=self, p_PQ_E=p)
        M = floats.narrowed(self)
        (central,) = floats.broadcast_batch(batch, M.central)
        return M._moved(batch, _shifted_com(precision, M.com, p), central)

    def _rotate(self, R_AE: Rotation, precision: PrecisionName) -> Self:
        require_compatible(Rotation=R_AE, SpatialInertia=self)
        return self if is_identity(R_AE) else self._placed(_rotated, precision, R_AE.entries)

    def _act(self, X_AB: RigidTransform, w: ArrayLike | None, precision: PrecisionName) -> Self:
        require_no_w(self, w, "act")
        return self._placed(_acted, precision, *X_AB._vectors)

    def _act_inverse(self, X_AB: RigidTransform, w: ArrayLike | None, precision: PrecisionName) -> Self:
        require_no_w(self, w, "act_inverse")
        return self._placed(_acted_inverse, precision, *X_AB._vectors)

    def _placed(self, function: Callable[..., list[jax.Array]], precision: PrecisionName, *pose: jax.Array) -> Self:
        """The same mass, with com and central from a formula of (*pose, com, central)."""
        M = floats.narrowed(self)
        batch = floats.broadcast_shapes(M.batch_shape, *(x.shape[:-1] for x in pose))
        return M._moved(batch, *function(precision, *pose, M.com, M.central))

    def _moved(self, batch_shape: tuple[int, ...], com: jax.Array, central: jax.Array) -> Self:
        """The same mass, over a batch, with another com and central."""
        (mass,) = floats.broadcast_batch(batch_shape, expanded(self.mass))
        return self._like(self.mass if self.batch_shape == batch_shape else mass[..., 0], com, central)

    # -- motion -------------------------------------------------------------------------------------------------------

    @overload
    def __matmul__(self, motion: SpatialAcceleration) -> SpatialForce: ...

    @overload
    def __matmul__(self, motion: SpatialVelocity) -> SpatialMomentum: ...

    def __matmul__(self, motion: SpatialAcceleration | SpatialVelocity) -> SpatialForce | SpatialMomentum:
        """M @ A is a SpatialForce, M @ V a SpatialMomentum: see `apply`."""
        return self.apply(motion)

    @promises(force=FORCE, torque=TORQUE)
    def apply(self, motion_P_E: SpatialAcceleration | SpatialVelocity, *, precision: PrecisionName = None) -> Any:
        """The 6 x 6 matrix times a motion: M A, the force of inertia of the body, or M V, its momentum, about P.

            acceleration   f = m (a + alpha x c)    tau = I alpha + c x f    SpatialForce
            velocity       l = m (v + w x c)        h = I w + c x l          SpatialMomentum

        c is com, I is central. A body that turns needs more force: see `jaxspatial.newton_euler`.

        Args:
            motion_P_E: the acceleration or the velocity of P, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            SpatialForce of an acceleration, SpatialMomentum of a velocity, over the common batch. 45 flops.

        Raises:
            TypeError: the motion is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: per component, of f and l at most 5 u mag in "fast" and "reproducible", u |r| + 16 u^2 mag in
            "compensated", 1 ulp of r in "faithful"; of tau and h at most 8 u mag in "fast" and "reproducible", u |r| +
            64 u^2 mag in "compensated", 1 ulp of r in "faithful".
        Source: Jain 2010, 2.1; Drake, SpatialInertia::operator*.

        Example:
            >>> M = js.SpatialInertia.point_mass([0.0, 0.0, 0.5], mass=2.0)
            >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[3.0, 0.0, 0.0])
            >>> M.apply(A)
            SpatialForce(tau=[0.0, 3.0, 0.0], f=[6.0, 0.0, 0.0])
        """
        kind = _RESULTS.get(type(motion_P_E))
        if kind is None:
            came = type(motion_P_E).__name__
            raise TypeError(f"SpatialInertia @: expected a SpatialAcceleration or SpatialVelocity, got {came}")
        require_compatible(SpatialInertia=self, motion=motion_P_E)
        return kind(*_applied(precision, self._grouped, Motion(*motion_P_E._vectors)))

    @promises(bound=ENERGY)
    def kinetic_energy(self, V_MBp_E: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
        """The kinetic energy m |v + w x c|^2 / 2 + w . I w / 2. Another point or frame does not change it.

        Args:
            V_MBp_E: the velocity of the point P of the body in the frame M.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,), over the common batch, J.

        Raises:
            TypeError: the motion is no SpatialVelocity, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: at most 12 u mag in "fast" and "reproducible", u |r| + 128 u^2 mag in "compensated", 1 ulp of r in
            "faithful".
        Source: Jain 2010, 2.1.

        Example:
            >>> M = js.SpatialInertia.solid_sphere(1.0, mass=5.0)
            >>> V = js.SpatialVelocity(w=[0.0, 0.0, 1.0], v=[2.0, 0.0, 0.0])
            >>> print(M.kinetic_energy(V))
            11.0
        """
        require_kind(V_MBp_E, SpatialVelocity, "kinetic_energy")
        require_compatible(SpatialInertia=self, SpatialVelocity=V_MBp_E)
        energy = _energy_of_float16 if self.dtype == np.float16 else _energy
        return energy(precision, self._grouped, Motion(*V_MBp_E._vectors))

    # -- bodies put together and taken apart --------------------------------------------------------------------------

    def __add__(self, other: Self) -> Any:
        """Two bodies as one: see `combine`."""
        return self.combine(other) if isinstance(other, type(self)) else NotImplemented

    def __radd__(self, other: int) -> Any:
        """0 + M is M, for Python's `sum`; for many bodies `SpatialInertia.sum` is faster and better."""
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def __sub__(self, other: Self) -> Any:
        """What is left without a part: see `remove`."""
        return self.remove(other) if isinstance(other, type(self)) else NotImplemented

    @promises(com=COMBINED_COM, central=COMBINED)
    def combine(self, other: Self, *, precision: PrecisionName = None) -> Self:
        """The inertia of two bodies as one, about the same point in the same frame.

            com = c1 + (m2 / m) d    central = I1 + I2 + (m1 m2 / m) (|d|^2 1 - d d^T)    d = c2 - c1

        The terms are positive semidefinite: nothing cancels, and the result is indefinite at most by the rounding of an
        entry: the validity slack falls by at most 16 u. Where the centres of mass coincide, com is exactly theirs. Two
        bodies without mass have the mean of their com.

        Args:
            other: the inertia of the other body.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia of both together, over the common batch.

        Raises:
            TypeError: the other is no SpatialInertia, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: of mass u m, of com at most 6 u (m1 |c1| + m2 |c2|) / m, of central 10 u mag; in "compensated" and
            "faithful" u |r| + 128 u^2 mag. Derivatives are exact to a few u.
        Source: Featherstone 2008, 2.13.

        Example:
            >>> rod = js.SpatialInertia.thin_rod(1.0, mass=2.0)
            >>> both = rod.combine(js.SpatialInertia.point_mass([0.0, 0.0, 0.5], mass=2.0))
            >>> print(both.mass, both.com)
            4.0 [0.   0.   0.25]
        """
        return self._with(composition.with_body, "+", other, precision)

    def remove(self, other: Self, *, precision: PrecisionName = None) -> Self:
        """The inertia of what is left of this body without a part of it, about the same point in the same frame.

        This cancels: mass, com and central lose as many digits as what is left is smaller. Where no mass is left of a
        body that had some, com and central are infinite or NaN; without mass from the start com stays.

        Args:
            other: the inertia of the part.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia of what is left, over the common batch.

        Raises:
            TypeError: the other is no SpatialInertia, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `combine`, with mag of the differences, com's over the mass that is left.

        Example:
            >>> rod = js.SpatialInertia.thin_rod(1.0, mass=2.0)
            >>> ball = js.SpatialInertia.point_mass([0.0, 0.0, 0.5], mass=2.0)
            >>> print((rod + ball).remove(ball).mass)
            2.0
        """
        return self._with(composition.without_body, "-", other, precision)

    def _with(self, operation: Callable, sign: str, other, precision: PrecisionName) -> Self:
        if not isinstance(other, type(self)):
            raise TypeError(f"{sign}: expected a SpatialInertia, got {type(other).__name__}")
        require_compatible(left=self, right=other)
        return self._like(*operation(precision, self._grouped, other._grouped))

    @promises(mass=SUM_MASS, com=SUM_COM, central=SUM_CENTRAL)
    def sum(self, axis: int = 0, *, precision: PrecisionName = None) -> Self:
        """The inertia of all bodies along an axis of the batch as one, about the same point in the same frame.

            com = sum m_i c_i / m    central = sum (I_i + m_i (|d_i|^2 1 - d_i d_i^T))    d_i = c_i - com

        Sums by halving, always in the same order. An error of com counts in central by its square only, and the result
        is indefinite at most by rounding, as for `combine`. Without any mass com is the mean; of no bodies at all the
        result is zero.

        Args:
            axis: an integer; which axis of the batch.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia of all together, over the other axes of the batch.

        Raises:
            TypeError: the axis is no integer.
            ValueError: the batch has no such axis.

        Error: with L = ceil(log2 n), of mass at most L u m, of com (2 + 2 L) u sum m_i |c_i| / m, of central
            (6 + L) u mag, mag = sum (|I_i| + m_i |d_i|^2) with |d_i|^2 <= |c_i|^2 + |com|^2. In "compensated" and
            "faithful" of com u |r| + 16 (2 + 2 L) u^2 sum m_i |c_i| / m, of central u |r| + 16 (6 + L) u^2 mag; of
            double words the same without u |r|.

        Example:
            >>> rod = js.SpatialInertia.thin_rod(1.0, mass=2.0)
            >>> print(js.stack([rod, rod, rod]).sum().mass)
            6.0
        """
        place = floats.batch_axis(axis, self.batch_shape, "SpatialInertia.sum")
        if not self.batch_shape[place]:
            return self.zero((*self.batch_shape[:place], *self.batch_shape[place + 1 :]), self.dtype)
        moved = moved_to_last(floats.narrowed_each(self._vectors), place, self.batch_shape)
        return self._like(*composition.composite(resolve(precision), *moved))

    # -- principal axes -----------------------------------------------------------------------------------------------

    def principal_moments(self, *, precision: PrecisionName = None) -> jax.Array:
        """The principal moments about the centre of mass.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3), ascending, kg m2.

        Error: as of `principal_moments_and_axes`.

        Example:
            >>> print(js.SpatialInertia.solid_box([3.0, 2.0, 1.0], mass=12.0).principal_moments())
            [ 5. 10. 13.]
        """
        return self.principal_moments_and_axes(precision=precision)[0]

    @promises(moments=MOMENTS, axes=AXES, orthonormal=ORTHONORMAL)
    def principal_moments_and_axes(self, *, precision: PrecisionName = None) -> tuple[jax.Array, Rotation]:
        """The principal moments about the centre of mass, and their axes.

        Where central is diagonal, up to 2 eps of its trace, axes are exactly coordinate axes, the third one reversed if
        they were left-handed else; where the moments differ by no more than 4 eps of the trace, exactly the identity.

        Derivatives of the moments are the derivatives of their matrix along the axes, those of axes divide by the
        difference of moments; of axes with equal moments, which have none, the part within their plane is 0.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (moments (*batch, 3), ascending, kg m2; R_EA with the principal axes as its columns, right-handed).

        Error: of the moments at most 8 u times the largest, of the axes 32 u times the largest moment over the distance
            to the next; R R^T is within 16 u of the identity, 2 u in "compensated" and "faithful".
        Source: Jacobi 1846.

        Example:
            >>> M = js.SpatialInertia.solid_box([3.0, 2.0, 1.0], mass=12.0)
            >>> moments, R = M.principal_moments_and_axes()
            >>> print(moments)
            [ 5. 10. 13.]
        """
        moments, axes = eigen.decomposition(resolve(precision), floats.narrowed(self.central))
        return moments, Rotation(axes)

    @promises(bound=ELLIPSOID)
    def equivalent_ellipsoid(self, *, precision: PrecisionName = None) -> tuple[jax.Array, Rotation]:
        """The solid ellipsoid about the centre of mass with this mass and inertia.

        a_i^2 = 5 s_i / m, s_i the second moment as of `validity_slack`; 0 where that is not positive, with derivative
        0. NaN or inf without mass.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (semi-axes a (*batch, 3), descending, m; R_EA of `principal_moments_and_axes`, along whose columns they
            are).

        Error: of a_i^2 at most 64 u times the largest: a rod may have 1e-8 (float32: 1e-3) of its length as its
            thickness.

        Example:
            >>> M = js.SpatialInertia.solid_ellipsoid([3.0, 2.0, 1.0], mass=2.0)
            >>> semi_axes, R = M.equivalent_ellipsoid()
            >>> print(semi_axes)
            [3. 2. 1.]
        """
        return self._equivalent(Fraction(1, 5), precision)

    def equivalent_box(self, *, precision: PrecisionName = None) -> tuple[jax.Array, Rotation]:
        """The solid box with this mass and inertia: edge_i^2 = 12 s_i / m, else as `equivalent_ellipsoid`.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (edges (*batch, 3), descending, m; R_EA of `principal_moments_and_axes`, along whose columns they are).

        Error: as of `equivalent_ellipsoid`.

        Example:
            >>> M = js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=6.0)
            >>> edges, R_EB = M.equivalent_box()
            >>> print(edges)
            [3. 2. 1.]
        """
        return self._equivalent(Fraction(1, 12), precision)

    def _equivalent(self, factor: Fraction, precision: PrecisionName) -> tuple[jax.Array, Rotation]:
        moments, R_EA = self.principal_moments_and_axes(precision=precision)
        return parameters.lengths(precision, expanded(self.mass), moments, factor=factor), R_EA

    @promises(bound=LENGTH)
    def minimum_length(self, *, precision: PrecisionName = None) -> jax.Array:
        """sqrt(2 tr(central) / mass): no body with this inertia is shorter than that in its longest direction.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,), m.

        Error: at most 8 u in "fast" and "reproducible", 1.01 u |r| in the other two.
        Source: Drake, CalcMinimumPhysicalLength.

        Example:
            >>> M = js.SpatialInertia.solid_sphere(1.0, mass=5.0)
            >>> print(M.minimum_length())
            1.5491934
        """
        return parameters.minimum_length(precision, expanded(self.mass), self.central)

    # -- which inertias a body can have -------------------------------------------------------------------------------

    @promises(bound=SLACK)
    def validity_slack(self, *, precision: PrecisionName = None) -> jax.Array:
        """How far this is from what no body can have: the smallest second moment over the sum of the sizes of all.

        Second moments s_i = (l_j + l_k - l_i) / 2, l the principal moments: integrals of x_i^2 dm along the principal
        axes, from the centre of mass. The sum is one of their absolute values.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,): 1/3 for a ball, 0 for a plate, a rod and a point, negative where the triangle inequality of the
            principal moments does not hold; -1 for a negative mass and for moments without mass, NaN where a number is
            not finite.

        Error: at most 32 u.
        Source: Wensing, Kim and Slotine 2018.

        Example:
            >>> M = js.SpatialInertia(1.0, [0.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0, 0.0, 5.0])
            >>> print(M.validity_slack() < 0)
            True
        """
        M = Inertia(*floats.narrowed_each(self._vectors))
        return parameters.slack(precision, M, eigen.decomposition(resolve(precision), M.central)[0])

    def is_physically_valid(self, tolerance: float | None = None, *, precision: PrecisionName = None) -> jax.Array:
        """Whether a body can have this inertia: all finite, mass >= 0, `validity_slack` >= -tolerance.

        Nothing at all is valid: mass 0 and central 0. Mass 0 with moments is not: what has no mass has no moments. The
        answer does not depend on the point P.

        Args:
            tolerance: relative, as the slack is; 16 eps by default, for what rounding takes from a plate.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,) of bool.

        Error: of the slack, as of `validity_slack`.

        Example:
            >>> flat = [1.0, 0.0, 1.0, 0.0, 0.0, 2.0]
            >>> M = js.SpatialInertia([1.0, 1.0], np.zeros((2, 3), np.float32), [flat, [1.0, 0.0, 1.0, 0.0, 0.0, 5.0]])
            >>> print(M.is_physically_valid())
            [ True False]
        """
        tolerance = _TOLERANCE * floats.eps(floats.narrowed(self).dtype) if tolerance is None else tolerance
        return self.validity_slack(precision=precision) >= -tolerance

    @promises(bound=NEAREST_VALID)
    def nearest_valid(self, tolerance: float | None = None, *, precision: PrecisionName = None) -> Self:
        """The nearest inertia that a body can have, of mass and second moments about the centre of mass no less than 0.

        The matrix of second moments is the nearest such one in the Frobenius norm. Mass, or central, that are valid
        with this tolerance stay bit for bit, and so do those that are not finite; com always. Where moments are left
        and the mass is not above 0, it becomes the smallest normal number of the dtype.

        Args:
            tolerance: relative, of the slack; 16 eps by default.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the same batch.

        Error: of central at most 32 u times its largest principal moment.

        Example:
            >>> M = js.SpatialInertia(1.0, [0.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0, 0.0, 5.0])
            >>> print(M.is_physically_valid(), M.nearest_valid().is_physically_valid())
            False True
        """
        M = floats.narrowed(self)
        tolerance = float(_TOLERANCE * floats.eps(M.dtype) if tolerance is None else tolerance)
        moments_and_axes = eigen.decomposition(resolve(precision), M.central)
        mass, central = parameters.nearest_valid(precision, M._grouped, *moments_and_axes, tolerance=tolerance)
        return self._like(mass, M.com, central)


_RESULTS = {SpatialAcceleration: SpatialForce, SpatialVelocity: SpatialMomentum}

# -- formulas over numbers --------------------------------------------------------------------------------------------

_applied = formula(algebra.apply_inertia, of_sums=True, layout=(3, 4))
_energy = formula(lambda M, V: halved(algebra.twice_energy(M, V)), of_sums=True)
_shifted_com = formula(lambda com, p: com - p, of_sums=True)
_rotated = formula(lambda R, com, central: [R @ com, congruence(R, central)], of_sums=True, layout=(1, 2))


@formula(of_sums=True)
def _energy_of_float16(M: Inertia, V: Motion) -> Number:
    """The same bits as `_energy`. The range of float16 ends at 65504: vectors are halved before they are squared."""
    return algebra.twice_energy(M, V, half=halved)


@formula(of_sums=True, layout=(None, 3))
def _acted(R, p: Vector, com: Vector, central: Symmetric) -> list:
    return list(algebra.acted_inertia(Pose(R, p), Inertia(com[0], com, central))[1:])


@formula(of_sums=True, layout=(2, 3))
def _acted_inverse(R, p: Vector, com: Vector, central: Symmetric) -> list:
    return list(algebra.inverse_acted_inertia(Pose(R, p), Inertia(com[0], com, central))[1:])


# -- arrays of a caller -----------------------------------------------------------------------------------------------


def _checked(operation: str, mass: ArrayLike, com: ArrayLike, six: ArrayLike, name: str = "central") -> list:
    """The three as arrays of one dtype over their common batch, the last by six entries."""
    dtype = floats.floating_dtype(mass, com, six)
    arrays = {
        f"{operation}: mass": floats.as_float_array(mass, f"{operation}: mass", dtype, keep_dtype=True),
        f"{operation}: com": floats.as_vectors(com, f"{operation}: com", dtype, keep_dtype=True),
        f"{operation}: {name}": as_entries(six, f"{operation}: {name}", 6, dtype),
    }
    arrays = check.same_dtype(**arrays)
    items = dict(zip(arrays, ((), (3,), (6,)), strict=True))
    shapes = {key: x.shape[: len(x.shape) - len(items[key])] for key, x in arrays.items()}
    batch = floats.common_batch_shape(**shapes)
    return [x if shapes[key] == batch else _broadcast(x, (*batch, *items[key])) for key, x in arrays.items()]


def as_entries(x: ArrayLike, name: str, n: int, dtype: DTypeLike | None = None):
    """An array (*batch, n), or of matrices (*batch, 3, 3) their n entries: 6 of symmetric ones, or all 9."""
    array = floats.as_float_array(x, name, dtype, keep_dtype=True)
    if array.shape[-1:] == (n,):
        return array
    if array.shape[-2:] != (3, 3):
        raise ValueError(f"{name}: expected shape (*batch, 3, 3) or (*batch, {n}), got {array.shape}")
    return eigen.six_of_matrix(array) if n == 6 else array.reshape((*array.shape[:-2], 9))


def _broadcast(array, shape: tuple[int, ...]):
    if isinstance(array, DoubleWord):
        return jax.tree.map(functools.partial(jnp.broadcast_to, shape=shape), array)
    if isinstance(array, floats.StandIn):
        return array._over_batch(shape[:-1])
    return (np if isinstance(array, np.ndarray) else jnp).broadcast_to(array, shape)

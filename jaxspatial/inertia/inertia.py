"""Spatial inertia: mass, centre of mass and inertia about the centre of mass, and what is done with them.

The mathematics is in the modules beside this one, as functions of arrays; the bases hold methods by subject.
"""

from typing import TYPE_CHECKING, Any, Self

import jax
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, Symmetric, Three, halved
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.tree import tree
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.inertia.composition import Composition
from jaxspatial.inertia.forms import Forms
from jaxspatial.inertia.parts import Parts
from jaxspatial.inertia.shapes import Shapes
from jaxspatial.inertia.validity import PrincipalAxes
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity, algebra
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.operations import rotate, shift


@tree
class SpatialInertia(Forms, Shapes, Composition, PrincipalAxes):
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

    if TYPE_CHECKING:
        __init__ = Parts.__init__

    def shift(self, p_PQ_E: Vector3, *, precision: PrecisionName = None) -> Self:
        """About the point Q of the same body, see `jaxspatial.shift`."""
        return shift(self, p_PQ_E, precision=precision)

    def __rmatmul__(self, R_AE: Any) -> Self:
        """R @ M: see `jaxspatial.rotate`."""
        return rotate(R_AE, self)

    def __matmul__(self, motion: Any) -> Any:
        """M @ A is a SpatialForce, M @ V a SpatialMomentum: see `apply`."""
        return self.apply(motion)

    def apply(self, motion_P_E: SpatialAcceleration | SpatialVelocity, *, precision: PrecisionName = None) -> Any:
        """The 6 x 6 matrix times a motion: M A, the force of inertia of the body, or M V, its momentum, about P.

            acceleration   f = m (a + alpha x c)    tau = I alpha + c x f    SpatialForce
            velocity       l = m (v + w x c)        h = I w + c x l          SpatialMomentum

        c is com, I is central. Without the terms in w x w that the force on a moving body has as well: those are
        `newton_euler`'s.

        Args:
            motion_P_E: the acceleration or the velocity of P, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            SpatialForce of an acceleration, SpatialMomentum of a velocity, over the common batch. 45 flops.

        Raises:
            TypeError: the motion is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: per component, of f and l at most 5 u mag, of tau and h 8 u mag in "fast" and "reproducible", u |r| + 64
            u^2 mag in "compensated", 1 ulp in "faithful".
        Source: Jain 2010, 2.1; Drake, SpatialInertia::operator*.
        """
        kind = _RESULTS.get(type(motion_P_E))
        if kind is None:
            came = type(motion_P_E).__name__
            raise TypeError(f"SpatialInertia @: expected a SpatialAcceleration or SpatialVelocity, got {came}")
        require_alike(SpatialInertia=self, motion=motion_P_E)
        return kind(*_applied(precision, *self.vectors, *motion_P_E.vectors))

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

        Error: at most 12 u mag in "fast" and "reproducible", u |r| + 128 u^2 mag in "compensated", 1 ulp in "faithful".
        Source: Jain 2010, 2.1.
        """
        require_kind(V_MBp_E, SpatialVelocity, "kinetic_energy")
        require_alike(SpatialInertia=self, SpatialVelocity=V_MBp_E)
        energy = _energy_of_float16 if self.dtype == np.float16 else _energy
        return energy(precision, *self.vectors, *V_MBp_E.vectors)


_RESULTS = {SpatialAcceleration: SpatialForce, SpatialVelocity: SpatialMomentum}


@formula(of_sums=True)
def _applied(mass: Numbers, com: Three, central: Symmetric, alpha: Three, a: Three) -> list[Numbers]:
    wrench = algebra.inertia_times(mass[0], com, central, alpha, a)
    return [vectors.laid_out_as(*each) for each in zip((alpha, a), wrench, strict=True)]


@formula(of_sums=True)
def _energy(mass: Numbers, com: Three, central: Symmetric, w: Three, v: Three) -> Number:
    return halved(algebra.twice_kinetic_energy(mass[0], com, central, w, v))


@formula(of_sums=True)
def _energy_of_float16(mass: Numbers, com: Three, central: Symmetric, w: Three, v: Three) -> Number:
    """As `_energy`, to the bit; but the range of float16 ends at 65504: halved are vectors, before they are squared."""
    return algebra.twice_kinetic_energy(mass[0], com, central, w, v, half=halved)

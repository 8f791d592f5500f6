"""The error bounds of inertias: see `arithmetic.promise`."""

from jaxspatial.arithmetic.promise import Normwise, OfSum, Promise

# f = m (a + alpha x c), and tau = I alpha + c x f.
FORCE, TORQUE = Promise(5, 64), Promise(8, 64)
# Twice the kinetic energy; its regressor.
ENERGY, ENERGY_REGRESSOR = Promise(12, 128), Promise(3, 8)
# The moments about another point than the centre of mass.
ABOUT = Promise(5, 16)
NEWTON_EULER, REGRESSOR = Promise(12, 48), Promise(2, 4)
ARTICULATED_TIMES, ARTICULATED_SHIFT, ARTICULATED_ROTATED = Promise(4, 8), Promise(8, 32), Promise(6, 64)
ARTICULATED_ACT = Promise(16, 128)
# Central inertias: of two bodies, of moments about another point, of a matrix root; com and mass have less.
COMBINED, FROM_MOMENTS, FROM_ROOT = Promise(10, 128), Promise(6, 64, mag="|I_P| + m |c|^2"), Promise(24, 64)
# What is left of an articulated inertia beyond a joint: per mag_D / D.
PROJECTED = Promise(16, 64)
COMBINED_COM, ROOT_MASS = Normwise(6, "(m1 |c1| + m2 |c2|) / m", u2=128), Normwise(8, "m")
# Of solids: what is made of products of sizes; of tetrahedra by density those of a determinant.
SHAPE_MASS, SHAPE_CENTRAL = Promise(12, 64), Promise(20, 64)
DETERMINANT, TETRAHEDRON_COM = Normwise(12, "size", u2=64), Normwise(4, "|vertices|")
# Sums of n bodies, L = ceil(log2 n), and of m triangles.
SUM_MASS, SUM_COM, SUM_CENTRAL = OfSum(of="m"), OfSum(4, of="sum m_i |c_i| / m", u2=64), OfSum(10, u2=64)
MESH_VOLUME, MESH_COM, MESH_CENTRAL = (
    OfSum(12, of="S", u2=8),
    OfSum(12, of="r S / V", u2=8),
    OfSum(24, 2, "mass r^2 S / V", u2=8),
)
# Of the largest moment.
MOMENTS, AXES = Normwise(8, "times the largest"), Normwise(32, "times the largest moment", rounded=32)
ORTHONORMAL = Normwise(16, "of the identity", rounded=2)
ELLIPSOID = Normwise(64, "times the largest", rounded=64)
NEAREST_VALID = Normwise(32, "times its largest principal moment", rounded=32)
LENGTH, SLACK = Normwise(8, ""), Normwise(32, "", rounded=32)
# c the condition of the second moments.
ALPHA, LOG_CHOLESKY, THERE_AND_BACK = Normwise(4, "|alpha|"), Normwise(32, "(c + |d|)"), Normwise(64, "c")
LOG_CHOLESKY_OFF_DIAGONAL = Normwise(32, "c sqrt(tr(Sigma) / m)")

# Whose docstrings state which.
PROMISES = {
    "SpatialInertia.apply": (FORCE, TORQUE),
    "SpatialInertia.kinetic_energy": (ENERGY,),
    "SpatialInertia.from_origin": (ABOUT,),
    "SpatialInertia.inertia_about_origin": (ABOUT,),
    "ArticulatedInertia.from_spatial_inertia": (ABOUT,),
    "ArticulatedInertia.times": (ARTICULATED_TIMES,),
    "ArticulatedInertia.shift": (ARTICULATED_SHIFT,),
    "ArticulatedInertia.rotate": (ARTICULATED_ROTATED,),
    "SpatialInertia.combine": (COMBINED, COMBINED_COM),
    "SpatialInertia.sum": (SUM_MASS, SUM_COM, SUM_CENTRAL),
    "SpatialInertia.triangle_mesh": (MESH_VOLUME, MESH_COM, MESH_CENTRAL),
    "SpatialInertia.solid_tetrahedron": (DETERMINANT, TETRAHEDRON_COM),
    "SpatialInertia.principal_moments_and_axes": (MOMENTS, AXES, ORTHONORMAL),
    "SpatialInertia.equivalent_ellipsoid": (ELLIPSOID,),
    "SpatialInertia.minimum_length": (LENGTH,),
    "SpatialInertia.nearest_valid": (NEAREST_VALID,),
    "SpatialInertia.validity_slack": (SLACK,),
    "SpatialInertia.to_log_cholesky": (ALPHA, LOG_CHOLESKY, LOG_CHOLESKY_OFF_DIAGONAL, THERE_AND_BACK),
    "SpatialInertia.from_dynamic_parameters": (FROM_MOMENTS,),
    "SpatialInertia.from_log_cholesky": (FROM_ROOT, ROOT_MASS),
    "newton_euler": (NEWTON_EULER,),
    "newton_euler_regressor": (REGRESSOR,),
    "kinetic_energy_regressor": (ENERGY_REGRESSOR,),
}

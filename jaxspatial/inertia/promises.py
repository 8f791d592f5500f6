"""The error bounds of inertias: see `arithmetic.promise`."""

from jaxspatial.arithmetic.promise import Promise

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
# Of solids: what is made of products of sizes.
SHAPE_MASS, SHAPE_CENTRAL = Promise(12, 64), Promise(20, 64)

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
    "SpatialInertia.combine": (COMBINED,),
    "SpatialInertia.from_dynamic_parameters": (FROM_MOMENTS,),
    "SpatialInertia.from_log_cholesky": (FROM_ROOT,),
    "newton_euler": (NEWTON_EULER,),
    "newton_euler_regressor": (REGRESSOR,),
    "kinetic_energy_regressor": (ENERGY_REGRESSOR,),
}

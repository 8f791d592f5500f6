"""The error bounds of algorithms of mechanisms, and of steps on configurations and in time: see `arithmetic.promise`.

Of the largest number of a result, of n links one behind the other; mag is what it would be if no terms cancelled. Where
the mass matrix is solved with, mag counts as many times as the condition c says.
"""

from jaxspatial.arithmetic.promise import Normwise

ALGORITHM = Normwise(4, "mag", per="n", u2=32)
FORWARD_DYNAMICS = ALGORITHM._replace(of="c mag")

# -- steps on configurations ------------------------------------------------------------------------------------------

INTEGRATED, INTEGRATED_TURN = Normwise(2, "(|q| + |v dt|)"), Normwise(8, "of a quaternion")
INTEGRATED_POSITION = Normwise(8, "(|p| + |v dt|)")
# Beyond half a turn.
TURNS, TURNS_OF_POSITION = Normwise(1, "|w dt|", rounded=0), Normwise(1, "|w dt| |v dt|", rounded=0)
DIFFERENCE, SHORTEST = Normwise(2, "(|q0| + |q1|)"), Normwise(4, "(|q0| + |q1|)")
DIFFERENCE_TURN, DIFFERENCE_POSITION = Normwise(12, "of a rotation vector"), Normwise(8, "(|p0| + |p1|) (1 + |w|)")
QUATERNION_RATE, POSITION_RATE = Normwise(2, "|w|"), Normwise(6, "|v|")

# -- steps in time ----------------------------------------------------------------------------------------------------

STRAIGHT_AHEAD = Normwise(8, "(|v| + dt |vdot| + dt |w| |v|)")
TURNS_OF_RATES = Normwise(1, "|w dt| of that", rounded=0)
SEMI_IMPLICIT, RK4 = (Normwise(u, "(|v| + dt |vdot|)") for u in (2, 4))
RK4_COORDINATES = Normwise(4, "(|q| + dt |dq/dt|)")
SYMPLECTIC = Normwise(8, "c (|v| + dt |vdot|)", per="n")
PASSIVE = Normwise(8, "times the sum of the sizes of the four terms", rounded=1, u2=64)
PASSIVE_TURNS = Normwise(8, "stiffness")

# -- the mass matrix solved with, nv its size -------------------------------------------------------------------------

FACTOR, SOLVED = Normwise(2, "|M|", per="nv (nv + 1)"), Normwise(4, "cond(M)", per="nv (nv + 1)")
LOG_DETERMINANT = Normwise(1, "(2 sum |log L_ii| + 4 nv (nv + 1) cond(M))", per="nv")

_ALGORITHMS = """
    bias_forces body_accelerations body_velocities center_of_mass center_of_mass_jacobian
    center_of_mass_velocity centroidal_momentum centroidal_momentum_matrix forward_kinematics gravity_forces
    inverse_dynamics inverse_dynamics_derivatives jacobian jacobian_rate joint_torque_regressor kinetic_energy
    mass_matrix potential_energy
"""
# Whose docstrings state which.
PROMISES = {
    **dict.fromkeys(_ALGORITHMS.split(), (ALGORITHM,)),
    "forward_dynamics": (FORWARD_DYNAMICS,),
    "integrate": (INTEGRATED, INTEGRATED_TURN, INTEGRATED_POSITION, TURNS, TURNS_OF_POSITION),
    "difference": (DIFFERENCE, SHORTEST, DIFFERENCE_TURN, DIFFERENCE_POSITION),
    "configuration_rates": (QUATERNION_RATE, POSITION_RATE),
    "semi_implicit_step": (SEMI_IMPLICIT, STRAIGHT_AHEAD, TURNS_OF_RATES),
    "rk4_step": (RK4, RK4_COORDINATES),
    "symplectic_step": (SYMPLECTIC,),
    "passive_forces": (PASSIVE, PASSIVE_TURNS),
    "mass_matrix_factor": (FACTOR,),
    "MassMatrixFactor.solve": (SOLVED,),
    "MassMatrixFactor.log_determinant": (LOG_DETERMINANT,),
}

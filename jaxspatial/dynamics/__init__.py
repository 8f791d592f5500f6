"""Layer 5: what mechanisms do."""

from jaxspatial.dynamics.configuration import difference as difference
from jaxspatial.dynamics.configuration import integrate as integrate
from jaxspatial.dynamics.configuration import interpolate as interpolate
from jaxspatial.dynamics.configuration import random_configuration as random_configuration
from jaxspatial.dynamics.energy import center_of_mass as center_of_mass
from jaxspatial.dynamics.energy import kinetic_energy as kinetic_energy
from jaxspatial.dynamics.energy import potential_energy as potential_energy
from jaxspatial.dynamics.forward_dynamics import forward_dynamics as forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import bias_forces as bias_forces
from jaxspatial.dynamics.inverse_dynamics import gravity_forces as gravity_forces
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics as inverse_dynamics
from jaxspatial.dynamics.kinematics import body_velocities as body_velocities
from jaxspatial.dynamics.kinematics import forward_kinematics as forward_kinematics
from jaxspatial.dynamics.kinematics import jacobian as jacobian
from jaxspatial.dynamics.mass_matrix import mass_matrix as mass_matrix

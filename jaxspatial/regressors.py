"""Regressors: what is linear in the ten dynamic parameters of each body, as matrices.

import jaxspatial as js

Y = js.regressors.joint_torque_regressor(mech, q, v, vdot)     # tau = Y @ parameters
"""

# of a mechanism
from jaxspatial.dynamics.regressors import joint_torque_regressor as joint_torque_regressor

# of one body
from jaxspatial.inertia.regressors import kinetic_energy_regressor as kinetic_energy_regressor
from jaxspatial.inertia.regressors import momentum_regressor as momentum_regressor
from jaxspatial.inertia.regressors import newton_euler_regressor as newton_euler_regressor

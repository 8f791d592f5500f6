"""The dynamics of mechanisms, as in the textbooks.

Each file is one subject, with its public functions and the formulas over a `MechanismState` that they run.
`jaxspatial.engine` turns a formula into a program.

    kinematics            poses, velocities, accelerations of bodies and frames
    newton_euler          the recursive Newton-Euler algorithm; external forces
    inverse_dynamics      generalized forces for given accelerations
    composite_bodies      the mass matrix and its factors
    articulated_bodies    accelerations for given forces, in forward_dynamics
    derivatives           derivatives of inverse dynamics in closed form, in linearization
    jacobians             Jacobians of frames and their time derivatives
    inverse_kinematics    configurations that put frames at targets
    centroid, energy      centre of mass, momentum, kinetic and potential energy
    configuration         steps on the manifold of configurations
    passive               springs, damping, friction, limits
    steps                 steps in time
    momentum_observer     external generalized forces from measured states
    regressors            forces as linear functions of inertial parameters
"""

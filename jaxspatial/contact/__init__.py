"""Contact, friction, limits and closed loops.

To follow a contact through a step, read `step`, then `term`, `points` and `newton`:

    PointContacts, as callers pass them -> ContactData, arrays at one configuration -> Contacts, the Term of a program

`step` checks arguments and makes the data. `newton` iterates in one program of all states, in which each data makes its
Term. A direction of the iteration comes from `hessian`, by passes over the tree of a `world`.

explicit        where spheres touch the ground; the explicit law of forces
term            what a term of the convex step is
points          spheres in contact
joints          limits and dry friction of joints
tendons         limits of tendons and of the angles of balls
closures        loop closures
world           a mechanism in world axes: its bodies, and passes over its tree
hessian         directions, by articulated bodies with the stiffness of terms
newton          Newton's method for any terms
step            convex_step
report          what is known of each contact
closed_loops    the errors and Jacobians of loop closures, and the motion of linkages that they close
"""

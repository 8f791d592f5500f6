"""Contact, friction, limits and closed loops.

In `convex_step` a contact has three shapes, one after the other:

    PointContacts       what a caller passes: frames, and the numbers of the law
    ContactData         what programs read: arrays (*batch, k) at one configuration, with normals and distances
    Contacts            what Newton's method iterates on: the numbers (n, B) of n contacts in all B states of a program

The last two are the TermData and the Term of contacts. Every other term has such a pair, too: limits and friction of
joints, limits of tendons and of balls, closures. To follow a contact, read `step`, which makes the data, then `term`,
`points` and `newton`. A direction of the iteration comes from `hessian`, by passes over the tree of a `world`.

geometry        where spheres touch the ground or other surfaces, how deep, and how they move there
explicit        the explicit law of forces
term            what a term of the convex step is
points          spheres in contact
joints          limits and dry friction of joints
tendons         limits of tendons and of the angles of balls
closures        loop closures
world           a mechanism in world axes: its bodies, and passes over its tree
hessian         directions of the iteration, by articulated bodies with the G of terms
newton          Newton's method for any terms
step            convex_step
report          what is known of each contact
closed_loops    the errors and Jacobians of loop closures, and the motion of linkages that they close
"""

"""Joints, bodies, and the tree they make: `Mechanism`."""

from jaxspatial.mechanism.actuators import Actuators as Actuators
from jaxspatial.mechanism.contacts import HalfSpace as HalfSpace
from jaxspatial.mechanism.contacts import PointContacts as PointContacts
from jaxspatial.mechanism.editing import add_frames as add_frames
from jaxspatial.mechanism.editing import lock_joints as lock_joints
from jaxspatial.mechanism.editing import subtree as subtree
from jaxspatial.mechanism.forces import AppliedForces as AppliedForces
from jaxspatial.mechanism.loops import LoopClosure as LoopClosure
from jaxspatial.mechanism.mechanism import Mechanism as Mechanism
from jaxspatial.mechanism.mechanism import StaticMechanism as StaticMechanism
from jaxspatial.mechanism.parts import Body as Body
from jaxspatial.mechanism.parts import Frame as Frame
from jaxspatial.mechanism.parts import Joint as Joint
from jaxspatial.mechanism.tendons import Tendon as Tendon

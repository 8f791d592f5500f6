"""Joints, bodies, and the tree they make: `Mechanism`."""

from jaxspatial.mechanism.actuators import Actuators as Actuators
from jaxspatial.mechanism.contacts import PointContacts as PointContacts
from jaxspatial.mechanism.distances import ClosestPoints as ClosestPoints
from jaxspatial.mechanism.distances import closest_points as closest_points
from jaxspatial.mechanism.distances import distance as distance
from jaxspatial.mechanism.editing import add_frames as add_frames
from jaxspatial.mechanism.editing import lock_joints as lock_joints
from jaxspatial.mechanism.editing import subtree as subtree
from jaxspatial.mechanism.forces import AppliedForces as AppliedForces
from jaxspatial.mechanism.height_field import HeightField as HeightField
from jaxspatial.mechanism.loops import LoopClosure as LoopClosure
from jaxspatial.mechanism.mechanism import Mechanism as Mechanism
from jaxspatial.mechanism.mechanism import StaticMechanism as StaticMechanism
from jaxspatial.mechanism.parts import Body as Body
from jaxspatial.mechanism.parts import Frame as Frame
from jaxspatial.mechanism.parts import Joint as Joint
from jaxspatial.mechanism.shape_contacts import ShapeContacts as ShapeContacts
from jaxspatial.mechanism.shapes import Box as Box
from jaxspatial.mechanism.shapes import Capsule as Capsule
from jaxspatial.mechanism.shapes import Cylinder as Cylinder
from jaxspatial.mechanism.shapes import HalfSpace as HalfSpace
from jaxspatial.mechanism.shapes import SignedDistance as SignedDistance
from jaxspatial.mechanism.shapes import Sphere as Sphere
from jaxspatial.mechanism.shapes import Stairs as Stairs
from jaxspatial.mechanism.shapes import Union as Union
from jaxspatial.mechanism.tendons import Tendon as Tendon

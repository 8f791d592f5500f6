"""Layer 1: rotations."""

from jaxspatial.rotation.rotation import Rotation as Rotation

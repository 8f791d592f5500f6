"""Rotations."""

from jaxspatial.rotation.rotation import Rotation as Rotation

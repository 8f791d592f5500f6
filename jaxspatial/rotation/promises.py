"""The error bounds of this layer, of what does not compute angles: see `arithmetic.promise`."""

from jaxspatial.arithmetic.promise import Promise

# R v, of a vector or of each column of a rotation.
ROTATED = Promise(3, 4)

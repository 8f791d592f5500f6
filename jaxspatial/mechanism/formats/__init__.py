"""Readers of model files: URDF and MuJoCo's MJCF. `Mechanism.from_urdf` and `from_mjcf` import them when first called.

A reader has one function, `read(path_or_text, ...)`, which makes a Mechanism, and refuses what it cannot represent
with the line, the element and the reason. The packages that parse the files are imported by then, not before.
"""

from jaxspatial.mechanism.formats.notes import ModelFileWarning as ModelFileWarning

"""Readers of model files: URDF and MuJoCo's MJCF. `Mechanism.from_urdf` and `from_mjcf` import them when first called.

A reader has one function, `read(build, path_or_text, ...)`. It makes a Mechanism, and refuses what a mechanism cannot
represent with the line, the element and the reason. The packages that parse the files are imported by it, not before.
`source` has what both readers share.
"""

from jaxspatial.mechanism.formats.source import ModelFileWarning as ModelFileWarning

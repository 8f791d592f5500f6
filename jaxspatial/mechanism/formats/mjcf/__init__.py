"""Mechanisms from MuJoCo's format (mujoco.readthedocs.io, XML reference).

The package mujoco compiles the files. Bodies, joints and sites become bodies, joints and frames of the same name,
"body_<id>", "joint_<id>" and "site_<id>" where they have none; a site with the name of a body is "<body>/<site>". Of
several joints on one body, each but the last carries a body without mass, "<body>/<joint>". A joint constraint of at
most first degree makes a mimic, as if it were rigid. Springs, damping and friction of joints are numbers of the
mechanism, see `passive_forces`. What serves pictures, contact or control (geoms but for their mass, cameras, sensors,
keyframes, actuators but for armature and damping, options of MuJoCo's solver, that bodies are of mocap) is no part of a
mechanism: one `ModelFileWarning` lists it. Everything else that changes the motion and has no counterpart is refused,
with its line (that of what holds it, where it is not in the text itself but in a model that is attached); so are
numbers that are not finite or that the dtype does not have.

Coordinates of hinges, slides and balls are MuJoCo's: zero is where `ref` is zero. A free joint has its quaternion
first, and its linear velocity in the body's axes; a mimic has no coordinate. `interop.mujoco` converts.
"""

import pathlib
from collections.abc import Callable
from typing import TypeVar

from jaxspatial.arithmetic.numbers.folding import in_double
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.mechanism.formats.mjcf.checks import check
from jaxspatial.mechanism.formats.mjcf.file import ModelFile
from jaxspatial.mechanism.formats.mjcf.left_out import leave_out
from jaxspatial.mechanism.formats.mjcf.parts import parts
from jaxspatial.mechanism.formats.numbers import built

Made = TypeVar("Made")


def read(build: Callable[..., Made], path_or_text: str | pathlib.Path, dtype: DTypeLike | None = None) -> Made:
    """Reads an MJCF: what `Mechanism.from_mjcf` calls, with the same arguments and errors, and its `build`."""
    file = ModelFile(path_or_text, dtype)
    check(file)
    leave_out(file)
    with in_double():
        found = parts(file)
    mechanism = built(build, file.refuse_named, *found, file.gravity, dtype)
    file.notes.tell()
    return mechanism

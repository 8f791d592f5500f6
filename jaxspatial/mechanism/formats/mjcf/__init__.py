"""Mechanisms from MuJoCo's format (mujoco.readthedocs.io, XML reference).

The package mujoco compiles the files. Bodies, joints, sites and fixed cameras become bodies, joints and frames of the
same name, "body_<id>", "joint_<id>", "site_<id>" and "cam_<id>" where they have none; a site or a camera with a name
that is taken is "<body>/<name>". A camera looks along -z. Of several joints on one body, each but the last carries a
body without mass, "<body>/<joint>". Fixed tendons with springs, damping or limits become the `tendons` of the
mechanism, and bodies with `gravcomp` have lifts. Springs, damping and friction of joints are numbers of the mechanism,
see `passive_forces`.

Equality constraints are taken for rigid. Those of joints and of fixed tendons may be of at most first degree. An
equality of two joints makes the first a mimic of the second; where it is one already, equations are solved for another
joint, and those that say nothing more are left out. An equality of one joint, or of three and more, becomes a
`Tendon` with two equal limits, which says what holds it; the warning names it. `connect` and `weld` become the
`loops` of the mechanism, of kinds "ball" and "weld"; between bodies they hold frames "<constraint>/a" on the first body
and "<constraint>/b" on the second.

What serves pictures, contact or control (geoms but for their mass, sensors, keyframes, actuators but for
armature and damping, options of MuJoCo's solver, mocap) is no part of a mechanism, and is left out. Drag of the medium,
springs, damping and limits of ropes (spatial tendons), and friction of tendons are left out, too; one
`ModelFileWarning` lists them, and `strict=True` refuses them. Everything else that changes the motion and that a
mechanism cannot represent is refused, and so are numbers that are not finite or beyond the dtype. Messages have the
line of the element, or of what holds it where it is in an attached model.

What a joint does not say has MuJoCo's default, or that of its class: without an axis it is along z. The mass matrix of
several slides of one body along the same direction is singular. MuJoCo takes it for diagonal (`body_simple`) where the
body hangs on the world and carries nothing, its joints are along the axes of its frame, and its centre of mass is at
its origin: results then differ.

Coordinates of hinges, slides and balls are MuJoCo's: zero is where `ref` is zero. A free joint has its quaternion
first, and its linear velocity in the body's axes; a mimic has no coordinate. `interop.mujoco` converts.

A free joint with `frictionloss` becomes the slides "<joint>/x", "<joint>/y" and "<joint>/z" along the axes of the world
and the ball "<joint>/ball", as MuJoCo's friction acts along the axes of the world; the warning names the joint. Their
coordinates and velocities are those of MuJoCo's free joint. The same is made of a free joint whose damping or armature
differs from axis to axis, as it can in an MjModel.
"""

from collections.abc import Callable, Mapping
from typing import Any

from jaxspatial.mechanism.formats.mjcf.actuators import read_actuators as read_actuators
from jaxspatial.mechanism.formats.mjcf.actuators import read_key_frames as read_key_frames
from jaxspatial.mechanism.formats.mjcf.checks import check_representable, leave_out_the_rest
from jaxspatial.mechanism.formats.mjcf.file import File
from jaxspatial.mechanism.formats.mjcf.geoms import read_height_field as read_height_field
from jaxspatial.mechanism.formats.mjcf.geoms import read_shapes as read_shapes
from jaxspatial.mechanism.formats.mjcf.parts import read_parts
from jaxspatial.mechanism.formats.source import Made, built
from jaxspatial.mechanism.formats.weightless import doubt_weightless
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.types import DTypeLike


def read(
    build: Callable[..., Made],
    path_or_text: Any,
    assets: Mapping[str, bytes] | None = None,
    dtype: DTypeLike | None = None,
    strict: bool = False,
) -> Made:
    """Reads an MJCF for `Mechanism.from_mjcf`: the same arguments and errors, and `Mechanism.build`."""
    file = File(path_or_text, assets, dtype, strict)
    check_representable(file)
    leave_out_the_rest(file)
    with in_double():
        *parts, loops, tendons = read_parts(file)
    mechanism = built(build, file.refuse_part, *parts, file.gravity, dtype, loops, tendons)
    doubt_weightless(file, mechanism)
    file.warn()
    return mechanism

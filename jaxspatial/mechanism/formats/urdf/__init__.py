"""Mechanisms from the Unified Robot Description Format (wiki.ros.org/urdf/XML).

The package yourdfpy reads the files, lxml checks them. Links and joints become bodies and joints of the same name. What
serves pictures, contact or control (visual, collision, transmission, gazebo, calibration, safety_controller ...) is no
part of a mechanism: one `ModelFileWarning` lists it. Everything else is refused, with its line: elements and attributes
that are not known (a misspelt one would change the robot), what comes twice, numbers that are not finite or that the
dtype does not have, joints and inertias that have no counterpart.

Inertias that no rigid body has (a third moment larger than the other two together: a dozen of the robots that are
passed around have such) are taken as they are; the warning lists their links, with the rule that is broken and by how
much, unless the body is possible that a link is a part of with all that is welded to it.
"""

import pathlib
from collections.abc import Callable
from typing import Any, TypeVar

from jaxspatial.arithmetic.types import DTypeLike, Vector3
from jaxspatial.mechanism.formats.numbers import built
from jaxspatial.mechanism.formats.urdf.robot import body, check_joints, check_mimics, joint, robot_of, root_of
from jaxspatial.mechanism.formats.urdf.text import Lines, broken_rule, check
from jaxspatial.mechanism.parts import WORLD, Joint

_ROOT = "root_joint"
Made = TypeVar("Made")


def read(
    build: Callable[..., Made],
    path_or_text: str | pathlib.Path,
    floating_base: bool = False,
    gravity: Vector3 = (0.0, 0.0, -9.81),
    dtype: DTypeLike | None = None,
) -> Made:
    """Reads a URDF: what `Mechanism.from_urdf` calls, with the same arguments and errors, and its `build`.

    The root link is welded to the world, or held by a "free" joint named "root_joint"; a root link named "world" is
    the world.
    """
    lines = Lines(path_or_text, dtype)
    check(lines, lines.root)
    robot = robot_of(lines)
    check_joints(robot, lines)
    check_mimics(robot, lines)
    root = root_of(robot, lines)
    bodies = [body(link, lines) for link in robot.links if link.name != WORLD]
    joints = [joint(part, lines) for part in robot.joints]
    if root != WORLD and floating_base and any(part.name == _ROOT for part in robot.joints):
        lines.refuse("joint", _ROOT, "name: that of the joint which holds a floating base")
    if root != WORLD:
        # Without a name, which no joint of a file can have.
        name, kind = (_ROOT, "free") if floating_base else ("", "fixed")
        joints.insert(0, Joint(name, kind, WORLD, root))
    elif floating_base:
        raise ValueError('from_urdf: floating_base: the root link is "world", which cannot float')
    mechanism = built(build, lines.refuse_made, bodies, joints, (), gravity, dtype)
    for link, why in lines.impossible.items():
        if _is_impossible(mechanism, link):
            lines.notes.doubt("inertia that no rigid body has", why)
    lines.notes.tell()
    return mechanism


def _is_impossible(mechanism: Any, link: str):
    """Whether the body that a link is welded to has such an inertia, with all that is. That of the world is nothing."""
    body = dict(mechanism.topology.frames)[link]
    return body >= 0 and broken_rule(mechanism.inertias.central[body]) is not None

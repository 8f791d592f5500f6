"""The mechanism: a tree of bodies that joints hold against each other, as a pytree of numbers."""

import dataclasses
import functools
import operator
import pathlib
import weakref
from collections.abc import Iterable
from typing import Any, cast

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.tree import tree_of
from jaxspatial.arithmetic.types import DTypeLike, Vector3
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.assembly import assembled
from jaxspatial.mechanism.leaves import ByContents, check_replaced, frozen, known, read_only
from jaxspatial.mechanism.parts import Body, Frame, Joint
from jaxspatial.mechanism.poses import known as known_in_double
from jaxspatial.mechanism.structure import Structure
from jaxspatial.mechanism.topology import Topology
from jaxspatial.spatial import RigidTransform


@tree_of("topology")
class Mechanism(Structure):
    """Bodies held against each other by joints: n of them move, with nq coordinates q and nv rates v.

    Quaternions in q are read normalised, whatever function they are given to: of any length but 0, which gives NaN.

    Its numbers are leaves: NumPy arrays are known while tracing and fold into programs; arrays of JAX, or a mechanism
    that is an argument of a traced function, are data, to be differentiated and batched. Body i is what joint i
    carries; P is its parent's frame, J the joint's, that coincides with it at zero.

    Attributes:
        topology: names, kinds and connections; static.
        placements: RigidTransform (n,), X_PJ at zero.
        child_placements: RigidTransform (n,), X_JB: where the body's own frame is on the joint's.
        axes, second_axes: (n, 3) unit vectors in J.
        pitches: (n,) of helical joints, metres per radian.
        parameters: {name: (n, size)} of other parameters, those of kinds that were registered.
        mimics: (n, 2) multiplier and offset of coordinates that follow another's; 1 and 0 for all others.
        inertias: SpatialInertia (n,) about the origin of J, in the axes of J; bodies welded to it are in it.
        armature, damping, friction_loss, stiffness, effort_limit, velocity_limit: (nv,), units as of `Joint`.
        lower, upper: (nq,) limits of the coordinates.
        spring_references: (nq,) coordinates at which the springs are at rest.
        frame_placements: RigidTransform (k,) of all named frames on their J, or in the world.
        gravity: (3,) acceleration of free fall in the world, m/s2.

    Known numbers take the dtype of q, whatever theirs; data has to have it. NumPy numbers are leaves as well: what
    trains, casts or saves all leaves of a tree takes them for parameters. `as_static` has none.

    A frame is a name for a place on a body, or on the world: every body is one, where its own frame is, and so is
    every body welded to it. `frame_body(name)` is the name of the body that carries a frame, `frame_placements` has
    where on that body's joint it is, `forward_kinematics(mech, q, name)` where in the world.
    """

    topology: Topology
    placements: RigidTransform
    child_placements: RigidTransform
    axes: jax.Array
    second_axes: jax.Array
    pitches: jax.Array
    parameters: dict[str, jax.Array]
    mimics: jax.Array
    inertias: SpatialInertia
    armature: jax.Array
    damping: jax.Array
    friction_loss: jax.Array
    stiffness: jax.Array
    effort_limit: jax.Array
    velocity_limit: jax.Array
    lower: jax.Array
    upper: jax.Array
    spring_references: jax.Array
    frame_placements: RigidTransform
    gravity: jax.Array

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def build(
        cls,
        bodies: Iterable[Body],
        joints: Iterable[Joint],
        frames: Iterable[Frame] = (),
        gravity: Vector3 = (0.0, 0.0, -9.81),
        dtype: DTypeLike | None = None,
    ) -> "Mechanism":
        """Builds a mechanism of bodies that joints hold against each other.

        Bodies held by "fixed" joints become one, their frames stay. Coordinates are in depth-first order, children in
        the order of `joints`. All numbers are known while tracing, also where JAX traces a function around.

        Args:
            bodies: at most one of each name.
            joints: each body is the child of one joint; a body that floats has a "free" one.
            frames: named places on bodies, or on "world".
            gravity: (3,) acceleration of free fall in the world, m/s2.
            dtype: of all numbers; JAX's default for None.

        Returns:
            The mechanism, with NumPy numbers.

        Raises:
            TypeError: a part has another type, or numbers are traced: put these in with `replace`.
            ValueError: a name is missing or comes twice, nothing holds a body against the world, a shape does not fit.
        """
        topology, arrays = assembled(list(bodies), list(joints), list(frames))
        arrays["gravity"] = check.as_vectors(known_in_double(gravity), "Mechanism.build: gravity", held=True)
        return cls(topology=topology, **arrays).astype(dtype)

    @classmethod
    def from_urdf(
        cls,
        path_or_text: str | pathlib.Path,
        floating_base: bool = False,
        *,
        gravity: Vector3 = (0.0, 0.0, -9.81),
        dtype: DTypeLike | None = None,
    ) -> "Mechanism":
        """Reads a file in the Unified Robot Description Format; see `jaxspatial.mechanism.formats.urdf`.

        Args:
            path_or_text: a path, or the text itself, told by its first sign "<".
            floating_base: whether a "free" joint named "root_joint" holds the root link; else it is welded.
            gravity: (3,) acceleration of free fall in the world, m/s2.
            dtype: of all numbers; JAX's default for None.

        Returns:
            The mechanism, with NumPy numbers.

        Raises:
            ValueError: the file is malformed, or has what a mechanism cannot represent; with line, element and reason.
            FileNotFoundError: there is no such file.
            ImportError: yourdfpy or lxml is missing.

        Warns:
            ModelFileWarning: names what was left out, and inertias that no rigid body has.
        """
        from jaxspatial.mechanism.formats import urdf

        return urdf.read(cls.build, path_or_text, floating_base, gravity, dtype)

    @classmethod
    def from_mjcf(cls, path_or_text: str | pathlib.Path, *, dtype: DTypeLike | None = None) -> "Mechanism":
        """Reads a file in MuJoCo's format; see `jaxspatial.mechanism.formats.mjcf`.

        Args:
            path_or_text: a path, or the text itself, told by its first sign "<".
            dtype: of all numbers; JAX's default for None.

        Returns:
            The mechanism with the file's gravity, with NumPy numbers.

        Raises:
            ValueError: MuJoCo does not compile it, or it has what a mechanism cannot represent; with line, element and
                reason.
            FileNotFoundError: there is no such file.
            ImportError: mujoco or lxml is missing.

        Warns:
            ModelFileWarning: names what was left out.
        """
        from jaxspatial.mechanism.formats import mjcf

        return mjcf.read(cls.build, path_or_text, dtype)

    def replace(self, **changes: Any) -> "Mechanism":
        """Replaces arrays: `mech.replace(gravity=...)`, `mech.replace(inertias=...)`.

        Args:
            **changes: fields by name, numbers known or traced.

        Returns:
            The same mechanism with these.

        Raises:
            TypeError: there is no such field, or it holds another type.
            ValueError: the shape is not that of the field.
        """
        for name, new in changes.items():
            check_replaced(Mechanism, name, getattr(self, name, None), new)
        return read_only(self._as_tree(**changes))

    def astype(self, dtype: DTypeLike | None) -> "Mechanism":
        """Converts all arrays to a dtype, JAX's default for None. What is known stays known."""
        dtype = check.as_dtype(dtype)
        return read_only(jax.tree.map(operator.methodcaller("astype", dtype), self._as_tree()))

    def as_data(self) -> "Mechanism":
        """Makes all numbers arrays of JAX: one compiled program serves all values."""
        return jax.tree.map(cast(Any, jax.numpy.asarray), check.narrowed(self._as_tree()))

    def as_known(self) -> "Mechanism":
        """Makes all numbers NumPy, known while tracing: the way back from `as_data` and `as_static`.

        Raises:
            TypeError: numbers are traced.
        """
        return read_only(jax.tree.map(known, self._as_tree()))

    def as_static(self) -> "StaticMechanism":
        """Makes a StaticMechanism of it, without leaves.

        For a field of a learner's module, or an argument of a function under jit that folds.

        Raises:
            TypeError: numbers are traced.
        """
        own = StaticMechanism(**vars(cast(Mechanism, jax.tree.map(frozen, self.as_known()))))
        return _STATIC.setdefault(own.contents, own)

    @functools.cached_property
    def first_data(self) -> Any:
        """The first number that is not known, or None. Kept: every call of an algorithm asks for its dtype."""
        return next((x for x in jax.tree.leaves(self) if not isinstance(x, np.ndarray)), None)

    def _as_tree(self, **changes: Any) -> "Mechanism":
        """A Mechanism with leaves, of these numbers and others."""
        own = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return Mechanism(**own | changes)


class StaticMechanism(Mechanism, ByContents):
    """A Mechanism that is a constant: hashable and equal by its contents, a pytree without leaves.

    `Mechanism.as_static` makes it, the same object for equal ones while one lives. All functions take it as they take
    a Mechanism, and its numbers fold, as an argument of a function under jit as well, without being named static:
    there is one program for each of its contents. Gradients, optimizers, casts and checkpoints see nothing of it.
    `replace`, `as_data` and `as_known` give a Mechanism with leaves. Equal are the tree, its names, dtypes and all
    numbers, bit by bit.
    """

    @functools.cached_property
    def contents(self) -> tuple[Topology, tuple[tuple[str, tuple[int, ...], bytes], ...]]:
        """(topology, the arrays as bytes): what it is equal and hashed by."""
        leaves = jax.tree.leaves(self._as_tree())
        return self.topology, tuple((x.dtype.name, x.shape, x.tobytes()) for x in leaves)

    def __reduce__(self):
        return Mechanism.as_static, (self.as_known(),)

    def astype(self, dtype: DTypeLike | None) -> "StaticMechanism":
        """Converts all arrays to a dtype, JAX's default for None. The result is static too."""
        return super().astype(dtype).as_static()

    def as_static(self) -> "StaticMechanism":
        """Returns itself."""
        return self


# Equal ones are one, which keeps its programs for all who ask.
_STATIC: weakref.WeakValueDictionary[Any, StaticMechanism] = weakref.WeakValueDictionary()
jax.tree_util.register_static(StaticMechanism)

"""The mechanism: a tree of bodies and joints, as a pytree of numbers."""

import dataclasses
import functools
import json
import operator
import pathlib
import weakref
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import jax.export
import numpy as np
from jax.core import Tracer

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism import named
from jaxspatial.mechanism.assembly import assembled, registered_parameters, require_in_range
from jaxspatial.mechanism.loops import LoopClosure, checked_loops
from jaxspatial.mechanism.parts import PER_VELOCITY, WORLD, Body, Frame, Joint, known
from jaxspatial.mechanism.tendons import Tendon, checked_tendons, leaf_shapes
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import as_tuples, tree_of
from jaxspatial.numerics.types import ArrayLike, DTypeLike
from jaxspatial.spatial import RigidTransform


@tree_of("topology")
class Mechanism:
    """A tree of n moving bodies, each carried by a joint, with nq coordinates q and nv generalized velocities v.

    All functions normalise the quaternions in q: any length but 0 serves, and 0 gives NaN.

    The numbers of a mechanism are leaves of a pytree. NumPy arrays are known while tracing and fold into programs.
    Arrays of JAX, or a mechanism that is an argument of a traced function, are data, to be differentiated and batched.
    Joint i carries body i. P is the frame of its parent, J the frame of the joint, which moves with the body.

    Attributes:
        topology: names, kinds and connections; static.
        placements: RigidTransform (n,), X_PJ at zero.
        child_placements: RigidTransform (n,), X_JB: where the body's own frame is on the joint's.
        axes, second_axes: (n, 3) unit vectors in J.
        pitches: (n,) of helical joints, metres per radian.
        parameters: {name: (n, size)} of other parameters, those of kinds that were registered.
        mimics: (n, 2) multiplier and offset of coordinates that follow another's; 1 and 0 for all others.
        inertias: SpatialInertia (n,) about the origin of J, in the axes of J, welded bodies included.
        armature, damping, friction_loss, stiffness, effort_limit, velocity_limit: (nv,), units as of `Joint`.
        lower, upper: (nq,) limits of the coordinates.
        spring_references: (nq,) coordinates at which the springs are at rest.
        frame_placements: RigidTransform (k,) of all named frames on their J, or in the world.
        weld_inertias: SpatialInertia (number of fixed joints,), of all that is welded behind each fixed joint,
            about the origin of the body that it holds, in its axes. Only `joint_reactions` at fixed joints takes
            them: of what moves they are part of `inertias`, too.
        gravity: (3,) acceleration of free fall in the world, m/s2.
        loops: LoopClosures that hold frames together beside the joints. Of all functions those act on them that take
            `loops`: `constrained_forward_dynamics(mech, q, v, tau, mech.loops)`. All others see the tree alone.
        lifts: SpatialInertia (n,), as `inertias`, of what is held against gravity, see `Body`; None for none.
        turn_limits: (n,) largest angles of the rotations of "ball" joints; None where none has any.
        tendons: Tendons over joints. `passive_forces` and the steps act on them.

    Known numbers are converted to the dtype of q; data must have it. NumPy numbers are leaves as well: libraries that
    train, cast or save all leaves of a tree take them for parameters. The result of `as_static` has no leaves.

    A frame is a named place on a body or on the world. Every body is a frame, and so is every body welded to another.
    `frame_body(name)` names the body that carries a frame, `frame_placements` has its pose on the joint of that body,
    and `forward_kinematics(mech, q, name)` is its pose in the world.

    Example:
        >>> arm
        Mechanism(nq=2, nv=2, 2 bodies, float32)
          upper  <- shoulder: revolute
            lower  <- elbow: revolute
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
    weld_inertias: SpatialInertia | None
    lifts: SpatialInertia | None
    turn_limits: jax.Array | None
    tendons: tuple[Tendon, ...]
    gravity: jax.Array
    loops: tuple[LoopClosure, ...] = ()

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def build(
        cls,
        bodies: Iterable[Body],
        joints: Iterable[Joint],
        frames: Iterable[Frame] = (),
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        dtype: DTypeLike | None = None,
        loops: Iterable[LoopClosure] = (),
        tendons: Iterable[Tendon] = (),
    ) -> "Mechanism":
        """Builds a mechanism of bodies and the joints that hold them.

        Bodies held by "fixed" joints merge with those that carry them, and stay as frames. Coordinates are in
        depth-first order, children in the order of `joints`. All numbers are known while tracing.

        Inertias must be finite, and so must, in the dtype, be what the algorithms make of them at any angles: moments
        of each body about its joint, and of all that the joint carries, stretched out; their weights; the mass of all.
        What overflows by large displacements of joints, by velocities, or by numbers that are put in place with
        `replace` and `astype`, is infinite or NaN in results.

        Args:
            bodies: at most one of each name.
            joints: each body is the child of one joint; a body that floats has a "free" one.
            frames: named places on bodies, or on "world".
            gravity: (3,) acceleration of free fall in the world, m/s2.
            dtype: of all numbers; JAX's default for None.
            loops: closures between frames, bodies among them, or the world.
            tendons: Tendons over joints of one coordinate.

        Returns:
            The mechanism, with NumPy numbers.

        Raises:
            KeyError: a closure names no frame, or a tendon no joint; lists those there are.
            TypeError: a part has another type, or numbers are traced: put these in with `replace`.
            ValueError: a name is missing or comes twice, nothing holds a body against the world, a shape does not fit;
                an inertia or gravity is not finite, or masses, moments or weights overflow in the dtype; numbers of a
                joint are NaN, its lower limits above the upper ones, or armature, damping, friction or largest forces
                or velocities below zero.

        Example:
            >>> pole = js.Joint("hinge", "revolute", "world", "pole", axis=(0, 1, 0))
            >>> js.Mechanism.build([js.Body("pole", rod)], [pole])
            Mechanism(nq=1, nv=1, 1 bodies, float32)
              pole  <- hinge: revolute
        """
        topology, arrays = assembled(
            check.as_tuple(bodies, Body, "Mechanism.build: bodies", "Body objects"),
            check.as_tuple(joints, Joint, "Mechanism.build: joints", "Joint objects"),
            check.as_tuple(frames, Frame, "Mechanism.build: frames", "Frame objects"),
        )
        gravity = known(gravity, "Mechanism.build: gravity")
        arrays["gravity"] = floats.as_vectors(gravity, "Mechanism.build: gravity", keep_dtype=True)
        if not np.isfinite(gravity).all():
            raise ValueError(f"Mechanism.build: gravity: expected finite numbers, got {gravity.tolist()}")
        require_in_range(topology, arrays, floats.as_dtype(dtype))
        arrays["loops"] = jax.tree.map(known, checked_loops(loops, topology, "Mechanism.build: loops"))
        arrays["tendons"] = jax.tree.map(known, checked_tendons(tendons, topology, "Mechanism.build: tendons"))
        return cls(topology=topology, **arrays).astype(dtype)

    @classmethod
    def from_urdf(
        cls,
        path_or_text: str | pathlib.Path,
        floating_base: bool = False,
        *,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        dtype: DTypeLike | None = None,
        strict: bool = False,
    ) -> "Mechanism":
        """Reads a file in the Unified Robot Description Format; see `jaxspatial.mechanism.formats.urdf`.

        Args:
            path_or_text: a path, or the text itself, which begins with "<".
            floating_base: whether a "free" joint named "root_joint" holds the root link; else it is welded.
            gravity: (3,) acceleration of free fall in the world, m/s2.
            dtype: of all numbers; JAX's default for None.
            strict: whether to refuse what the format does not allow. Else words that it does not know are left out and
                listed, and what is doubtful is taken as most readers take it, and listed.

        Returns:
            The mechanism, with NumPy numbers.

        Raises:
            TypeError: path_or_text is something else, or floating_base neither True nor False.
            ValueError: the file is malformed, or has what a mechanism cannot represent; with line, element and reason.
            FileNotFoundError: there is no such file.
            ImportError: lxml is missing.

        Warns:
            ModelFileWarning: names coordinates along which nothing has inertia, inertias that no rigid body has, other
                doubts, and unknown words that were left out. Nothing is said of pictures, contact and control.

        Example:
            >>> inertia = '<mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
            >>> link = f'<link name="base"/><link name="arm"><inertial>{inertia}</inertial></link>'
            >>> joint = '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
            >>> lift = f'<robot name="lift">{link}<joint name="lift" type="prismatic">{joint}</joint></robot>'
            >>> print(js.gravity_forces(js.Mechanism.from_urdf(lift), jnp.zeros(1)))
            [19.62]
        """
        from jaxspatial.mechanism.formats import urdf

        # Numbers in its place were meant as gravity.
        if not isinstance(floating_base, bool | np.bool_):
            check.refuse("from_urdf: floating_base", "True or False", floating_base)
        return urdf.read(cls.build, path_or_text, floating_base, gravity, dtype, strict)

    @classmethod
    def from_mjcf(
        cls,
        path_or_text: Any,
        *,
        assets: Mapping[str, bytes] | None = None,
        dtype: DTypeLike | None = None,
        strict: bool = False,
    ) -> "Mechanism":
        """Reads a file in MuJoCo's format; see `jaxspatial.mechanism.formats.mjcf`.

        Args:
            path_or_text: a path; the text itself, which begins with "<"; a mujoco.MjSpec, or a mujoco.MjModel.
            assets: files that the text names, such as meshes, by their names; of a path those that are not beside it.
            dtype: of all numbers; JAX's default for None.
            strict: whether to refuse what changes the motion and is left out else: drag, limits of tendons along ropes.

        Returns:
            The mechanism with the file's gravity, with NumPy numbers.

        Raises:
            TypeError: path_or_text is something else.
            ValueError: MuJoCo does not compile it, or it has what a mechanism cannot represent; with line, element and
                reason. An MjModel has no lines.
            FileNotFoundError: there is no such file.
            ImportError: mujoco or lxml is missing.

        Warns:
            ModelFileWarning: names coordinates along which nothing has inertia, joints and constraints that became
                something else, other doubts, and what was left out that changes the motion.

        Example:
            >>> part = '<joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.5" mass="2"/>'
            >>> pendulum = js.Mechanism.from_mjcf(f"<mujoco><worldbody><body>{part}</body></worldbody></mujoco>")
            >>> print(pendulum.joint_names, js.gravity_forces(pendulum, jnp.array([np.pi / 2])))
            ('hinge',) [9.81]
        """
        from jaxspatial.mechanism.formats import mjcf

        return mjcf.read(cls.build, path_or_text, assets, dtype, strict)

    # -- names and places ---------------------------------------------------------------------------------------------

    @property
    def nq(self) -> int:
        """The number of coordinates."""
        return self.topology.nq

    @property
    def nv(self) -> int:
        """The number of generalized velocities."""
        return self.topology.nv

    @property
    def body_names(self) -> tuple[str, ...]:
        """The names of the moving bodies, in the order of results."""
        return self.topology.body_names

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the joints that move, in the order of bodies: joint i carries body i."""
        return self.topology.joint_names

    @property
    def parents(self) -> tuple[int, ...]:
        """The number of the body that each body hangs on, -1 for the world; lower than its own."""
        return self.topology.parents

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of all frames: the world, all bodies with the welded ones, and the frames given by name."""
        return tuple(name for name, _ in self.topology.frames)

    @property
    def weld_names(self) -> tuple[str, ...]:
        """The names of the fixed joints, which `joint_reactions` takes; "" of the weld that a URDF's base stands on."""
        return tuple(name for name, _ in self.topology.welds)

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(self.gravity.dtype)

    def frame_body(self, name: str) -> str:
        """Names the body that carries a frame: the one it is, is on or is welded to, or "world".

        Raises:
            KeyError: there is no such frame; lists those there are.

        Example:
            >>> arm.frame_body("hand")
            'lower'
        """
        body = self.topology.frames[self.topology.index(self.frame_names, name, "Mechanism.frame_body: name")][1]
        return WORLD if body < 0 else self.body_names[body]

    def joint_position_indices(self, name: str) -> np.ndarray:
        """Returns the places of a joint's coordinates in q: integers (k,).

        Those of a mimic are those of the joint that it follows.

        Raises:
            KeyError: there is no such joint; lists those there are.

        Example:
            >>> arm.joint_position_indices("elbow")
            array([1])
        """
        return np.arange(self.nq)[self.topology.q_slice(self.topology.index(self.joint_names, name, "joint"))]

    def joint_velocity_indices(self, name: str) -> np.ndarray:
        """Returns the places of a joint's velocities in v: integers (k,). Raises as `joint_position_indices`.

        Example:
            >>> arm.joint_velocity_indices("elbow")
            array([1])
        """
        return np.arange(self.nv)[self.topology.v_slice(self.topology.index(self.joint_names, name, "joint"))]

    def neutral(self) -> np.ndarray:
        """Makes the coordinates (nq,) at zero: 0, and 1 0 0 0 for quaternions.

        Example:
            >>> print(arm.neutral())
            [0. 0.]
        """
        t = self.topology
        return np.array([x for i in range(len(t)) if not t.is_mimic(i) for x in t.kind(i).neutral], self.dtype)

    # -- coordinates by name ------------------------------------------------------------------------------------------

    def configuration(self, positions: Mapping[str, Any]) -> jax.Array:
        """Makes q of coordinates by names of joints; those that are not named are neutral.

            q = mech.configuration({"root_joint": X_WB, "elbow": 0.3})

        Nothing has to know the order of q, which is depth first and not that of a file.

        Args:
            positions: by name of a joint: a number or (*batch,) of one with one coordinate, rad or m; (*batch, k) of
                one with k. Of a "free" joint a RigidTransform, the pose across it, which of a floating base is X_WB, or
                7 numbers; of a "ball" joint a Rotation, or 4 numbers. Python numbers take the dtype of arrays beside
                them, and else that of the mechanism.

        Returns:
            q (*batch, nq), over the common batch; NumPy, known while tracing, where all of them are NumPy numbers.

        Raises:
            KeyError: there is no such joint; lists those there are.
            TypeError: a value has another type, or dtypes differ.
            ValueError: a joint is a mimic, or shapes do not fit.

        Example:
            >>> print(arm.configuration({"elbow": 0.5}))
            [0.  0.5]
        """
        return named.of_all_joints(self.topology, named.POSITIONS, positions, self.dtype)

    def joint_positions(self, q: ArrayLike) -> dict[str, Any]:
        """Takes q apart by names of joints: the inverse of `configuration`.

        Args:
            q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).

        Returns:
            By name of a joint that is no mimic, in the order of `joint_names`: (*batch,) of one with one coordinate,
            (*batch, k) of one with k; a RigidTransform of a "free" joint, a Rotation of a "ball" joint.

        Raises:
            TypeError: q is not of floating point.
            ValueError: the shape does not fit.

        Example:
            >>> arm.joint_positions(np.float32([0.1, 0.5]))["elbow"]
            array(0.5, dtype=float32)
        """
        return named.by_joint(self.topology, named.POSITIONS, q, "Mechanism.joint_positions: q")

    def velocities(self, velocities: Mapping[str, Any]) -> jax.Array:
        """Makes v of velocities by names of joints; those that are not named are zero.

            v = mech.velocities({"elbow": 0.5})

        Accelerations and forces of joints are in the same order: `mech.velocities({"elbow": 12.0})` is a tau, too.

        Args:
            velocities: by name of a joint: a number or (*batch,) of one with one velocity, rad/s or m/s; (*batch, k)
                of one with k. Of a "free" joint a SpatialVelocity in the axes of the body, or 6 numbers.

        Returns:
            v (*batch, nv), over the common batch; NumPy where all of them are NumPy numbers.

        Raises:
            as `configuration`.

        Example:
            >>> print(arm.velocities({"elbow": 0.5}))
            [0.  0.5]
        """
        return named.of_all_joints(self.topology, named.VELOCITIES, velocities, self.dtype)

    def joint_velocities(self, v: ArrayLike) -> dict[str, Any]:
        """Takes v apart by names of joints: the inverse of `velocities`.

        Args:
            v: (*batch, nv) generalized velocities: rad/s, m/s.

        Returns:
            By name of a joint that is no mimic: (*batch,) or (*batch, k); a SpatialVelocity of a "free" joint.

        Raises:
            as `joint_positions`.

        Example:
            >>> arm.joint_velocities(np.float32([0.1, 0.5]))["elbow"]
            array(0.5, dtype=float32)
        """
        return named.by_joint(self.topology, named.VELOCITIES, v, "Mechanism.joint_velocities: v")

    def __repr__(self):
        """The tree: one line per body, with its joint."""
        t = self.topology
        # JAX rebuilds trees with leaves that are no arrays: shapes, axes, None.
        dtype = getattr(self.gravity, "dtype", type(self.gravity).__name__)
        lines = [f"{type(self).__name__}(nq={self.nq}, nv={self.nv}, {len(t)} bodies, {dtype})"]
        for i, (body, joint, kind) in enumerate(zip(t.body_names, t.joint_names, t.kinds, strict=True)):
            indent = "  " * len([*t.ancestors(i)])
            follows = f" follows {t.joint_names[t.followed[i]]}" if t.is_mimic(i) else ""
            lines.append(f"{indent}{body}  <- {joint}: {kind}{follows}")
        return "\n".join(lines)

    # -- other numbers ------------------------------------------------------------------------------------------------

    def replace(self, **changes: Any) -> "Mechanism":
        """Replaces arrays: `mech.replace(gravity=...)`, `mech.replace(inertias=...)`; loops and tendons by any others.

        Args:
            **changes: fields by name, numbers known or traced.

        Returns:
            The mechanism with these.

        Raises:
            KeyError: a closure of a loop names no frame, or a tendon no joint; lists those there are.
            TypeError: there is no such field, or it holds another type.
            ValueError: the shape is not that of the field.

        Example:
            >>> light = arm.replace(gravity=np.float32([0.0, 0.0, -1.62]))  # on the Moon
            >>> print(js.gravity_forces(light, q) / js.gravity_forces(arm, q))
            [0.1651 0.1651]
        """
        for name, new in changes.items():
            if name in ("loops", "tendons"):
                checked = checked_loops if name == "loops" else checked_tendons
                changes[name] = checked(new, self.topology, f"Mechanism.replace: {name}")
            else:
                changes[name] = _replacement(name, getattr(self, name, None), new)
        return _read_only(self._as_tree(**changes))

    def astype(self, dtype: DTypeLike | None) -> "Mechanism":
        """Converts all arrays to a dtype, JAX's default for None. Known numbers stay known.

        Nothing is checked as in `build`: what the dtype does not hold becomes infinite.

        Example:
            >>> arm.astype(np.float64).dtype
            dtype('float64')
        """
        dtype = floats.as_dtype(dtype)
        return _read_only(jax.tree.map(operator.methodcaller("astype", dtype), self._as_tree()))

    def as_data(self) -> "Mechanism":
        """Makes all numbers arrays of JAX: one compiled program serves all values.

        Example:
            >>> held = jax.jit(lambda mechanism: js.gravity_forces(mechanism, q))
            >>> print(held(arm.as_data()))  # one program for all masses and lengths
            [17.0086  2.8991]
        """
        return jax.tree.map(jax.numpy.asarray, floats.narrowed(self._as_tree()))

    def _as_known(self) -> "Mechanism":
        """Makes all numbers NumPy, known while tracing: the way back from `as_data` and `as_static`.

        Raises:
            TypeError: numbers are traced.
        """
        leaves = jax.tree.leaves(self._as_tree())
        if traced := [x for x in leaves if isinstance(x, Tracer)]:
            came = type(traced[0]).__name__
            raise TypeError(f"Mechanism._as_known: expected numbers (NumPy or JAX arrays), got {came}, traced")
        return _read_only(jax.tree.map(np.asarray, self._as_tree()))

    def as_static(self) -> "StaticMechanism":
        """Makes a StaticMechanism, without leaves: for a field of a learner's module, or an argument of a jitted
        function that is to fold.

        Raises:
            TypeError: numbers are traced.

        Example:
            >>> static = arm.as_static()
            >>> jax.tree.leaves(static), static == arm.as_static()
            ([], True)
        """
        static = StaticMechanism(**vars(jax.tree.map(_frozen, self._as_known())))
        return _STATIC.setdefault(static.contents, static)

    @functools.cached_property
    def _first_data(self):
        """The first number that is not known, or None. Cached: every call of an algorithm asks for its dtype."""
        return next((x for x in jax.tree.leaves(self) if not isinstance(x, np.ndarray)), None)

    @functools.cached_property
    def _misshapen(self) -> str:
        """What is wrong with the shape of a field, "" for nothing. Cached: every call of an algorithm asks. JAX
        rebuilds mechanisms with any leaves, so nobody has checked them before."""
        for name, expected in _shapes(self.topology, self.parameters, self.tendons).items():
            for x, shape in zip(jax.tree.leaves(getattr(self, name)), expected, strict=False):
                if np.shape(x) != shape:
                    return _unexpected_shape(name, shape, np.shape(x))
        return ""

    @functools.cached_property
    def lifted(self) -> "Mechanism":
        """The mechanism with what is held against gravity in place of its inertias. Cached, with its programs."""
        return self._as_tree(inertias=self.lifts)

    @functools.cached_property
    def in_float32(self) -> "Mechanism":
        """The mechanism with its numbers as float32. Cached, with its programs."""
        return self.astype(np.float32)

    def _as_tree(self, **changes) -> "Mechanism":
        """A Mechanism with leaves, of these numbers and others."""
        return Mechanism(**{field.name: getattr(self, field.name) for field in dataclasses.fields(self)} | changes)


def _shapes(t: Topology, parameters: dict[str, Any], tendons: tuple[Tendon, ...]) -> dict[str, list[tuple[int, ...]]]:
    """{field: the shapes of its leaves}, of the numbers of a mechanism."""
    n, frames, welds = len(t), len(t.frames), len(t.welds)
    inertias: list[tuple[int, ...]] = [(n,), (n, 3), (n, 6)]
    return {
        **dict.fromkeys(("placements", "child_placements"), [(n, 9), (n, 3)]),
        **dict.fromkeys(("axes", "second_axes"), [(n, 3)]),
        "pitches": [(n,)],
        "parameters": [(n, *np.shape(parameters[name])[-1:]) for name in sorted(parameters)],
        "mimics": [(n, 2)],
        **dict.fromkeys(("inertias", "lifts"), inertias),
        **dict.fromkeys(PER_VELOCITY, [(t.nv,)]),
        **dict.fromkeys(("lower", "upper", "spring_references"), [(t.nq,)]),
        "frame_placements": [(frames, 9), (frames, 3)],
        "weld_inertias": [(welds,), (welds, 3), (welds, 6)] if welds else [],
        "gravity": [(3,)],
        "turn_limits": [(n,)],
        "tendons": [shape for tendon in tendons for shape in leaf_shapes(tendon).values()],
    }


def _unexpected_shape(name: str, expected: tuple[int, ...], came: tuple[int, ...]) -> str:
    hint = ""
    if len(came) > len(expected) and came[len(came) - len(expected) :] == expected:
        way_out = f"jax.vmap(lambda x, q: f(mech.as_data().replace({name}=x), q))"
        hint = f"; a batch of mechanisms is mapped over the field: {way_out}"
    return f"{name}: expected shape {expected}, got {came}{hint}"


def _replacement(name: str, old, new):
    """The new numbers of a field, checked; integers of NumPy as floats."""
    if old is None or name == "topology":
        fields = [field.name for field in dataclasses.fields(Mechanism) if field.name != "topology"]
        near = check.did_you_mean(name, fields)
        raise TypeError(f"Mechanism.replace: expected one of {', '.join(fields)}, got {name!r}{near}")
    structures = [jax.tree.structure(x) for x in (old, new)]
    if structures[0] != structures[1]:
        types = [type(x).__name__ for x in (old, new)]
        expected, came = types if types[0] != types[1] else structures
        raise TypeError(f"Mechanism.replace: {name}: expected {expected}, got {came}")

    def checked(a, b):
        if np.shape(a) != np.shape(b):
            raise ValueError(f"Mechanism.replace: {_unexpected_shape(name, np.shape(a), np.shape(b))}")
        array = floats.as_float_array(b, f"Mechanism.replace: {name}", floats.floating_dtype(a), keep_dtype=True)
        return array if isinstance(b, np.ndarray) else b

    return jax.tree.map(checked, old, new)


def _read_only(mechanism: Mechanism) -> Mechanism:
    """Copies NumPy arrays that others may write to. Programs are compiled for the values, and looked up by the
    mechanism."""
    return jax.tree.map(
        lambda x: _frozen(x) if isinstance(x, np.ndarray) and (x.base is not None or x.flags.writeable) else x,
        mechanism,
    )


def _frozen(x):
    """A copy that nobody can write to."""
    x = np.array(x, order="C")
    x.flags.writeable = False
    return x


# -- mechanisms that are constants ------------------------------------------------------------------------------------


class StaticMechanism(Mechanism):
    """A Mechanism that is a constant: hashable and equal by its contents, a pytree without leaves.

    `Mechanism.as_static` makes it; equal ones are the same object while one lives. All functions take it as they take
    a Mechanism. Its numbers fold also where it is an argument of a jitted function, which need not be named static:
    each value has a program. Gradients, optimizers, casts and checkpoints pass it by. `replace` and `as_data`
    give a Mechanism with leaves. Two are equal when tree, names, dtypes and all bits of the numbers are.

    Example:
        >>> static = arm.as_static()
        >>> hash(static) == hash(arm.as_static()), jax.tree.leaves(static)
        (True, [])
    """

    @functools.cached_property
    def contents(self) -> tuple:
        """(topology, what else there is and its names, the arrays as bytes): what decides equality and hash."""
        leaves = jax.tree.leaves(self._as_tree())
        loops = tuple((x.frame_a, x.frame_b, x.kind) for x in self.loops)
        tendons = tuple((x.name, x.joints) for x in self.tendons)
        arrays = tuple((x.dtype.name, x.shape, x.tobytes()) for x in leaves)
        return self.topology, (loops, tendons, self.lifts is not None, self.turn_limits is not None), arrays

    @functools.cached_property
    def _hash(self):
        return hash(self.contents)

    def __hash__(self):
        return self._hash

    def __eq__(self, other: object):
        return self is other or (isinstance(other, StaticMechanism) and self.contents == other.contents)

    def __reduce__(self):
        return Mechanism.as_static, (self._as_known(),)

    def astype(self, dtype: DTypeLike | None) -> "StaticMechanism":
        """Converts all arrays to a dtype, JAX's default for None. The result is static too.

        Example:
            >>> print(arm.as_static().astype(np.float16).dtype)
            float16
        """
        return super().astype(dtype).as_static()

    def as_static(self) -> "StaticMechanism":
        """Returns itself.

        Example:
            >>> fixed = arm.as_static()
            >>> print(fixed.as_static() is fixed)
            True
        """
        return self


# Equal ones are one object, which keeps its programs for all who ask.
_STATIC: weakref.WeakValueDictionary[Any, StaticMechanism] = weakref.WeakValueDictionary()
jax.tree_util.register_static(StaticMechanism)


# -- exported programs ------------------------------------------------------------------------------------------------
# They hold the tree as JSON, and of a StaticMechanism its arrays too.


def _static_to_bytes(static: StaticMechanism):
    topology, others, arrays = static.contents
    as_text = [(name, shape, x.hex()) for name, shape, x in arrays]
    return json.dumps([dataclasses.astuple(topology), others, as_text]).encode()


def _static_from_bytes(data: bytes):
    fields, (loops, tendons, has_lifts, has_turn_limits), arrays = json.loads(data)
    topology = Topology(*as_tuples(fields))
    leaves = [np.frombuffer(bytes.fromhex(x), np.dtype(name)).reshape(shape) for name, shape, x in arrays]
    parameters = {p.name: 0 for p in registered_parameters(topology.kinds)}
    loops = tuple(LoopClosure(a, b, kind, 1.0 if kind == "distance" else None) for a, b, kind in loops)
    tendons = tuple(Tendon(name, joints, [0.0] * len(joints)) for name, joints in tendons)
    empty = Mechanism.build([], [])
    like = dataclasses.replace(empty, topology=topology, parameters=parameters, loops=loops, tendons=tendons)
    if topology.welds:
        like = dataclasses.replace(like, weld_inertias=like.inertias)
    if has_lifts:
        like = dataclasses.replace(like, lifts=like.inertias)
    if has_turn_limits:
        like = dataclasses.replace(like, turn_limits=like.pitches)
    return jax.tree.unflatten(jax.tree.structure(like), leaves).as_static()


jax.export.register_pytree_node_serialization(
    Mechanism,
    serialized_name="jaxspatial.Mechanism",
    serialize_auxdata=lambda structure: json.dumps(dataclasses.astuple(structure[0])).encode(),
    deserialize_auxdata=lambda data: (Topology(*as_tuples(json.loads(data))),),
)
jax.export.register_pytree_node_serialization(
    StaticMechanism,
    serialized_name="jaxspatial.StaticMechanism",
    serialize_auxdata=_static_to_bytes,
    deserialize_auxdata=_static_from_bytes,
    from_children=lambda aux_data, children: aux_data,
)

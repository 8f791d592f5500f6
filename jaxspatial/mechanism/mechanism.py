"""The mechanism: a tree of bodies that joints hold against each other, as a pytree of numbers."""

import dataclasses
import functools
import json
import weakref

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.tree import tree_of
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.assembly import assembled, known
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.mechanism.topology import Topology
from jaxspatial.spatial import RigidTransform

# What `from_urdf` and its like call; the readers enter themselves.
READERS = {}


@tree_of("topology")
class Mechanism:
    """Bodies held against each other by joints: n of them move, with nq coordinates q and nv rates v.

    Its numbers are leaves: NumPy arrays are known while tracing and fold into programs; arrays of JAX, or a mechanism
    that is an argument of a traced function, are data, to be differentiated and batched. Body i is what joint i
    carries; P is its parent's frame, J the joint's, that coincides with it at zero.

    topology: names, kinds and connections; static
    placements: RigidTransform (n,), X_PJ at zero
    child_placements: RigidTransform (n,), X_JB: where the body's own frame is on the joint's
    axes, second_axes: (n, 3) unit vectors in J
    pitches: (n,) of helical joints, metres per radian
    mimics: (n, 2) multiplier and offset of coordinates that follow another's; 1 and 0 for all others
    inertias: SpatialInertia (n,) about the origin of J, in the axes of J; bodies welded to it are in it
    armature, damping, friction_loss, stiffness, effort_limit, velocity_limit: (nv,)
    lower, upper: (nq,) limits of the coordinates
    spring_references: (nq,) coordinates at which the springs are at rest
    frame_placements: RigidTransform (k,) of all named frames on their J, or in the world
    gravity: (3,) acceleration of free fall in the world, m/s2

    Known numbers take the dtype of q, whatever theirs; data has to have it. NumPy numbers are leaves as well: what
    trains, casts or saves all leaves of a tree takes them for parameters. `as_static` has none.

    A frame is a name for a place on a body, or on the world: every body is one, where its own frame is, and so is
    every body welded to it. `frame_body(name)` is the name of the body that carries a frame, `frame_placements` has
    where on that body's joint it is, `forward_kinematics(mech, q, [name])` where in the world.
    """

    topology: Topology
    placements: RigidTransform
    child_placements: RigidTransform
    axes: jax.Array
    second_axes: jax.Array
    pitches: jax.Array
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
    def build(cls, bodies, joints, frames=(), gravity=(0.0, 0.0, -9.81), dtype=None):
        """From lists of Body, Joint and Frame; see there. Bodies held by "fixed" joints become one, their frames stay.

        Coordinates are in depth-first order, children in the order of `joints`. Everything is known while tracing, in
        `dtype`, JAX's default for None; this works while JAX traces a function around, too. Raises ValueError for
        names that are missing or come twice and for bodies that nothing holds against the world: add a "free" joint
        for one that floats. Raises TypeError for numbers that are traced: put them in with `replace`.
        """
        topology, arrays = assembled(list(bodies), list(joints), list(frames))
        gravity = check.as_vectors(known(gravity), "Mechanism.build: gravity", held=True)
        return cls(topology=topology, gravity=np.asarray(gravity, np.float64), **arrays).astype(dtype)

    @classmethod
    def from_urdf(cls, path_or_text, floating_base=False, *, gravity=(0.0, 0.0, -9.81), dtype=None):
        """From a file in the Unified Robot Description Format, or its text. With a floating base, a "free" joint named
        "root_joint" holds the root link. See `jaxspatial.interop.urdf`."""
        return READERS["urdf"](path_or_text, floating_base, gravity, dtype)

    @classmethod
    def from_mjcf(cls, path_or_text, *, dtype=None):
        """From a file of MuJoCo's format, or its text. See `jaxspatial.interop.mjcf`."""
        return READERS["mjcf"](path_or_text, dtype)

    def replace(self, **changes):
        """The same with other arrays: `mech.replace(gravity=...)`, `mech.replace(inertias=...)`.

        Raises ValueError for a shape that is not the one it takes the place of, TypeError for another type.
        """
        for name, new in changes.items():
            _check_replaced(name, getattr(self, name, None), new)
        return _read_only(self._as_tree(**changes))

    def astype(self, dtype):
        """The same with all arrays in another dtype, JAX's default for None; what is known stays known."""
        dtype = check.as_dtype(dtype)
        return _read_only(jax.tree.map(lambda x: x.astype(dtype), self._as_tree()))

    def as_data(self):
        """The same with all numbers as data: one compiled program for all values."""
        return jax.tree.map(jax.numpy.asarray, check.narrowed(self._as_tree()))

    def as_known(self):
        """The same with all numbers known while tracing, NumPy: the way back from `as_data` and `as_static`.

        Raises TypeError for numbers that are traced.
        """
        return _read_only(jax.tree.map(_known, self._as_tree()))

    def as_static(self):
        """The same as a StaticMechanism, without leaves: for a field of a learner's module, or an argument of a
        function under jit that folds.

        Raises TypeError for numbers that are traced.
        """
        own = StaticMechanism(**vars(jax.tree.map(_frozen, self.as_known())))
        return _STATIC.setdefault(own.contents, own)

    def _as_tree(self, **changes):
        """A Mechanism with leaves, of these numbers and others."""
        return Mechanism(**{field.name: getattr(self, field.name) for field in dataclasses.fields(self)} | changes)

    # -- structure ----------------------------------------------------------------------------------------------------

    @property
    def nq(self):
        """How many coordinates there are."""
        return self.topology.nq

    @property
    def nv(self):
        """How many rates there are."""
        return self.topology.nv

    @property
    def body_names(self):
        """Of every body that a joint carries, in the order of results."""
        return self.topology.body_names

    @property
    def joint_names(self):
        """Of every joint that moves, in the order of bodies."""
        return self.topology.joint_names

    @property
    def frame_names(self):
        """Of all frames: the world, bodies (welded ones too), and those named apart."""
        return tuple(name for name, _ in self.topology.frames)

    @property
    def dtype(self):
        return np.dtype(self.gravity.dtype)

    def frame_body(self, name):
        """The name of the body that carries a frame: itself, the one it is welded to, or "world"."""
        body = self.topology.frames[self.topology.index(self.frame_names, name, "Mechanism.frame_body: name")][1]
        return WORLD if body < 0 else self.body_names[body]

    def joint_position_indices(self, name):
        """Where in q the coordinates of a joint are; those of a mimic are its master's."""
        return np.arange(self.nq)[self.topology.q_slice(self._joint(name))]

    def joint_velocity_indices(self, name):
        """Where in v the rates of a joint are."""
        return np.arange(self.nv)[self.topology.v_slice(self._joint(name))]

    def _joint(self, name):
        return self.topology.index(self.joint_names, name, "joint")

    def neutral(self):
        """q (nq,) at zero: 0, and 1 0 0 0 for quaternions."""
        own = (i for i in range(len(self.topology)) if not self.topology.is_mimic(i))
        return np.array([x for i in own for x in self.topology.kind(i).neutral], self.dtype)

    def __repr__(self):
        """The tree: one line per body, with its joint."""
        t = self.topology
        head = f"{type(self).__name__}(nq={self.nq}, nv={self.nv}, {len(t)} bodies, {self.dtype.name})"
        return "\n".join([head, *(self._line(i) for i in range(len(t)))])

    def _line(self, i):
        t = self.topology
        indent = "  " * sum(1 for _ in t.ancestors(i))
        follows = f" follows {t.joint_names[t.masters[i]]}" if t.is_mimic(i) else ""
        return f"{indent}{t.body_names[i]}  <- {t.joint_names[i]}: {t.kinds[i]}{follows}"


def _read_only(mechanism):
    """With NumPy numbers of its own that nobody writes to: programs are made for their values, and found again by the
    mechanism."""
    return jax.tree.map(_of_its_own, mechanism)


def _of_its_own(x):
    is_ready = not isinstance(x, np.ndarray) or (x.base is None and not x.flags.writeable)
    return x if is_ready else _frozen(x)


def _check_replaced(name, old, new):
    if old is None or name == "topology":
        fields = ", ".join(f.name for f in dataclasses.fields(Mechanism) if f.name != "topology")
        raise TypeError(f"Mechanism.replace: expected one of {fields}, got {name!r}")
    if jax.tree.structure(old) != jax.tree.structure(new):
        raise TypeError(f"Mechanism.replace: {name}: expected {type(old).__name__}, got {type(new).__name__}")
    for a, b in zip(jax.tree.leaves(old), jax.tree.leaves(new), strict=True):
        if np.shape(a) != np.shape(b):
            raise ValueError(f"Mechanism.replace: {name}: expected shape {np.shape(a)}, got {np.shape(b)}")


def _known(x):
    if isinstance(x, jax.core.Tracer):
        raise TypeError(f"Mechanism.as_known: expected numbers (NumPy or JAX arrays), got {type(x).__name__}, traced")
    return np.asarray(x)


def _frozen(x):
    """A copy that nobody can write to."""
    x = np.array(x, order="C")
    x.flags.writeable = False
    return x


# -- without leaves ---------------------------------------------------------------------------------------------------


class StaticMechanism(Mechanism):
    """A Mechanism that is a constant: hashable and equal by its contents, a pytree without leaves.

    `Mechanism.as_static` makes it, the same object for equal ones while one lives. All functions take it as they take
    a Mechanism, and its numbers fold, as an argument of a function under jit as well, without being named static:
    there is one program for each of its contents. Gradients, optimizers, casts and checkpoints see nothing of it.
    `replace`, `as_data` and `as_known` give a Mechanism with leaves. Equal are the tree, its names, dtypes and all
    numbers, bit by bit.
    """

    @functools.cached_property
    def contents(self):
        """(topology, the arrays as bytes): what it is equal and hashed by."""
        leaves = jax.tree.leaves(self._as_tree())
        return self.topology, tuple((x.dtype.name, x.shape, x.tobytes()) for x in leaves)

    @functools.cached_property
    def _hash(self):
        return hash(self.contents)

    def __hash__(self):
        return self._hash

    def __eq__(self, other):
        return self is other or (isinstance(other, StaticMechanism) and self.contents == other.contents)

    def __reduce__(self):
        return Mechanism.as_static, (self.as_known(),)

    def astype(self, dtype):
        """The same in another dtype, JAX's default for None, static too."""
        return super().astype(dtype).as_static()

    def as_static(self):
        """Itself."""
        return self


# Equal ones are one, which keeps its programs for all who ask.
_STATIC = weakref.WeakValueDictionary()
jax.tree_util.register_static(StaticMechanism)


# -- export -----------------------------------------------------------------------------------------------------------


def _to_bytes(structure):
    return json.dumps(dataclasses.astuple(structure[0])).encode()


def _from_bytes(data):
    return (Topology(*map(_as_tuples, json.loads(data))),)


def _as_tuples(x):
    return tuple(map(_as_tuples, x)) if isinstance(x, list) else x


def _static_to_bytes(static):
    topology, arrays = static.contents
    return json.dumps([dataclasses.astuple(topology), [(*x, data.hex()) for *x, data in arrays]]).encode()


def _static_from_bytes(data):
    topology, arrays = json.loads(data)
    leaves = [np.frombuffer(bytes.fromhex(x), np.dtype(name)).reshape(shape) for name, shape, x in arrays]
    structure = jax.tree.structure(Mechanism.build([], [])._as_tree(topology=Topology(*map(_as_tuples, topology))))
    return jax.tree.unflatten(structure, leaves).as_static()


jax.export.register_pytree_node_serialization(
    Mechanism, serialized_name="jaxspatial.Mechanism", serialize_auxdata=_to_bytes, deserialize_auxdata=_from_bytes
)
jax.export.register_pytree_node_serialization(
    StaticMechanism,
    serialized_name="jaxspatial.StaticMechanism",
    serialize_auxdata=_static_to_bytes,
    deserialize_auxdata=_static_from_bytes,
    from_children=lambda static, _: static,
)

"""The mechanism: a tree of bodies that joints hold against each other, as a pytree of numbers."""

import dataclasses
import json

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.tree import tree_of
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.assembly import assembled, known
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

    Known numbers take the dtype of q, whatever theirs; data has to have it.
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
        return dataclasses.replace(self, **changes)

    def astype(self, dtype):
        """The same with all arrays in another dtype, JAX's default for None; what is known stays known."""
        dtype = check.as_dtype(dtype)
        return jax.tree.map(lambda x: x.astype(dtype), self)

    def as_data(self):
        """The same with all numbers as data: one compiled program for all values."""
        return jax.tree.map(jax.numpy.asarray, self)

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
        head = f"Mechanism(nq={self.nq}, nv={self.nv}, {len(t)} bodies, {self.dtype.name})"
        return "\n".join([head, *(self._line(i) for i in range(len(t)))])

    def _line(self, i):
        t = self.topology
        indent = "  " * sum(1 for _ in t.ancestors(i))
        follows = f" follows {t.joint_names[t.masters[i]]}" if t.is_mimic(i) else ""
        return f"{indent}{t.body_names[i]}  <- {t.joint_names[i]}: {t.kinds[i]}{follows}"


def _check_replaced(name, old, new):
    if old is None or name == "topology":
        fields = ", ".join(f.name for f in dataclasses.fields(Mechanism) if f.name != "topology")
        raise TypeError(f"Mechanism.replace: expected one of {fields}, got {name!r}")
    if jax.tree.structure(old) != jax.tree.structure(new):
        raise TypeError(f"Mechanism.replace: {name}: expected {type(old).__name__}, got {type(new).__name__}")
    for a, b in zip(jax.tree.leaves(old), jax.tree.leaves(new), strict=True):
        if np.shape(a) != np.shape(b):
            raise ValueError(f"Mechanism.replace: {name}: expected shape {np.shape(a)}, got {np.shape(b)}")


# -- export -----------------------------------------------------------------------------------------------------------


def _to_bytes(structure):
    return json.dumps(dataclasses.astuple(structure[0])).encode()


def _from_bytes(data):
    return (Topology(*map(_as_tuples, json.loads(data))),)


def _as_tuples(x):
    return tuple(map(_as_tuples, x)) if isinstance(x, list) else x


jax.export.register_pytree_node_serialization(
    Mechanism, serialized_name="jaxspatial.Mechanism", serialize_auxdata=_to_bytes, deserialize_auxdata=_from_bytes
)

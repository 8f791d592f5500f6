"""What a mechanism says of its structure: names, and where things are."""

import jax
import numpy as np

from jaxspatial.mechanism.parts import WORLD
from jaxspatial.mechanism.topology import Topology


class Structure:
    """Of a topology, and numbers of a dtype: a part of `Mechanism`."""

    topology: Topology
    gravity: jax.Array

    @property
    def nq(self) -> int:
        """The number of coordinates."""
        return self.topology.nq

    @property
    def nv(self) -> int:
        """The number of rates."""
        return self.topology.nv

    @property
    def body_names(self) -> tuple[str, ...]:
        """The names of all bodies that a joint carries, in the order of results."""
        return self.topology.body_names

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of all joints that move, in the order of bodies."""
        return self.topology.joint_names

    @property
    def frame_names(self) -> tuple[str, ...]:
        """The names of all frames: the world, bodies (welded ones too), and those named apart."""
        return tuple(name for name, _ in self.topology.frames)

    @property
    def dtype(self) -> np.dtype:
        """The dtype of its numbers."""
        return np.dtype(self.gravity.dtype)

    def frame_body(self, name: str) -> str:
        """Names the body that carries a frame: itself, the one it is welded to, or "world".

        Raises:
            KeyError: there is no such frame; lists those there are.
        """
        body = self.topology.frames[self.topology.index(self.frame_names, name, "Mechanism.frame_body: name")][1]
        return WORLD if body < 0 else self.body_names[body]

    def joint_position_indices(self, name: str) -> np.ndarray:
        """Tells where in q the coordinates of a joint are: integers (k,).

        Those of a mimic are those of the joint that it follows.

        Raises:
            KeyError: there is no such joint; lists those there are.
        """
        return np.arange(self.nq)[self.topology.q_slice(self._joint(name))]

    def joint_velocity_indices(self, name: str) -> np.ndarray:
        """Tells where in v the rates of a joint are: integers (k,). Raises as `joint_position_indices`."""
        return np.arange(self.nv)[self.topology.v_slice(self._joint(name))]

    def _joint(self, name: str):
        return self.topology.index(self.joint_names, name, "joint")

    def neutral(self) -> np.ndarray:
        """Makes the coordinates (nq,) at zero: 0, and 1 0 0 0 for quaternions."""
        own = (i for i in range(len(self.topology)) if not self.topology.is_mimic(i))
        return np.array([x for i in own for x in self.topology.kind(i).neutral], self.dtype)

    def __repr__(self):
        """The tree: one line per body, with its joint."""
        t = self.topology
        # Of a tree that JAX rebuilt leaves may be anything: shapes, axes, None.
        numbers = getattr(self.gravity, "dtype", type(self.gravity).__name__)
        head = f"{type(self).__name__}(nq={self.nq}, nv={self.nv}, {len(t)} bodies, {numbers})"
        return "\n".join([head, *(self._line(i) for i in range(len(t)))])

    def _line(self, i: int):
        t = self.topology
        indent = "  " * sum(1 for _ in t.ancestors(i))
        follows = f" follows {t.joint_names[t.followed[i]]}" if t.is_mimic(i) else ""
        return f"{indent}{t.body_names[i]}  <- {t.joint_names[i]}: {t.kinds[i]}{follows}"

"""A mechanism without leaves: a constant to JAX, equal by its contents."""

import functools
import weakref
from typing import Any

import jax

from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.mechanism.leaves import frozen
from jaxspatial.mechanism.mechanism import Mechanism
from jaxspatial.mechanism.topology import Topology


def static(mechanism: Mechanism) -> "StaticMechanism":
    """The one StaticMechanism of these numbers, while it lives. Raises TypeError for numbers that are traced."""
    own = StaticMechanism(**vars(jax.tree.map(frozen, mechanism.as_known())))
    return _STATIC.setdefault(own.contents, own)


class StaticMechanism(Mechanism):
    """A Mechanism that is a constant: hashable and equal by its contents, a pytree without leaves.

    `Mechanism.as_static` makes it, the same object for equal ones while one lives. All functions take it as they take
    a Mechanism, and its numbers fold, as an argument of a function under jit as well, without being named static:
    there is one program for each of its contents. Gradients, optimizers, casts and checkpoints see nothing of it.
    `replace`, `as_data` and `as_known` give a Mechanism with leaves. Equal are the tree, its names, dtypes and all
    numbers, bit by bit.
    """

    @functools.cached_property
    def contents(self) -> tuple[Topology, tuple[Any, ...]]:
        """(topology, the arrays as bytes): what it is equal and hashed by."""
        leaves = jax.tree.leaves(self._as_tree())
        return self.topology, tuple((x.dtype.name, x.shape, x.tobytes()) for x in leaves)

    @functools.cached_property
    def _hash(self):
        return hash(self.contents)

    def __hash__(self):
        return self._hash

    def __eq__(self, other: object):
        return self is other or (isinstance(other, StaticMechanism) and self.contents == other.contents)

    def __reduce__(self):
        return Mechanism.as_static, (self.as_known(),)

    def astype(self, dtype: DTypeLike | None) -> "StaticMechanism":
        """Converts all arrays to a dtype, JAX's default for None. The result is static too."""
        return super().astype(dtype).as_static()

    def as_static(self) -> "StaticMechanism":
        """Returns itself."""
        return self


# Equal ones are one, which keeps its programs for all who ask.
_STATIC = weakref.WeakValueDictionary()
jax.tree_util.register_static(StaticMechanism)

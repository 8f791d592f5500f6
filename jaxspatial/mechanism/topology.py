"""The static part of a mechanism: which body hangs on which, by which kind of joint, and where its coordinates are."""

import dataclasses
import functools
import itertools
from typing import NamedTuple

from jaxspatial.mechanism.joints import KINDS

# Chains of equal joints at least as long as this run as loops: written out, they would compile for minutes.
LONG_CHAIN = 64


class Segment(NamedTuple):
    """The bodies start to stop - 1: one, or a chain of which each but the first is the only child of the one before."""

    start: int
    stop: int
    parent: int

    @property
    def is_chain(self):
        return self.stop - self.start > 1


@dataclasses.dataclass(frozen=True)
class Topology:
    """Body i is what joint i carries; parents come first, -1 is the world.

    masters: the joint that joint i follows, or i. frames: (name, body) of all frames, -1 on the world.
    """

    body_names: tuple
    joint_names: tuple
    kinds: tuple
    parents: tuple
    masters: tuple
    frames: tuple = ()

    def __hash__(self):
        return self._hash

    @functools.cached_property
    def _hash(self):
        return hash((self.body_names, self.joint_names, self.kinds, self.parents, self.masters, self.frames))

    def __len__(self):
        return len(self.parents)

    def kind(self, i):
        return KINDS[self.kinds[i]]

    def is_mimic(self, i):
        return self.masters[i] != i

    @property
    def has_mimics(self):
        return any(map(self.is_mimic, range(len(self))))

    @functools.cached_property
    def q_starts(self):
        """Where the coordinates of each joint begin, and their number at the end; those of a mimic are its master's."""
        return self._starts([kind.nq for kind in map(self.kind, range(len(self)))])

    @functools.cached_property
    def v_starts(self):
        return self._starts([kind.nv for kind in map(self.kind, range(len(self)))])

    def _starts(self, sizes):
        own = [0 if self.is_mimic(i) else size for i, size in enumerate(sizes)]
        starts = [0, *itertools.accumulate(own)]
        return (*(starts[master] for master in self.masters), starts[-1])

    @property
    def nq(self):
        return self.q_starts[-1]

    @property
    def nv(self):
        return self.v_starts[-1]

    def q_slice(self, i):
        return slice(self.q_starts[i], self.q_starts[i] + self.kind(i).nq)

    def v_slice(self, i):
        return slice(self.v_starts[i], self.v_starts[i] + self.kind(i).nv)

    @functools.cached_property
    def children(self):
        children = tuple([] for _ in self.parents)
        for i, parent in enumerate(self.parents):
            if parent >= 0:
                children[parent].append(i)
        return children

    def ancestors(self, i):
        """Body i and what it hangs on, towards the base."""
        while i >= 0:
            yield i
            i = self.parents[i]

    @functools.cached_property
    def segments(self):
        """All bodies, parents first, long chains of equal joints as one."""
        found, i = [], 0
        while i < len(self):
            stop = i + 1
            while stop < len(self) and self._continues(stop):
                stop += 1
            stop = stop if stop - i >= LONG_CHAIN else i + 1
            found.append(Segment(i, stop, self.parents[i]))
            i = stop
        return tuple(found)

    def _continues(self, i):
        """Whether body i is the only child of the one before, by a joint of the same kind, and neither follows."""
        is_only = self.parents[i] == i - 1 and len(self.children[i - 1]) == 1
        return is_only and self.kinds[i] == self.kinds[i - 1] and not (self.is_mimic(i) or self.is_mimic(i - 1))

    def index(self, names, name, what):
        """Where a name is among others; raises KeyError that lists what there is."""
        if name not in names:
            raise KeyError(f"{what}: expected one of {', '.join(map(repr, names))}, got {name!r}")
        return names.index(name)

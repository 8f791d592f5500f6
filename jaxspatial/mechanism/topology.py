"""The static part of a mechanism: which body hangs on which, by which kind of joint, and where its coordinates are."""

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.mechanism.joints import KINDS, JointKind, kind_named

T = TypeVar("T")


class Chains(NamedTuple):
    """Chains of joints of one kind and one length, side by side.

    starts: the first body of each chain; the others follow it. parents: the body that each chain hangs on.
    """

    kind: type[JointKind]
    length: int
    starts: tuple[int, ...]
    parents: tuple[int, ...]

    @property
    def width(self):
        return len(self.starts)

    @property
    def ends(self):
        return tuple(start + self.length - 1 for start in self.starts)

    @property
    def bodies(self):
        """(length, width) of their numbers."""
        return np.arange(self.length)[:, None] + np.array(self.starts)


@dataclasses.dataclass(frozen=True)
class Bundle:
    """Chains of joints of one kind, groups of equal ones one after the other: what a recursion takes as one loop.

    A row of it is as wide as the widest group. Where a group is narrower, its first chain stands there again: its twins
    are computed beside it, and nobody asks for them.
    """

    groups: tuple[Chains, ...]

    @property
    def kind(self):
        return self.groups[0].kind

    @functools.cached_property
    def width(self):
        return max(group.width for group in self.groups)

    @functools.cached_property
    def length(self):
        return sum(group.length for group in self.groups)

    @property
    def is_on_world(self):
        """Whether its bodies hang on the world."""
        return self.groups[0].parents[0] < 0

    @functools.cached_property
    def bodies(self):
        """(length, width) of their numbers."""
        return np.concatenate([group.bodies[:, list(self._slots(group))] for group in self.groups])

    def _slots(self, group: Chains):
        """The chain of a group that stands in each column."""
        return (*range(group.width), *[0] * (self.width - group.width))

    def by_column(self, group: Chains, of_chains: Sequence[T]):
        """What there is for each chain of a group, by column."""
        return [of_chains[c] for c in self._slots(group)]

    @property
    def ends(self):
        return tuple(i for group in self.groups for i in group.ends)

    @functools.cached_property
    def own_rows(self):
        """Where, with chains one behind the other, all are but the twins."""
        is_own = np.concatenate(
            [np.tile(np.arange(self.width) < group.width, (group.length, 1)) for group in self.groups]
        )
        return np.flatnonzero(is_own.T)

    @functools.cached_property
    def own_bodies(self):
        """Their bodies."""
        return self.bodies.T.ravel()[self.own_rows]

    @property
    def cost(self):
        """Of its rows: what all chains together do, and what a row costs by itself."""
        return self.length * (self.width + 1)


@dataclasses.dataclass(frozen=True)
class Topology:
    """Body i is what joint i carries; parents come first, -1 is the world.

    followed: the joint whose coordinate that of joint i follows, or i.
    frames: (name, body) of all frames, -1 on the world.
    """

    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    kinds: tuple[str, ...]
    parents: tuple[int, ...]
    followed: tuple[int, ...]
    frames: tuple[tuple[str, int], ...] = ()

    def __hash__(self):
        return self._hash

    def __reduce__(self):
        """By its fields: hashes of names differ from one process to the next."""
        return Topology, dataclasses.astuple(self)

    @functools.cached_property
    def _hash(self):
        return hash((self.body_names, self.joint_names, self.kinds, self.parents, self.followed, self.frames))

    def __len__(self):
        return len(self.parents)

    def kind(self, i: int):
        return kind_named(self.kinds[i])

    def is_mimic(self, i: int):
        return self.followed[i] != i

    @property
    def has_mimics(self):
        return any(map(self.is_mimic, range(len(self))))

    def has_mimics_in(self, bundle: Bundle):
        return any(map(self.is_mimic, bundle.bodies.ravel().tolist()))

    @functools.cached_property
    def q_starts(self):
        """Where the coordinates of each joint begin, and their number at the end; a mimic has none of its own."""
        return self._starts([kind.nq for kind in map(self.kind, range(len(self)))])

    @functools.cached_property
    def v_starts(self):
        return self._starts([kind.nv for kind in map(self.kind, range(len(self)))])

    def _starts(self, sizes: list[int]):
        own = [0 if self.is_mimic(i) else size for i, size in enumerate(sizes)]
        starts = [0, *itertools.accumulate(own)]
        return (*(starts[i] for i in self.followed), starts[-1])

    @property
    def nq(self):
        return self.q_starts[-1]

    @property
    def nv(self):
        return self.v_starts[-1]

    def q_slice(self, i: int):
        return slice(self.q_starts[i], self.q_starts[i] + self.kind(i).nq)

    def v_slice(self, i: int):
        return slice(self.v_starts[i], self.v_starts[i] + self.kind(i).nv)

    @functools.cached_property
    def children(self):
        children = tuple(list[int]() for _ in self.parents)
        for i, parent in enumerate(self.parents):
            if parent >= 0:
                children[parent].append(i)
        return children

    def ancestors(self, i: int):
        """Body i and what it hangs on, towards the base."""
        while i >= 0:
            yield i
            i = self.parents[i]

    @functools.cached_property
    def chains(self):
        """All bodies, parents first: chains that hang on bodies before, those alike side by side."""
        found, level = dict[tuple[int, str, int], list[int]](), {-1: -1}
        for start, stop in self._chains():
            level[stop - 1] = level[self.parents[start]] + 1
            found.setdefault((level[stop - 1], self.kind(start).moves_as, stop - start), []).append(start)
        return tuple(
            Chains(KINDS[kind], n, tuple(starts), tuple(self.parents[i] for i in starts))
            for (_, kind, n), starts in sorted(found.items(), key=lambda item: (item[0][0], item[1]))
        )

    @functools.cached_property
    def bundles(self):
        """All chains, parents first, in as few bundles as cost little more than each on its own."""
        found, place = list[Bundle](), {-1: -1}
        for group in self.chains:
            last = max(place[parent] for parent in group.parents)
            for k in range(max(last, 0), len(found)):
                if _goes_with(found[k], group):
                    found[k] = Bundle((*found[k].groups, group))
                    break
            else:
                k, found = len(found), [*found, Bundle((group,))]
            place |= dict.fromkeys(group.ends, k)
        return tuple(found)

    @functools.cached_property
    def joints_by_kind(self):
        """All joints that are no mimics, kind by kind: for what needs no tree."""
        found: dict[str, list[int]] = {}
        for i, kind in enumerate(self.kinds):
            if not self.is_mimic(i):
                found.setdefault(kind, []).append(i)
        return tuple(
            Bundle((Chains(KINDS[kind], 1, tuple(own), tuple(self.parents[i] for i in own)),))
            for kind, own in found.items()
        )

    def _chains(self):
        """(start, stop) of chains that branch, or change the kind of their joints, at their ends only."""
        ends = [i for i in range(1, len(self)) if not self._continues(i)]
        return zip([0, *ends], [*ends, len(self)], strict=True) if len(self) else ()

    def _continues(self, i: int):
        """Whether body i is the only child of the one before, by a joint that moves alike. What hangs on the world is
        alone: there, most is known."""
        is_only = self.parents[i] == i - 1 and len(self.children[i - 1]) == 1 and self.parents[i - 1] >= 0
        return is_only and self.kind(i).moves_as == self.kind(i - 1).moves_as

    @functools.cached_property
    def places(self):
        """(bundle, row, column) of every body."""
        found: dict[int, tuple[int, int, int]] = {}
        for k, bundle in enumerate(self.bundles):
            rows = itertools.accumulate((group.length for group in bundle.groups), initial=0)
            for first, group in zip(rows, bundle.groups, strict=False):
                found |= {i + j: (k, first + j, c) for c, i in enumerate(group.starts) for j in range(group.length)}
        return found

    @functools.cached_property
    def _chains_by_end(self):
        """(which of `chains`, which of them) of every body that a chain ends with; (-1, 0) for the world."""
        ends = ((i, (k, c)) for k, group in enumerate(self.chains) for c, i in enumerate(group.ends))
        return {-1: (-1, 0), **dict(ends)}

    def carriers(self, b: int):
        """{which of `chains`: [(chain of b, the chain there that carries it)]}, b itself among them."""
        found: dict[int, list[tuple[int, int]]] = {}
        for c in range(self.chains[b].width):
            k, mine = b, c
            while k >= 0:
                found.setdefault(k, []).append((c, mine))
                k, mine = self._chains_by_end[self.chains[k].parents[mine]]
        return found

    @functools.cached_property
    def skeleton(self):
        """The same without names: mechanisms of one structure share their programs."""
        return dataclasses.replace(
            self, body_names=(), joint_names=(), frames=tuple(("", body) for _, body in self.frames)
        )

    def index(self, names: tuple[str, ...], name: str, what: str):
        """Where a name is among others; raises KeyError that lists what there is, and says which is near."""
        if name not in names:
            near = check.did_you_mean(name, names)
            raise KeyError(f"{what}: expected one of {', '.join(map(repr, names))}, got {name!r}{near}")
        return names.index(name)


def _goes_with(bundle: Bundle, group: Chains):
    """Whether a group does as the next rows of a bundle. What hangs on the world does not: there, most is known."""
    if group.kind.moves_as != bundle.kind.moves_as or bundle.is_on_world:
        return False
    apart = sum(Bundle((g,)).cost for g in (*bundle.groups, group))
    return Bundle((*bundle.groups, group)).cost <= _MOST * apart


# How much more than on their own chains may cost together: they are compiled once.
_MOST = 1.25

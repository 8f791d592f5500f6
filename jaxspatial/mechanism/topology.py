"""The tree of a mechanism: which body hangs on which, by which kind of joint, and where its coordinates are.

Algorithms compute joints of one kind together. A chain is a run of bodies in series, each the only child of the one
before, with joints of one kind. Chains of one kind and length are batched (`Chains`), and such batches are stacked, one
after the other, into one loop (`Bundle`).
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from jaxspatial.mechanism.joints import KINDS, JointKind, kind_named
from jaxspatial.numerics import check

T = TypeVar("T")
# How much more a bundle may cost than its batches of chains each in a loop of its own: it is compiled once.
_MOST = 1.25


class Chains(NamedTuple):
    """A batch of chains of one kind and one length.

    starts: the first body of each chain; its others have the numbers that follow. parents: the body that each chain
    hangs on.
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
        """The numbers of the bodies (length, width)."""
        return np.arange(self.length)[:, None] + np.array(self.starts)


@dataclasses.dataclass(frozen=True)
class Bundle:
    """Batches of chains of one kind, stacked: a recursion over the tree computes them as one loop over rows.

    Each row is as wide as the widest batch. Narrower batches are padded with copies of their first chain: these are
    computed, and their results are not used.
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
        """Whether its chains hang on the world."""
        return self.groups[0].parents[0] < 0

    @functools.cached_property
    def bodies(self):
        """The numbers of the bodies (length, width), padding included."""
        return np.concatenate([np.stack(self.by_column(group, group.bodies.T), 1) for group in self.groups])

    def places(self, starts: Sequence[int], n: int):
        """Where the n numbers of each of its bodies are, (length, width, n), if those of body i begin at starts[i]."""
        return np.array(starts)[self.bodies][..., None] + np.arange(n)

    def by_column(self, group: Chains, items: Sequence[T] | np.ndarray) -> list[T]:
        """The items of the chains of a group, one for each column of the bundle."""
        return [*items, *[items[0]] * (self.width - group.width)]

    @functools.cached_property
    def own_rows(self):
        """The places of `bodies.T.ravel()` that are no padding."""
        lengths, widths = zip(*((group.length, group.width) for group in self.groups), strict=True)
        return np.flatnonzero(np.arange(self.width)[:, None] < np.repeat(widths, lengths))

    @functools.cached_property
    def own_bodies(self):
        """The numbers of the bodies, column by column, without padding."""
        return self.bodies.T.ravel()[self.own_rows]

    def has_room_for(self, group: Chains):
        """Whether a batch of chains is computed as its next rows at little more cost than in a loop of its own. Chains
        on the world are not: most of what they compute with is known."""
        if group.kind.moves_as != self.kind.moves_as or self.is_on_world:
            return False
        groups = *self.groups, group
        lengths, widths = [g.length for g in groups], [g.width for g in groups]
        # A row costs what its chains do, and as much as one more chain by itself.
        separate = sum(length * (width + 1) for length, width in zip(lengths, widths, strict=True))
        return sum(lengths) * (max(widths) + 1) <= _MOST * separate


@dataclasses.dataclass(frozen=True)
class Topology:
    """Names, kinds and connections: joint i carries body i. Parents have lower numbers than children, the world is -1.

    followed: for each joint the one whose coordinate it follows; itself where it has coordinates of its own.
    frames: (name, body) of all frames. computed: the bodies that recursions compute, None for all; see
    `carrying`.

    welds: (name of a fixed joint, the frame that it holds). carried_by: for each frame the one that it is a part of, or
    is welded to; itself for the world and for moving bodies. hung_on: for each joint the frame that it hangs on.
    """

    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    kinds: tuple[str, ...]
    parents: tuple[int, ...]
    followed: tuple[int, ...]
    frames: tuple[tuple[str, int], ...] = ()
    computed: tuple[int, ...] | None = None
    welds: tuple[tuple[str, int], ...] = ()
    carried_by: tuple[int, ...] = ()
    hung_on: tuple[int, ...] = ()

    def __hash__(self):
        return self._hash

    def __reduce__(self):
        """Pickles the fields alone: the hash of a name differs from one process to the next."""
        return Topology, dataclasses.astuple(self)

    @functools.cached_property
    def _hash(self):
        return hash(dataclasses.astuple(self))

    def __len__(self):
        return len(self.parents)

    def index(self, names: tuple[str, ...], name: str, what: str):
        """The index of a name; raises KeyError that lists the names there are and the nearest."""
        if name not in names:
            near = check.did_you_mean(name, names)
            raise KeyError(f"{what}: expected one of {', '.join(map(repr, names))}, got {name!r}{near}")
        return names.index(name)

    @functools.cached_property
    def skeleton(self):
        """The topology without names: mechanisms of one structure share their programs."""
        frames = tuple(("", body) for _, body in self.frames)
        nothing = dict.fromkeys(("body_names", "joint_names", "welds", "carried_by", "hung_on"), ())
        return dataclasses.replace(self, frames=frames, **nothing)

    # -- joints and their coordinates ---------------------------------------------------------------------------------

    def kind(self, i: int):
        return kind_named(self.kinds[i])

    def is_mimic(self, i: int):
        return self.followed[i] != i

    @functools.cached_property
    def has_mimics(self):
        return any(map(self.is_mimic, range(len(self))))

    @functools.cached_property
    def turns_axes(self):
        """Whether the linear velocities of any joint are along axes that the joint itself turns."""
        return any(self.kind(i).turned for i in range(len(self)))

    @functools.cached_property
    def has_subspaces_of_q(self):
        """Whether the motion subspace of any joint depends on coordinates that are no angles."""
        return any(self.kind(i).subspace_needs_q for i in range(len(self)))

    @functools.cached_property
    def q_starts(self):
        """For each joint the index of its first coordinate, that of the followed joint for a mimic; then nq."""
        return self._starts([self.kind(i).nq for i in range(len(self))])

    @functools.cached_property
    def v_starts(self):
        """The same for generalized velocities; then nv."""
        return self._starts([self.kind(i).nv for i in range(len(self))])

    def _starts(self, sizes: list[int]):
        starts = [0, *itertools.accumulate(0 if self.is_mimic(i) else size for i, size in enumerate(sizes))]
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

    # -- the tree -----------------------------------------------------------------------------------------------------

    def ancestors(self, i: int):
        """Body i and those it hangs on, towards the world."""
        while i >= 0:
            yield i
            i = self.parents[i]

    def bodies_of(self, frames: Iterable[int]) -> list[int]:
        """The bodies that carry frames, -1 for the world."""
        return [self.frames[frame][1] for frame in frames]

    def carrying(self, bodies: Iterable[int]) -> "Topology":
        """The same topology, of which recursions compute some bodies and those that carry them, and no others."""
        computed = {i for body in bodies for i in self.ancestors(body)}
        return self if len(computed) == len(self) else dataclasses.replace(self, computed=tuple(sorted(computed)))

    @functools.cached_property
    def _computed(self):
        return tuple(range(len(self))) if self.computed is None else self.computed

    @functools.cached_property
    def children(self):
        """Of each body those that recursions compute."""
        children = tuple(list[int]() for _ in self.parents)
        for i in self._computed:
            if self.parents[i] >= 0:
                children[self.parents[i]].append(i)
        return children

    @functools.cached_property
    def velocity_carriers(self):
        """For each velocity those before it that the mass matrix couples with it: of its own joint and of those that
        carry it. Velocities of mimics belong to several joints; then all are taken."""
        if self.has_mimics:
            return tuple(tuple(range(k)) for k in range(self.nv))
        carriers = list[tuple[int, ...]]()
        for i in range(len(self)):
            carrying = [k for body in self.ancestors(i) for k in range(self.nv)[self.v_slice(body)]]
            carriers += (tuple(k for k in carrying if k < own) for own in range(self.nv)[self.v_slice(i)])
        return tuple(carriers)

    def behind(self, weld: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """(the frames that a weld holds, the moving joints that hang on them)."""
        child = self.welds[weld][1]

        def is_behind(frame: int) -> bool:
            while frame != child and frame != self.carried_by[frame]:
                frame = self.carried_by[frame]
            return frame == child

        frames, joints = range(len(self.frames)), enumerate(self.hung_on)
        return tuple(filter(is_behind, frames)), tuple(i for i, frame in joints if is_behind(frame))

    # -- chains and bundles -------------------------------------------------------------------------------------------

    @functools.cached_property
    def chains(self):
        """All bodies as batches of chains, parents first. Chains of one batch are as many chains from the world."""
        batches, depth = dict[tuple[int, str, int], list[int]](), {-1: -1}
        runs = list[tuple[int, int]]()  # (start, stop)
        for i in self._computed:
            # A chain goes on with the only child of its last body, by a joint of the same kind. A body on the world is
            # a chain of its own: most of what it computes with is known.
            is_only = i > 0 and self.parents[i] == i - 1 and len(self.children[i - 1]) == 1 and self.parents[i - 1] >= 0
            goes_on = is_only and self.kind(i).moves_as == self.kind(i - 1).moves_as
            runs.append((runs.pop()[0] if goes_on else i, i + 1))
        for start, stop in runs:
            depth[stop - 1] = depth[self.parents[start]] + 1
            batches.setdefault((depth[stop - 1], self.kind(start).moves_as, stop - start), []).append(start)
        return tuple(
            Chains(KINDS[kind], n, tuple(starts), tuple(self.parents[i] for i in starts))
            for (_, kind, n), starts in sorted(batches.items(), key=lambda item: (item[0][0], item[1]))
        )

    def carriers(self, b: int):
        """The batches that carry batch b of `chains`, b among them: {index of a batch: [(chain of b, the chain of that
        batch which it hangs on)]}."""
        # Of the chain that ends with a body the index in `chains`, and that in its batch.
        by_end = {i: (k, c) for k, group in enumerate(self.chains) for c, i in enumerate(group.ends)}
        carriers = dict[int, list[tuple[int, int]]]()
        for c in range(self.chains[b].width):
            k, carrier = b, c
            while k >= 0:
                carriers.setdefault(k, []).append((c, carrier))
                k, carrier = by_end.get(self.chains[k].parents[carrier], (-1, 0))
        return carriers

    @functools.cached_property
    def bundles(self):
        """All chains, parents first, in as few bundles as cost little more than a loop for each batch."""
        bundles, place = list[Bundle](), {-1: -1}
        for group in self.chains:
            last = max(place[parent] for parent in group.parents)
            for k in range(max(last, 0), len(bundles)):
                if bundles[k].has_room_for(group):
                    bundles[k] = Bundle((*bundles[k].groups, group))
                    break
            else:
                k = len(bundles)
                bundles.append(Bundle((group,)))
            place |= dict.fromkeys(group.ends, k)
        return tuple(bundles)

    @functools.cached_property
    def places(self):
        """(bundle, row, column) of every body."""
        places = dict[int, tuple[int, int, int]]()
        for k, bundle in enumerate(self.bundles):
            firsts = itertools.accumulate((group.length for group in bundle.groups), initial=0)
            for first, group in zip(firsts, bundle.groups, strict=False):
                places |= {i + j: (k, first + j, c) for c, i in enumerate(group.starts) for j in range(group.length)}
        return places

    def has_mimics_in(self, bundle: Bundle):
        return any(map(self.is_mimic, bundle.bodies.ravel().tolist()))

    @functools.cached_property
    def joints_by_kind(self):
        """All joints that are no mimics, a bundle for each kind: for formulas that need no tree."""
        return self._by_kind(range(len(self)))

    @functools.cached_property
    def not_computed(self):
        """The other joints that are no mimics, those that recursions do not compute."""
        return self._by_kind(sorted({*range(len(self))} - {*self._computed}))

    def _by_kind(self, bodies: Iterable[int]):
        joints = dict[str, list[int]]()
        for i in bodies:
            if not self.is_mimic(i):
                joints.setdefault(self.kinds[i], []).append(i)
        return tuple(
            Bundle((Chains(KINDS[kind], 1, tuple(of_kind), tuple(self.parents[i] for i in of_kind)),))
            for kind, of_kind in joints.items()
        )

"""Which numbers of a program wait for their use, and which are computed again instead.

Threads of a GPU have 255 registers, and few bytes of fast memory. Numbers that do not fit are written to memory and
read again, which takes longer than most computations do. So operations are put into an order in which few numbers
wait, and numbers that wait long are computed again from others, where that is cheap.
"""

import collections
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from jaxspatial.engine.graph import Graph

# An operation, by its node, or the number of a loop as (loop,). No checker tells these apart by `type(x) is tuple`.
Item = Any
# How many operations one number may take to be computed again. The cheapest that suffice are taken.
MOST_AGAIN = (4, 16, 64, 128)
# Numbers that are used again after so few operations wait.
SOON = 40
# Operations that are never done again.
DEAR = {"div", "rem", "sqrt"}


class Order:
    """Items of the program, outside of loops, in the order in which they are computed.

    item_of: by node the item that makes it, None for what is read where it lies. nodes_read: those that an item reads.
    """

    def __init__(
        self,
        graph: Graph,
        items: Sequence[Item],
        item_of: list[Item | None],
        nodes_read: Callable[[Item], Iterable[int]],
    ):
        self.graph, self.items, self.item_of, self.nodes_read = graph, list(items), item_of, nodes_read
        self._known_items_read: dict[Item, list[Item]] = {}

    def _items_read(self, item: Item) -> list[Item]:
        """The items that one reads."""
        found = self._known_items_read.get(item)
        if found is None:
            found = list(dict.fromkeys(x for node in self.nodes_read(item) if (x := self.item_of[node]) is not None))
            self._known_items_read[item] = found
        return found

    def uses(self) -> dict[Item, list[int]]:
        """By item of this order, where it is read."""
        found: dict[Item, list[int]] = {item: [] for item in self.items}
        for k, item in enumerate(self.items):
            for x in self._items_read(item):
                if x in found:
                    found[x].append(k)
        return found

    def waiting(self, uses: dict[Item, list[int]]) -> list[int]:
        """How many numbers wait, or are made, at each item."""
        counts, n = list[int](), 0
        ends = collections.Counter(places[-1] for places in uses.values() if places)
        for k, item in enumerate(self.items):
            n += bool(uses[item])
            counts.append(n)
            n -= ends[k]
        return counts

    def excess(self, n_registers: int) -> tuple[int, int]:
        """By how many numbers more wait than there are registers: in sum, and the most that wait."""
        counts = self.waiting(self.uses())
        return sum(max(n - n_registers, 0) for n in counts), max(counts, default=0)

    def with_few_waiting(self, roots: Sequence[int]) -> "Order":
        """What ends the wait of another number, or is a result, comes as soon as it can."""
        position = {item: k for k, item in enumerate(self.items)}
        reads = [sorted(position[x] for x in self._items_read(item) if x in position) for item in self.items]
        readers: list[list[int]] = [[] for _ in self.items]
        for k, read in enumerate(reads):
            for x in read:
                readers[x].append(k)
        n_left, n_missing = [len(x) for x in readers], [len(x) for x in reads]
        are_results = {position[x] for r in roots if (x := self.item_of[r]) in position}
        is_done, found = [False] * len(self.items), list[Item]()
        for k in range(len(self.items)):
            ready = [k]
            while ready:
                item = ready.pop()
                if is_done[item]:
                    continue
                is_done[item] = True
                found.append(self.items[item])
                for x in reads[item]:
                    n_left[x] -= 1
                for x in readers[item]:
                    n_missing[x] -= 1
                for x in (item, *reads[item]):
                    for reader in readers[x]:
                        ends_one = reader in are_results or any(n_left[y] == 1 for y in reads[reader])
                        if ends_one and not is_done[reader] and not n_missing[reader]:
                            ready.append(reader)
        return Order(self.graph, found, self.item_of, self.nodes_read)

    def compute_again(self, n_registers: int) -> None:
        """Does operations again, until no more numbers wait than there are registers, or nothing helps.

        The graph gets nodes for what is done again, and the others read these.
        """
        excess = self.excess(n_registers)[0]
        while excess:
            self._compute_at_the_most(n_registers)
            before, excess = excess, self.excess(n_registers)[0]
            if excess > 0.99 * before:
                break

    def _compute_at_the_most(self, n_registers: int) -> None:
        """Computes again, after the place where most numbers wait, some that wait there."""
        uses = self.uses()
        counts = self.waiting(uses)
        at = max(range(len(counts)), key=counts.__getitem__)
        held = [x for x in self.items[: at + 1] if uses[x] and uses[x][-1] > at]
        late = {x for x in held if type(x) is not tuple and next(k for k in uses[x] if k > at) > at + SOON}
        # What a loop reads stays.
        for k in range(at + 1, len(self.items)):
            if type(self.items[k]) is tuple:
                late.difference_update(self._items_read(self.items[k]))
        chosen = again = set[int]()
        for most in MOST_AGAIN:
            chosen, again = self._chosen(held, late, most)
            if counts[at] - len(chosen) <= n_registers:
                break
        self._insert(at, chosen, again)

    def _chosen(self, held: Sequence[Item], late: set[Item], most: int) -> tuple[set[int], set[int]]:
        """(those of the late items that take at most so many more operations each, all operations to do again)."""
        kept, again, chosen = set(held), set[int](), set[int]()
        for item in held:
            if item not in late:
                continue
            kept.discard(item)
            cone = self._cone(item, kept, again, most)
            if cone is None:
                kept.add(item)
            else:
                again |= cone
                chosen.add(item)
        return chosen, again

    def _cone(self, item: int, kept: set[Item], again: set[int], most: int) -> set[int] | None:
        """The operations that make a number from what waits or is done again; None if they are too many, or dear."""
        operations, operands = self.graph.operations, self.graph.operands
        found, stack = set[int](), [item]
        while stack:
            node = stack.pop()
            x = self.item_of[node]
            if node in found or node != item and (x in kept or node in again):
                continue
            if x is None and operations[node] in ("constant", "load"):
                continue
            if x is None or type(x) is tuple or operations[node] in DEAR or len(found) == most:
                return None
            found.add(node)
            stack.extend(operands[node])
        return found

    def _insert(self, at: int, chosen: set[int], again: set[int]) -> None:
        """Puts operations that are done again where they are needed first, and leaves out what nobody reads then."""
        graph, copies = self.graph, dict[int, int]()
        rest = list[Item]()

        def copied(node: int) -> int:
            """The copy of a node, behind copies of what it reads."""
            stack = [node]
            while stack:
                top = stack[-1]
                missing = [x for x in graph.operands[top] if x in again and x not in copies]
                if top in copies:
                    stack.pop()
                elif missing:
                    stack += missing
                else:
                    operands = tuple(copies.get(x, x) for x in graph.operands[top])
                    copies[top] = graph.copied(top, operands)
                    self.item_of.append(copies[top])
                    rest.append(copies[top])
                    stack.pop()
            return copies[node]

        for item in self.items[at + 1 :]:
            if type(item) is not tuple and any(x in chosen for x in graph.operands[item]):
                graph.operands[item] = tuple(copied(x) if x in chosen else x for x in graph.operands[item])
                self._known_items_read.pop(item, None)
            rest.append(item)
        self.items = [*self.items[: at + 1], *rest]
        self._leave_out_unread()

    def _leave_out_unread(self) -> None:
        results = {self.item_of[n] for x in self.graph.results for n in x.ravel().tolist()}
        needed, stack = set[Item](), [x for x in self.items if type(x) is tuple or x in results]
        while stack:
            item = stack.pop()
            if item not in needed:
                needed.add(item)
                stack += self._items_read(item)
        self.items = [x for x in self.items if x in needed]

"""What is to be evaluated: sums of products of components of arrays."""

from typing import NamedTuple

from jaxspatial.arithmetic.numbers.polynomial import Term


class Sum(NamedTuple):
    """One array of the result: for each of its components the terms; the axes of the batch it is summed over; and the
    powers of two that components are multiplied by before they are rounded, none for 1."""

    components: tuple[tuple[Term, ...], ...]
    reduced: tuple[int, ...] = ()
    shares: tuple[float, ...] = ()


class Plan(NamedTuple):
    """What is to be evaluated: Sums over a batch, in a precision, each as one array or as the pair of a double word.

    `leading`: components are on the first axis, with the batch behind them, and not on the last.
    """

    sums: tuple[Sum, ...]
    batch: tuple[int, ...]
    precision: str
    is_pair: bool = False
    leading: bool = False

    @property
    def axis(self) -> int:
        return 0 if self.leading else len(self.batch)

    @property
    def degree(self) -> int:
        """The largest number of factors of a term."""
        return max(len(t.factors) for s in self.sums for terms in s.components for t in terms)

    def shape(self, s: Sum) -> tuple[int, ...]:
        """The shape of the result for a Sum; axes that are summed over keep size 1."""
        batch = [1 if i in s.reduced else n for i, n in enumerate(self.batch)]
        return (len(s.components), *batch) if self.leading else (*batch, len(s.components))

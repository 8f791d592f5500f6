"""The error bound of algorithms of mechanisms, relative to the largest number of a result."""

from typing import NamedTuple


class Normwise(NamedTuple):
    """For n links one behind the other; per_link u of the largest number for each, or rounded u in all."""

    per_link: float
    rounded: float

    def allowed(self, precision, links, roundoff, condition=1):
        """The largest error over the largest number. condition: of the mass matrix, where it is solved with."""
        return self.rounded * roundoff if precision.sees_whole_sums else self.per_link * links * condition * roundoff

    @property
    def words(self):
        """As the docstrings have it."""
        return (
            f'of the largest number, for n links one behind the other: at most {self.per_link:g} n u in "fast" and '
            f'"reproducible", {self.rounded:g} u in the other two'
        )


ALGORITHM = Normwise(per_link=4, rounded=1.01)

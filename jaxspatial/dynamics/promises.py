"""The error bound of algorithms of mechanisms: of all numbers of a result, relative to the largest."""

from typing import NamedTuple


class Normwise(NamedTuple):
    """For n links one behind the other, r the largest number and mag what it would be if no terms cancelled:

        fast, reproducible       u n u mag
        compensated, faithful    rounded u |r| + u2 n u^2 mag

    u stands for the unit roundoff behind each factor. Where the mass matrix is solved with, mag counts as many times as
    its condition says.
    """

    u: float
    rounded: float
    u2: float

    def allowed(self, precision, links, roundoff, r, mag, condition=1):
        """The largest error."""
        if precision.sees_whole_sums:
            return self.rounded * roundoff * r + self.u2 * links * roundoff**2 * condition * mag
        return self.u * links * roundoff * condition * mag

    def words(self, condition=""):
        """As the docstrings have it; condition: its letter and a blank."""
        return (
            f'at most {self.u:g} n u {condition}mag in "fast" and "reproducible", {self.rounded:g} u |r| + '
            f"{self.u2:g} n u^2 {condition}mag in the other two"
        )


ALGORITHM = Normwise(u=4, rounded=1.01, u2=32)

"""The error bound that algorithms on a mechanism have in common.

Let n be the number of links in the longest chain, r the largest number of the result, and mag that number with every
term replaced by its absolute value. The error of every number of the result is at most `ALGORITHM`: 4 n u mag in "fast"
and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two. u is the unit roundoff of the dtype of q.
"""

from jaxspatial.numerics.promise import Normwise

ALGORITHM = Normwise(4, "mag", per="n", u2=32)

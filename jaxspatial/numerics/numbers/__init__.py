"""The numbers that formulas are written over: one interface, `Number`, and four kinds.

A formula uses `+ - * /`, negation and the functions below; `linear` has vectors and matrices of numbers. It is written
once and runs in what `formula` picks:

    Rounded       an array over the batch, each operation rounded as the precision says
                  or a number known while tracing, which folds
    Corrected     the same, with a correction of its rounding errors
    DoubleWord    an array with twice the digits
    Polynomial    what a result is the sum of, evaluated as a whole afterwards: knows `+ - *`, one last `/`, `halved`,
                  and zero as a `constant`

Comparisons, roots and selections are for the first three alone.
"""

from jaxspatial.numerics.numbers.corrected import Corrected as Corrected
from jaxspatial.numerics.numbers.number import as_data as as_data
from jaxspatial.numerics.numbers.number import constant as constant, data_of as data_of
from jaxspatial.numerics.numbers.number import doubled as doubled
from jaxspatial.numerics.numbers.number import frozen as frozen, halved as halved
from jaxspatial.numerics.numbers.number import high as high, is_constant as is_constant
from jaxspatial.numerics.numbers.number import is_number as is_number, mapped as mapped
from jaxspatial.numerics.numbers.number import nearest_integer as nearest_integer, noinline as noinline
from jaxspatial.numerics.numbers.number import noinline_pairs as noinline_pairs, repeated as repeated
from jaxspatial.numerics.numbers.number import shape_of as shape_of
from jaxspatial.numerics.numbers.number import times_power_of_two as times_power_of_two, where as where
from jaxspatial.numerics.numbers.number import where_any as where_any
from jaxspatial.numerics.numbers.number import with_data as with_data, without_data as without_data
from jaxspatial.numerics.numbers.number import Mask as Mask, Numbers as Numbers
from jaxspatial.numerics.numbers.rounded import Number as Number, Rounded as Rounded

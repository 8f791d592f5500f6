"""The numbers that formulas are written over: one protocol, five kinds.

A formula uses `+ - * /`, negation and the functions below; `vectors` has those of tuples of numbers. It is written once
and runs in what `formula` picks:

    Rounded       an array over the batch, each operation rounded as the precision says
                  or a number known while tracing, which folds (see `folding`)
    Corrected     the same, with a correction of its rounding errors
    DoubleWord    an array with twice the digits
    Polynomial    what a result is the sum of, evaluated as a whole afterwards: knows `+ - *`, one last `/`, `halved`,
                  and zero as a `constant`

Comparisons, roots and selections are for the first three alone. In signatures each is a `Number`; what tuples of them
hold is said by `Three`, `Rows`, `Motion` and the like, see `protocol`.
"""

from jaxspatial.arithmetic.numbers.corrected import Corrected as Corrected
from jaxspatial.arithmetic.numbers.number import as_data as as_data, constant as constant, data_of as data_of
from jaxspatial.arithmetic.numbers.number import doubled as doubled, each as each, flattened as flattened
from jaxspatial.arithmetic.numbers.number import frozen as frozen, halved as halved
from jaxspatial.arithmetic.numbers.number import high as high, is_constant as is_constant
from jaxspatial.arithmetic.numbers.number import is_number as is_number, mapped as mapped
from jaxspatial.arithmetic.numbers.number import nearest_integer as nearest_integer, noinline as noinline
from jaxspatial.arithmetic.numbers.number import noinline_pairs as noinline_pairs, repeated as repeated
from jaxspatial.arithmetic.numbers.number import shape_of as shape_of, with_data as with_data
from jaxspatial.arithmetic.numbers.number import times_power_of_two as times_power_of_two, where as where
from jaxspatial.arithmetic.numbers.protocol import Mask as Mask, Motion as Motion, Number as Number, Numbers as Numbers
from jaxspatial.arithmetic.numbers.protocol import Rows as Rows, Symmetric as Symmetric, Three as Three
from jaxspatial.arithmetic.numbers.protocol import Wrench as Wrench
from jaxspatial.arithmetic.numbers.rounded import Rounded as Rounded

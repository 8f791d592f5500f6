"""The numbers that formulas are written over: one protocol, four kinds.

A formula uses `+ - * /`, negation and the functions below; `vectors` has those of tuples of numbers. It is written once
and runs in what `formula` picks:

    Rounded       an array over the batch, each operation rounded as the precision says
                  or a number known while tracing, which folds (see `folding`)
    DoubleWord    an array with twice the digits
    Polynomial    what a result is the sum of, evaluated as a whole afterwards: knows `+ - *`, one last `/`, `halved`,
                  and zero as a `constant`

Comparisons, roots and selections are for the first two alone.
"""

from jaxspatial.arithmetic.numbers.number import (
    Number as Number,
)
from jaxspatial.arithmetic.numbers.number import (
    as_data as as_data,
)
from jaxspatial.arithmetic.numbers.number import (
    constant as constant,
)
from jaxspatial.arithmetic.numbers.number import (
    data_of as data_of,
)
from jaxspatial.arithmetic.numbers.number import (
    doubled as doubled,
)
from jaxspatial.arithmetic.numbers.number import (
    each as each,
)
from jaxspatial.arithmetic.numbers.number import (
    frozen as frozen,
)
from jaxspatial.arithmetic.numbers.number import (
    halved as halved,
)
from jaxspatial.arithmetic.numbers.number import (
    high as high,
)
from jaxspatial.arithmetic.numbers.number import (
    is_number as is_number,
)
from jaxspatial.arithmetic.numbers.number import (
    mapped as mapped,
)
from jaxspatial.arithmetic.numbers.number import (
    nearest_integer as nearest_integer,
)
from jaxspatial.arithmetic.numbers.number import (
    noinline as noinline,
)
from jaxspatial.arithmetic.numbers.number import (
    noinline_pairs as noinline_pairs,
)
from jaxspatial.arithmetic.numbers.number import (
    repeated as repeated,
)
from jaxspatial.arithmetic.numbers.number import (
    times_power_of_two as times_power_of_two,
)
from jaxspatial.arithmetic.numbers.number import (
    where as where,
)
from jaxspatial.arithmetic.numbers.number import (
    with_data as with_data,
)
from jaxspatial.arithmetic.numbers.rounded import Rounded as Rounded

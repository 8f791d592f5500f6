"""Layer 7: measuring accuracy and speed, on this machine and on the user's own numbers.

    from jaxspatial import measure

    value, mag = measure.evaluate(lambda x, y: (x * y).sum(-1), x, y)    # exact, and the sizes of its terms
    measure.in_ulps(computed, value), measure.in_u_of(computed, value, mag)
    measure.recommend(function, *arguments, tolerance=1e-6)              # which precision it needs
    measure.interleaved({"ours": ours, "theirs": theirs})                # seconds per call, fairly

`python -m jaxspatial` prints what `trade`, `conditions` and `power` measure.
"""

# what a result should be, exactly
from jaxspatial.measure import exact as exact
from jaxspatial.measure.exact import evaluate as evaluate, rationals as rationals

# how far off it is
from jaxspatial.measure import error as error
from jaxspatial.measure.error import agrees_when_not_finite as agrees_when_not_finite, in_u_of as in_u_of
from jaxspatial.measure.error import in_ulps as in_ulps, in_ulps_of_norm as in_ulps_of_norm
from jaxspatial.measure.error import in_units_of as in_units_of, ulp as ulp, unit_roundoff as unit_roundoff

# arguments that cancel, as much as asked for
from jaxspatial.measure import inputs as inputs

# how long it takes
from jaxspatial.measure import timing as timing
from jaxspatial.measure.timing import interleaved as interleaved, machine as machine

# the trade: of the operations in `OPERATIONS`, against condition numbers, of one's own function
from jaxspatial.measure import conditions as conditions, power as power, trade as trade
from jaxspatial.measure.operation import OPERATIONS as OPERATIONS, Operation as Operation
from jaxspatial.measure.recommend import Recommendation as Recommendation, recommend as recommend

# does it hold here
from jaxspatial.measure.findings import Finding as Finding, Report as Report
from jaxspatial.measure.self_check import self_check as self_check

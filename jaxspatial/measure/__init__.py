"""Accuracy and speed of one's own functions, measured on one's own numbers.

    from jaxspatial import measure

    value, mag = measure.evaluate(lambda x, y: (x * y).sum(-1), x, y)    # exact, and the sizes of its terms
    measure.in_ulps(computed, value), measure.in_u_of(computed, value, mag)
    measure.recommend(function, *arguments, tolerance=1e-6)              # which precision it needs
    measure.count_operations(function, *arguments)                        # multiplications and the like, at one state
    measure.interleaved({"ours": ours, "theirs": theirs})                # seconds per call, fairly

Exact results are fractions.
"""

# what a result should be, exactly, and how far off it is
from jaxspatial.measure.error import evaluate as evaluate, rationals as rationals
from jaxspatial.measure.error import agrees_when_not_finite as agrees_when_not_finite, in_u_of as in_u_of
from jaxspatial.measure.error import in_ulps as in_ulps, in_ulps_of_norm as in_ulps_of_norm
from jaxspatial.measure.error import in_units_of as in_units_of, ulp as ulp, unit_roundoff as unit_roundoff

# arguments that cancel, as much as asked for
from jaxspatial.measure import inputs as inputs

# how long it takes, and which precision it needs
from jaxspatial.measure.timing import Recommendation as Recommendation, recommend as recommend
from jaxspatial.measure.timing import interleaved as interleaved, machine as machine

# how many operations it asks for
from jaxspatial.measure.counting import count_operations as count_operations

# does it hold here
from jaxspatial.measure.checks import Finding as Finding, Report as Report, self_check as self_check

"""Layer 7: measuring accuracy and speed, on this machine and on the user's own numbers. `python -m jaxspatial`."""

from jaxspatial.measure.recommend import Recommendation as Recommendation
from jaxspatial.measure.recommend import recommend as recommend

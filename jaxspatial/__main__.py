"""python -m jaxspatial: the speed and accuracy trade on this machine."""

import sys

from jaxspatial.measure.cli import main

sys.exit(main())

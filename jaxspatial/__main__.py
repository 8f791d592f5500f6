"""python -m jaxspatial: the command `jaxspatial`."""

import sys

from jaxspatial.command.main import main

if __name__ == "__main__":
    sys.exit(main())

"""python -m jaxspatial: the speed and accuracy trade on this machine; its subcommands."""

import sys

try:
    from jaxspatial.command.cli import main

    status = main()
except KeyboardInterrupt:
    print("error: interrupted", file=sys.stderr)
    status = 130
sys.exit(status)

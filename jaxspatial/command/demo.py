"""The demo: a quadruped that is pushed, in a browser or as a recording."""

import argparse
import webbrowser

from jaxspatial.command import quadruped
from jaxspatial.command.files import OutputError, WrenchFileError, writable

_SECONDS = 4.0
# From, to, s, and the force on the trunk, N. It withstands the first two.
_PUSHES = ((0.5, 0.65, (0.0, 65.0, 0.0)), (1.5, 1.65, (-65.0, 0.0, 0.0)), (2.5, 2.65, (0.0, -90.0, 0.0)))


def run(given: argparse.Namespace) -> int:
    """Shows it until it is interrupted, or writes it to a file; returns the exit status."""
    try:
        from jaxspatial import viewer
    except ImportError as error:
        raise WrenchFileError(f"demo: {error}") from error
    if given.record is not None:
        if given.record.suffix not in (".html", ".viser"):
            raise OutputError(f"--record: expected a name ending in .html or .viser, got {given.record}")
        writable(given.record, given.overwrite)
    print("A quadruped of 12 joints: it withstands two pushes, and the third throws it over.")
    print("Compiling its steps takes some seconds ...", flush=True)
    mech, q, forces = quadruped.pushed(_SECONDS, _PUSHES, may_fall=True)
    scene = {"dt": float(quadruped.DT), "shapes": quadruped.FILE, "forces": forces, "ground": quadruped.GROUND}
    if given.record is not None:
        viewer.record(mech, q, given.record, **scene)
        print(f"recording: {given.record}")
        return 0
    shown = viewer.show(mech, q, port=given.port, **scene)
    address = f"http://localhost:{shown.server.get_port()}"
    print(f"{address}: check the box `play`. Ctrl-C ends it.", flush=True)
    webbrowser.open(address)
    shown.server.sleep_forever()
    return 0

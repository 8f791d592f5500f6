"""Readers of model files are found when they are asked for; what they read is tested with each of them."""

import subprocess
import sys

import jaxspatial as js

SOURCE = """
import sys
import jaxspatial as js

def there():
    names = {name.removeprefix("jaxspatial.mechanism.formats.") for name in sys.modules}
    return names & {"urdf", "mjcf", "lxml", "yourdfpy", "mujoco"}

assert not there(), there()
js.Mechanism.from_urdf('<robot name="r"><link name="l"/></robot>')
assert {"urdf", "lxml", "yourdfpy"} <= there() and "mjcf" not in there(), there()
"""


def test_readers_are_imported_with_what_they_need_at_the_first_call():
    subprocess.run([sys.executable, "-c", SOURCE], check=True)


def test_the_public_edge_is_listed():
    assert {"interop", "measure"} <= set(dir(js))
    assert js.interop.ModelFileWarning is js.mechanism.formats.ModelFileWarning

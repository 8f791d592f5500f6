"""Readers of model files are found when they are asked for; what they read is tested with each of them."""

import subprocess
import sys

import pytest

import jaxspatial as js

SOURCE = """
import sys
import jaxspatial as js

def there():
    names = {name.removeprefix("jaxspatial.mechanism.formats.") for name in sys.modules}
    return names & {"urdf", "mjcf", "lxml", "mujoco"}

assert not there(), there()
js.Mechanism.from_urdf('<robot name="r"><link name="l"/></robot>')
assert there() == {"urdf", "lxml"}, there()
"""


def test_readers_are_imported_with_what_they_need_at_the_first_call():
    subprocess.run([sys.executable, "-c", SOURCE], check=True)


URDF, MJCF = '<robot name="r"><link name="l"/></robot>', "<!-- -->\n<mujoco/>"
SDF = "this is an SDF: convert it to a URDF or an MJCF first"
OTHERS = {
    "a URDF": (
        "from_mjcf",
        URDF,
        "line 1: <robot>: expected <mujoco>; this is a URDF: read it with Mechanism.from_urdf",
    ),
    "an MJCF": (
        "from_urdf",
        MJCF,
        "line 2: <mujoco>: expected <robot>; this is an MJCF: read it with Mechanism.from_mjcf",
    ),
    "SDF, as URDF": ("from_urdf", "<sdf/>", f"line 1: <sdf>: expected <robot>; {SDF}"),
    "SDF, as MJCF": ("from_mjcf", "<sdf/>", f"line 1: <sdf>: expected <mujoco>; {SDF}"),
    "part of an MJCF": (
        "from_mjcf",
        "<mujocoinclude/>",
        "line 1: <mujocoinclude>: expected <mujoco>; this is a part that models include: read one of these",
    ),
}


@pytest.mark.parametrize(("reader", "text", "message"), OTHERS.values(), ids=OTHERS)
def test_files_of_another_format_are_told_by_what_is_in_them(tmp_path, reader, text, message):
    """Whatever their names end in."""
    paths = [tmp_path / f"robot.{suffix}" for suffix in ("urdf", "xml", "txt")]
    for path in paths:
        path.write_text(text)
    for source in (text, *paths, str(paths[0])):
        with pytest.raises(ValueError) as error:
            getattr(js.Mechanism, reader)(source)
        assert str(error.value) == f"{reader}: {message}"


def test_the_public_edge_is_listed():
    assert {"interop", "measure"} <= set(dir(js))
    assert js.interop.ModelFileWarning is js.mechanism.formats.ModelFileWarning

"""What a browser is told: recordings have the poses of the library, at their times. A real one shows it, in `slow`."""

import pathlib
import struct
import subprocess
import sys
import time
import urllib.request

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.soon import compiled_soon

pytest.importorskip("viser")
msgspec = pytest.importorskip("msgspec")
zstandard = pytest.importorskip("zstandard")
from jaxspatial import viewer  # noqa: E402
from jaxspatial._drawing import meshes  # noqa: E402

FLOAT = np.float32
LAW = {"stiffness": 1e3, "relaxation_time": 0.01, "friction": 0.5}
BROWSER = pathlib.Path("/usr/bin/chromium")
# Nothing of it is ours to mend.
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning:(websockets|viser|trimesh).*"),
    pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning"),
]


@pytest.fixture(autouse=True, scope="module")
def _soon():
    """What is drawn is the same, and many small programs compile sooner."""
    with compiled_soon():
        yield


SHAPES = """<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.25"/><geometry><box size="0.1 0.2 0.5"/></geometry></visual>
  </link>
  <link name="lower">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://robots/shapes/tetrahedron.stl" scale="1 2 1"/></geometry></visual>
  </link>
  <link name="tip"/>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/><origin xyz="0 0 0.3"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/><origin xyz="0 0 0.5"/>
  </joint>
  <joint name="weld" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0 0 0.4"/></joint>
</robot>
"""
CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.4]], FLOAT)


@pytest.fixture
def robot(tmp_path):
    """(the mechanism, the path of its file): a box, and a mesh in a folder above that of the file."""
    (tmp_path / "shapes").mkdir()
    faces = CORNERS[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    rows = [struct.pack("<12fH", 0, 0, 0, *face.ravel(), 0) for face in faces]
    (tmp_path / "shapes" / "tetrahedron.stl").write_bytes(bytes(80) + struct.pack("<I", 4) + b"".join(rows))
    (tmp_path / "urdf").mkdir()
    path = tmp_path / "urdf" / "arm.urdf"
    path.write_text(SHAPES)
    return js.Mechanism.from_urdf(path.read_text(), dtype=FLOAT), path


def told(data):
    """(seconds, messages by time) of a recording."""
    inner = zstandard.ZstdDecompressor().decompressobj().decompress(data[8:])
    n = int.from_bytes(inner[:8], "little")
    content = msgspec.msgpack.decode(inner[8 : 8 + n])
    start, arrays = 8 + n, []
    for length in content["binaryBufferLengths"]:
        start += -start % 8
        arrays.append(inner[start : start + length])
        start += length
    return content["durationSeconds"], content["messages"], arrays


def last(messages, kind, name, until=np.inf):
    """The last message of a kind on a node."""
    found = [m for t, m in messages if m["type"] == kind and m["name"] == name and t <= until]
    return found[-1] if found else None


def trajectory(n=31):
    t = np.linspace(0, 1, n, dtype=FLOAT)
    return np.stack([np.sin(3 * t), 2 * t], -1).astype(FLOAT)


def test_a_recording_has_the_poses_of_all_times(robot, tmp_path):
    mech, path = robot
    q = trajectory()
    out = viewer.record(mech, q, tmp_path / "arm.viser", dt=1 / 30, shapes=path, frames=["tip"])
    seconds, messages, _ = told(out.read_bytes())
    assert seconds == pytest.approx(31 / 30)
    X = js.forward_kinematics(mech, q, ["upper", "lower", "tip"])
    wxyz, p = np.asarray(X.rotation.to_quaternion()), np.asarray(X.translation)
    for i in (0, 7, 30):
        for k, name in enumerate(("upper", "lower", "tip")):
            node = f"/robot/{name}"
            place = last(messages, "SetPositionMessage", node, until=(i + 0.5) / 30)
            turn = last(messages, "SetOrientationMessage", node, until=(i + 0.5) / 30)
            np.testing.assert_allclose(place["position"], p[i, k], atol=1e-6)
            # What changes nothing is not sent. A quaternion and its negative are one rotation.
            turned = turn["wxyz"] if turn else [1, 0, 0, 0]
            assert abs(np.dot(turned, wxyz[i, k])) == pytest.approx(1, abs=1e-6)
    assert last(messages, "FrameMessage", "/robot/tip")["props"]["show_axes"]
    assert not last(messages, "FrameMessage", "/robot/upper")["props"]["show_axes"]
    assert last(messages, "LabelMessage", "/robot/tip/name")["props"]["text"] == "tip"


def test_shapes_are_those_of_the_file_in_the_axes_of_their_links(robot):
    mech, path = robot
    shapes = meshes("viewer", mech, path)
    assert list(shapes) == ["upper", "lower"]
    (box,), (mesh,) = shapes.values()
    np.testing.assert_allclose(box.bounds, [[-0.05, -0.1, 0], [0.05, 0.1, 0.5]], atol=1e-7)
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 0], [0.1, 0.2, 0.4]], atol=1e-7)


def scene(mech, q, **options):
    nothing = dict.fromkeys(("shapes", "forces", "ground", "contacts"))
    given = {"dt": 0.1, "frames": (), **nothing} | options
    return viewer.Scene(mech, q, **given, host="127.0.0.1", port=8090)


@pytest.fixture
def scenes():
    """Makes Scenes, and stops their servers."""
    made = []

    def make(*arguments, **options):
        made.append(scene(*arguments, **options))
        return made[-1]

    yield make
    for x in made:
        x.server.stop()


def test_without_shapes_inertias_are_seen(scenes, robot):
    """Boxes with the second moments of the bodies: also where the body is not on the frame of its joint."""
    M = js.SpatialInertia.solid_box(FLOAT([0.3, 0.2, 0.1]), mass=FLOAT(2)).shift(FLOAT([0, 0, -0.5]))
    turn = js.RigidTransform(js.Rotation.about_x(FLOAT(0.7)), FLOAT([0.1, 0, 0.2]))
    joint = js.Joint("a", "revolute", "world", "b", child_placement=turn)
    shown = scenes(js.Mechanism.build([js.Body("b", M)], [joint], dtype=FLOAT), FLOAT([0.4]))
    (box,) = [h for n, h in shown.server.scene._handle_from_node_name.items() if n.endswith("b/shape")]
    np.testing.assert_allclose(box.dimensions, [0.3, 0.2, 0.1], rtol=1e-4)
    np.testing.assert_allclose(box.position, [0, 0, 0.5], atol=1e-5)
    turned = np.asarray(js.Rotation.from_quaternion(FLOAT(box.wxyz)).to_matrix())
    np.testing.assert_allclose(abs(turned), np.eye(3), atol=1e-3)


def test_the_camera_sees_long_bodies(scenes):
    """A rod is as long as it is, and the camera is farther away than its end, though its origin is the only one."""
    rod = js.SpatialInertia.thin_rod(FLOAT(3), FLOAT([1, 0, 0]), mass=FLOAT(2))
    joint = js.Joint("a", "revolute", "world", "b", axis=(0, 1, 0))
    shown = scenes(js.Mechanism.build([js.Body("b", rod)], [joint], dtype=FLOAT), FLOAT([0.0]))
    (box,) = [h for n, h in shown.server.scene._handle_from_node_name.items() if n.endswith("b/shape")]
    np.testing.assert_allclose(box.dimensions, [3, 0.06, 0.06], rtol=1e-4)
    assert np.linalg.norm(shown.server.initial_camera.position) > 2


def visible(arrows):
    """The arrows (k, 2, 3) of one kind that are seen, from long ones to short ones, and the lengths of their heads."""
    shown = [handle for handle in arrows.handles if handle.visible]
    heads = [np.full(len(handle.points), handle.head_length) for handle in shown]
    return (np.concatenate([handle.points for handle in shown]), np.concatenate(heads)) if shown else ([], [])


def test_arrows_are_the_forces_at_their_points_over_time(scenes, robot):
    mech, _ = robot
    q, n = trajectory(4), 4
    f = np.zeros((n, 2, 3), FLOAT)
    f[:, 0, 2], f[2, 1, 0] = [1, 2, 4, 0], 3
    tau = np.zeros((n, 2, 3), FLOAT)
    tau[:, 0, 1] = 5
    points = FLOAT([[0, 0.1, 0], [0, 0, 0.2]])
    forces = js.AppliedForces(["tip", "upper"], js.SpatialForce(tau, f), points, axes="frame")
    shown = scenes(mech, q, forces=forces)
    arrows, torques = shown._arrows
    X = js.forward_kinematics(mech, q, ["tip", "upper"])
    R, p = np.asarray(X.rotation.to_matrix()), np.asarray(X.translation)
    starts = p + np.einsum("nmij,mj->nmi", R, points)
    scale = None
    for i, seen in enumerate(([0], [0], [0, 1], [])):
        shown.draw(i)
        ends, _ = visible(arrows)
        assert len(ends) == len(seen) and len(visible(torques)[0]) == 1
        if seen:
            vectors = np.einsum("mij,mj->mi", R[i], f[i])[seen]
            scale = scale or np.linalg.norm(ends[0, 1] - ends[0, 0]) / np.linalg.norm(vectors[0])
            np.testing.assert_allclose(ends[:, 0], starts[i][seen], atol=1e-6)
            np.testing.assert_allclose(ends[:, 1] - ends[:, 0], scale * vectors, atol=1e-5)
    np.testing.assert_allclose(visible(torques)[0][0, 0], starts[3, 0], atol=1e-6)


def test_small_forces_are_seen_beside_the_peak_of_an_impact(scenes, robot):
    """Down to a two hundredth of it, with heads that are shorter than their arrows."""
    shares = FLOAT([1, 0.11, 0.05, 0.02, 0.006, 0.004, 0])
    f = np.zeros((len(shares), 1, 3), FLOAT)
    f[:, 0, 2] = 300 * shares
    shown = scenes(
        robot[0], np.tile(trajectory(1), (len(shares), 1)), forces=js.AppliedForces(["tip"], js.SpatialForce(f=f))
    )
    (arrows,) = shown._arrows
    peak = None
    for i, share in enumerate(shares):
        shown.draw(i)
        ends, heads = visible(arrows)
        assert len(ends) == (share > 0.005)
        if len(ends):
            length = np.linalg.norm(ends[0, 1] - ends[0, 0])
            peak = peak or length
            np.testing.assert_allclose(length, share * peak, rtol=1e-4)
            assert 0 < heads[0] < length


def test_forces_by_name_and_contact_forces(scenes, robot):
    mech, _ = robot
    q = trajectory(3)
    one, many = js.SpatialForce(f=FLOAT([0, 0, 9])), js.SpatialForce(f=FLOAT([[0, 0, 1], [0, 0, 2], [0, 0, 3]]))
    (arrows,) = scenes(mech, q, forces={"tip": one, "upper": many})._arrows
    lengths = np.linalg.norm(arrows.ends[..., 1, :] - arrows.ends[..., 0, :], axis=-1)
    np.testing.assert_allclose(lengths / lengths[0, 0], [[1, 1 / 9], [1, 2 / 9], [1, 3 / 9]], rtol=1e-5)
    feet = js.PointContacts(["tip"], stiffness=1e3, relaxation_time=0.01, friction=0.5)
    ground = js.HalfSpace(offset=FLOAT(1.15))
    pressed = js.contact_forces(mech, q, 0 * q, feet, ground)
    assert np.any(pressed.wrenches.f) and scenes(mech, q, forces=pressed, ground=ground)._arrows


def seen(scene, i=0):
    """Pairs (start, direction and length) of the arrows of forces at state i, those that are hidden too."""
    (arrows,) = scene._arrows
    return arrows.ends[i, :, 0], np.diff(arrows.ends[i], axis=1)[:, 0]


@pytest.mark.parametrize("way", ["AppliedForces", "points", "dict", "list", "batch", "loop"])
def test_forces_are_those_that_dynamics_take(way, scenes, robot):
    """Pure forces, whose torques are left out; several sources in a list; steps of a loop, stacked."""
    mech, _ = robot
    q, n = trajectory(3), 3
    up, aside = FLOAT([0, 0, 2]), FLOAT([1, 0, 0])
    X = js.forward_kinematics(mech, q, ["tip", "upper"])
    starts = np.asarray(X.translation)
    both = js.SpatialForce(f=np.stack([up, aside]))
    forces = {
        "AppliedForces": js.AppliedForces(["tip", "upper"], both),
        "points": js.AppliedForces(["tip", "upper"], both, np.zeros((n, 2, 3), FLOAT)),
        "dict": {"tip": js.SpatialForce(f=up), "upper": js.SpatialForce(f=np.tile(aside, (n, 1)))},
        "list": [None, {"tip": js.SpatialForce(f=up)}, js.AppliedForces(["upper"], js.SpatialForce(f=aside[None]))],
        "batch": js.AppliedForces(["tip", "upper"], js.SpatialForce(f=np.tile(both.f, (n, 1, 1)))),
        "loop": jax.tree.map(lambda *x: np.stack(x), *[js.AppliedForces(["tip", "upper"], both)] * n),
    }[way]
    tau = np.zeros((n, mech.nv), FLOAT)
    assert np.isfinite(js.forward_dynamics(mech, q, tau, tau, forces)).all()
    shown = scenes(mech, q, forces=forces)
    for i in range(n):
        points, arrows = seen(shown, i)
        np.testing.assert_allclose(points, starts[i], atol=1e-6)
        np.testing.assert_allclose(arrows / np.linalg.norm(arrows[0]), [[0, 0, 1], [0.5, 0, 0]], atol=1e-5)


def test_a_state_that_is_not_finite_hides_its_arrows_alone(scenes, robot):
    f = np.ones((3, 1, 3), FLOAT)
    f[1] = np.nan
    shown = scenes(robot[0], trajectory(3), forces=js.AppliedForces(["tip"], js.SpatialForce(f=f)))
    (arrows,) = shown._arrows
    assert (arrows.sizes.ravel() == len(arrows.handles)).tolist() == [False, True, False]
    assert np.isfinite(arrows.ends[[0, 2]]).all() and not scenes(robot[0], trajectory(3), forces=[{}, None])._arrows


def test_a_ground_function_is_shown_where_it_is_zero(scenes, robot):
    """Of any slope; a HalfSpace as a grid."""
    mech, _ = robot
    q = trajectory(4)
    feet = js.PointContacts(["tip"], stiffness=1e3, relaxation_time=0.01, friction=0.5)
    ground = lambda p: 2 * p[2] - p[0] - 0.2  # noqa: E731
    js.contact_forces(mech, q, 0 * q, feet, ground)
    shown = scenes(mech, q, ground=ground)
    mesh = shown.server.scene._handle_from_node_name["/ground"]
    x, _, z = np.asarray(mesh.vertices, float).T
    np.testing.assert_allclose(2 * z - x - 0.2, 0, atol=1e-5)
    assert len(mesh.faces) > 100 and np.ptp(x) > 1
    places = np.asarray(js.forward_kinematics(mech, q).translation)[..., 0]
    assert x.min() < places.min() and places.max() < x.max()


def test_contacts_are_spheres_on_their_frames(scenes, robot):
    """In their place on the frame, points as spheres that can be seen."""
    feet = js.PointContacts(["tip", "lower"], FLOAT([[0, 0, 0.1], [1, 2, 3]]), FLOAT([0.25, 0]), **LAW)
    shown = scenes(robot[0], trajectory(2), contacts=feet)
    handles = shown.server.scene._handle_from_node_name
    one, other = (handles[f"/robot/{name}"] for name in ("tip/contact 0", "lower/contact 1"))
    np.testing.assert_allclose([one.position, other.position], feet.positions, atol=1e-7)
    assert one.radius == 0.25 and 0 < other.radius < 0.05


def test_a_slider_moves_the_robot_and_play_moves_the_slider(scenes, robot):
    mech, path = robot
    q = trajectory()
    shown = scenes(mech, q, dt=0.02, shapes=path)
    shown._add_player()
    gui = {type(x).__name__: x for x in shown.server.gui._gui_input_handle_from_uuid.values()}
    slider, plays = gui["GuiSliderHandle"], gui["GuiCheckboxHandle"]
    slider.value = 12
    p = np.asarray(js.forward_kinematics(mech, q[12], "lower").translation)
    np.testing.assert_allclose(shown.server.scene._handle_from_node_name["/robot/lower"].position, p, atol=1e-6)
    plays.value = True
    deadline = time.time() + 10
    while slider.value == 12 and time.time() < deadline:
        time.sleep(0.02)
    plays.value = False
    assert slider.value != 12


def test_states_are_shown_30_times_a_second(scenes, robot):
    mech, _ = robot
    assert scenes(mech, trajectory(100), dt=0.01).times().tolist() == [int(k * 100 / 30 + 1e-9) for k in range(30)]
    assert scenes(mech, trajectory(3), dt=0.1).times().tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]


def test_a_page_has_all_it_needs(robot, tmp_path, capfd):
    """Scripts and data are inside, nothing is fetched, and nothing is printed."""
    mech, path = robot
    page = viewer.record(mech, FLOAT([0.1, 0.2]), tmp_path / "arm.html", shapes=path).read_text()
    assert "__VISER_EMBED_DATA__" in page and 'src="http' not in page and 'href="http' not in page
    assert page.count("darkMode:") == 1 and "darkMode:(window.frameElement" in page  # as the page around it, if any
    assert capfd.readouterr().out == ""


def test_what_is_shown_is_served(robot):
    mech, path = robot
    shown = viewer.show(mech, trajectory(), shapes=path, port=8095)
    try:
        address = f"http://127.0.0.1:{shown.server.get_port()}"
        assert b"<html" in urllib.request.urlopen(address, timeout=10).read().lower()
    finally:
        shown.server.stop()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"mech": "arm"}, TypeError, "viewer: expected a Mechanism first"),
        ({"q": np.zeros((2, 2, 2), FLOAT)}, ValueError, r"q: expected shape \(2,\) or \(n, 2\), got \(2, 2, 2\)"),
        ({"shapes": "nowhere.urdf"}, FileNotFoundError, "there is no file nowhere.urdf"),
        ({"frames": ["tips"]}, KeyError, "did you mean 'tip'"),
        ({"forces": [1]}, TypeError, r"forces\[0\]: expected SpatialForces in a dict .*, AppliedForces, or a list"),
        ({"forces": {"tip": np.ones(6)}}, TypeError, r"forces\['tip'\]: expected a SpatialForce, got ndarray"),
        ({"forces": {"tips": js.SpatialForce(f=np.ones(3, FLOAT))}}, KeyError, "did you mean 'tip'"),
        ({"forces": [{"tip": js.SpatialForce(f=np.ones(3, FLOAT))}] * 5}, ValueError, r"act.* together.*np.stack\(x\)"),
        ({"forces": {"tip": js.SpatialForce(f=np.ones((7, 3), FLOAT))}}, ValueError, r"one for all states or \(5,\)"),
        ({"ground": 0.0}, TypeError, "ground: expected a HalfSpace, or a function"),
        ({"ground": js.HalfSpace(offset=np.zeros(5, FLOAT))}, ValueError, r"ground: expected one plane, got .*\(5,\)"),
        ({"ground": lambda p: p}, ValueError, r"ground: expected a signed distance, .* got float32\[3\]"),
        ({"ground": lambda p: p[2] * 0 + 1}, ValueError, "ground: expected a distance that is 0 near the robot"),
        ({"contacts": ["tip"]}, TypeError, "viewer: contacts: expected a PointContacts, got list"),
        ({"contacts": js.PointContacts(["tips"], **LAW)}, KeyError, "did you mean 'tip'"),
        ({"contacts": js.PointContacts(["tip"], np.zeros((5, 1, 3)), **LAW)}, ValueError, r"one for .*a batch \(5,\)"),
        ({"path": "arm.mp4"}, ValueError, "path: expected one that ends in .html or .viser"),
        ({"path": None}, TypeError, "viewer.record: path: expected a path, got NoneType"),
        ({"path": "nowhere/arm.html"}, FileNotFoundError, "viewer.record: path: there is no folder nowhere"),
        ({"dt": "a"}, ValueError, "viewer: dt: expected a number above 0, .*got 'a'"),
        ({"dt": -1.0}, ValueError, "viewer: dt: expected a number above 0, .*got -1.0"),
    ],
    ids=[
        "mech",
        "q",
        "shapes",
        "frames",
        "forces",
        "wrench",
        "frame of a force",
        "one each",
        "states",
        "ground",
        "grounds",
        "distance",
        "no ground",
        "contacts",
        "frame of a contact",
        "many contacts",
        "path",
        "no path",
        "no folder",
        "time as a text",
        "time before",
    ],
)
def test_messages(change, error, message, robot, tmp_path):
    given = {"mech": robot[0], "q": trajectory(5), "path": tmp_path / "x.viser"} | change
    with pytest.raises(error, match=message):
        viewer.record(given.pop("mech"), given.pop("q"), given.pop("path"), **given)


@pytest.mark.parametrize("port", ["8080", -1, 65536, 80.0])
def test_a_port_has_a_number_that_there_is(port, robot):
    """Else viser would wait for ever."""
    with pytest.raises(ValueError, match="viewer: port: expected an integer from 0 to 65535, got"):
        viewer.show(robot[0], trajectory(5), port=port)


def test_links_of_another_robot_are_named(robot):
    mech, path = robot
    path.write_text(path.read_text().replace('"lower"', '"under"'))
    with pytest.raises(KeyError, match="a link of the file: expected one of .*got 'under'"):
        meshes("viewer", mech, path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody/></mujoco>", "expected a URDF, <robot>, got <mujoco>; without shapes"),
        ("<sdf/>", "expected a URDF, <robot>, got <sdf>$"),
        ("joints: 3", "expected a URDF, got malformed XML"),
        ("<robot/>", "an element lacks the attribute 'name'"),
    ],
)
def test_shapes_of_another_format_are_refused(text, message, robot):
    mech, path = robot
    path.write_text(text)
    with pytest.raises(ValueError, match=f"viewer: shapes: .*arm.urdf: {message}"):
        viewer.record(mech, trajectory(2), path.with_suffix(".viser"), shapes=path)


def test_only_who_looks_needs_viser():
    source = """
import sys
sys.modules["viser"] = None
import jaxspatial
try:
    from jaxspatial import viewer
except ImportError as error:
    assert "[view]" in str(error) and "viser" in str(error), error
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-c", source], check=True)


@pytest.mark.slow
@pytest.mark.skipif(not BROWSER.exists(), reason="needs chromium")
def test_a_browser_shows_a_recording(robot, tmp_path):
    """The robot is in the middle, and has moved when the film has played on."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install playwright")
    image = pytest.importorskip("PIL.Image")
    mech, path = robot
    tip = {"tip": js.SpatialForce(f=FLOAT([0, 0, -10]))}
    page = viewer.record(mech, trajectory(61), tmp_path / "arm.html", shapes=path, forces=tip)
    flags = "--headless --no-sandbox --disable-gpu --disable-background-networking --disable-component-update"
    flags += " --disable-sync --no-first-run"
    faults, pictures, orange = [], [], 0
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=str(BROWSER), args=flags.split())
        tab = browser.new_page(viewport={"width": 800, "height": 600})
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.goto(page.as_uri())
        for k in range(40):
            tab.wait_for_timeout(1000)
            tab.screenshot(path=tmp_path / f"{k}.png")
            # The middle of the page, without what the client writes at its sides.
            pictures.append(np.asarray(image.open(tmp_path / f"{k}.png").convert("RGB"), float)[150:500, 250:750])
            orange = (abs(pictures[-1] - viewer.FORCE).max(-1) < 60).sum()
            if orange and pictures[-1].std() > 5 and abs(pictures[-1] - pictures[0]).mean() > 1:
                break
        browser.close()
    assert not faults and pictures[-1].std() > 5 and orange
    assert abs(pictures[-1] - pictures[0]).mean() > 1

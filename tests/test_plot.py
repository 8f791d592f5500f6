"""What is drawn has the numbers of the library: ends of lines, arrows and arcs, extents of ellipsoids."""

import inspect
import re
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.marks import slow
from tests.helpers.soon import compiled_soon

pyplot = pytest.importorskip("matplotlib.pyplot")
from jaxspatial import plot  # noqa: E402

FLOAT = np.float32
DRAWING = [plot.axes, plot.mechanism, plot.torques, plot.frame, plot.wrench, plot.inertia, plot.scales]
DRAWING += [plot.forces, plot.scale_bars]


@pytest.fixture(autouse=True, scope="module")
def _soon():
    """What is drawn is the same, and many small programs compile sooner."""
    with compiled_soon():
        yield


@pytest.fixture(autouse=True)
def _closed():
    backend = pyplot.get_backend()
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")
    pyplot.switch_backend(backend)


def placed(*p):
    return js.RigidTransform(js.Rotation.identity(dtype=FLOAT), np.array(p, FLOAT))


def arm():
    """A hinge on the world about x, a slide along its z, and a hinge whose body is not where its joint is."""
    M = js.SpatialInertia.solid_box(FLOAT([0.1, 0.2, 0.4]), mass=FLOAT(2))
    joints = [
        js.Joint("shoulder", "revolute", "world", "upper", placed(0.1, 0, 0.5), axis=(1, 0, 0)),
        js.Joint("slide", "prismatic", "upper", "rod", placed(0, 0.2, 0.3)),
        js.Joint("wrist", "revolute", "rod", "hand", placed(0, 0, 0.2), placed(0, 0.3, 0), axis=(0, 1, 0)),
    ]
    bodies = [js.Body(name, M) for name in ("upper", "rod", "hand")]
    frames = [js.Frame("grip", "hand", placed(0, 0.4, 0.1)), js.Frame("table", "world", placed(0, 0, 0.2))]
    return js.Mechanism.build(bodies, joints, frames, dtype=FLOAT)


Q = FLOAT([0.7, 0.1, -0.4])


def named(ax, gid):
    """The points (n, 3) of each line and arrow of a name."""
    lines = [np.stack(line.get_data_3d(), -1) for line in ax.lines if line.get_gid() == gid]
    return lines + [arrow.ends for arrow in ax.patches if arrow.get_gid() == gid]


def places(mech, q, frames):
    return np.asarray(js.forward_kinematics(mech, q, frames).translation)


def test_bodies_join_the_origins_of_joints():
    mech = arm()
    X_WH = js.forward_kinematics(mech, Q, "hand")
    wrist = np.asarray(X_WH @ FLOAT([0, -0.3, 0]))  # where the joint is on the body
    joints = np.stack([*places(mech, Q, ["upper", "rod"]), wrist])
    ax = plot.mechanism(mech, Q, frames=["grip", "table"])
    close = {"rtol": 0, "atol": 1e-6}
    np.testing.assert_allclose(named(ax, "joints")[0], joints, **close)
    for name, start, end in zip(["upper", "rod", "hand"], [np.zeros(3), *joints[:2]], joints, strict=True):
        np.testing.assert_allclose(named(ax, name), [[start, end]], **close)
    grip, table = places(mech, Q, ["grip", "table"])
    np.testing.assert_allclose(named(ax, "grip"), [[wrist, grip]], **close)
    np.testing.assert_allclose(named(ax, "table"), [[np.zeros(3), table]], **close)
    assert [text.get_text().strip() for text in ax.texts] == ["grip", "table"]
    axes = np.stack([named(ax, f"grip {letter}")[0] for letter in "xyz"])
    R_WG = np.asarray(js.forward_kinematics(mech, Q, "grip").rotation.to_matrix())
    directions = np.diff(axes, axis=1)[:, 0]
    np.testing.assert_allclose(directions / np.linalg.norm(directions, axis=1, keepdims=True), R_WG.T, **close)


def test_a_body_without_children_ends_in_its_farthest_frame():
    """Or in its centre of mass."""
    mech = arm()
    ax = plot.mechanism(mech, Q)
    np.testing.assert_allclose(named(ax, "hand tip")[0][1], places(mech, Q, "grip"), rtol=0, atol=1e-6)
    M = js.SpatialInertia.thin_rod(FLOAT(0.6), mass=FLOAT(1)).shift(FLOAT([0, 0, 0.3]))
    pendulum = js.Mechanism.build([js.Body("rod", M)], [js.Joint("a", "revolute", "world", "rod", axis=(0, 1, 0))])
    q = FLOAT([0.3])
    end = named(plot.mechanism(pendulum, q), "rod tip")[0][1]
    np.testing.assert_allclose(end, js.center_of_mass(pendulum, q), rtol=0, atol=1e-6)


def test_nothing_ties_a_free_body_to_the_world():
    M = js.SpatialInertia.solid_sphere(FLOAT(0.1), mass=FLOAT(1))
    ball = js.Mechanism.build([js.Body("ball", M)], [js.Joint("root", "free", "world", "ball")])
    ax = plot.mechanism(ball, FLOAT([1, 0, 0, 0, 0.5, 0.2, 1]), ground=js.HalfSpace(FLOAT([0, 0, 2]), FLOAT(0.1)))
    assert not named(ax, "ball") and named(ax, "joints")[0].tolist() == [pytest.approx([0.5, 0.2, 1])]
    low, high = ax.get_zlim()
    assert low <= 0.1 <= high  # the plane, for a normal of any length


COLLECTION = plot.Poly3DCollection
GROUNDS = {
    "slope": lambda p: 2 * p[2] - p[0] + 0.3,
    "ball": lambda p: 0.5 - jnp.linalg.norm(p),
    "box": lambda p: jnp.linalg.norm(jnp.maximum(abs(p) - jnp.array([0.3, 0.3, 0.05], p.dtype), 0)) - 0.01,
}


@pytest.mark.parametrize("name", GROUNDS)
def test_a_ground_function_is_drawn_where_it_is_zero(name, monkeypatch):
    """As contacts take it: of any slope, round, with edges; what is drawn is inside the axes."""
    mech, ground = arm(), GROUNDS[name]
    given = []
    monkeypatch.setattr(plot, "Poly3DCollection", lambda x, **look: given.append(x) or COLLECTION(x, **look))
    ax = plot.mechanism(mech, Q, ground=ground)
    assert [x.get_gid() for x in ax.collections] == ["ground"]
    vertices = np.concatenate(given).reshape(-1, 3)
    steps = np.ptp(vertices, axis=0).max() / 24
    distances = [float(ground(jnp.asarray(p, FLOAT))) for p in vertices[::7]]
    assert len(vertices) > 1000 and np.ptp(vertices, axis=0)[:2].min() > 0.5
    np.testing.assert_allclose(distances, 0, atol=1e-6 if name == "slope" else 0.5 * steps)
    for values, limits in zip(vertices.T, (ax.get_xlim(), ax.get_ylim(), ax.get_zlim()), strict=True):
        assert limits[0] <= values.min() and values.max() <= limits[1]


def test_frames():
    X = js.RigidTransform(js.Rotation.exp(FLOAT([0.3, -0.2, 0.9])), FLOAT([1, 2, 3]))
    ax = plot.frame(X, length=0.5, name="B")
    for k, letter in enumerate("xyz"):
        tip = np.asarray(X @ (0.5 * np.eye(3, dtype=FLOAT)[k]))
        np.testing.assert_allclose(named(ax, f"B {letter}"), [[[1, 2, 3], tip]], rtol=0, atol=1e-6)
    assert ax.texts[0].get_text().strip() == "B"


def test_a_wrench():
    """The arrow is along the force; the arc turns about the torque; about the central axis no torque is across it."""
    F, P = js.SpatialForce(FLOAT([1, 2, -1]), FLOAT([0, 4, -20])), np.array([0.3, 0.2, 0.1])
    ax = plot.wrench(F, P, scale=plot.Scales(0.05, 0.1))
    (arrow,), (arc,), (line,) = (named(ax, name) for name in ("force", "torque", "central axis"))
    np.testing.assert_allclose(arrow, [P, P + 0.05 * np.asarray(F.f)], rtol=0, atol=1e-6)
    spokes = arc - P
    np.testing.assert_allclose(np.linalg.norm(spokes, axis=1), 0.1 * np.sqrt(6), rtol=1e-6)
    turning = np.cross(spokes[:-1], spokes[1:])
    n = np.asarray(F.tau) / np.sqrt(6)
    np.testing.assert_allclose(turning / np.linalg.norm(turning, axis=1, keepdims=True), n + 0 * turning, atol=1e-6)
    (head,) = named(ax, "torque head")
    np.testing.assert_allclose(head[1], arc[-1], atol=1e-12)
    pitch = js.central_axis(F).pitch
    for end in line:
        F_A = js.shift(F, FLOAT(end - P))
        np.testing.assert_allclose(F_A.tau, pitch * F.f, rtol=0, atol=2e-5)
    assert ax.get_legend_handles_labels()[1] == [f"central axis, pitch {pitch:.3g} m"]


def test_no_axis_is_drawn_without_use():
    """Through the point of the wrench, of a couple, far away, or where none is asked for."""
    zero, f = FLOAT([0, 0, 0]), FLOAT([0, 0, 10])
    for F in (js.SpatialForce(zero, f), js.SpatialForce(f, zero), js.SpatialForce(FLOAT([0, 1e3, 0]), f)):
        assert not named(plot.wrench(F, np.zeros(3)), "central axis")
    assert not named(plot.wrench(js.SpatialForce(FLOAT([0, 1, 0]), f), np.zeros(3), axis=False), "central axis")


def test_arrows_in_the_same_axes_have_one_scale():
    """The largest has the length that is said, whichever came first."""
    zero, points = np.zeros((2, 3), FLOAT), np.array([[0, 0, 0.1], [0.1, 0, 0.5]])
    ax = plot.mechanism(arm(), Q)
    size = max(np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim()))
    plot.wrench(js.SpatialForce(zero, FLOAT([[0, 0, 5], [0, 0, 20]])), points, ax)
    assert plot.scales(ax) == (pytest.approx(0.3 * size / 20), None)
    plot.wrench(js.SpatialForce(FLOAT([0, 0, 7]), FLOAT([0, 40, 0])), points[0], ax, axis=False)
    lengths = [np.linalg.norm(np.diff(ends, axis=0)) for ends in named(ax, "force")]
    np.testing.assert_allclose(lengths, 0.3 * size * np.array([5, 20, 40]) / 40, rtol=1e-6)
    assert plot.scales(ax) == (pytest.approx(0.3 * size / 40), pytest.approx(0.09 * size / 7))
    assert len(named(ax, "torque")) == 1  # nothing where there is no torque
    plot.wrench(js.SpatialForce(zero[0], FLOAT([0, 1, 0])), points[0], ax, scale=plot.Scales(force=0.01))
    assert plot.scales(ax) == (0.01, pytest.approx(0.09 * size / 7))
    np.testing.assert_allclose(np.diff(named(ax, "force")[0], axis=0), [[0, 0, 0.05]], atol=1e-7)


def test_axes_can_be_cleared_for_the_next_state():
    ax = plot.wrench(FORCE, np.zeros(3))
    for _ in range(2):
        ax.clear()
        plot.wrench(FORCE, np.zeros(3), plot.mechanism(arm(), Q, ax))
        assert len(named(ax, "force")) == 1


def test_small_arrows_are_left_out():
    f = FLOAT([[0, 0, 10], [0, 0, 0.01], [0, 0, 0]])
    ax = plot.wrench(js.SpatialForce(np.zeros((3, 3), FLOAT), f), np.zeros(3))
    assert len(named(ax, "force")) == 1


def test_forces_of_joints_are_about_and_along_their_axes():
    mech, tau = arm(), FLOAT([3, -4, -2])
    ax = plot.torques(mech, Q, tau, plot.mechanism(mech, Q))
    force, torque = map(float, plot.scales(ax))
    (slide,) = named(ax, "force")
    R = js.forward_kinematics(mech, Q).rotation.to_matrix()
    np.testing.assert_allclose(np.diff(slide, axis=0)[0], force * -4 * np.asarray(R[1, :, 2]), atol=1e-6)
    joints = named(ax, "joints")[0]
    for arc, i, axis, t in zip(named(ax, "torque"), (0, 2), (R[0, :, 0], R[2, :, 1]), (3, -2), strict=True):
        spokes = arc - joints[i]
        np.testing.assert_allclose(np.linalg.norm(spokes, axis=1), torque * abs(t), rtol=1e-5)
        turning = np.cross(spokes[0], spokes[1])
        np.testing.assert_allclose(turning / np.linalg.norm(turning), np.sign(t) * np.asarray(axis), atol=1e-5)


def test_joints_of_several_coordinates_and_mimics_have_no_arrow():
    mech = js.testing.random_mechanism(0, 6, ["free", "ball", "revolute"], dtype=FLOAT)
    hinges = mech.topology.kinds.count("revolute")
    ax = plot.torques(mech, mech.neutral(), np.ones(mech.nv, FLOAT), plot.mechanism(mech, mech.neutral()))
    assert 0 < len(named(ax, "torque")) == hinges < mech.nv


def test_an_ellipsoid():
    """Its sections are on the surface whose second moments are those of the inertia."""
    M = js.SpatialInertia.solid_box(FLOAT([0.1, 0.5, 0.3]), mass=FLOAT(2)).shift(FLOAT([0.2, 0.1, 0]))
    X = js.RigidTransform(js.Rotation.exp(FLOAT([0.3, -0.2, 0.9])), FLOAT([1, 2, 3]))
    sections = named(plot.inertia(M, None, X), "inertia")
    assert len(sections) == 3
    p_WC = np.asarray(X @ M.com)
    R = np.asarray(X.rotation.to_matrix(), float)
    second = np.diag(np.array([0.1, 0.5, 0.3]) ** 2 / 12)  # of a box: those of the ellipsoid are a^2 / 5
    inverse = np.linalg.inv(R @ (5 * second) @ R.T)
    for section in sections:
        np.testing.assert_allclose(np.einsum("ni,ij,nj->n", section - p_WC, inverse, section - p_WC), 1, rtol=1e-5)
    farthest = max(np.linalg.norm(section - p_WC, axis=1).max() for section in sections)
    np.testing.assert_allclose(farthest, M.equivalent_ellipsoid()[0][0], rtol=1e-5)


def test_lengths_are_equal_along_all_axes():
    ax = plot.mechanism(arm(), Q)
    plot.wrench(js.SpatialForce(FLOAT([0, 0, 0]), FLOAT([0, 9, 0])), np.zeros(3), ax)
    lengths = np.ptp([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()], axis=1)
    shape = np.array(ax.get_box_aspect())
    np.testing.assert_allclose(shape / np.linalg.norm(shape), lengths / np.linalg.norm(lengths))


def test_all_that_is_drawn_is_inside_the_axes():
    ax = plot.frame(placed(0, 0, 0))
    plot.wrench(js.SpatialForce(FLOAT([0, 0, 1]), FLOAT([30, 40, 0])), np.ones(3), ax)
    ax.figure.canvas.draw()
    for line in [*named(ax, "force"), *named(ax, "torque"), *named(ax, "central axis")]:
        for values, limits in zip(line.T, (ax.get_xlim(), ax.get_ylim(), ax.get_zlim()), strict=True):
            assert limits[0] <= values.min() and values.max() <= limits[1]


def test_axes_of_our_own_have_equal_steps():
    figure = pyplot.figure()
    ax = plot.mechanism(arm(), Q, plot.axes(figure, (1, 2, 2)))
    assert ax.figure is figure and ax.get_subplotspec().get_geometry()[:2] == (1, 2)
    steps = [np.diff(ticks) for ticks in (ax.get_xticks(), ax.get_yticks(), ax.get_zticks())]
    np.testing.assert_allclose(np.concatenate(steps), steps[0][0])


def test_names_are_in_the_ink_of_the_theme():
    with pyplot.style.context("dark_background"):
        ax = plot.frame(placed(0, 0, 0), name="W")
        assert ax.texts[0].get_color() == pyplot.rcParams["text.color"] == "white"


def _luminance(color):
    from matplotlib.colors import to_rgb

    rgb = np.array(to_rgb(color))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("color", [plot.BODY, plot.JOINT, plot.FORCE, plot.TORQUE, plot.INERTIA, *plot.XYZ])
def test_colours_can_be_seen_on_white_and_on_black(color):
    """The contrast that WCAG 2.2 asks of graphics, 1.4.11."""
    y = _luminance(color)
    assert 1.05 / (y + 0.05) >= 3 and (y + 0.05) / 0.05 >= 3


MECH, FORCE = arm(), js.SpatialForce(np.zeros(3, FLOAT), np.ones(3, FLOAT))
MANY = js.SpatialForce(np.zeros((2, 2, 3), FLOAT), np.ones((2, 2, 3), FLOAT))
TWO = placed(0, 0, 0)._with_vectors([np.tile(x, (2, 1)) for x in placed(0, 0, 0)._vectors])
BODIES = MECH.inertias
MESSAGES = [
    (lambda: plot.mechanism("robot", Q), TypeError, "plot.mechanism: expected a Mechanism first, got str"),
    (lambda: plot.mechanism(MECH, np.zeros((5, 3), FLOAT)), ValueError, r"q: .*, got \(5, 3\): pass one state, q\[i\]"),
    (lambda: plot.mechanism(MECH, np.zeros(4, FLOAT)), ValueError, r"q: expected shape \(3,\), got \(4,\)$"),
    (lambda: plot.mechanism(MECH, Q, frames=["gripp"]), KeyError, "did you mean 'grip'"),
    (lambda: plot.mechanism(MECH, Q, frames="grip"), TypeError, "frames: expected a sequence of names"),
    (lambda: plot.mechanism(MECH, Q, ground=0.0), TypeError, "ground: expected a HalfSpace, or a function"),
    (lambda: plot.mechanism(MECH, Q, ground=js.HalfSpace(offset=np.zeros(2))), ValueError, r"one plane, .* \(2,\)"),
    (lambda: plot.mechanism(MECH, Q, ground=lambda p: p), ValueError, "ground: expected a signed distance, float32"),
    (lambda: plot.mechanism(MECH, Q, ground=lambda p: p[0] ** 2 + 1), ValueError, "a distance that is 0 near the rob"),
    (lambda: plot.mechanism(MECH, Q, pyplot.figure().add_subplot()), TypeError, "projection='3d', got Axes"),
    (lambda: plot.mechanism(jax.tree.map(lambda x: np.stack([x, x]), MECH), Q), ValueError, "mechanism, got a batch"),
    (lambda: plot.torques(MECH, Q, np.zeros(2, FLOAT)), ValueError, r"tau: expected shape \(3,\), got \(2,\)"),
    (lambda: plot.torques(MECH, Q, np.full(3, np.nan, FLOAT)), ValueError, "expected finite numbers"),
    (lambda: plot.frame(np.eye(4)), TypeError, "plot.frame: X_WF: expected a RigidTransform"),
    (lambda: plot.frame(TWO), ValueError, r"got a batch \(2,\): pass x.at_batch\(i\)"),
    (lambda: plot.wrench(np.zeros(6), np.zeros(3)), TypeError, "plot.wrench: expected a SpatialForce"),
    (lambda: plot.wrench(MANY, np.zeros(3)), ValueError, r"got \(2, 2\): pass F.at_batch\(i\)"),
    (lambda: plot.wrench(FORCE, np.zeros(2)), ValueError, r"p_WP: expected shape \(3,\)"),
    (lambda: plot.wrench(FORCE, np.zeros(3), scale=0.1), TypeError, "scale: expected a Scales"),
    (lambda: plot.inertia(BODIES), ValueError, r"got a batch \(3,\): pass x.at_batch\(i\)"),
    (lambda: plot.inertia(js.SpatialInertia.zero(dtype=FLOAT)), ValueError, "the inertia of a body with a mass"),
    (lambda: plot.scales(None), TypeError, "projection='3d', got NoneType"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "message"), MESSAGES, ids=[message for *_, message in MESSAGES])
def test_messages(call, error, message):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize("function", DRAWING, ids=lambda f: f.__name__)
def test_docstrings_tell_arguments_results_and_errors(function):
    doc = inspect.getdoc(function) or ""
    args = re.search(r"^Args:\n((?:    .*\n)+)", doc, re.M)
    assert args and re.findall(r"^    (\w+): ", args[1], re.M) == list(inspect.signature(function).parameters)
    assert re.search(r"^Returns:", doc, re.M) and re.search(r"^    \w+Error: .", doc, re.M)


def test_only_who_draws_needs_matplotlib():
    source = """
import sys
sys.modules["matplotlib"] = None
import jaxspatial
try:
    from jaxspatial import plot
except ImportError as error:
    assert "[plot]" in str(error) and "matplotlib" in str(error), error
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-c", source], check=True)


# -- forces, contacts, shapes and scale bars ---------------------------------------------------------------------------


def test_forces_are_those_of_dynamics():
    """From a dict, from AppliedForces in axes of frames and at points, and from both in a list."""
    mech = arm()
    up, along = js.SpatialForce(f=FLOAT([0, 0, 4])), js.SpatialForce(f=FLOAT([[2, 0, 0]]))
    there = js.AppliedForces(["grip"], along, points=FLOAT([[0.1, 0, 0]]), axes="frame")
    X_WG = js.forward_kinematics(mech, Q, "grip")
    start = np.asarray(X_WG @ FLOAT([0.1, 0, 0]))
    ax = plot.forces(mech, Q, [{"table": up}, there], plot.mechanism(mech, Q))
    scale = plot.scales(ax).force
    first, second = named(ax, "force")
    np.testing.assert_allclose(first, [[0, 0, 0.2], [0, 0, 0.2 + 4 * scale]], atol=1e-6)
    turned = np.asarray(X_WG.rotation @ FLOAT([2 * scale, 0, 0]))
    np.testing.assert_allclose(second, [start, start + turned], atol=1e-6)
    assert not named(plot.forces(mech, Q, None), "force")


def test_contacts_are_rings_about_their_centres():
    mech = arm()
    offsets = FLOAT([[0, 0, 0], [0, 0.1, 0]])
    touching = {"stiffness": FLOAT(1e4), "relaxation_time": FLOAT(0.01), "friction": FLOAT(0.5)}
    ax = plot.mechanism(mech, Q, contacts=js.PointContacts(["hand", "grip"], offsets, **touching))
    X = js.forward_kinematics(mech, Q, ["hand", "grip"])
    expected = [np.asarray(X.at_batch(k) @ offsets[k]) for k in range(2)]
    np.testing.assert_allclose(named(ax, "contacts"), [expected], atol=1e-6)
    with pytest.raises(ValueError, match="plot.mechanism: contacts: expected one for all states"):
        plot.mechanism(mech, Q, contacts=js.PointContacts(["hand"], offsets[:, None], **touching))


_BOX = """<robot name="box"><link name="base"/><link name="box">
<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0 0 0.25"/><geometry><box size="0.1 0.2 0.5"/></geometry></visual></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="box"/><axis xyz="0 1 0"/>
<origin xyz="0 0 1"/></joint></robot>"""


def with_shapes(tmp_path, text, q, ground=None):
    (tmp_path / "box.urdf").write_text(text)
    mech = js.Mechanism.from_urdf(text, dtype=FLOAT)
    return plot.mechanism(mech, FLOAT([q]), shapes=tmp_path / "box.urdf", ground=ground)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_shapes_take_the_place_of_lines(tmp_path):
    pytest.importorskip("yourdfpy")
    ax = with_shapes(tmp_path, _BOX, np.pi / 2)  # z of the link along x
    (solid,) = (found for found in ax.artists if found.get_gid() == "shapes")
    np.testing.assert_allclose(solid.corners.min((0, 1)), [0, -0.1, 0.95], atol=1e-6)
    np.testing.assert_allclose(solid.corners.max((0, 1)), [0.5, 0.1, 1.05], atol=1e-6)
    assert not named(ax, "joints") and len(solid.corners) == 12
    with pytest.raises(FileNotFoundError, match="plot.mechanism: shapes: there is no file"):
        plot.mechanism(js.Mechanism.from_urdf(_BOX), FLOAT([0]), shapes=tmp_path / "none.urdf")


def painted(ax):
    """(the colours of a picture, row by row from below; the row and the column of a point of space)."""
    ax.figure.canvas.draw()
    image = np.asarray(ax.figure.canvas.buffer_rgba())[::-1, :, :3] / 255

    def at(p):
        x, y, _ = plot.proj3d.proj_transform(*p, ax.get_proj())
        return tuple(ax.transData.transform((x, y)).astype(int)[::-1])

    return image, at


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("elevation", [90, slow(-90)])
def test_what_is_nearer_covers(tmp_path, elevation):
    """A wide red box above a small blue one, from above and from below; edges keep flat faces flat."""
    pytest.importorskip("yourdfpy")
    look = '<material name="{0}"><color rgba="{1}"/></material></visual>'
    red = '<visual><origin xyz="0 0 1"/><geometry><box size="1 1 0.1"/></geometry>' + look.format("red", "1 0 0 1")
    blue = '<visual><geometry><box size="0.4 0.4 0.1"/></geometry>' + look.format("blue", "0 0 1 1")
    text = re.sub("<visual>.*</visual>", red + blue, _BOX.replace("\n", ""))
    ax = with_shapes(tmp_path, text, 0)
    ax.view_init(elevation, 0)
    image, at = painted(ax)
    middle, beside = image[at((0, 0, 1))], image[at((0.4, 0.4, 2 if elevation > 0 else 1))]
    assert np.argmax(middle) == (0 if elevation > 0 else 2) and np.ptp(middle) > 0.4
    assert np.argmax(beside) == 0 and np.ptp(beside) > 0.4
    assert elevation < 0 or abs(middle - image[at((0.3, -0.3, 2))]).max() < 0.01


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_shapes_throw_a_shadow_on_a_plane(tmp_path):
    """The light comes from x and from -y."""
    pytest.importorskip("yourdfpy")
    ground = js.HalfSpace(FLOAT([0, 0, 1]), FLOAT(1.0))
    at_ground, away = (-0.05, 0.14, 1.0), (0.13, -0.13, 1.0)
    ax = with_shapes(tmp_path, _BOX, 0, ground)
    (solid,) = (found for found in ax.artists if found.get_gid() == "shapes")
    np.testing.assert_allclose(solid.shadow[..., 2], 1, atol=1e-6)
    next(x for x in ax.collections if x.get_gid() == "ground").remove()
    ax.set_axis_off()
    ax.view_init(60, -90)
    image, at = painted(ax)
    assert image[at(at_ground)].max() < 0.85 and image[at(away)].min() > 0.99
    beyond = (-0.16, 0.18, 1.0)  # in the shadow, if the ground went on
    assert image[at(beyond)].min() > 0.99


def test_amounts_stand_beside_torques():
    """In two digits, with their units, and clear of their arcs: a text is moved on paper as far as it is long."""
    mech = arm()
    tau = FLOAT([33.3, -1234.0, -12.4])
    ax = plot.torques(mech, Q, tau, plot.mechanism(mech, Q), numbers=True)
    texts = list(ax.texts)
    assert [text.get_text().strip() for text in texts] == ["33 N m", "1200 N", "12 N m"]
    up = {"grip": js.SpatialForce(f=FLOAT([0, 0, 4]))}
    assert plot.forces(mech, Q, up, numbers=True).texts[0].get_text().strip() == "4 N"
    _, at = painted(ax)
    for text, arc in zip([texts[0], texts[2]], named(ax, "torque"), strict=True):
        assert not any(text.get_window_extent().contains(*at(p)[::-1]) for p in arc)


def test_scale_bars_have_round_numbers_and_the_scale_of_all_arrows():
    ax = plot.mechanism(arm(), Q)
    with pytest.raises(ValueError, match="plot.scale_bars: ax: expected axes with wrenches"):
        plot.scale_bars(ax)
    plot.wrench(js.SpatialForce(FLOAT([0, 0, 7]), FLOAT([0, 0, 70])), FLOAT([0, 0, 0]), ax)
    plot.scale_bars(ax)
    for largest, force in ((70, 20.0), (7000, 2000.0)):
        if largest == 7000:  # the bars follow
            plot.wrench(js.SpatialForce(f=FLOAT([0, 0, largest])), FLOAT([0, 0, 0]), ax)
        ((start, end),) = named(ax, "force bar")
        assert np.linalg.norm(end - start) == pytest.approx(force * plot.scales(ax).force, rel=1e-6)
        assert f"{force:g} N" in {text.get_text().strip() for text in ax.texts}
    assert "5 N m" in {text.get_text().strip() for text in ax.texts}


def test_a_short_arrow_has_a_small_head():
    """One longer than the arrow would seem to point the other way; that of an arc stays."""
    ax = plot.mechanism(arm(), Q)
    f = FLOAT([[0, 0, 50], [0, 0, 2]])
    plot.wrench(js.SpatialForce(FLOAT([[0, 0, 5], [0, 0, 5]]), f), FLOAT([[0, 0, 0], [0.2, 0, 0]]), ax)
    ax.figure.canvas.draw()
    arrows = [arrow for arrow in ax.patches if arrow.get_gid() == "force"]
    lengths = []
    for arrow in arrows:
        corners = arrow.get_transform().transform_path(arrow.get_path()).vertices
        lengths.append(float(np.linalg.norm(np.ptp(corners, axis=0))) * 72 / ax.figure.dpi)
    large, small = (arrow.get_mutation_scale() for arrow in arrows)
    assert (
        large == pytest.approx(13.2) and lengths[0] > 0.4 * large > 0.4 * small > 0 and 0.4 * small < 1.05 * lengths[1]
    )
    assert {arrow.get_mutation_scale() for arrow in ax.patches if arrow.get_gid() == "torque head"} == {6 * 1.7}


def _flat(ax):
    """Much wider than high, with names at its ends."""
    plot.frame(placed(0, 0, 0), ax, length=0.2, name="the world")
    return plot.frame(placed(2, 0.5, 0), ax, length=0.2, name="a frame with a long name")


SCENES = {
    "arm": lambda ax: plot.mechanism(arm(), Q, ax),
    "arm on the ground": lambda ax: plot.mechanism(arm(), Q, ax, ground=js.HalfSpace(FLOAT([0, 0, 1]), FLOAT(0))),
    "flat": _flat,
    "high": lambda ax: plot.inertia(js.SpatialInertia.solid_box(FLOAT([0.3, 0.4, 3]), mass=FLOAT(1)), ax),
}


@pytest.mark.parametrize("size", [(6.5, 6), (3.35, 2)])  # in: of a screen, and of a column of a paper
@pytest.mark.parametrize("scene", SCENES)
def test_labels_are_not_cut(scene, size):
    """Those of axes, ticks and things are in the figure; names of axes are clear of numbers; little room is left."""
    figure = pyplot.figure(figsize=size)
    ax = SCENES[scene](plot.axes(figure))
    figure.canvas.draw()
    width, height = figure.bbox.size
    texts, corners = list(ax.texts), np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        low, high = axis.get_view_interval()
        seen = [tick.label1 for tick in axis.get_major_ticks() if low < tick.get_loc() < high]
        assert seen or scene == "high"
        assert not any(axis.label.get_window_extent().overlaps(text.get_window_extent()) for text in seen)
        texts += [axis.label, *seen]
    boxes = [text.get_window_extent() for text in texts]
    for text, box in zip(texts, boxes, strict=True):
        assert box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height, text
    at = np.stack(np.meshgrid(*corners), -1).reshape(-1, 3)
    paper = ax.transData.transform(np.stack(plot.proj3d.proj_transform(*at.T, ax.get_proj())[:2], -1))
    paper = np.concatenate([paper, *(box.get_points() for box in boxes)])
    assert (np.ptp(paper, axis=0) / [width, 0.94 * height]).max() > 0.9


def test_a_robot_on_the_ground_is_as_large():
    """The ground is beside it, and no larger than that needs: the box around both is not much larger on paper."""
    heights = []
    for ground in (None, js.HalfSpace(FLOAT([0, 0, 1]), FLOAT(0)), lambda p: p[2] - 0.02 * jnp.sin(9 * p[0])):
        ax = plot.mechanism(arm(), Q, ground=ground)
        _, at = painted(ax)
        heights.append(np.subtract(at(named(ax, "joints")[0][2]), at(np.zeros(3)))[0])
    assert min(heights[1:]) > 0.8 * heights[0] > 100


@pytest.mark.parametrize("module", ["plot", "viewer"])
def test_public_names_are_listed(module):
    """And no more: what is imported is not."""
    if module == "viewer":
        pytest.importorskip("viser")
    found = __import__(f"jaxspatial.{module}", fromlist=["__all__"])
    assert set(found.__all__) >= ({"mechanism", "wrench", "forces"} if module == "plot" else {"show", "record"})
    for name in found.__all__:
        assert getattr(found, name).__module__ == found.__name__, name

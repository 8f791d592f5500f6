"""Collision shapes of model files as spheres: where they are, which are taken, and that they bear what rests on them.

Poses on robots are compared with Pinocchio's and MuJoCo's in `peers/test_shapes.py`.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism.formats import collision

LAW = {"stiffness": 1e4, "relaxation_time": 0.02}

BODY = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = f"""<robot name="r">
  <link name="base">{BODY}
    <collision name="ball"><geometry><sphere radius="0.5"/></geometry></collision>
    <collision><origin xyz="1 2 3" rpy="1.5707963267948966 0 0"/>
      <geometry><capsule radius="0.1" length="0.4"/></geometry></collision>
  </link>
  <link name="foot">{BODY}
    <collision><origin xyz="0 0 1"/><geometry><box size="2 4 6"/></geometry></collision>
    <collision><origin rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="2" length="6"/></geometry></collision>
  </link>
  <link name="sole"/>
  <joint name="hinge" type="continuous"><parent link="base"/><child link="foot"/></joint>
  <joint name="weld" type="fixed"><parent link="foot"/><child link="sole"/></joint>
</robot>"""
MJCF = """<mujoco>
  <default>
    <geom friction=".7 .1 .1"/><default class="rough"><geom friction="1.5 .1 .1" contype="0"/></default>
  </default>
  <worldbody>
    GROUND
    <body name="base"><freejoint/>
      <geom name="ball" size=".5" contype="2" conaffinity="2"/>
      <geom name="pill" type="capsule" size=".1 .2" pos="1 2 3" euler="90 0 0"/>
      <body name="foot"><joint axis="0 0 1"/>
        <geom name="box" type="box" size="1 2 3" pos="0 0 1" class="rough"/>
        <geom name="egg" type="ellipsoid" size="1 2 3" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  REST
</mujoco>"""


def of_urdf(text=URDF, floating_base=True, **options):
    mech = js.Mechanism.from_urdf(text, floating_base, dtype=np.float64)
    return js.PointContacts.from_urdf(mech, text, **LAW, friction=0.5, **options)


def of_mjcf(ground="", rest="", **options):
    text = MJCF.replace("GROUND", ground).replace("REST", rest)
    mech = js.Mechanism.from_mjcf(text, dtype=np.float64)
    return js.PointContacts.from_mjcf(mech, text, **LAW, **options)


def box(x, y, z):
    return np.array(list(itertools.product((-x, x), (-y, y), (-z, z))))


# -- where they are ---------------------------------------------------------------------------------------------------


def test_points_of_shapes():
    contacts = of_urdf(rim=4)
    assert contacts.frames == ("base",) * 3 + ("foot",) * 16
    rims = [[x, *yz] for x in (-3, 3) for yz in ((0, -2), (2, 0), (0, 2), (-2, 0))]
    expected = [[0, 0, 0], [1, 2.2, 3], [1, 1.8, 3], *box(1, 2, 3) + [0, 0, 1]]
    np.testing.assert_allclose(contacts.positions[:11], expected, atol=1e-15)
    # The x axis of the cylinder is -z of its link.
    np.testing.assert_allclose(contacts.positions[11:], rims, atol=2e-15)
    np.testing.assert_array_equal(contacts.radius, [0.5, 0.1, 0.1, *[0] * 16])
    assert contacts.friction == 0.5 and contacts.dtype == np.float64
    np.testing.assert_array_equal(of_urdf(rim=5).positions.shape, (21, 3))


def test_a_sphere_without_radius_is_a_point():
    """Files mark points of a sole so."""
    text = URDF.replace('radius="0.5"', 'radius="0.0"')
    contacts = js.PointContacts.from_urdf(js.Mechanism.from_urdf(text, True), text, **LAW, friction=0.5)
    np.testing.assert_array_equal(contacts.positions[0], np.zeros(3))
    np.testing.assert_array_equal(contacts.radius[:3], np.array([0, 0.1, 0.1], contacts.dtype))


def test_words_of_vendors_beside_a_shape_are_left_out():
    text = URDF.replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ', 1)
    marked = text.replace('<sphere radius="0.5"/>', '<sphere radius="0.5"/><drake:declare_convex/>')
    np.testing.assert_array_equal(of_urdf(marked).positions, of_urdf(text).positions)
    alone = text.replace('<sphere radius="0.5"/>', "<drake:declare_convex/>")
    with pytest.raises(ValueError, match="expected a <geometry> with one of sphere, .*, got <drake:declare_convex>"):
        of_urdf(alone)


def test_geoms_of_an_mjcf(x64):
    contacts = of_mjcf(geoms=["ball", "pill", "box", "egg"])
    assert contacts.frames == ("base",) * 3 + ("foot",) * 14
    expected = [
        [0, 0, 0],
        [1, 2.2, 3],
        [1, 1.8, 3],
        *box(1, 2, 3) + [0, 0, 1],
        *-np.diag([1, 2, 3]),
        *np.diag([1, 2, 3]),
    ]
    np.testing.assert_allclose(contacts.positions, expected, atol=1e-15)
    np.testing.assert_array_equal(contacts.radius, [0.5, 0.1, 0.1, *[0] * 14])
    # Of the file, by the default classes of its geoms; or the caller's.
    np.testing.assert_array_equal(contacts.friction, [*[0.7] * 3, *[1.5] * 8, *[0.7] * 6])
    assert of_mjcf(geoms=["ball"], friction=0.25).friction == 0.25
    text = MJCF.replace("GROUND", "").replace("REST", "")
    assert js.PointContacts.from_mjcf(js.Mechanism.from_mjcf(text), text, **LAW).dtype == (
        np.float64 if x64 else np.float32
    )


def test_frames_of_welded_links_are_those_of_the_file():
    on_sole = '<link name="sole"><collision><geometry><sphere radius="1"/></geometry></collision></link>'
    text = URDF.replace('<link name="sole"/>', on_sole).replace(
        '<child link="sole"/>', '<child link="sole"/><origin xyz="0 0 -5"/>'
    )
    contacts = of_urdf(text, bodies=["sole"])
    assert contacts.frames == ("sole",) and not contacts.positions.any()
    mech = js.Mechanism.from_urdf(text, True, dtype=np.float64)
    with jax.enable_x64(True):
        X_WS = js.forward_kinematics(mech, mech.neutral(), "sole")
    np.testing.assert_allclose(X_WS.translation, [0, 0, -5])


# -- meshes -----------------------------------------------------------------------------------------------------------

CUBE = box(1.0, 1.0, 1.0)


def as_obj(points, faces):
    lines = ["v " + " ".join(map(repr, p)) for p in np.asarray(points, float).tolist()]
    return "\n".join([*lines, *("f " + " ".join(str(i + 1) for i in face) for face in faces)])


def tetrahedra(points):
    return [face for k in range(len(points) - 3) for face in itertools.combinations(range(k, k + 4), 3)]


def test_meshes_give_the_corners_of_their_hull(tmp_path):
    pytest.importorskip("trimesh")
    inside = np.random.default_rng(0).uniform(-0.9, 0.9, (20, 3))
    points = np.concatenate([inside, CUBE])
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "cube.obj").write_text(as_obj(points, tetrahedra(points)))
    file = tmp_path / "robot.urdf"
    mesh = '<mesh filename="package://some/meshes/cube.obj" scale="2 -1 1"/>'
    file.write_text(URDF.replace('<sphere radius="0.5"/>', mesh))
    mech = js.Mechanism.from_urdf(file, True, dtype=np.float64)
    contacts = js.PointContacts.from_urdf(mech, file, **LAW, friction=0.5, geoms=["ball"])
    assert {tuple(p) for p in contacts.positions.tolist()} == {tuple(p) for p in (CUBE * [2, -1, 1]).tolist()}
    few = js.PointContacts.from_urdf(mech, file, **LAW, friction=0.5, geoms=["ball"], corners=2)
    # Across the long diagonal.
    np.testing.assert_allclose(few.positions[0], -few.positions[1], atol=1e-15)
    assert len(few.frames) == 2
    (tmp_path / "meshes" / "cube.obj").unlink()
    with pytest.raises(FileNotFoundError, match=r"from_urdf: line 3: <mesh>: there is no file 'package://some/meshes"):
        js.PointContacts.from_urdf(mech, file, **LAW, friction=0.5, geoms=["ball"])
    # A mesh that nobody asked for is not looked for.
    assert len(js.PointContacts.from_urdf(mech, file, **LAW, friction=0.5, geoms=["base_1"]).frames) == 2


def test_meshes_of_an_mjcf():
    vertices = " ".join(map(str, np.concatenate([CUBE, CUBE / 2])[:, :].ravel().tolist()))
    asset = f'<asset><mesh name="cube" vertex="{vertices}" scale="1 2 3"/></asset>'
    text = MJCF.replace("REST", asset).replace("GROUND", "").replace('size=".5"', 'type="mesh" mesh="cube" pos="0 0 1"')
    mech = js.Mechanism.from_mjcf(text, dtype=np.float64)
    contacts = js.PointContacts.from_mjcf(mech, text, **LAW, geoms=["ball"])
    order = np.lexsort(contacts.positions.round(3).T)
    expected = CUBE * [1, 2, 3] + [0, 0, 1]
    # MuJoCo keeps vertices in float32.
    np.testing.assert_allclose(contacts.positions[order], expected[np.lexsort(expected.T)], atol=1e-6)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_flat_meshes_have_corners(rank):
    rng = np.random.default_rng(1)
    points = np.repeat(rng.uniform(-1, 1, (60, rank)), 2, 0) @ np.linalg.qr(rng.standard_normal((3, 3)))[0][:rank] + [
        1,
        2,
        3,
    ]
    found = collision.corners_of_hull(points)
    # In every direction as far as the points.
    directions = rng.standard_normal((100, 3))
    np.testing.assert_allclose((found @ directions.T).max(0), (points @ directions.T).max(0), atol=1e-12)
    assert len(found) == {0: 1, 1: 2}.get(rank, len(found)) and len(found) < 60


def test_few_corners_lie_far_apart():
    points = np.concatenate([[[10.0, 0, 0], [-8, 0, 0], [0, 5, 0], [-8, 1e-12, 0]], 1e-3 * CUBE])
    np.testing.assert_array_equal(collision.farthest(points, 3), points[:3])
    np.testing.assert_array_equal(collision.farthest(points[[0, 1, 1]], 3), points[:2])
    assert len(collision.farthest(points[:1], 5)) == 1


# -- which are taken --------------------------------------------------------------------------------------------------

FLOOR = '<geom name="floor" type="plane" size="1 1 1" {}/>'


@pytest.mark.parametrize(
    ("ground", "rest", "taken"),
    [
        # The egg touches nothing; without ground, the others could touch something.
        ("", "", {"ball", "pill", "box"}),
        # By masks 1 and 1: not the ball, whose masks are 2.
        (FLOOR.format(""), "", {"pill", "box"}),
        (FLOOR.format('contype="2" conaffinity="0"'), "", {"ball"}),
        (FLOOR.format(""), '<contact><pair geom1="floor" geom2="egg"/></contact>', {"pill", "box", "egg"}),
        (FLOOR.format(""), '<contact><exclude body1="world" body2="foot"/></contact>', {"pill"}),
        ("", '<contact><pair geom1="ball" geom2="egg"/></contact>', {"ball", "pill", "box", "egg"}),
    ],
)
def test_masks(ground, rest, taken):
    counts = {"ball": 1, "pill": 2, "box": 8, "egg": 6}
    names = [name for name in counts if name in taken]
    every, named = of_mjcf(ground, rest), of_mjcf(ground, rest, geoms=names)
    np.testing.assert_array_equal(every.positions, named.positions)
    assert len(every.frames) == sum(counts[name] for name in taken)
    on_foot = [name for name in names if name in ("box", "egg")]
    if on_foot:
        assert of_mjcf(ground, rest, bodies=["foot"]).frames == ("foot",) * sum(counts[name] for name in on_foot)


def test_what_is_welded_to_the_world_is_ground():
    contacts = of_urdf(floating_base=False)
    assert set(contacts.frames) == {"foot"}
    assert len(of_urdf(floating_base=False, bodies=["base"]).frames) == 3  # whoever names it gets it


def test_selections_add_up():
    assert of_urdf(bodies=["base"]).frames == ("base",) * 3
    assert of_urdf(bodies=["base"], geoms=["foot_0"]).frames == ("base",) * 3 + ("foot",) * 8


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"bodies": "foot"}, TypeError, "PointContacts.from_urdf: bodies: expected a sequence of names, got 'foot'"),
        (
            {"bodies": ["feet"]},
            KeyError,
            "bodies: expected one of 'base', 'foot', 'sole', got 'feet'",
        ),
        ({"geoms": ["bal"]}, KeyError, "geoms: expected one of 'ball', 'base_1', .*got 'bal'; did you mean 'ball'"),
        (
            {"bodies": ["sole"]},
            ValueError,
            "expected collision shapes that may touch, on bodies of these names; got none",
        ),
        ({"rim": 2}, ValueError, "PointContacts.from_urdf: rim: expected an integer >= 3, got 2"),
        ({"corners": 0.5}, ValueError, "corners: expected an integer >= 1, got 0.5"),
    ],
)
def test_arguments_that_do_not_fit(options, error, message):
    with pytest.raises(error, match=message):
        of_urdf(**options)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('radius="0.5"', 'radius="-1"', "from_urdf: line 3: <sphere>: radius: expected 1 number of at least 0, got"),
        ('radius="0.1"', 'radius="0"', r"<capsule>: radius: expected 1 number above 0, got '0'"),
        ('<sphere radius="0.5"/>', '<mesh filename="a" scale="1 0 1"/>', "scale: expected 3 numbers other than 0, got"),
        ('size="2 4 6"', 'size="2 4"', r"line 8: <box>: size: expected 3 numbers above 0, got '2 4'"),
        ('radius="2" length', 'radius="2" high', r"line 9: <cylinder>: length: expected 1 number above 0, got None"),
        ("<sphere ", "<cone ", r"line 3: <collision>: expected a <geometry> with one of sphere, .*, got <cone>"),
        ('xyz="1 2 3"', 'xyz="1 2"', r"line 4: <origin>: xyz: expected 3 numbers, got '1 2'"),
        ('<sphere radius="0.5"/>', "<mesh/>", "line 3: <mesh>: filename: expected one"),
    ],
)
def test_shapes_that_do_not_fit(old, new, message):
    assert old in URDF
    mech = js.Mechanism.from_urdf(URDF, True)
    with pytest.raises(ValueError, match=message):
        js.PointContacts.from_urdf(mech, URDF.replace(old, new), **LAW, friction=0.5)


# -- they bear what rests on them -------------------------------------------------------------------------------------

# A box of 3 kg and edges 0.4, 0.2, 0.1 m.
BRICK = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body name="brick" pos="0 0 .05"><freejoint/><geom type="box" size=".2 .1 .05" mass="3" friction=".6 .1 .1"/></body>
</worldbody></mujoco>"""


def test_a_box_of_a_file_rests():
    """It sinks in by m g / (4 k), and four corners bear its weight without a moment, in both laws."""
    mech = js.Mechanism.from_mjcf(BRICK, dtype=np.float64)
    contacts = js.PointContacts.from_mjcf(mech, BRICK, stiffness=1e4, relaxation_time=0.02)
    weight, sunk = 3 * 9.81, 3 * 9.81 / 4e4
    with jax.enable_x64(True):
        q, v = jnp.array([1.0, 0, 0, 0, 0, 0, 0.05]), jnp.zeros(6)
        step = jax.jit(lambda q, v: js.convex_step(mech, q, v, jnp.zeros(6), 5e-3, contacts=contacts))
        for _ in range(100):
            after = step(q, v)
            q, v = after.q, after.v
        np.testing.assert_allclose(q[6], 0.05 - sunk, rtol=0, atol=1e-9)
        np.testing.assert_allclose(q[:6], [1, 0, 0, 0, 0, 0], atol=1e-9)
        np.testing.assert_allclose(after.contact_forces.f.sum(0), [0, 0, weight], atol=1e-6)
        explicit = js.contact_forces(mech, q, v, contacts)
        F_W = js.applied_wrenches(mech, q, explicit)["brick"]
        np.testing.assert_allclose(F_W.f, [0, 0, weight], atol=1e-5)
        np.testing.assert_allclose(F_W.tau, np.zeros(3), atol=1e-6)

"""Spheres of collision shapes against the geometries of Pinocchio and MuJoCo, in the world at random configurations.

Every point of ours is on the shape that the other engine has there: a sphere's centre, the ends of a capsule's axis, a
corner of a box, on a rim of a cylinder, a vertex of a mesh. Absolute errors, m.
"""

import importlib.metadata

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import mujoco as states
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs

ALLOWED = 1e-12
LAW = {"stiffness": 1e4, "relaxation_time": 0.02}

pytestmark = pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def points_in_world(mech, contacts, q):
    """(number of states, number of spheres, 3)"""
    names = tuple(dict.fromkeys(contacts.frames))
    X = interpreted(jax.vmap(lambda q: js.forward_kinematics(mech, q, names)))(q)
    of = [names.index(name) for name in contacts.frames]
    R = X.rotation.entries.reshape(*X.rotation.entries.shape[:-1], 3, 3)[:, of]
    return np.einsum("nkij,kj->nki", R, contacts.positions) + X.translation[:, of]


def distance_from(kind, size, p):
    """How far points (n, 3), in the axes of a shape, are from its points that touch."""
    match kind:
        case "sphere":
            return np.linalg.norm(p, axis=-1)
        case "capsule":
            return np.hypot(np.hypot(p[:, 0], p[:, 1]), abs(p[:, 2]) - size[1])
        case "box":
            return np.linalg.norm(abs(p) - size, axis=-1)
        case "cylinder":
            return np.hypot(np.hypot(p[:, 0], p[:, 1]) - size[0], abs(p[:, 2]) - size[1])
        case "ellipsoid":
            return abs(np.linalg.norm(p / size, axis=-1) - 1) * min(size)
        case "mesh":
            return np.linalg.norm(p[:, None] - size, axis=-1).min(1)
    raise AssertionError(kind)


# -- Pinocchio --------------------------------------------------------------------------------------------------------

ROBOTS = ["solo12.urdf", "quadruped.urdf", "b1.urdf"]


def shape_of(geometry):
    """(kind, sizes) of a geometry of coal."""
    names = {"Sphere": "sphere", "Capsule": "capsule", "Box": "box", "Cylinder": "cylinder"}
    kind = names.get(type(geometry).__name__, "mesh")
    size = {
        "sphere": lambda: (geometry.radius,),
        "capsule": lambda: (geometry.radius, geometry.halfLength),
        "cylinder": lambda: (geometry.radius, geometry.halfLength),
        "box": lambda: geometry.halfSide,
        "mesh": lambda: np.array(geometry.vertices()),
    }[kind]()
    return kind, size


@pytest.mark.parametrize("robot", ROBOTS)
def test_robots_against_pinocchio(robot):
    pin = needs("pinocchio")
    file = next(f.locate() for f in importlib.metadata.files("example-robot-data") or () if f.name == robot)
    mech = js.Mechanism.from_urdf(str(file), floating_base=True, dtype=np.float64)
    contacts = js.PointContacts.from_urdf(mech, str(file), **LAW, friction=0.5)
    model = pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer())
    folders = [str(folder) for folder in file.resolve().parents]
    geometries = pin.buildGeomFromUrdf(model, str(file), pin.GeometryType.COLLISION, package_dirs=folders)
    data, placed = pin.Data(model), pin.GeometryData(geometries)
    q = np.asarray(js.random_configuration(mech, jax.random.key(0), 2, np.float64))
    points, worst, seen = points_in_world(mech, contacts, q), 0.0, set()
    for k in range(len(q)):
        there = pin.neutral(model)
        for name in mech.joint_names:
            own, joint = q[k, mech.joint_position_indices(name)], model.joints[model.getJointId(name)]
            there[joint.idx_q : joint.idx_q + joint.nq] = [*own[4:], *np.roll(own[:4], -1)] if len(own) == 7 else own
        pin.updateGeometryPlacements(model, data, geometries, placed, there)
        # Links come in another order there, the shapes of a link in that of the file.
        left = {name: [i for i, of in enumerate(contacts.frames) if of == name] for name in contacts.frames}
        for g, geometry in enumerate(geometries.geometryObjects):
            kind, size = shape_of(geometry.geometry)
            if kind == "mesh":
                size = size * geometry.meshScale
            of_link = left[frame_of(model, geometry)]
            # The hulls of all these meshes have more than 16 corners.
            own = [of_link.pop(0) for _ in range({"sphere": 1, "capsule": 2, "box": 8, "cylinder": 16}.get(kind, 16))]
            X = placed.oMg[g]
            local = (points[k, own] - X.translation) @ X.rotation
            worst = max(worst, distance_from(kind, size, local).max())
            seen.add(kind)
        assert not any(left.values())
    assert worst <= ALLOWED, seen


def frame_of(model, geometry):
    return model.frames[geometry.parentFrame].name


# -- MuJoCo -----------------------------------------------------------------------------------------------------------


def test_geoms_against_mujoco():
    mujoco = needs("mujoco")
    rng = np.random.default_rng(3)
    numbers = lambda n: " ".join(map(repr, rng.standard_normal(n).tolist()))  # noqa: E731
    kinds = ["sphere", "capsule", "box", "cylinder", "ellipsoid", "mesh"]
    counts = {"sphere": 1, "capsule": 2, "box": 8, "cylinder": 10, "ellipsoid": 6, "mesh": 7}

    def geom(kind):
        size = 'mesh="m"' if kind == "mesh" else f'size="{" ".join(map(str, rng.uniform(0.1, 1, 3)))}"'
        return f'<geom type="{kind}" {size} pos="{numbers(3)}" quat="{numbers(4)}" friction="{rng.uniform()} .1 .1"/>'

    def body(inside):
        geoms = "".join(map(geom, kinds))
        return f'<body pos="{numbers(3)}" quat="{numbers(4)}"><joint axis="{numbers(3)}"/>{geoms}{inside}</body>'

    text = f"""<mujoco><asset><mesh name="m" vertex="{numbers(60)}" scale="1 -2 .5"/></asset><worldbody>
        {body(body(""))}<body><freejoint/>{"".join(map(geom, kinds))}</body></worldbody></mujoco>"""
    mech, model = js.Mechanism.from_mjcf(text, dtype=np.float64), mujoco.MjModel.from_xml_string(text)
    contacts = js.PointContacts.from_mjcf(mech, text, **LAW, rim=5, corners=7)
    data = mujoco.MjData(model)
    q = js.random_configuration(mech, jax.random.key(0), 3, np.float64)
    points, qpos = points_in_world(mech, contacts, q), interpreted(jax.vmap(lambda q: states.to_qpos(mech, q)))(q)
    for k in range(len(q)):
        data.qpos[:] = qpos[k]
        mujoco.mj_kinematics(model, data)
        start = 0
        for g, kind in zip(range(model.ngeom), kinds * 3, strict=True):
            n = counts[kind]
            local = (points[k, start : start + n] - data.geom_xpos[g]) @ data.geom_xmat[g].reshape(3, 3)
            size = model.mesh_vert if kind == "mesh" else model.geom_size[g]
            assert distance_from(kind, size, local).max() <= ALLOWED, kind
            if kind in ("sphere", "capsule"):
                np.testing.assert_array_equal(contacts.radius[start : start + n], model.geom_size[g, 0])
            np.testing.assert_array_equal(contacts.friction[start : start + n], model.geom_friction[g, 0])
            start += n
        assert start == len(contacts.frames)


FIELD = """<mujoco><asset>
  <hfield name="hills" nrow="3" ncol="4" size="2 1 0.5 0.1" elevation="0 1 2 3  4 9 6 7  8 2 10 11"/>
</asset><worldbody>
  <body pos="0.3 -1 2" euler="20 0 0">
    <geom name="hills" type="hfield" hfield="hills" pos="1 0 3" euler="0 10 90"/>
  </body>
  <body><freejoint/><geom name="ball" size="0.1"/><geom name="stone" type="hfield" hfield="hills"/></body>
</worldbody></mujoco>"""


def test_height_field_is_where_rays_of_mujoco_hit_it():
    """Between the cells, where two triangles and a bilinear surface are the same."""
    mujoco = needs("mujoco")
    model = mujoco.MjModel.from_xml_string(FIELD)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    field = js.HeightField.from_mjcf(FIELD, dtype=np.float64)
    assert field.heights.shape == (4, 3) and field.dtype == np.float64
    R, p_WF = data.geom_xmat[0].reshape(3, 3), data.geom_xpos[0]
    rng, hits = np.random.default_rng(0), []
    for k in range(20):
        x, y = (rng.choice([-2 / 3, 2 / 3]), rng.uniform(-0.99, 0.99)) if k % 2 else (rng.uniform(-1.99, 1.99), 0.0)
        above = p_WF + R @ [x, y, 5.0]
        hits.append(above - R[:, 2] * mujoco.mj_ray(model, data, above, -R[:, 2], None, 1, -1, np.zeros(1, np.int32)))
    at = js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array(hits))
    gaps = js.distance(js.Sphere(np.zeros(20), at), field)
    np.testing.assert_allclose(gaps, 0, atol=1e-7)


def test_a_height_field_that_moves_is_none():
    mech = js.Mechanism.from_mjcf(FIELD)
    assert js.PointContacts.from_mjcf(mech, FIELD, **LAW).positions.shape == (1, 3)
    with pytest.raises(ValueError, match="expected 'stone', a height field that does not move; the file has hills"):
        js.HeightField.from_mjcf(FIELD, "stone")
    with pytest.raises(ValueError, match="expected the name of one, .* the file has none"):
        js.HeightField.from_mjcf("<mujoco><worldbody/></mujoco>")

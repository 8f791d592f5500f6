"""Mechanisms built in Python: order, names, welded bodies, mimics, what is refused; and a mechanism as a pytree."""

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism.joints import KINDS
from tests.helpers import tangents
from tests.helpers.interpreted import interpreted
from tests.helpers.tracing import assert_known_while_tracing

U = 2.0**-53


@pytest.fixture
def float64():
    with jax.enable_x64(True):
        yield


def inertia(seed=0, dtype=np.float64):
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((3, 3))
    central = (a @ a.T + np.eye(3)).astype(dtype)
    return js.SpatialInertia(dtype(rng.uniform(1, 2)), rng.standard_normal(3).astype(dtype), central)


def pose(seed):
    rng = np.random.default_rng(seed)
    w, p = rng.standard_normal((2, 3)).astype(jax.dtypes.canonicalize_dtype(float))
    return js.RigidTransform(js.Rotation.exp(w), p)


def bodies(names):
    return [js.Body(name) for name in names]


def revolute(name, parent, child, **more):
    return js.Joint(name, "revolute", parent, child, **more)


def branches(**more):
    """world - a - b - d, a - c, world - e, named so that no other order is theirs too."""
    joints = [("j1", "world", "a"), ("j2", "a", "b"), ("j3", "a", "c"), ("j4", "b", "d"), ("j5", "world", "e")]
    return js.Mechanism.build(bodies("ecbad"), [revolute(*joint) for joint in joints], **more)


# -- order and names --------------------------------------------------------------------------------------------------


def test_bodies_come_depth_first_and_children_in_the_order_of_joints():
    mech = branches()
    assert mech.body_names == ("a", "b", "d", "c", "e")
    assert mech.joint_names == ("j1", "j2", "j4", "j3", "j5")
    assert mech.topology.parents == (-1, 0, 1, 0, -1)
    assert mech.frame_names == ("world", *mech.body_names)


def test_a_welded_body_hands_on_what_hangs_on_it_in_its_place():
    joints = [revolute("j1", "world", "a"), js.Joint("w", "fixed", "a", "b"), revolute("j2", "b", "c")]
    mech = js.Mechanism.build(bodies("abcd"), [*joints, revolute("j3", "a", "d")])
    assert mech.body_names == ("a", "c", "d")
    assert mech.topology.parents == (-1, 0, 0)


def test_coordinates_of_all_kinds():
    joints = [js.Joint(f"j{i}", kind, "world", f"b{i}") for i, kind in enumerate(KINDS)]
    mech = js.Mechanism.build([js.Body(joint.child) for joint in joints], joints)
    assert (mech.nq, mech.nv) == tuple(sum(getattr(kind, n) for kind in KINDS.values()) for n in ("nq", "nv"))
    found = [mech.joint_position_indices(name) for name in mech.joint_names]
    np.testing.assert_array_equal(np.concatenate(found), np.arange(mech.nq))
    found = [mech.joint_velocity_indices(name) for name in mech.joint_names]
    np.testing.assert_array_equal(np.concatenate(found), np.arange(mech.nv))
    np.testing.assert_array_equal(mech.neutral(), np.concatenate([kind.neutral for kind in KINDS.values()]))
    assert mech.neutral().dtype == np.float32
    with pytest.raises(KeyError, match="joint: expected one of 'j1', .*got 'x'"):
        mech.joint_position_indices("x")


def test_repr_is_the_tree():
    assert repr(branches()) == (
        "Mechanism(nq=5, nv=5, 5 bodies, float32)\n"
        "  a  <- j1: revolute\n"
        "    b  <- j2: revolute\n"
        "      d  <- j4: revolute\n"
        "    c  <- j3: revolute\n"
        "  e  <- j5: revolute"
    )
    assert "  c  <- k: prismatic follows j\n" in repr(geared()) + "\n"


# -- welded bodies ----------------------------------------------------------------------------------------------------


def welded():
    return js.Mechanism.build(*welded_parts(), dtype=np.float64)


def welded_parts():
    """b and c on a, d on the world; and a frame on c."""
    named = [js.Body(name, inertia(k)) for k, name in enumerate("abcd")]
    joints = [
        js.Joint("j", "ball", "world", "a", placement=pose(1), child_placement=pose(2)),
        js.Joint("w1", "fixed", "a", "b", placement=pose(3)),
        js.Joint("w2", "fixed", "b", "c", placement=pose(4), child_placement=pose(5)),
        js.Joint("w3", "fixed", "world", "d", placement=pose(6)),
    ]
    return named, joints, [js.Frame("tip", "c", pose(7))]


def test_welded_bodies_are_one(float64):
    mech, X_JA = welded(), pose(2)
    X_JB = X_JA @ pose(3)
    places = [X_JA, X_JB, X_JB @ (pose(4) @ pose(5))]
    parts = [js.act(X, inertia(k)) for k, X in enumerate(places)]
    M = jax.tree.map(lambda x: x[0], mech.inertias)
    expected = functools.reduce(operator.add, parts)
    jax.tree.map(functools.partial(np.testing.assert_allclose, rtol=16 * U), M, expected)
    # As dense matrices: mass, centre of mass and moments add.
    whole = sum(np.asarray(part.to_matrix()) for part in parts)
    np.testing.assert_allclose(M.to_matrix(), whole, atol=64 * U * abs(whole).max())
    np.testing.assert_allclose(M.mass, sum(inertia(k).mass for k in range(3)), rtol=4 * U)


def test_what_is_welded_to_the_world_moves_nothing(float64):
    mech = welded()
    assert (mech.body_names, mech.nv) == (("a",), 3)
    with_d = np.asarray(js.center_of_mass(mech, mech.neutral()))
    X_WJ = pose(1)
    np.testing.assert_allclose(with_d, X_WJ @ mech.inertias.com[0], rtol=1e-14)


def test_frames_of_welded_bodies_stay(float64):
    mech = welded()
    X_JC = pose(2) @ pose(3) @ (pose(4) @ pose(5))
    expected = {"world": (-1, None), "a": (0, pose(2)), "b": (0, pose(2) @ pose(3)), "c": (0, X_JC)}
    expected |= {"tip": (0, X_JC @ pose(7)), "d": (-1, pose(6))}
    assert dict(mech.topology.frames) == {name: carrier for name, (carrier, _) in expected.items()}
    for k, name in enumerate(mech.frame_names):
        X = expected[name][1] or js.RigidTransform.identity(dtype=np.float64)
        found = jax.tree.map(operator.itemgetter(k), mech.frame_placements)
        np.testing.assert_allclose(found.to_matrix(), X.to_matrix(), atol=16 * U)


def test_a_body_at_its_joint_keeps_its_numbers(float64):
    mech = js.Mechanism.build([js.Body("a", inertia())], [revolute("j", "world", "a")], dtype=np.float64)
    jax.tree.map(lambda x, y: np.testing.assert_array_equal(x[0], y), mech.inertias, inertia())
    massless = js.Mechanism.build(bodies("a"), [revolute("j", "world", "a")])
    assert not any(x.any() for x in jax.tree.leaves(massless.inertias))


# -- numbers of joints ------------------------------------------------------------------------------------------------


def geared(**more):
    """c slides as a turns, three times as far."""
    numbers = {"armature": 5.0, "damping": 7.0, "friction_loss": 11.0}
    joints = [
        revolute("j", "world", "a", armature=1.0, damping=2.0, friction_loss=3.0),
        js.Joint("i", "ball", "a", "b", damping=(1.0, 2.0, 3.0)),
        js.Joint("k", "prismatic", "world", "c", mimic=("j", -3.0, 0.5), **numbers),
    ]
    return js.Mechanism.build([js.Body(name, inertia(k)) for k, name in enumerate("abc")], joints, **more)


def test_a_mimic_has_the_coordinate_of_its_master():
    mech = geared()
    assert (mech.nq, mech.nv, mech.topology.followed) == (5, 4, (0, 1, 0))
    for name in ("j", "k"):
        np.testing.assert_array_equal(mech.joint_position_indices(name), [0])
        np.testing.assert_array_equal(mech.joint_velocity_indices(name), [0])
    np.testing.assert_array_equal(mech.joint_position_indices("i"), [1, 2, 3, 4])
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [1, 0], [-3, 0.5]])
    X = js.forward_kinematics(mech, np.float32([2, 1, 0, 0, 0]))
    np.testing.assert_array_equal(X.translation[2], [0, 0, -5.5])


def test_the_master_feels_what_turns_with_its_mimic():
    """By the square of the ratio, since both the rates and the forces go with it; friction by the ratio."""
    mech = geared()
    np.testing.assert_array_equal(mech.armature, [1 + 9 * 5, 0, 0, 0])
    np.testing.assert_array_equal(mech.damping, [2 + 9 * 7, 1, 2, 3])
    np.testing.assert_array_equal(mech.friction_loss, [3 + 3 * 11, 0, 0, 0])


def sprung(**more):
    """c slides as a turns, three times as far, and both have springs."""
    joints = [
        revolute("j", "world", "a", stiffness=2.0, spring_reference=0.25),
        js.Joint("i", "ball", "a", "b", stiffness=(1.0, 2.0, 3.0), spring_reference=(0.6, 0.8, 0.0, 0.0)),
        js.Joint("k", "prismatic", "world", "c", mimic=("j", -3.0, 0.5), stiffness=4.0, spring_reference=1.5),
        js.Joint("f", "free", "world", "d"),
    ]
    return js.Mechanism.build([js.Body(name, inertia(k)) for k, name in enumerate("abcd")], joints, **more)


def test_springs_of_mimics_act_on_their_masters():
    """2 (q - 1/4) and -3 * 4 (-3 q + 1/2 - 3/2) are 38 (q + 11.5 / 38); what has no spring rests at zero."""
    mech = sprung(dtype=np.float64).astype(np.float32)
    np.testing.assert_array_equal(mech.stiffness, [38, 1, 2, 3, *[0] * 6])
    rests = np.float32([-11.5 / 38, 0.6, 0.8, 0, 0, 1, *[0] * 6])
    np.testing.assert_allclose(mech.spring_references, rests, rtol=2e-7)
    single = js.Mechanism.build(bodies("a"), [revolute("j", "world", "a", spring_reference=0.25)])
    np.testing.assert_array_equal(single.spring_references, [0.25])


def test_springs_stay_what_they_are_when_a_mechanism_is_edited():
    with jax.enable_x64(True):
        mech = sprung()
        for other in (js.lock_joints(mech, {}), js.lock_joints(mech, {"f": mech.neutral()[5:]})):
            np.testing.assert_array_equal(other.stiffness[:4], mech.stiffness[:4])
            np.testing.assert_array_equal(other.spring_references[:5], mech.spring_references[:5])
        other = js.subtree(mech, "b")
        np.testing.assert_array_equal(other.stiffness, [1, 2, 3])
        np.testing.assert_array_equal(other.spring_references, [0.6, 0.8, 0, 0])
        assert jax.tree.structure(other.as_data()) == jax.tree.structure(other)
    np.testing.assert_array_equal(mech.replace(stiffness=2 * mech.stiffness).stiffness, 2 * mech.stiffness)


@pytest.mark.parametrize("axis", [(1e-200, 1e-200, 0), (1e-320, 1e-320, 0), (1e200, 1e200, 0), (1.7e308, 1.7e308, 0)])
def test_axes_of_any_length(axis):
    mech = js.Mechanism.build(bodies("a"), [revolute("j", "world", "a", axis=axis)])
    np.testing.assert_allclose(mech.axes, [[0.5**0.5, 0.5**0.5, 0]], rtol=1e-7)


def test_mechanisms_are_built_while_tracing(x64):
    """Of known numbers, and are known."""
    parts = welded_parts()

    def made():
        mech = js.Mechanism.build(*parts)
        return [mech, js.lock_joints(mech, {"j": (0.6, 0.8, 0.0, 0.0)}), js.testing.random_mechanism(3, 3)]

    assert_known_while_tracing(made)


def test_numbers_that_are_traced_are_refused():
    def mass(x):
        body = js.Body("a", js.SpatialInertia(x, np.zeros(3, np.float32), np.eye(3, dtype=np.float32)))
        return js.Mechanism.build([body], [revolute("j", "world", "a")]).inertias.mass

    with pytest.raises(TypeError, match="Mechanism.build: expected known numbers .* Mechanism.replace"):
        jax.jit(mass)(np.float32(1))
    with pytest.raises(TypeError, match="Mechanism.build: expected known numbers"):
        jax.jit(lambda x: js.Mechanism.build(bodies("a"), [revolute("j", "world", "a", damping=x)]).damping)(1.0)


def test_a_locked_master_holds_its_mimics():
    locked = js.lock_joints(geared(dtype=np.float64), {"j": 2.0})
    assert locked.joint_names == ("i",)
    with jax.enable_x64(True):
        X = js.forward_kinematics(locked, np.array([1.0, 0, 0, 0]), ["a", "c"])
    np.testing.assert_array_equal(X.translation[1], [0, 0, -5.5])
    with pytest.raises(ValueError, match="lock_joints: 'k' is a mimic: lock 'j', which it follows"):
        js.lock_joints(geared(), {"k": 0.0})


def test_the_algorithms_of_a_mechanism_with_mimics():
    """Torques are linear in its mass matrix, bias forces and regressor, and have its derivatives; both dynamics are
    inverse to each other."""
    with jax.enable_x64(True), js.default_precision("fast"):
        mech, rng = geared(dtype=np.float64), np.random.default_rng(0)
        q = np.array([0.3, 0.5, 0.5, 0.5, 0.5])
        v, a = rng.standard_normal((2, mech.nv))

        def both(q, v, a):
            tau = js.inverse_dynamics(mech, q, v, a)
            return tau, js.forward_dynamics(mech, q, v, tau)

        tau, back = interpreted(both)(q, v, a)
        np.testing.assert_allclose(back, a, rtol=1e-12)

        def torques(q, v):
            return js.inverse_dynamics(mech, q, v, jnp.asarray(a))

        def others(q, v, a):
            derivatives = js.inverse_dynamics_derivatives(mech, q, v, a).dtau_dv, jax.jacrev(torques)(q, v)
            linear = js.mass_matrix(mech, q) @ a + js.bias_forces(mech, q, v)
            Y = js.regressors.joint_torque_regressor(mech, q, v, a)
            return linear, Y, derivatives, tangents.jacobians(torques, (0, 1))(q, v)

        linear, Y, (dtau_dv, dtau_dq), (by_q, by_v) = interpreted(others)(q, v, a)
        np.testing.assert_allclose(linear, tau, rtol=1e-13)
        pi = mech.inertias.to_dynamic_parameters().ravel()
        np.testing.assert_allclose(Y @ pi + mech.armature * a, tau, rtol=1e-13)
        np.testing.assert_allclose(dtau_dv, by_v, atol=1e-13)
        np.testing.assert_allclose(dtau_dq, by_q, atol=1e-13)


def test_limits_are_per_rate_or_coordinate():
    joint = js.Joint("j", "cylindrical", "world", "a", lower=(-1.0, -2.0), upper=3.0, effort_limit=(4.0, 5.0))
    mech = js.Mechanism.build(bodies("a"), [joint])
    np.testing.assert_array_equal([mech.lower, mech.upper, mech.effort_limit], [[-1, -2], [3, 3], [4, 5]])


def test_axes_become_unit_vectors():
    mech = js.Mechanism.build(bodies("a"), [revolute("j", "world", "a", axis=(0, -3.0, 4.0))], dtype=np.float32)
    np.testing.assert_allclose(mech.axes, [[0, -0.6, 0.8]], rtol=1e-7)


# -- what is refused --------------------------------------------------------------------------------------------------

A = js.Body("a")
J = revolute("j", "world", "a")
BATCHED = revolute("j", "world", "a", child_placement=js.RigidTransform.identity((2,)))
REFUSED = {
    "no body": (([3], [J]), TypeError, "Mechanism.build: bodies: expected a sequence of Body objects, got .3"),
    "no joint": (([A], [A]), TypeError, "Mechanism.build: joints: expected a sequence of Joint objects, got .Body"),
    "no frame": (([A], [J], [J]), TypeError, "Mechanism.build: frames: expected a sequence of Frame objects, got .J"),
    "a body alone": ((A, [J]), TypeError, "Mechanism.build: bodies: expected a sequence of Body objects, got Body"),
    "a number as a name": (([js.Body(3)], [J]), TypeError, "Mechanism.build: bodies: .*name of a Body, got 3"),
    "body twice": (([A, A], [J]), ValueError, "Mechanism.build: bodies: 'a' comes twice"),
    "joint twice": (([A, js.Body("b")], [J, revolute("j", "a", "b")]), ValueError, "joints: 'j' comes twice"),
    "two parents": (([A, js.Body("b")], [J, revolute("k", "b", "a")]), ValueError, "joints: children: 'a' comes twice"),
    "frame as a body": (([A], [J], [js.Frame("a", "a")]), ValueError, "bodies and frames: 'a' comes twice"),
    "body as the world": (([js.Body("world")], []), ValueError, "bodies and frames: 'world' comes twice"),
    "missing parent": (([A], [revolute("j", "x", "a")]), ValueError, "Joint 'j': parent: there is no body 'x'"),
    "missing child": (([A], [revolute("j", "world", "x")]), ValueError, "Joint 'j': child: there is no body 'x'"),
    "world as a child": (([A], [J, revolute("k", "a", "world")]), ValueError, "child: there is no body 'world'"),
    "missing frame": (([A], [J], [js.Frame("f", "x")]), ValueError, "Frame 'f': body: there is no body 'x'"),
    "nothing holds": (([A, js.Body("b")], [J]), ValueError, "joints: nothing holds 'b' against the world"),
    "loop": (([A, js.Body("b")], [revolute("j", "a", "b"), revolute("k", "b", "a")]), ValueError, "holds 'a', 'b'"),
    "no axis": (([A], [revolute("j", "world", "a", axis=(0, 0, 0))]), ValueError, "Joint 'j': axis: .* got .0.0, 0.0"),
    "short axis": (([A], [revolute("j", "world", "a", axis=(1, 0))]), ValueError, "Joint 'j': axis: expected three"),
    "placement": (([A], [revolute("j", "world", "a", placement=3)]), TypeError, "'j': placement: .*Transform, got int"),
    "placements": (([A], [BATCHED]), TypeError, r"'j': child_placement: .*got a batch of shape \(2,\)"),
    "frame placement": (([A], [J], [js.Frame("f", "a", 3)]), TypeError, "Frame 'f': placement: expected .*, got int"),
    "inertia": (([js.Body("a", 3)], [J]), TypeError, "Body 'a': inertia: expected a single SpatialInertia, got int"),
    "mimic of nothing": (([A], [revolute("j", "world", "a", mimic=("x",))]), ValueError, "'j': mimic: expected"),
    "mimic of itself": (([A], [revolute("j", "world", "a", mimic=("j",))]), ValueError, "Joint 'j': mimic"),
    "mimic of a ball": (
        ([A, js.Body("b")], [js.Joint("j", "ball", "world", "a"), revolute("k", "a", "b", mimic=("j",))]),
        ValueError, "Joint 'k': mimic: expected the name of a joint with one coordinate",
    ),
    "ball as a mimic": (
        ([A, js.Body("b")], [J, js.Joint("k", "ball", "a", "b", mimic=("j",))]), ValueError, "Joint 'k': mimic",
    ),
    "spring of a ball": (
        ([A], [js.Joint("j", "ball", "world", "a", spring_reference=(1.0, 1, 0, 0))]),
        ValueError, "Joint 'j': spring_reference: expected a unit quaternion first, got .1.0, 1.0",
    ),
    "armature along axes that turn": (
        ([A], [js.Joint("j", "free", "world", "a", armature=(1.0, 2, 3, 4, 4, 5))]),
        ValueError, "Joint 'j': armature: expected one number for the linear .* 'free', .* got .4.0, 4.0, 5.0",
    ),
    "axis as a text": (([A], [revolute("j", "world", "a", axis="z")]), TypeError, "Joint 'j': axis: expected an array"),
    "damping as a text": (([A], [revolute("j", "world", "a", damping="1")]), TypeError, "Joint 'j': damping: expected"),
    "damping of NaN": (([A], [revolute("j", "world", "a", damping=np.nan)]), ValueError, "'j': damping: .*got nan"),
    "pitch of NaN": (([A], [js.Joint("j", "helical", "world", "a", pitch=np.nan)]), ValueError, "pitch: .*got nan"),
    "armature below zero": (([A], [revolute("j", "world", "a", armature=-1.0)]), ValueError, "at least 0, got -1.0"),
    "damping below zero": (([A], [revolute("j", "world", "a", damping=-1.0)]), ValueError, "at least 0, got -1.0"),
    "effort below zero": (([A], [revolute("j", "world", "a", effort_limit=-1.0)]), ValueError, "at least 0, got -1.0"),
    "limits in disorder": (
        ([A], [revolute("j", "world", "a", lower=1.0, upper=-1.0)]),
        ValueError, "Joint 'j': lower: expected at most upper, -1.0, got 1.0",
    ),
    "gravity of NaN": (([A], [J], (), (0.0, 0.0, np.nan)), ValueError, "Mechanism.build: gravity: .*finite.*nan"),
    "limits": (([A], [revolute("j", "world", "a", lower=(1.0, 2.0))]), ValueError, r"'j': lower: .*got shape \(2,\)"),
    "gravity": (([A], [J], (), (0.0, 1.0)), ValueError, r"Mechanism.build: gravity: expected shape .* got \(2,\)"),
}  # fmt: skip


@pytest.mark.parametrize(("arguments", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        js.Mechanism.build(*arguments)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"mimic": "elbow"}, TypeError, r"Joint 'j': mimic: expected \(joint, multiplier, offset\).* got 'elbow'"),
        ({"mimic": ("k", "2")}, TypeError, "Joint 'j': mimic: expected"),
        ({"kind": "ball", "turn_limit": -1.0}, ValueError, "Joint 'j': turn_limit: expected a number >= 0, got -1.0"),
        ({"kind": "ball", "turn_limit": "1"}, ValueError, "Joint 'j': turn_limit: expected a number >= 0, got '1'"),
    ],
)
def test_joints_that_are_refused_at_once(given, error, message):
    with pytest.raises(error, match=message):
        js.Joint(**{"name": "j", "kind": "revolute", "parent": "world", "child": "a"} | given)


@pytest.mark.parametrize(
    ("positions", "error", "message"),
    [
        (["elbow"], TypeError, "lock_joints: positions: expected a mapping from names of joints, got list"),
        ({"elbow": "0.3"}, TypeError, "'elbow'.: expected an array of floating point .*got str '0.3'"),
        ({"elbow": [0.3, 0.2]}, ValueError, r"'elbow'.: expected a number or 1 of them, got shape \(2,\)"),
        ({"elbow": np.nan}, ValueError, "'elbow'.: expected finite numbers, got nan"),
    ],
)
def test_positions_at_which_no_joint_is_locked(positions, error, message):
    elbow = js.Mechanism.build([A], [revolute("elbow", "world", "a")])
    with pytest.raises(error, match=message):
        js.lock_joints(elbow, positions)


def test_frames_are_a_sequence():
    with pytest.raises(TypeError, match="add_frames: frames: expected a sequence of Frame objects, got Frame"):
        js.add_frames(js.Mechanism.build([A], [J]), js.Frame("tool", "a"))


def heavy(mass, com=(0.0, 0.0, 0.0), central=(1.0, 0, 1, 0, 0, 1)):
    return js.SpatialInertia(*(np.asarray(x, np.float64) for x in (mass, com, central)))


def _two(one, other, distance=0.0, gravity=0.0, kind="revolute", base="world"):
    """Bodies a and b: b on a, or on the world, at a distance."""
    placement = js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array([0.0, distance, 0.0]))
    joints = [revolute("j", "world", "a"), js.Joint("k", kind, base, "b", placement)]
    return [js.Body("a", one), js.Body("b", other)], joints, (), (0.0, 0.0, -gravity)


# {what overflows in float64: the parts, the body that is named, what is said}; numbers a thousand times smaller do not.
OVERFLOWING = {
    "moments": (lambda x: _two(heavy(1.5 * x, (0.0, 3.0, 0.0)), heavy(1.0)), "a", "mass and moments about its origin"),
    "central": (lambda x: _two(heavy(x / 4, (0, 2, 0), np.eye(3) * x), heavy(1.0)), "a", "mass and moments about"),
    "far away": (lambda x: _two(heavy(1.0), heavy(1.5e-9 * x, (0, 0, 1e5))), "b", "mass and moments about its origin"),
    "welded": (lambda x: _two(heavy(x), heavy(x), kind="fixed", base="a"), "a", "with what is welded to it"),
    "welded to the world": (lambda x: _two(heavy(1.0), heavy(1.5 * x, (0, 4, 0)), kind="fixed"), "b", "mass and mom"),
    "carried": (lambda x: _two(heavy(1.0), heavy(1.5 * x, (0, 0.5, 0)), 1.0, base="a"), "a", r"moments \(.* carries"),
    "weight": (lambda x: _two(heavy(1.0), heavy(0.2 * x), 0.0, 9.81), "b", "weight"),
    "weight of all": (lambda x: _two(heavy(0.1 * x), heavy(0.11 * x), 0.0, 9.81), "b", "weight of all"),
    "mass of all": (lambda x: _two(heavy(x), heavy(x)), "a", "mass and a weight of all"),
}  # fmt: skip


@pytest.mark.parametrize(("parts", "body", "message"), OVERFLOWING.values(), ids=OVERFLOWING)
def test_bodies_that_overflow_in_the_dtype_are_refused(float64, parts, body, message):
    for dtype, largest in ("float64", 1e308), ("float32", 2e38):
        with pytest.raises(ValueError, match=f"^Body '{body}': inertia: expected .*{message}.*, got"):
            js.Mechanism.build(*parts(largest), dtype=dtype)
        mech = js.Mechanism.build(*parts(largest / 1000), dtype=dtype)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves((mech.inertias, mech.weld_inertias)))
    M = interpreted(lambda q: (js.mass_matrix(mech, q), js.gravity_forces(mech, q)))(mech.neutral())
    assert all(np.isfinite(x).all() for x in M)


def test_bodies_a_thousand_times_lighter_than_what_overflows_fall_as_others(float64):
    parts = [_two(heavy(m, (0.1, 0.2, 0.3), np.eye(3) * m), heavy(m), 1.0, 9.81, base="a") for m in (1.0, 1e305)]
    fall = interpreted(lambda mech, q: js.forward_dynamics(mech, q, 0 * q, 0 * q))
    one, other = (fall(js.Mechanism.build(*x), np.array([0.3, -0.4])) for x in parts)
    np.testing.assert_allclose(one, other, rtol=1e-13)


@pytest.mark.parametrize("field", range(3))
def test_inertias_that_are_not_finite_are_refused(float64, field):
    for x in (np.nan, np.inf):
        three = [1.0, np.zeros(3), np.eye(3)]
        three[field] = three[field] * 0 + x
        with pytest.raises(ValueError, match="^Body 'b': inertia: expected mass and moments"):
            js.Mechanism.build(*_two(heavy(1.0), heavy(*three)))


def test_unknown_kinds_are_refused():
    with pytest.raises(ValueError, match="Joint 'j': kind: expected one of 'fixed', 'revolute', .*got 'hinge'"):
        js.Joint("j", "hinge", "world", "a")


# -- other numbers ----------------------------------------------------------------------------------------------------


def test_dtype_is_what_was_asked_for(x64):
    for dtype, expected in ((None, np.float64 if x64 else np.float32), (np.float32, np.float32)):
        for mech in (geared(dtype=dtype), geared().astype(dtype)):
            assert mech.dtype == expected
            assert all(isinstance(x, np.ndarray) and x.dtype == expected for x in jax.tree.leaves(mech))
    assert geared().astype(np.float16).neutral().dtype == np.float16


def test_data_is_of_jax():
    mech = geared()
    data = mech.as_data()
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(data))
    jax.tree.map(np.testing.assert_array_equal, data, mech)
    assert data.topology == mech.topology


def test_replace():
    mech = geared()
    other = mech.replace(gravity=np.zeros(3, np.float32), armature=2 * mech.armature)
    np.testing.assert_array_equal(other.gravity, [0, 0, 0])
    np.testing.assert_array_equal(other.armature, [92, 0, 0, 0])
    np.testing.assert_array_equal(other.damping, mech.damping)
    assert mech.gravity[2] == np.float32(-9.81)
    heavier = mech.replace(inertias=js.SpatialInertia(2 * mech.inertias.mass, mech.inertias.com, mech.inertias.central))
    np.testing.assert_array_equal(heavier.inertias.mass, 2 * mech.inertias.mass)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"weight": 3}, TypeError, "Mechanism.replace: expected one of placements, .*, gravity, loops, got 'weight'"),
        ({"topology": 3}, TypeError, "Mechanism.replace: expected one of .* got 'topology'"),
        ({"gravity": np.zeros(2)}, ValueError, r"Mechanism.replace: gravity: expected shape \(3,\), got \(2,\)"),
        ({"inertias": np.zeros(3)}, TypeError, "Mechanism.replace: inertias: expected SpatialInertia, got ndarray"),
        (
            {"damping": np.zeros((5, 4))},
            ValueError,
            r"Mechanism.replace: damping: expected shape \(4,\), got \(5, 4\); a batch of mechanisms is mapped over "
            r"the field: jax.vmap\(lambda x, q: f\(mech.as_data\(\).replace\(damping=x\), q\)\)$",
        ),
    ],
)
def test_replace_refuses(changes, error, message):
    with pytest.raises(error, match=message):
        geared().replace(**changes)


# -- as a pytree ------------------------------------------------------------------------------------------------------


def test_there_and_back():
    mech = geared()
    leaves, tree = jax.tree.flatten(mech)
    again = jax.tree.unflatten(tree, leaves)
    assert again.topology is mech.topology and repr(again) == repr(mech)
    assert all(x is y for x, y in zip(jax.tree.leaves(again), leaves, strict=True))
    # JAX rebuilds it with leaves that are no arrays.
    for leaf in (None, 0, object()):
        jax.tree.unflatten(tree, [leaf] * len(leaves))
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(mech)]
    assert {".gravity", ".inertias.mass", ".placements.translation"} <= set(paths)


def test_topologies_of_equal_mechanisms_are_equal():
    assert geared().topology == geared().topology and hash(geared().topology) == hash(geared().topology)
    assert geared().topology != branches().topology
    assert jax.tree.structure(geared()) == jax.tree.structure(geared(dtype=np.float16))


def test_a_mechanism_that_is_built_again_is_not_traced_again():
    traced = []

    @jax.jit
    def position(mech, q):
        traced.append(mech)
        return js.forward_kinematics(mech, q).translation

    q = jnp.float32([1, 1, 0, 0, 0])
    first = position(geared(), q)
    np.testing.assert_array_equal(position(geared(), q), first)
    position(geared().replace(gravity=np.zeros(3, np.float32)), q)
    assert len(traced) == 1
    other = geared()
    position(other.replace(mimics=2 * other.mimics), q)
    assert len(traced) == 1


def test_known_numbers_and_data_give_the_same(float64):
    mech = geared(dtype=np.float64)
    q = jnp.asarray([0.3, 0.5, 0.5, -0.5, 0.5])
    v, a = jnp.asarray([1.0, -2, 0.5, 3]), jnp.asarray([0.1, 0.2, -3, 1])
    known = interpreted(functools.partial(js.inverse_dynamics, mech))(q, v, a)
    calls = jax.jit(js.inverse_dynamics)(mech, q, v, a), interpreted(js.inverse_dynamics)(mech.as_data(), q, v, a)
    for data in calls:
        np.testing.assert_allclose(data, known, rtol=0, atol=16 * U * abs(np.asarray(known)).max())
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), mech)
    found = interpreted(jax.vmap(js.inverse_dynamics, in_axes=(0, None, None, None)))(batch, q, v, a)
    np.testing.assert_allclose(found, [known, known], rtol=0, atol=16 * U * abs(np.asarray(known)).max())


def test_random_mechanisms_are_the_same_for_the_same_seed():
    first, again, other = (js.testing.random_mechanism(seed, 4) for seed in (0, 0, 1))
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert (first.inertias.mass != other.inertias.mass).all()
    chain = js.testing.random_mechanism(0, 4, ["ball"], is_chain=True)
    assert (chain.topology.parents, chain.topology.kinds) == ((-1, 0, 1, 2), ("ball",) * 4)


def test_a_program_of_a_mechanism_is_exported():
    """And takes another with the same tree."""
    mech, q = geared().as_data(), np.float32([0.3, 1, 0, 0, 0])
    exported = jax.export.export(jax.jit(js.gravity_forces))(mech, q)
    again = jax.export.deserialize(exported.serialize())
    heavier = mech.replace(gravity=2 * mech.gravity)
    np.testing.assert_allclose(again.call(heavier, q), interpreted(js.gravity_forces)(heavier, q), rtol=1e-6)


def test_known_numbers_stay_known_inside_a_shard_map_outside_of_jit():
    """There JAX runs operation by operation, and holds all that is computed for spread over devices."""
    ball = js.SpatialInertia.solid_sphere(np.float32(0.1), mass=np.float32(2))
    still = js.Mechanism.build([js.Body("b", ball)], [js.Joint("j", "fixed", "world", "b")], dtype=np.float32)

    def made(x):
        rod = js.SpatialInertia.thin_rod(1.0, mass=2.0, axis=[1.0, 1.0, 0.0])
        mech = js.lock_joints(js.testing.random_mechanism(0, 2, ["revolute"], dtype=np.float32), {"joint0": 0.3})
        return x + js.kinetic_energy(still, x[:0], x[:0]) + (rod + ball).mass + mech.placements.translation[0, 0]

    mesh = jax.make_mesh((1,), ("batch",), axis_types=(jax.sharding.AxisType.Auto,))
    x = np.zeros(1, np.float32)
    found = jax.shard_map(made, mesh=mesh, in_specs=jax.P("batch"), out_specs=jax.P("batch"))(x)
    np.testing.assert_array_equal(found, made(x))

"""Reactions at fixed joints, and with closed loops. `tests/peers/test_reactions.py` has those of Drake."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

ALLOWED = 1e-12
# Each body with the one that it hangs on, and how; the revolute ones move.
TREE = {
    "stand": ("world", "fixed"),
    "arm": ("stand", "revolute"),
    "wrist": ("arm", "fixed"),
    "sensor": ("wrist", "fixed"),
    "hand": ("sensor", "revolute"),
    "camera": ("wrist", "fixed"),
    "lamp": ("stand", "fixed"),
    "finger": ("hand", "fixed"),
}
WELDS = [name for name, (_, kind) in TREE.items() if kind == "fixed"]


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def pose(rng):
    return js.RigidTransform(js.Rotation.exp(rng.standard_normal(3)), rng.standard_normal(3))


def inertia(rng):
    a = rng.standard_normal((3, 3))
    return js.SpatialInertia(np.float64(rng.uniform(1, 2)), rng.standard_normal(3), a @ a.T / 10 + np.eye(3))


def built(kind_of_welds):
    """The tree, with welds or with joints in their places; a camera without mass."""
    rng = np.random.default_rng(0)
    bodies = [js.Body(name, None if name == "camera" else inertia(rng)) for name in TREE]
    joints = [
        js.Joint(f"to {name}", kind_of_welds if kind == "fixed" else kind, on, name, pose(rng), pose(rng))
        for name, (on, kind) in TREE.items()
    ]
    return js.Mechanism.build(bodies, joints, [js.Frame("lens", "camera", pose(rng))], dtype=np.float64)


with jax.enable_x64(True):
    MECH = built("fixed")
NAMES = [f"to {name}" for name in WELDS]


def reactions(mech, *arguments, **options):
    """In NumPy."""
    return interpreted(lambda *x: js.joint_reactions(mech, *x, **options).to_array())(*arguments)


def state(*batch):
    rng = np.random.default_rng(1)
    tau, f = rng.standard_normal((2, *batch, 3, 3))
    F = js.AppliedForces(["lens", "finger", "stand"], js.SpatialForce(tau, f), rng.standard_normal((3, 3)))
    return *rng.standard_normal((3, *batch, 2)), F


def at_welds(mech, *arguments):
    return js.joint_reactions(mech, *arguments, joints=NAMES).to_array()


def test_as_through_joints_at_rest():
    """Joints in the places of welds, which do not move."""
    moving = built("revolute")
    arguments = state(2)
    found = interpreted(at_welds)(MECH, *arguments)
    *q_v_vdot, F = arguments
    wide = [np.zeros((2, moving.nv)) for _ in range(3)]
    for x, y in zip(wide, q_v_vdot, strict=True):
        for k, name in enumerate(MECH.joint_names):
            x[:, moving.joint_velocity_indices(name)[0]] = y[:, k]
    expected = reactions(moving, *wide, F, joints=NAMES)
    assert abs(expected).max() > 10 and found.shape == (2, len(WELDS), 6)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ALLOWED * abs(expected).max())


def test_names_and_order():
    arguments = state()
    names = ["to finger", "to hand", "stand", "to arm"]
    F = reactions(MECH, *arguments, joints=names)
    np.testing.assert_array_equal(F[1::2], reactions(MECH, *arguments)[::-1])
    for i, name in ((0, "finger"), (2, "to stand")):
        one = reactions(MECH, *arguments, joints=name)
        assert one.shape == (6,)
        np.testing.assert_array_equal(F[i], one)
    # In depth-first order, as all joints.
    depth_first = "stand", "wrist", "sensor", "finger", "camera", "lamp"
    assert MECH.weld_names == tuple(f"to {name}" for name in depth_first)
    with pytest.raises(KeyError, match="joint_reactions: joints: expected one of .* did you mean 'to wrist'"):
        js.joint_reactions(MECH, *arguments, joints="to wirst")
    with pytest.raises(ValueError, match="expected at least one name"):
        js.joint_reactions(MECH, *arguments, joints=[])


@pytest.mark.slow
def test_transformed():
    """jit, vmap, the mechanism as data, and the derivative by the inertia of what is welded."""
    q, v, vdot, F = state(2)
    expected = at_welds(MECH, q, v, vdot, F)
    at = js.AppliedForces(F.frames, F.wrenches.at_batch(0), F.points)
    mapped = jax.vmap(lambda q, v, a, W: at_welds(MECH, q, v, a, js.AppliedForces(F.frames, W, F.points)))
    jitted = jax.jit(at_welds)
    size = abs(expected).max()
    for found in (mapped(q, v, vdot, F.wrenches), jitted(MECH, q, v, vdot, F)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * size)
    # A force is the sum of m (a - g) over masses, so it is linear in a mass.
    lamp, row = MECH.weld_names.index("to lamp"), NAMES.index("to lamp")

    def force(mass):
        M = MECH.weld_inertias
        heavier = js.SpatialInertia(jnp.asarray(M.mass).at[lamp].set(mass), M.com, M.central)
        return at_welds(MECH.replace(weld_inertias=heavier), q[0], v[0], vdot[0], at)[row, 5]

    mass = jnp.float64(MECH.weld_inertias.mass[lamp])
    R = js.forward_kinematics(MECH, q[0], "lamp").rotation.to_matrix()
    np.testing.assert_allclose(jax.grad(force)(mass), R[2, 2] * 9.81, rtol=1e-13)
    np.testing.assert_allclose(force(mass), R[2, 2] * 9.81 * mass, rtol=1e-13)


def test_nothing_moves():
    """A free-body diagram: what holds a table with a vice on it that is pushed, for a batch of pushes."""
    box = js.SpatialInertia.solid_box(np.ones(3), mass=np.float64(2.0))
    on_top = js.RigidTransform(js.Rotation.identity(), np.array([1.0, 0, 0]))
    joints = [js.Joint("feet", "fixed", "world", "table"), js.Joint("bolt", "fixed", "table", "vice", on_top)]
    mech = js.Mechanism.build([js.Body("table", box), js.Body("vice", box)], joints, dtype=np.float64)
    push = js.SpatialForce(np.zeros((3, 3)), np.array([[0.0, 0, 0], [0, 0, -5], [0, 7, 0]]))
    nothing = jnp.zeros((3, 0))
    F = js.joint_reactions(mech, nothing, nothing, nothing, {"vice": push}, joints=["feet", "bolt"]).to_array()
    weight = 2 * 9.81
    bolt = [[0, 0, 0, 0, 0, weight], [0, 0, 0, 0, 0, weight + 5], [0, 0, 0, 0, -7, weight]]
    feet = [[0, -weight, 0, 0, 0, 2 * weight], [0, -weight - 5, 0, 0, 0, 2 * weight + 5]]
    feet += [[0, -weight, -7, 0, -7, 2 * weight]]
    np.testing.assert_allclose(F, np.stack([feet, bolt], 1), atol=1e-13)


def test_locked_joints_have_reactions():
    """As those of the joints at rest that were locked."""
    q, v, vdot, F = (x[:1] if isinstance(x, np.ndarray) else x for x in state())
    locked = js.lock_joints(MECH, {"to hand": 0.3})
    assert locked.weld_names == ("to hand",)
    found = reactions(locked, q, v, vdot, F, joints=["to hand", "to arm"])
    wide = [np.append(x, y) for x, y in ((q, 0.3), (v, 0.0), (vdot, 0.0))]
    expected = reactions(MECH, *wide, F, joints=["to hand", "to arm"])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_frames_that_are_added_to_what_is_welded():
    q, v, vdot, _ = state()
    X = pose(np.random.default_rng(5))
    mech = js.add_frames(MECH, [js.Frame("tip", "lens", X)])
    F = js.SpatialForce(np.array([1.0, 2, 3]), np.array([4.0, 5, 6]))
    found = reactions(mech, q, v, vdot, {"tip": F}, joints="to camera")
    X_WT, X_WC = (
        interpreted(lambda q, name=name: js.forward_kinematics(mech, q, name))(q) for name in ("tip", "camera")
    )
    arm, R = X_WT.translation - X_WC.translation, X_WC.rotation.entries.reshape(3, 3)
    by_hand = np.concatenate([R.T @ (F.tau + np.cross(arm, F.f)), R.T @ F.f])
    np.testing.assert_allclose(found, -by_hand, atol=1e-12)


# -- closed loops -----------------------------------------------------------------------------------------------------
#
# A crank and a rocker on hinges, with a rod on ball joints between them. The rocker stands on what is welded to the
# world.


def linkage(rod_hangs_on):
    """The rod hangs on the crank or on the rocker, by a ball joint; the other end is closed."""
    rng = np.random.default_rng(3)
    bodies = [js.Body(name, inertia(rng)) for name in ("stand", "crank", "rocker", "rod", "weight")]
    M_rod = bodies[3].inertia
    length = 3.0
    ends = {"crank": np.array([0.5, 0.1, 0.2]), "rocker": np.array([0.3, 0.9, -0.2])}
    along = js.RigidTransform(js.Rotation.identity(), np.array([length, 0, 0]))
    own_end = js.RigidTransform(js.Rotation.identity(), ends[rod_hangs_on])
    # The rod's frame is at the end that the crank holds.
    child = js.RigidTransform(js.Rotation.identity(), -along.translation) if rod_hangs_on == "rocker" else None
    joints = [
        js.Joint("feet", "fixed", "world", "stand", js.RigidTransform(js.Rotation.identity(), np.array([2.5, 0.4, 0]))),
        js.Joint("a", "revolute", "world", "crank", axis=(0, 1, 0.2)),
        js.Joint("c", "revolute", "stand", "rocker", axis=(0.3, 0, 1)),
        js.Joint("pin", "ball", rod_hangs_on, "rod", own_end, child),
        js.Joint("screw", "fixed", "rod", "weight", js.RigidTransform(js.Rotation.identity(), np.array([1.0, 0.5, 0]))),
    ]
    other = "rocker" if rod_hangs_on == "crank" else "crank"
    frames = [
        js.Frame("held", other, js.RigidTransform(js.Rotation.identity(), ends[other])),
        js.Frame("end", "rod", along if other == "rocker" else None),
    ]
    bodies[3] = js.Body("rod", M_rod)
    loop = js.LoopClosure("held", "end", "ball")
    return js.Mechanism.build(bodies, joints, frames, dtype=np.float64, loops=[loop])


@pytest.mark.slow
def test_wherever_a_loop_is_cut_its_joints_bear_the_same():
    """Cut at the rocker, then at the crank: what one takes for a joint the other takes for a closure."""
    cut_at_rocker, cut_at_crank = linkage("crank"), linkage("rocker")
    start = cut_at_rocker.configuration({"a": 0.3, "c": 0.2})
    q, residual = jax.jit(lambda q: js.close_loops(cut_at_rocker, q, cut_at_rocker.loops))(start)
    assert residual < 1e-12
    turn = interpreted(lambda q: js.forward_kinematics(cut_at_rocker, q, ["rocker", "rod"]).rotation)(q)
    R_rocker, R_rod = (js.Rotation(turn.entries[k]) for k in (0, 1))
    of_both = cut_at_rocker.joint_positions(q)
    other_q = cut_at_crank.configuration({"a": of_both["a"], "c": of_both["c"], "pin": R_rocker.inverse() @ R_rod})
    error = interpreted(lambda q: js.constraint_error(cut_at_crank, q, cut_at_crank.loops))(other_q)
    assert abs(error).max() < 1e-12
    push = {"rod": js.SpatialForce(jnp.array([1.0, 2, 3]), jnp.array([3.0, -20, 10]))}
    torques = {"a": 40.0, "c": -25.0}
    names = ["a", "c", "feet", "screw"]
    results = []
    for mech, x in ((cut_at_rocker, q), (cut_at_crank, other_q)):
        rest, tau = np.zeros(mech.nv), mech.velocities(torques)

        def solved(q, tau, mech=mech, rest=rest):
            vdot, wrenches = js.constrained_forward_dynamics(mech, q, rest, tau, mech.loops, push)
            closed = {"loops": mech.loops, "loop_wrenches": wrenches}
            return wrenches, js.joint_reactions(mech, q, rest, vdot, push, joints=[*names, "pin"], **closed).to_array()

        wrenches, F = jax.jit(solved)(x, tau)
        # With the wrenches of the closure the joints need exactly the torques that drive them.
        for i, name in enumerate(("a", "c")):
            axis = np.asarray(mech.axes[mech.joint_names.index(name)])
            np.testing.assert_allclose(F[i, :3] @ axis, torques[name], rtol=1e-8)
        R = interpreted(lambda q, mech=mech: js.forward_kinematics(mech, q, "rod").rotation.to_matrix())(x)
        results.append((F[:4], R @ F[4, 3:], np.asarray(wrenches.f[0])))
    (one, pin, closure), (other, other_pin, other_closure) = results
    assert abs(pin).max() > 5 and abs(closure).max() > 5
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-8 * abs(one).max())
    np.testing.assert_allclose(pin, other_closure, rtol=0, atol=1e-8 * abs(pin).max())
    np.testing.assert_allclose(other_pin, closure, rtol=0, atol=1e-8 * abs(pin).max())


def test_loops_come_with_their_wrenches():
    mech = linkage("crank")
    q, rest = mech.neutral(), np.zeros(mech.nv)
    two = js.SpatialForce.zero(2, np.float64)
    for given in ({"loops": mech.loops}, {"loop_wrenches": two}):
        with pytest.raises(ValueError, match="joint_reactions: expected loops and their wrenches"):
            js.joint_reactions(mech, q, rest, rest, **given)
    with pytest.raises(ValueError, match=r"loop_wrenches: expected shape \(\*batch, 1\), got \(2,\)"):
        js.joint_reactions(mech, q, rest, rest, loops=mech.loops, loop_wrenches=two)
    with pytest.raises(TypeError, match="loop_wrenches: expected a SpatialForce, got ndarray"):
        js.joint_reactions(mech, q, rest, rest, loops=mech.loops, loop_wrenches=np.zeros(3))

"""Kinds of joints: the laws of every form, and one filled in outside of the package.

The latter is RigidBodyDynamics.jl's sine-cosine revolute joint: it turns about an axis, and its coordinates are the
sine and cosine of the angle. Whatever is computed with it is what an ordinary revolute joint has at the same angle, to
the bit where cosine and sine are the same numbers.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism import joints
from jaxspatial.mechanism.joints import AXIS, BUILT_IN, KINDS, JointKind, Parameter, Revolute
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.functions import angle_ratio, cosine_sine, pi
from jaxspatial.numerics.linear import Motion, Pose, cross, unit
from jaxspatial.numerics.numbers import Rounded, where
from jaxspatial.numerics.precision import Precision
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

U = 2.0**-53


# -- a kind from outside ----------------------------------------------------------------------------------------------


class SineCosineRevolute(JointKind):
    """Turns about the axis: q = (sine, cosine) of the angle, v its rate, rad/s."""

    name, nq, nv, neutral, sphere = "sine_cosine_revolute", 2, 1, (0.0, 1.0), (2, 1)
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q, cos_sin):
        return Revolute.transform(self, q, {0: (q[1], q[0])})

    motion_subspace = Revolute.motion_subspace
    constraint_subspace = Revolute.constraint_subspace

    def rates(self, q, cos_sin, v):
        return q[1] * v[0], -(q[0] * v[0])

    def integrate(self, q, step):
        (s, c), (cosine, sine) = q, cosine_sine(step[0])
        return unit((s * cosine + c * sine, c * cosine - s * sine))

    def difference(self, q, q2):
        s, c = q2[0] * q[1] - q2[1] * q[0], q2[1] * q[1] + q2[0] * q[0]
        acute = s * angle_ratio(s * s, abs(c), (s * s + c * c).sqrt())
        return (where(c >= 0, acute, where(s >= 0, pi(s), -pi(s)) - acute),)

    @classmethod
    def random(cls, key, lower, upper, batch_shape):
        angle = jax.random.uniform(key, batch_shape, lower.dtype, -math.pi, math.pi)
        return jnp.stack([jnp.sin(angle), jnp.cos(angle)], -1)


LEAD = Parameter("lead", default=0.25)
OFFSET = Parameter("offset", 3)


class OffsetScrew(JointKind):
    """A helical joint with the pitch as a parameter of another name, about a parallel axis `offset` away."""

    name, nq, nv, angles, parameters = "offset_screw", 1, 1, (0,), (AXIS, LEAD, OFFSET)

    def transform(self, q, cos_sin):
        R = Revolute.transform(self, q, cos_sin).R
        return Pose(R, self.offset - R @ self.offset + (self.lead * q[0]) * self.axis)

    def motion_subspace(self, cos_sin):
        return (Motion(self.axis, cross(self.offset, self.axis) + self.lead * self.axis),)


@pytest.fixture(autouse=True, scope="module")
def _registered():
    """Known in this module alone: programs go on being kept by the name."""
    for kind in (SineCosineRevolute, OffsetScrew):
        assert joints.register(kind) is kind
    yield
    for kind in (SineCosineRevolute, OffsetScrew):
        del KINDS[kind.name]


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


RNG = np.random.default_rng(0)
# (parent, kind) of every body: "r" is the joint that is compared, others are as they are.
TREES = {
    "one": [(-1, "r")],
    # A chain of two beside one of three: rows of one loop, with others that stand in where one is shorter.
    "loops": [(-1, "ball"), (0, "r"), (1, "r"), (0, "r"), (3, "r"), (4, "r")],
    "a loop": [(k - 1, "r") for k in range(4)],
    "between others": [(-1, "prismatic"), (0, "r"), (1, "ball"), (2, "r"), (2, "r")],
}


def build(tree, kind, **more):
    """A random mechanism of a tree, that does not depend on the kind of the joints that are compared."""
    like = js.testing.random_mechanism(7, len(tree), ["revolute"], dtype=np.float64)
    bodies = [js.Body(f"b{i}", jax.tree.map(lambda x, i=i: x[i], like.inertias)) for i in range(len(tree))]
    made = [
        js.Joint(
            f"j{i}", kind if of == "r" else of, f"b{on}" if on >= 0 else "world", f"b{i}",
            jax.tree.map(lambda x, i=i: x[i], like.placements), axis=like.axes[i], damping=0.5, **more,
        )
        for i, (on, of) in enumerate(tree)
    ]  # fmt: skip
    return js.Mechanism.build(bodies, made, dtype=np.float64)


def pair(name, **more):
    return tuple(build(TREES[name], kind, **more) for kind in ("revolute", "sine_cosine_revolute"))


def sine_cosine(angles):
    """The very numbers that an ordinary joint computes with."""
    entries = js.Rotation.about_z(angles).entries
    return jnp.stack([entries[..., 3], entries[..., 0]], -1)


def as_sine_cosine(name, plain, q):
    """The coordinates of the second of a `pair`, of those of the first."""
    parts = np.split(
        np.asarray(q), np.cumsum([k.nq for k in map(plain.topology.kind, range(len(plain.body_names)))])[:-1], -1
    )
    parts = [sine_cosine(x[..., 0]) if k == "revolute" else x for k, x in zip(plain.topology.kinds, parts, strict=True)]
    return jnp.concatenate(parts, -1)


@functools.cache
def angles():
    """Those whose sine and cosine, as rounded, have the length 1, as rounded: reading them changes no bit."""
    found = np.linspace(-3, 3, 500)
    both = sine_cosine(found)
    return found[(formula(lambda v: unit(v))("reproducible", both) == both).all(-1)]


def state(name, batch=(), **more):
    plain, other = pair(name, **more)
    q = np.array(js.random_configuration(plain, jax.random.key(3), batch))
    kinds = zip(plain.joint_names, plain.topology.kinds, strict=True)
    own = [plain.joint_position_indices(joint)[0] for joint, kind in kinds if kind == "revolute"]
    q[..., own] = angles()[abs(angles() - q[..., own, None]).argmin(-1)]
    v, a = (jnp.asarray(RNG.standard_normal((*batch, plain.nv))) for _ in range(2))
    return (plain, q), (other, as_sine_cosine(name, plain, q)), v, a


def of(function, mech):
    """The function of this mechanism, in NumPy; of its numbers too, where they are data."""
    if all(isinstance(x, np.ndarray) for x in jax.tree.leaves(mech)):
        return interpreted(functools.partial(function, mech))
    return functools.partial(interpreted(function), mech)


FORCES = {"b0": js.SpatialForce(np.array([1.0, 2, 3]), np.array([4.0, 5, 6]))}
CALLS = {
    "inverse dynamics": lambda m, q, v, a, **p: js.inverse_dynamics(m, q, v, a, FORCES, **p),
    "forward dynamics": lambda m, q, v, a, **p: js.forward_dynamics(m, q, v, a, FORCES, **p),
    "mass matrix": lambda m, q, v, a, **p: js.mass_matrix(m, q, **p),
    "poses": lambda m, q, v, a, **p: js.forward_kinematics(m, q, **p),
    "velocities": lambda m, q, v, a, **p: js.body_velocities(m, q, v, **p),
    "accelerations": lambda m, q, v, a, **p: js.body_accelerations(m, q, v, a, **p),
    "jacobian": lambda m, q, v, a, **p: js.jacobian(m, q, m.body_names[-1], **p),
    "jacobian rate": lambda m, q, v, a, **p: js.jacobian_rate(m, q, v, m.body_names[-1], **p),
    "energy": lambda m, q, v, a, **p: js.kinetic_energy(m, q, v, **p) + js.potential_energy(m, q, **p),
    "momentum": lambda m, q, v, a, **p: js.centroidal_momentum(m, q, v, **p),
    "regressor": lambda m, q, v, a, **p: js.regressors.joint_torque_regressor(m, q, v, a, **p),
    "derivatives of inverse dynamics": lambda m, q, v, a, **p: js.inverse_dynamics_derivatives(m, q, v, a, **p),
    "derivatives of forward dynamics": lambda m, q, v, a, **p: js.forward_dynamics_derivatives(m, q, v, a, **p),
}


KEPT = ("inverse dynamics", "forward dynamics", "derivatives of inverse dynamics")
CASES = [("loops", call) if call in KEPT else slow("loops", call) for call in CALLS]
CASES += [("between others", "forward dynamics")]


@pytest.mark.parametrize(("name", "call"), CASES)
def test_dynamics_is_that_of_a_revolute_joint_to_the_bit(name, call):
    (plain, q), (other, q_other), v, a = state(name)
    expected, found = of(CALLS[call], plain)(q, v, a), of(CALLS[call], other)(q_other, v, a)
    jax.tree.map(np.testing.assert_array_equal, found, expected)


def test_its_sine_and_cosine_are_read_at_unit_length():
    _, (other, q), v, a = state("a loop")
    torques = of(js.inverse_dynamics, other)
    expected = torques(q, v, a)
    np.testing.assert_array_equal(torques(-2 * -q, v, a), expected)
    np.testing.assert_allclose(torques(3 * q, v, a), expected, rtol=0, atol=200 * U * abs(expected).max())


def test_it_is_in_other_precisions_over_batches_and_as_data(call="inverse dynamics"):
    (plain, q), (other, q_other), v, a = state("one", (3,))
    for precision in ("fast", "compensated"):
        function = functools.partial(CALLS[call], precision=precision)
        expected, found = of(function, plain)(q, v, a), of(function, other.as_data())(q_other, v, a)
        np.testing.assert_allclose(found, expected, rtol=0, atol=200 * U * abs(expected).max())
    each = jax.jit(jax.vmap(functools.partial(CALLS[call], other)))(q_other, v, a)
    np.testing.assert_array_equal(each, of(CALLS[call], plain)(q, v, a))


# -- its coordinates --------------------------------------------------------------------------------------------------


def test_it_moves_on_the_circle():
    (plain, q), (other, q_other), v, _ = state("between others", (5,))
    later = lambda mech, q: js.integrate(mech, q, v, 0.7)  # noqa: E731
    q2, q2_other = of(later, plain)(q), of(later, other)(q_other)
    np.testing.assert_allclose(q2_other, as_sine_cosine("between others", plain, q2), rtol=0, atol=8 * U)
    step = of(js.difference, other)(q_other, q2_other)
    np.testing.assert_allclose(step, of(js.difference, plain)(q, q2), rtol=0, atol=32 * U)
    np.testing.assert_allclose(step, 0.7 * np.asarray(v), rtol=0, atol=32 * U)


def test_differences_are_the_short_way_round():
    _, other = pair("one")
    angles = np.array([0.0, 1e-200, 1e-9, 0.5, np.pi / 2, 3.0, np.pi - 1e-9, -1e-9, -1.5, -3.0])
    for start in (0.0, 2.0, -3.0):
        q, q2 = sine_cosine(np.full_like(angles, start)), sine_cosine(start + angles)
        expected = np.where(abs(angles) < 1e-3, (start + angles) - start, angles)
        np.testing.assert_allclose(js.difference(other, q, q2)[:, 0], expected, rtol=0, atol=8 * U)


def test_rates_are_derivatives_of_the_coordinates():
    (plain, q), (other, q_other), v, _ = state("between others")
    to_other = functools.partial(as_sine_cosine, "between others", plain)
    h = 1e-6
    ahead, behind = (to_other(js.integrate(plain, q, v, s * h)) for s in (1, -1))
    expected = (np.asarray(ahead) - np.asarray(behind)) / (2 * h)
    np.testing.assert_allclose(js.configuration_rates(other, q_other, v), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("function_of", [js.inverse_dynamics, slow(js.forward_dynamics)])
def test_derivatives_by_coordinates_are_those_along_rates(function_of):
    """Forward and in reverse: of sine and cosine, by way of their rates, what the angle has."""
    (plain, q), (other, q_other), v, a = state("a loop")

    def along(mech, q, u):
        rate = js.configuration_rates(mech, q, u)
        return jax.jvp(lambda q: function_of(mech, q, v, a), (q,), (rate,))[1]

    def slope(mech, q):
        gradient = jax.grad(lambda q: function_of(mech, q, v, a) @ a)(q)
        return jax.vjp(lambda u: js.configuration_rates(mech, q, u), v)[1](gradient)[0]

    u = jnp.asarray(RNG.standard_normal(plain.nv))
    for function in (functools.partial(along, u=u), slope):
        expected, found = of(function, plain)(q), of(function, other)(q_other)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_its_springs_and_friction_are_those_of_an_angle():
    plain = build(TREES["a loop"], "continuous", stiffness=3.0, friction_loss=0.5, spring_reference=0.4)
    sine, cosine = np.sin(0.4), np.cos(0.4)
    other = build(
        TREES["a loop"], "sine_cosine_revolute", stiffness=3.0, friction_loss=0.5, spring_reference=(sine, cosine)
    )
    q, v = jnp.asarray([0.3, -2.0, 3.0, -2.8]), jnp.asarray(RNG.standard_normal(4))
    expected, found = of(js.passive_forces, plain)(q, v), of(js.passive_forces, other)(sine_cosine(q).ravel(), v)
    np.testing.assert_allclose(found, expected, rtol=0, atol=64 * U)
    with pytest.raises(ValueError, match="Joint 'j0': spring_reference: expected 2 numbers of length 1 first, got"):
        build(TREES["one"], "sine_cosine_revolute", spring_reference=(1.0, 1.0))


def test_steps_in_time_follow_those_of_a_revolute_joint():
    (plain, q), (other, q_other), v, a = state("a loop")
    step = lambda mech, q: js.semi_implicit_step(mech, q, v, a, 1e-3)  # noqa: E731
    (q2, v2), (q2_other, v2_other) = of(step, plain)(q), of(step, other)(q_other)
    np.testing.assert_allclose(v2_other, v2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(q2_other, sine_cosine(q2).ravel(), rtol=0, atol=1e-13)


# -- as any other kind ------------------------------------------------------------------------------------------------


def test_what_edits_and_makes_mechanisms_knows_it():
    (plain, q), (other, q_other), *_ = state("a loop")
    np.testing.assert_array_equal(other.neutral(), [0, 1] * 4)
    locked = js.lock_joints(other, {"j2": q_other[4:6]})
    assert locked.topology.kinds == ("sine_cosine_revolute",) * 3
    expected = js.lock_joints(plain, {"j2": q[2]})
    found = of(js.mass_matrix, locked)(np.delete(q_other, [4, 5]))
    np.testing.assert_allclose(found, of(js.mass_matrix, expected)(np.delete(q, 2)), rtol=0, atol=1e-14)
    assert js.subtree(other, "b2").nq == 4
    random = js.random_configuration(other, jax.random.key(0), (100,))
    np.testing.assert_allclose((random.reshape((100, 4, 2)) ** 2).sum(-1), 1, rtol=4 * U)
    assert (abs(random).max(0) > 0.9).all()
    assert repr(build(TREES["one"], "sine_cosine_revolute")).endswith("b0  <- j0: sine_cosine_revolute")


def test_the_sine_and_cosine_are_not_followed():
    parts = [js.Body("a"), js.Body("b")]
    made = [
        js.Joint("i", "sine_cosine_revolute", "world", "a"),
        js.Joint("j", "revolute", "a", "b", mimic=("i",)),
    ]
    with pytest.raises(ValueError, match="Joint 'j': mimic: expected the name of a joint with one coordinate"):
        js.Mechanism.build(parts, made)


# -- parameters of its own --------------------------------------------------------------------------------------------


def screws(dtype=np.float64):
    """Helical joints off the origins of their frames, and the same as joints of the other kind."""
    rng = np.random.default_rng(2)
    axes, offsets = rng.standard_normal((2, 4, 3))
    leads = (0.3, -0.2, 0.25, 0.25)
    shape = js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.2, 0.3]), mass=np.float64(2))
    bodies, plain, other = [js.Body(f"b{i}", shape) for i in range(4)], [], []
    for i, (axis, offset, lead) in enumerate(zip(axes, offsets, leads, strict=True)):
        on = f"b{i - 1}" if i else "world"
        there, back = (js.RigidTransform(js.Rotation(np.eye(3).ravel()), x) for x in (offset, -offset))
        plain.append(js.Joint(f"j{i}", "helical", on, f"b{i}", there, back, axis=axis, pitch=lead))
        # The last two have the lead by default, and one has no offset given.
        given = {"lead": lead, "offset": offset} if i < 2 else {"offset": offset}
        other.append(js.Joint(f"j{i}", "offset_screw", on, f"b{i}", axis=axis, parameters=given))
    return tuple(js.Mechanism.build(bodies, made, dtype=dtype) for made in (plain, other))


@pytest.mark.parametrize("as_data", [False, True])
def test_parameters_reach_the_formulas(as_data):
    plain, other = (m.as_data() if as_data else m for m in screws())
    assert {name: x.shape for name, x in other.parameters.items()} == {"lead": (4, 1), "offset": (4, 3)}
    assert plain.parameters == {}
    q, v, a = jnp.asarray(RNG.standard_normal((3, 4)))
    found, expected = (of(js.inverse_dynamics, m)(q, v, a) for m in (other, plain))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * abs(expected).max())
    found, expected = (of(js.forward_kinematics, m)(q).translation for m in (other, plain))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_parameters_are_numbers_of_the_mechanism():
    """Replaced, differentiated, edited, without leaves, exported: as all others are."""
    plain, other = screws()
    q = jnp.asarray(RNG.standard_normal(4))
    longer = other.replace(parameters={**other.parameters, "lead": 2 * other.parameters["lead"]})
    expected = of(js.gravity_forces, plain.replace(pitches=2 * plain.pitches))(q)
    np.testing.assert_allclose(of(js.gravity_forces, longer)(q), expected, rtol=0, atol=1e-13)
    gradient = interpreted(jax.grad(lambda m: js.potential_energy(m, q)))
    slope, expected = gradient(other.as_data()).parameters["lead"][:, 0], gradient(plain.as_data()).pitches
    np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-13)
    held = js.lock_joints(other, {"j1": 0.3})
    expected = of(js.gravity_forces, js.lock_joints(plain, {"j1": 0.3}))(q[:3])
    np.testing.assert_allclose(of(js.gravity_forces, held)(q[:3]), expected, rtol=0, atol=1e-13)
    static = other.as_static()
    exported = jax.export.export(jax.jit(js.gravity_forces))(static, q)
    again = jax.export.deserialize(exported.serialize())
    np.testing.assert_array_equal(again.call(static, q), of(js.gravity_forces, other)(q))
    random = js.testing.random_mechanism(0, 3, ["offset_screw", "helical"], dtype=np.float64)
    assert random.parameters["lead"][0] != 0.25 != random.parameters["lead"][2] and random.pitches[1] != 0


REFUSED = {
    "unknown": ({"parameters": {"speed": 1.0}}, "Joint 'j': parameters: expected one of 'lead', 'offset', got 'speed'"),
    "two leads": ({"parameters": {"lead": (1.0, 2.0)}}, r"Joint 'j': lead: expected 1 number, got shape \(2,\)"),
    "short": ({"parameters": {"offset": (1.0, 2.0)}}, r"Joint 'j': offset: expected 3 numbers, got shape \(2,\)"),
}


@pytest.mark.parametrize(("more", "message"), REFUSED.values(), ids=REFUSED)
def test_refused_parameters(more, message):
    with pytest.raises(ValueError, match=message):
        js.Mechanism.build([js.Body("a")], [js.Joint("j", "offset_screw", "world", "a", **more)])
    with pytest.raises(ValueError, match="parameters: expected none of 'revolute', got 'lead'"):
        js.Joint("j", "revolute", "world", "a", parameters={"lead": 1.0})


# -- registered -------------------------------------------------------------------------------------------------------


def made(**fields):
    return type("Made", (JointKind,), {"name": "made", "nq": 1, "nv": 1} | fields)


@pytest.mark.parametrize(
    ("kind", "error", "message"),
    [
        (3, TypeError, "register: expected a subclass of JointKind, got 3"),
        (made(name="ball"), ValueError, "register: name: there is another kind 'ball'"),
        (made(nq=2), ValueError, "register: made: neutral: expected 2 coordinates, got 1"),
        (made(parameters=(Parameter("lead"),)), ValueError, "register: made: parameters: there is another 'lead'"),
        (made(parameters=(Parameter("rates"),)), ValueError, "register: made: parameters: 'rates' is something else"),
        (made(parameters=(Parameter("axis", 3),)), ValueError, "register: made: parameters: there is another 'axis'"),
    ],
)
def test_kinds_that_would_be_taken_for_others_are_refused(kind, error, message):
    before = dict(KINDS)
    with pytest.raises(error, match=message):
        joints.register(kind)
    assert before == KINDS


def test_a_tree_with_a_kind_that_is_not_known_says_so():
    topology = build(TREES["one"], "sine_cosine_revolute").topology
    kind = KINDS.pop("sine_cosine_revolute")
    try:
        with pytest.raises(KeyError, match="kind: expected one of 'fixed', .*got 'sine_cosine_revolute'.*register"):
            topology.kind(0)
    finally:
        joints.register(kind)


# -- laws of every form -----------------------------------------------------------------------------------------------

FORMS = [kind for kind in (*BUILT_IN, SineCosineRevolute)]
AXES = {"z": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0), "skew": (0.48, -0.64, 0.6)}


def _number(x):
    return Rounded(Precision.REPRODUCIBLE, np.float64(x))


def _numbers(kind, axis):
    """A joint, and the cosines and sines of some of its coordinates."""
    given = {"axis": axis, "second_axis": (0.0, 0.8, 0.6), "pitch": 0.3}
    joint = kind(lambda p: tuple(map(_number, given[p.name])) if p.size > 1 else _number(given[p.name]), _number(0.0))
    return joint, {k: (_number(np.cos(0.3 + k)), _number(np.sin(0.3 + k))) for k in kind.angles}


def _matrix(six):
    return np.array([[float(x.value) for part in column for x in part] for column in six]).reshape((-1, 6))


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("kind", FORMS, ids=lambda kind: kind.name)
def test_constraint_wrenches_are_all_that_have_no_power(kind, axis):
    joint, cos_sin = _numbers(kind, AXES[axis])
    S, T = _matrix(joint.motion_subspace(cos_sin)), _matrix(joint.constraint_subspace(cos_sin))
    assert (len(S), len(T)) == (kind.nv, 6 - kind.nv)
    np.testing.assert_allclose(T @ S.T, 0, atol=8 * U)
    assert len(T) == 0 or np.linalg.matrix_rank(T) == 6 - kind.nv
    singular = np.linalg.svd(np.concatenate([S, T]), compute_uv=False)
    assert singular.min() > 0.1


def _values(numbers):
    return np.array([float(x.value) for x in numbers])


@pytest.mark.parametrize("kind", [kind for kind in FORMS if kind.nv], ids=lambda kind: kind.name)
def test_what_advances_keeps_its_velocity_in_the_axes_of_the_parent(kind):
    """dq/dt, but for angular rates, which stay along the child's axes; a short way as `integrate` goes."""
    joint, _ = _numbers(kind, AXES["skew"])
    rng, n = np.random.default_rng(3), kind.sphere[0]
    q, v = rng.standard_normal(kind.nq), rng.standard_normal(kind.nv)
    q[:n] /= np.linalg.norm(q[:n]) or 1.0

    def advanced(h):
        after = joint.advance(tuple(map(_number, q)), tuple(map(_number, v)), _number(h))
        return [_values(x) for x in after]

    def rates(q, v):
        cos_sin = {k: (_number(np.cos(q[k])), _number(np.sin(q[k]))) for k in kind.angles}
        return _values(joint.rates(tuple(map(_number, q)), cos_sin, tuple(map(_number, v))))

    (far, v_far), (near, v_near) = advanced(0.7), advanced(1e-6)
    np.testing.assert_allclose(rates(far, v_far)[n:], rates(q, v)[n:], rtol=0, atol=16 * U)
    np.testing.assert_allclose(far[n:], (q + 0.7 * rates(q, v))[n:], rtol=0, atol=16 * U)
    along = _values(joint.transport(*[tuple(map(_number, v))] * 2))
    np.testing.assert_array_equal(np.flatnonzero(along), kind.turned)
    np.testing.assert_allclose(v_near, v - 1e-6 * along, rtol=0, atol=1e-11)
    step = tuple(map(_number, 1e-6 * v))
    np.testing.assert_allclose(near, _values(joint.integrate(tuple(map(_number, q)), step)), rtol=0, atol=1e-11)

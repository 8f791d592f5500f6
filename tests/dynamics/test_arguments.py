"""What algorithms say of arguments that are none: integers of JAX, and names that nothing has."""

import dataclasses
import functools
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

ALGORITHMS = {
    name: f
    for name, f in vars(js).items()
    if inspect.isfunction(f)
    and f.__module__.startswith(("jaxspatial.dynamics", "jaxspatial.contact"))
    and name != "random_configuration"
}
NUMBERS = "q", "q0", "q1", "v", "vdot", "tau", "dt", "t"
MECH = js.testing.random_mechanism(0, 2, ["revolute", "prismatic"], dtype=np.float32)


def _cases():
    for name, f in ALGORITHMS.items():
        for parameter in inspect.signature(f).parameters:
            if parameter in NUMBERS:
                yield name, parameter


def _arguments(f, dtype, **others):
    """What f is called with, but for what has a default."""
    given = {"mechanism": MECH, "frames": "body0", "external_forces": {}} | dict.fromkeys(
        NUMBERS[:-2], np.ones(2, dtype)
    )
    given["contacts"] = js.PointContacts(["body0"], radius=dtype(0), stiffness=1.0, relaxation_time=0.0, friction=0.5)
    given["targets"] = np.ones(3, dtype)
    given |= {"loops": [js.LoopClosure("body0", "body1", "ball")]} | dict.fromkeys(NUMBERS[-2:], dtype(0.5))
    needed = {name for name, x in inspect.signature(f).parameters.items() if x.default is x.empty}
    return {name: x for name, x in given.items() if name in needed} | others


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize(("name", "parameter"), list(_cases()))
def test_integers_are_to_become_floats(name, parameter, dtype):
    """Of the dtype of the numbers beside them; of those of the mechanism, or JAX's own, where there are none."""
    f = ALGORITHMS[name]
    integers = jnp.int32(1) if parameter in ("dt", "t") else jnp.arange(2)
    given = _arguments(f, dtype, **{parameter: integers})
    beside = dtype if {*given} & {*NUMBERS} - {parameter} else np.float32
    with pytest.raises(
        TypeError, match=rf"expected floating point .*, got int32; convert with .astype\('{beside.__name__}'\)$"
    ):
        f(**given)


@pytest.mark.parametrize("integers", [jnp.arange(2), np.ones(2, bool)])
def test_integers_beside_nothing_else(integers):
    for mech, dtype in ((MECH, "float32"), (MECH.astype(np.float16).as_data(), "float16")):
        with pytest.raises(TypeError, match=rf"^gravity_forces: q: .* got {integers.dtype}; convert with .*'{dtype}'"):
            js.gravity_forces(mech, integers)


def test_lists_of_integers_are_numbers():
    """Integers of NumPy, too. Beside integers of JAX, which are refused."""
    for given in ([1, 2], np.array([1, 2])):
        np.testing.assert_array_equal(js.gravity_forces(MECH, given), js.gravity_forces(MECH, [1.0, 2.0]))
        with pytest.raises(TypeError, match=r"^bias_forces: v: expected floating point .* got int32; .*'float32'"):
            js.bias_forces(MECH, given, jnp.arange(2))


@pytest.mark.parametrize("dtype", [">f4", ">f2", ">i4"])
def test_bytes_of_numbers_in_the_other_order(dtype):
    """As files may have them. JAX takes none."""
    given, same = np.array([1, 2], dtype), np.array([1, 2], dtype[1:])
    F = js.SpatialForce(given[[0, 1, 1]], given[[1, 1, 0]])
    assert F.dtype == (np.float16 if dtype == ">f2" else np.float32) and F.to_array().tolist() == [1, 2, 2, 2, 2, 1]
    assert js.from_double_word(js.to_double_word(given)).tolist() == [1, 2]
    mech = MECH if dtype != ">f2" else MECH.astype(np.float16)
    for run in (lambda f: f(), lambda f: jax.jit(f)()):
        found, expected = (run(lambda x=x: js.gravity_forces(mech, x)) for x in (given, same))
        np.testing.assert_array_equal(found, expected)


def test_numbers_of_a_mechanism_are_no_integers_of_jax():
    with pytest.raises(TypeError, match=r"^Mechanism.replace: gravity: expected floating point .*'float32'"):
        MECH.replace(gravity=jnp.asarray([0, 0, -9]))
    changed = MECH.replace(gravity=np.asarray([0, 0, -9]))
    assert changed.dtype == np.float32 and changed.gravity.tolist() == [0, 0, -9]


F = js.SpatialForce(np.ones(3, np.float32), np.ones(3, np.float32))
Q = np.ones(2, np.float32)
NAMES = {
    "external forces": ("body0", lambda name: js.inverse_dynamics(MECH, Q, Q, Q, {name: F})),
    "kinematics": ("body1", lambda name: js.forward_kinematics(MECH, Q, [name])),
    "velocities": ("world", lambda name: js.body_velocities(MECH, Q, Q, ["body0", name])),
    "loops": ("body1", lambda name: js.constraint_error(MECH, Q, [js.LoopClosure("world", name, "ball")])),
    "closure": ("hinge", lambda name: js.LoopClosure("world", "body1", name)),
    "jacobian": ("body1", lambda name: js.jacobian(MECH, Q, name)),
    "jacobian rate": ("body1", lambda name: js.jacobian_rate(MECH, Q, Q, name)),
    "positions": ("joint1", lambda name: MECH.joint_position_indices(name)),
    "rates": ("joint1", lambda name: MECH.joint_velocity_indices(name)),
    "frame": ("body1", lambda name: MECH.frame_body(name)),
    "locked": ("joint0", lambda name: js.lock_joints(MECH, {name: 0.0})),
    "subtree": ("body0", lambda name: js.subtree(MECH, name)),
    "parent": ("bolt", lambda name: js.Mechanism.build(PARTS, [*HELD, js.Joint("k", "fixed", name, "nut")])),
    "child": ("nut", lambda name: js.Mechanism.build(PARTS, [*HELD, js.Joint("k", "fixed", "bolt", name)])),
    "mimic": ("screw", lambda name: js.Mechanism.build(PARTS, [*HELD, _mimic(name)])),
    "frame's body": ("bolt", lambda name: js.Mechanism.build(PARTS[:1], HELD, [js.Frame("f", name)])),
    "kind": ("helical", lambda name: js.Joint("j", name, "world", "bolt")),
    "kinds": ("prismatic", lambda name: js.testing.random_mechanism(0, 1, [name])),
    "field": ("armature", lambda name: MECH.replace(**{name: 0.0})),
}
PARTS, HELD = [js.Body("bolt"), js.Body("nut")], [js.Joint("screw", "helical", "world", "bolt")]


def _mimic(name):
    return js.Joint("k", "helical", "bolt", "nut", mimic=(name,))


@pytest.mark.parametrize(("name", "call"), NAMES.values(), ids=NAMES)
def test_a_name_that_nothing_has_is_told_which_is_near(name, call):
    for wrong in (f"{name}x", name.upper(), f"_{name}"):
        with pytest.raises((KeyError, ValueError, TypeError)) as error:
            call(wrong)
        message = error.value.args[0]
        assert message.endswith(f"; did you mean {name!r}?") and repr(wrong) in message
    with pytest.raises((KeyError, ValueError, TypeError), match="^(?!.*did you mean)"):
        call("zzzzzz")


def test_what_is_no_name_is_near_nothing():
    with pytest.raises(KeyError, match="got 3"):
        js.jacobian(MECH, Q, [3])


FIELDS = [field.name for field in dataclasses.fields(MECH) if jax.tree.leaves(getattr(MECH, field.name))]


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_field_that_is_batched_is_refused(name):
    """Not broadcast against states: known numbers of gravity and mimics gave the results of the first, silently."""
    for field in ["gravity", "mimics"] if name != "inverse_dynamics" else [x for x in FIELDS if x != "topology"]:
        batched = jax.tree.map(lambda x: np.stack([x] * 2), getattr(MECH, field))
        both = dataclasses.replace(MECH, **{field: batched})
        for mech in (both, both.as_data()):
            with pytest.raises(ValueError, match=f": mechanism: {field}: expected shape .*; a batch of mechanisms"):
                ALGORITHMS[name](**_arguments(ALGORITHMS[name], np.float32, mechanism=mech))


@pytest.mark.parametrize("field", ["coefficients", "offset", "stiffness", "rest", "damping", "lower", "upper"])
def test_a_number_of_a_tendon_that_is_batched_is_refused(field):
    hinges = [js.Joint("j", "revolute", "world", "a"), js.Joint("k", "revolute", "a", "b")]
    tendon = js.Tendon("t", ["j", "k"], [1.0, 2.0], stiffness=1.0)
    mech = js.Mechanism.build([js.Body("a"), js.Body("b")], hinges, tendons=[tendon], dtype=np.float32).as_data()
    (tendon,) = mech.tendons
    object.__setattr__(tendon, field, np.stack([getattr(tendon, field)] * 2))
    with pytest.raises(
        ValueError, match=r"^passive_forces: mechanism: tendons: expected shape .*, got \(2,.*; a batch"
    ):
        js.passive_forces(mech, np.zeros(2, np.float32), np.zeros(2, np.float32))


def test_a_field_is_mapped_over_as_the_message_says():
    x, q = np.stack([MECH.gravity, -MECH.gravity]), np.float32([0.5, 0.25])
    found = jax.vmap(lambda x, q: js.gravity_forces(MECH.as_data().replace(gravity=x), q), (0, None))(x, q)
    np.testing.assert_array_equal(found[0], -found[1])
    assert found[0].any()


def test_a_count_is_an_integer_that_is_known_while_tracing():
    zero = np.zeros(2, np.float32)

    def step(count):
        return js.symplectic_step(MECH, zero, zero, zero, np.float32(0.1), iterations=count)

    for count, told in ((-1, "-1"), (2.5, "2.5"), (True, "True"), ("3", "'3'"), (jnp.float32(2), r"float32\[\]")):
        with pytest.raises(ValueError, match=f"^symplectic_step: iterations: expected an integer >= 0, got {told}"):
            step(count)
    with pytest.raises(ValueError, match=r"expected an integer >= 0, got int32\[\]"):
        jax.jit(step)(3)
    for a, b in zip(step(np.int64(2)), step(2), strict=True):
        np.testing.assert_array_equal(a, b)


NEEDED = [(name, x) for name, x in _cases() if inspect.signature(ALGORITHMS[name]).parameters[x].default is not None]


@pytest.mark.parametrize(("name", "parameter"), NEEDED)
def test_no_array_is_left_out(name, parameter):
    """None is no array of zeros, and no time."""
    with pytest.raises(TypeError, match=rf"{name}: {parameter}: expected .*, got NoneType None"):
        ALGORITHMS[name](**_arguments(ALGORITHMS[name], np.float32, **{parameter: None}))


@pytest.mark.parametrize(("name", "parameter"), NEEDED)
def test_double_words_are_refused(name, parameter):
    """Targets in double words had been read limb by limb: a finite result that was wrong."""
    x = js.to_double_word(np.ones(() if parameter in NUMBERS[-2:] else 2, np.float32))
    with pytest.raises(TypeError, match=rf"{name}: {parameter}: expected arrays, got a DoubleWord; from_double_word"):
        ALGORITHMS[name](**_arguments(ALGORITHMS[name], np.float32, **{parameter: x}))


def test_trees_of_double_words_are_refused():
    f, x = js.to_double_word, jnp.ones(2)
    F, X = js.SpatialForce(jnp.ones(3), jnp.ones(3)), js.RigidTransform.identity(dtype=np.float32)
    contacts = _arguments(js.contact_forces, np.float32)["contacts"]
    of_ground = js.HalfSpace(jnp.array([0.0, 0.0, 1.0]), jnp.zeros(()))
    step = functools.partial(js.convex_step, MECH, x, x, x, 0.5)
    calls = {
        "external_forces": lambda: js.forward_dynamics(MECH, x, x, x, {"body0": f(F)}),
        "contacts": lambda: step(contacts=f(contacts)),
        "ground": lambda: step(contacts=contacts, ground=f(of_ground)),
        "pairs": lambda: step(pairs=(contacts, f(contacts))),
        "targets": lambda: js.inverse_kinematics(MECH, x, "body1", f(X)),
    }
    for name, call in calls.items():
        with pytest.raises(TypeError, match=rf": {name}.*: expected arrays, got a DoubleWord"):
            call()


@pytest.mark.parametrize("key", [0, np.random.default_rng(0), jax.random.split(jax.random.key(0))])
def test_a_key_is_one_of_jax_random(key):
    with pytest.raises(
        TypeError, match=r"^random_configuration: key: expected a single key, as jax.random.key\(0\), got"
    ):
        js.random_configuration(MECH, key)
    with pytest.raises(TypeError, match="^inverse_kinematics: key: expected a single key"):
        js.inverse_kinematics(MECH, np.ones(2, np.float32), "body0", np.ones(3, np.float32), starts=2, key=key)
    assert js.random_configuration(MECH, jax.random.PRNGKey(0)).shape == (2,)


@pytest.mark.parametrize("shape", [-3, 2.5, "a", (2, -1), True])
def test_a_batch_shape_has_integers(shape):
    makers = (js.SpatialForce.zero, js.Rotation.identity, js.RigidTransform.identity, js.SpatialInertia.zero)
    for make in (*makers, lambda shape: js.random_configuration(MECH, jax.random.key(0), shape)):
        with pytest.raises(ValueError, match="^batch_shape: expected integers >= 0, one or a tuple of them, got"):
            make(shape)


def test_tolerances_are_numbers():
    ones = np.ones(2, np.float32)
    for x in ("1", None, np.ones(2)):
        with pytest.raises(ValueError, match="^inverse_kinematics: angle: expected a number above 0"):
            js.inverse_kinematics(MECH, ones, "body0", np.ones(3, np.float32), angle=x)
        with pytest.raises(ValueError, match="^recommend: tolerance: expected a number above 0"):
            js.measure.recommend(lambda x: x, ones, tolerance=x)


def test_contacts_at_a_frame_that_is_not_there():
    contacts = js.PointContacts(["body9"], stiffness=1.0, relaxation_time=0.1, friction=0.5)
    with pytest.raises(KeyError, match="convex_step: contacts: frames: expected one of .*, got 'body9'"):
        js.convex_step(MECH, *np.ones((3, 2), np.float32), 0.1, contacts=contacts)


def test_dtypes_and_names_that_are_not_there():
    with pytest.raises(TypeError, match="^dtype: expected float16, bfloat16, float32 or float64, got 'float23'"):
        MECH.astype("float23")
    with pytest.raises(AttributeError, match="no attribute 'SpatialForces'; did you mean 'SpatialForce'"):
        getattr(js, "SpatialForces")  # noqa: B009
    with pytest.raises(
        TypeError, match="^stack: quantities: expected a sequence of spatial vectors .*got SpatialForce"
    ):
        js.stack(js.SpatialForce.zero())

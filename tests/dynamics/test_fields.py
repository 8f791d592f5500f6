"""Derivatives by the numbers of a mechanism: of every algorithm, by every field that it reads, in every way to batch
states and fields."""

import collections
import dataclasses
import functools
import inspect
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxspatial as js
from jaxspatial.engine import algorithm as reading
from jaxspatial.mechanism import joints
from jaxspatial.numerics.linear import Motion
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


# -- mechanisms -------------------------------------------------------------------------------------------------------


class Geared(joints.JointKind):
    """Slides along the axis by `ratio` times q: a kind with a parameter of its own."""

    name, nq, nv = "geared", 1, 1
    parameters, is_about_one_axis = (joints.AXIS, joints.Parameter("ratio", default=2.0)), True

    def transform(self, q, cos_sin):
        return joints.Prismatic.transform(self, [self.ratio * q[0]], cos_sin)

    def motion_subspace(self, cos_sin):
        (s,) = joints.Prismatic.motion_subspace(self, cos_sin)
        return (Motion(s.w, self.ratio * s.v),)

    constraint_subspace = joints.Prismatic.constraint_subspace


@pytest.fixture(autouse=True, scope="module")
def _registered():
    joints.register(Geared)
    yield
    del joints.KINDS["geared"]


MECHANISMS = {
    "single": ["revolute on -1"],
    "planar": ["planar on -1", "ball on 0"],
    # A loop.
    "chain": ["revolute on -1", "revolute on 0", "revolute on 1"],
    # Chains side by side, and one that begins where another ends, on a floating base.
    "floating": ["free on -1", "revolute on 0", "revolute on 1", "revolute on 0", "revolute on 3", "revolute on 3"],
    "mimic": ["revolute on -1", "revolute on 0 as 0"],
    "two axes": ["universal on -1", "helical on 0"],
    "sliding": ["geared on -1", "cylindrical on 0"],
    # With a tendon over the two joints, bodies that something lifts, and a ball whose angle is limited.
    "held": ["ball on -1", "revolute on 0", "revolute on 1"],
}


@functools.cache
def mechanism(name):
    """Each body with an inertia, a spring, a frame of its own, and each joint with all that it may have."""
    rng = np.random.default_rng(0)
    parts = [text.split() for text in MECHANISMS[name]]
    is_held, tendons = name == "held", []
    bodies = [js.Body(f"body{i}", inertia(rng), lift=inertia(rng) if is_held else None) for i in range(len(parts))]
    own = [joint(rng, i, *words) for i, words in enumerate(parts)]
    if is_held:
        own[0] = dataclasses.replace(own[0], turn_limit=0.1)
        tendons = [js.Tendon("rope", ["joint1", "joint2"], [1.0, -0.7], 0.1, 2.0, 0.3, 0.4, upper=-0.2)]
    frames = [js.Frame(f"tool{i}", f"body{i}", pose(rng)) for i in range(len(parts))]
    mech = js.Mechanism.build(bodies, own, [*frames, POST], rng.standard_normal(3), np.float64, tendons=tendons)
    far = {"lower": np.full(mech.nq, 0.3), "upper": np.full(mech.nq, -0.2)}
    return mech.replace(**far)


def joint(rng, i, kind, _, on, *follows):
    parent = "world" if on == "-1" else f"body{on}"
    geared = {"parameters": {"ratio": rng.uniform(1, 2)}} if kind == "geared" else {}
    names = "armature", "damping", "friction_loss", "stiffness", "pitch"
    more = dict(zip(names, rng.uniform(0.5, 1, len(names)), strict=True)) | geared
    if follows:
        more = {"mimic": (f"joint{follows[1]}", 0.7, 0.2)}
    directions = {"axis": rng.standard_normal(3), "second_axis": rng.standard_normal(3)}
    placed = {"placement": pose(rng), "child_placement": pose(rng)}
    if kind == "revolute" and parent == "world":
        # Turns about an axis of the world, along which gravity is what it is for all states.
        directions["axis"], placed["placement"] = np.eye(3)[2], None
    return js.Joint(f"joint{i}", kind, parent, f"body{i}", **placed, **directions, **more)


def pose(rng):
    return js.RigidTransform(js.Rotation.exp(rng.standard_normal(3)), rng.standard_normal(3))


def inertia(rng):
    a = rng.standard_normal((3, 3))
    return js.SpatialInertia(np.float64(rng.uniform(1, 2)), 0.3 * rng.standard_normal(3), a @ a.T / 20 + np.eye(3) / 5)


@functools.cache
def states(name):
    """Two of them: (q, v, vdot or tau)."""
    mech, rng = mechanism(name), np.random.default_rng(1)
    free = mech.replace(lower=np.full(mech.nq, -np.inf))
    q = np.asarray(js.random_configuration(free, jax.random.key(0), 2, np.float64))
    return q, *rng.standard_normal((2, 2, mech.nv))


# -- algorithms -------------------------------------------------------------------------------------------------------


def spheres(dtype):
    return js.PointContacts(["tool0"], radius=np.asarray(9.0, dtype), stiffness=2.0, relaxation_time=0.0, friction=0.5)


SOFT, DT, TOOL = js.Compliance(friction_speed=0.7, limit_stiffness=3.0, limit_damping=0.2), 0.1, "tool0"
JOINTS, GEOMETRY, BODIES, DYNAMICS = reading.JOINTS, reading.GEOMETRY, reading.BODIES, reading.DYNAMICS
FREE_OF_GRAVITY = *BODIES, "armature"
OF_BODIES, OF_FRAMES = (*GEOMETRY, "child_placements"), (*GEOMETRY, "frame_placements")
LOADED = *DYNAMICS, "frame_placements"
# From a place that no axis of a joint passes: there a distance does not depend on the joint, and nothing is held.
POST = js.Frame("post", "world", js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array([0.3, -0.5, 0.2])))
HELD = (js.LoopClosure("post", TOOL, "distance", 0.7),)
HOLDING = "lifts", "turn_limits", "tendons"
PASSIVE = "stiffness", "spring_references", "damping", "friction_loss", "lower", "upper"
STEPS = *DYNAMICS, *PASSIVE


def loads(q):
    """A force on a frame, of every state its own."""
    first = q[..., 0]
    return {TOOL: js.SpatialForce(*(jnp.stack([wave(first + k) for k in range(3)], -1) for wave in (jnp.sin, jnp.cos)))}


def at_points(q):
    """Two wrenches at points of a frame, along its axes, of every state their own."""
    first = jnp.stack([q[..., 0], q[..., 0] + 1], -1)
    tau, f, p = (jnp.stack([wave(first + k) for k in range(3)], -1) for wave in (jnp.sin, jnp.cos, jnp.tanh))
    return js.AppliedForces([TOOL, TOOL], js.SpatialForce(tau, f), p, "frame")


def sums(m, q):
    return [F.to_array() for F in js.applied_wrenches(m, q, at_points(q)).values()]


def factor(L, a):
    return L.solve(a), L.inverse(), L.log_determinant()


def moved(m, q, v):
    return js.integrate(m.as_data(), q, v, DT)


# (what is computed of a mechanism m at q, v and a, which stands for accelerations and forces; the fields it reads).
ALGORITHMS = {
    "inverse_dynamics": (lambda m, q, v, a: js.inverse_dynamics(m, q, v, a, loads(q)), LOADED),
    "bias_forces": (lambda m, q, v, a: js.bias_forces(m, q, v), DYNAMICS),
    "gravity_forces": (lambda m, q, v, a: js.gravity_forces(m, q), DYNAMICS),
    "forward_dynamics": (lambda m, q, v, a: js.forward_dynamics(m, q, v, a, loads(q)), LOADED),
    "mass_matrix": (lambda m, q, v, a: js.mass_matrix(m, q), FREE_OF_GRAVITY),
    "mass_matrix_factor": (lambda m, q, v, a: factor(js.mass_matrix_factor(m, q), a), FREE_OF_GRAVITY),
    "forward_kinematics": (lambda m, q, v, a: js.forward_kinematics(m, q).to_matrix(), OF_BODIES),
    "forward_kinematics, a frame": (lambda m, q, v, a: js.forward_kinematics(m, q, [TOOL]).to_matrix(), OF_FRAMES),
    "body_velocities": (lambda m, q, v, a: js.body_velocities(m, q, v).to_array(), OF_BODIES),
    "body_accelerations": (lambda m, q, v, a: js.body_accelerations(m, q, v, a).to_array(), OF_BODIES),
    "jacobian": (lambda m, q, v, a: js.jacobian(m, q, TOOL), OF_FRAMES),
    "jacobian_rate": (lambda m, q, v, a: js.jacobian_rate(m, q, v, TOOL), OF_FRAMES),
    "center_of_mass": (lambda m, q, v, a: js.center_of_mass(m, q), BODIES),
    "center_of_mass_velocity": (lambda m, q, v, a: js.center_of_mass_velocity(m, q, v), BODIES),
    "center_of_mass_jacobian": (lambda m, q, v, a: js.center_of_mass_jacobian(m, q), BODIES),
    "centroidal_momentum": (lambda m, q, v, a: js.centroidal_momentum(m, q, v).to_array(), BODIES),
    "centroidal_momentum_matrix": (lambda m, q, v, a: js.centroidal_momentum_matrix(m, q), BODIES),
    "kinetic_energy": (lambda m, q, v, a: js.kinetic_energy(m, q, v), FREE_OF_GRAVITY),
    "potential_energy": (lambda m, q, v, a: js.potential_energy(m, q), (*BODIES, "gravity")),
    "joint_torque_regressor": (js.regressors.joint_torque_regressor, (*GEOMETRY, "gravity")),
    "inverse_dynamics_derivatives": (lambda m, q, v, a: js.inverse_dynamics_derivatives(m, q, v, a, loads(q)), LOADED),
    "forward_dynamics_derivatives": (lambda m, q, v, a: js.forward_dynamics_derivatives(m, q, v, a), DYNAMICS),
    "passive_forces": (lambda m, q, v, a: js.passive_forces(m, q, v, SOFT), (*JOINTS, *PASSIVE, *HOLDING)),
    "configuration_rates": (lambda m, q, v, a: js.configuration_rates(m, q, v), JOINTS),
    "integrate": (lambda m, q, v, a: js.integrate(m, q, v, DT), JOINTS),
    "difference": (lambda m, q, v, a: js.difference(m, q, moved(m, q, v)), JOINTS),
    "interpolate": (lambda m, q, v, a: js.interpolate(m, q, moved(m, q, v), 0.3), JOINTS),
    "semi_implicit_step": (lambda m, q, v, a: js.semi_implicit_step(m, q, v, a, DT, compliance=SOFT), STEPS),
    "symplectic_step": (
        lambda m, q, v, a: js.symplectic_step(m, q, v, a, DT, iterations=2, compliance=SOFT),
        STEPS,
    ),
    "rk4_step": (lambda m, q, v, a: js.rk4_step(m, q, v, a, DT, compliance=SOFT), STEPS),
    "joint_reactions": (
        lambda m, q, v, a: js.joint_reactions(m, q, v, a, at_points(q)).to_array(),
        (*BODIES, "gravity", *reading.FRAMES),
    ),
    "constraint_error": (lambda m, q, v, a: js.constraint_error(m, q, HELD), (*GEOMETRY, "frame_placements")),
    "constraint_jacobian": (lambda m, q, v, a: js.constraint_jacobian(m, q, HELD), (*GEOMETRY, "frame_placements")),
    "constrained_forward_dynamics": (
        lambda m, q, v, a: js.constrained_forward_dynamics(m, q, v, a, HELD).vdot,
        (*DYNAMICS, "frame_placements"),
    ),
    # Derivatives by numbers of the mechanism are those of a closed start, and first ones: in `test_closed_loops`.
    "contact_forces": (
        lambda m, q, v, a: js.contact_forces(m, q, v, spheres(q.dtype), stiction_speed=1.0).wrenches.to_array(),
        OF_FRAMES,
    ),
    "contact_report": (
        lambda m, q, v, a: js.contact_report(m, q, v, spheres(q.dtype)).slip,
        OF_FRAMES,
    ),
    "applied_wrenches": (lambda m, q, v, a: sums(m, q), (*GEOMETRY, *reading.FRAMES)),
}

# -- derivatives ------------------------------------------------------------------------------------------------------

DERIVATIVES = {"jacfwd": jax.jacfwd, "jacrev": jax.jacrev, "hessian": jax.hessian}


def one(states):
    return [x[0] for x in states]


# Of f(field, *state), with d one of the derivatives by the field: at which of two fields and two states, and how.
EACH = slice(None)
WAYS = {
    "one state": ((0, 0), lambda d, f, x, s: d(lambda y: f(y, *one(s)))(x[0])),
    "states by leading axes": ((0, EACH), lambda d, f, x, s: d(lambda y: f(y, *s))(x[0])),
    "states by vmap": ((0, EACH), lambda d, f, x, s: jax.vmap(lambda *own: d(lambda y: f(y, *own))(x[0]))(*s)),
    "states by vmap within": (
        (0, EACH), lambda d, f, x, s: d(lambda y: jax.vmap(lambda *own: f(y, *own))(*s))(x[0])
    ),
    "fields by vmap": ((EACH, 0), lambda d, f, x, s: jax.vmap(d(lambda y: f(y, *one(s))))(x)),
    "both by vmap": (
        (np.arange(2), np.arange(2)), lambda d, f, x, s: jax.vmap(lambda y, *own: d(lambda z: f(z, *own))(y))(x, *s)
    ),
    "fields by vmap, states by leading axes": ((EACH, EACH), lambda d, f, x, s: jax.vmap(d(lambda y: f(y, *s)))(x)),
}  # fmt: skip


def numbers_of(field):
    """What a field is differentiated by: rotation vectors of what is a rotation, all others as they are."""
    if isinstance(field, js.RigidTransform):
        return jnp.zeros(field.translation.shape), jnp.asarray(field.translation)
    return jax.tree.map(jnp.asarray, field)


def of_numbers(mech, name, x):
    """The mechanism with a field of these numbers: rotations stay rotations, and axes unit vectors."""
    if name.endswith("placements"):
        x = js.RigidTransform(js.Rotation.exp(x[0]) @ getattr(mech, name).rotation, x[1])
    elif name in ("axes", "second_axes"):
        x = x / jnp.sqrt((x * x).sum(-1, keepdims=True))
    return mech.replace(**{name: x})


# Of sixth order: off by about (STEP k)^6 / 140 of a function that changes by k per unit, which is here at most some 10,
# and by rounding, u / STEP and u / STEP^2 of its values.
STEP = 2e-3
FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 / STEP
SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180 / STEP**2


class Table:
    """All derivatives by one field of one mechanism."""

    def __init__(self, name, field):
        self.mechanism, self.states, self.field, self.found = mechanism(name), states(name), field, {}
        start, self.unraveled = ravel_pytree(numbers_of(getattr(self.mechanism, field)))
        # The second field is near the first: limits stay limits, and inertias positive.
        rng = np.random.default_rng(2)
        self.fields = np.stack([start, start + 0.02 * rng.standard_normal(start.shape)])
        # Hessians are by the coordinates along three directions: some fields have a hundred numbers.
        self.directions = rng.standard_normal((3, start.size))
        self.coordinates = np.array([1.0, -0.7, 0.4])
        self.direction = self.coordinates @ self.directions

    def function(self, name):
        """(field as a vector, *state) -> a tuple of arrays."""
        algorithm, _ = ALGORITHMS[name]

        def run(x, *state):
            return tuple(jax.tree.leaves(algorithm(of_numbers(self.mechanism, self.field, self.unraveled(x)), *state)))

        return run

    def differences(self, name):
        """(values, first, second derivatives along the direction) by central differences of sixth order: the results,
        (fields, states, ...) each. The values are of one field and one state each."""
        at = self.fields[:, None] + STEP * np.arange(-3, 4)[:, None] * self.direction  # (fields, nodes, n)
        x = np.broadcast_to(at[:, None], (2, 2, *at.shape[1:])).reshape((-1, at.shape[-1]))
        s = [np.broadcast_to(y[None, :, None], (2, 2, 7, y.shape[-1])).reshape((-1, y.shape[-1])) for y in self.states]
        if name not in self.found:
            found = interpreted(jax.vmap(self.function(name)))(x, *s)
            found = [y.reshape((2, 2, 7, *y.shape[1:])) for y in found]
            self.found[name] = [(y[:, :, 3], *(np.tensordot(y, w, (2, 0)) for w in (FIRST, SECOND))) for y in found]
        return self.found[name]

    def hessian(self, function):
        return lambda x: jax.hessian(lambda t: function(x + t @ self.directions))(jnp.zeros(3))

    def failure(self, name, derivative, way):
        """What is wrong, None if nothing is."""
        where, run = WAYS[way]
        d = self.hessian if derivative == "hessian" else DERIVATIVES[derivative]
        own = functools.partial(run, d, self.function(name))
        found = interpreted(own)(jnp.asarray(self.fields), list(map(jnp.asarray, self.states)))
        differences = self.differences(name)
        size = sum(max(abs(x).max() for x in each) for each in zip(*differences, strict=True))
        for y, (_, by, twice) in zip(found, differences, strict=True):
            if derivative == "hessian":
                along, expected, near = y @ self.coordinates @ self.coordinates, twice[where], 1e-6
                if abs(y - np.swapaxes(y, -1, -2)).max() > 1e-9 * size:
                    return "not symmetric"
            else:
                along, expected, near = y @ self.direction, by[where], 1e-9
            if along.shape != expected.shape:
                return f"shape {along.shape}, expected {expected.shape}"
            if not abs(along - expected).max() <= near * size:
                return f"off by {abs(along - expected).max()} of {size}"
        return None


@functools.cache
def table(name, field):
    return Table(name, field)


# -- what is drawn ----------------------------------------------------------------------------------------------------

# The fields that only some kinds of joints read, and the mechanism that has them; all others are in every mechanism.
OF_KINDS = {"second_axes": "two axes", "pitches": "two axes", "parameters": "sliding", "mimics": "mimic"}
OF_KINDS |= dict.fromkeys(HOLDING, "held")
# Limits of what motors can do are there for others, and loops for callers to pass. Inertias behind welds are read by
# reactions at these alone, see `test_reactions`.
READ_BY_NONE = "effort_limit", "velocity_limit", "loops", "weld_inertias"
# What takes longest to trace: these, and second derivatives, are drawn for the smallest mechanism; and of these no
# second derivatives.
LONG = (
    "inverse_dynamics", "forward_dynamics", "derivatives", "step", "regressor", "factor", "reactions",
    "constraint_jacobian", "bias_forces", "gravity_forces",
)  # fmt: skip


def covering(rows):
    """For rows (algorithm, how many fields) cases (mechanism, field, algorithm, derivative, way): the fields of an
    algorithm that came least so far, and ways, derivatives and mechanisms in turn. Ways and derivatives come in all
    pairs."""
    pairs, of_long = (itertools.cycle(itertools.product(WAYS, names)) for names in (DERIVATIVES, ["jacfwd", "jacrev"]))
    large = itertools.cycle(["planar", "floating", "chain"])
    came, cases = collections.Counter(), []
    for name, count in rows:
        for _ in range(count):
            way, derivative = next(of_long if name.endswith(LONG) else pairs)
            is_small = name.endswith(LONG) or derivative == "hessian"
            field = min((x for x in ALGORITHMS[name][1] if not (is_small and x in OF_KINDS)), key=lambda x: came[x])
            came[field] += 1
            cases.append((OF_KINDS.get(field) or ("single" if is_small else next(large)), field, name, derivative, way))
    return cases


def whole():
    """Every algorithm by every field that it reads, with every derivative; and in every way with every derivative."""
    mechanisms = itertools.cycle(MECHANISMS)
    for name, (_, fields) in ALGORITHMS.items():
        for k, derivative in itertools.product(range(max(len(fields), len(WAYS))), DERIVATIVES):
            field = fields[k % len(fields)]
            mech = OF_KINDS.get(field) or next(mechanisms)
            yield mech, field, name, derivative, list(WAYS)[k % len(WAYS)]


# What raised once: gravity is one for all chains, a field one for all states, and multipliers differ between states.
FOUND = [
    ("chain", "gravity", "gravity_forces", "jacfwd", "one state"),
    ("single", "gravity", "symplectic_step", "jacfwd", "one state"),
    ("single", "inertias", "kinetic_energy", "hessian", "states by leading axes"),
    ("mimic", "mimics", "mass_matrix", "jacfwd", "one state"),
]
HELD_BY = [
    ("held", "lifts", "passive_forces", "jacfwd", "one state"),
    ("held", "turn_limits", "passive_forces", "jacrev", "states by vmap"),
    ("held", "tendons", "passive_forces", "hessian", "both by vmap"),
]
# By default every algorithm once, with every field, every derivative and every way among them.
DRAWN = [*FOUND, *HELD_BY, *covering([(name, 3 if name == "passive_forces" else 1) for name in ALGORITHMS])]
OTHERS = [case for case in dict.fromkeys(whole()) if case not in DRAWN]


@pytest.mark.parametrize(("mech", "field", "name", "derivative", "way"), [*DRAWN, *(slow(*x) for x in OTHERS)])
def test_derivatives_by_a_field(mech, field, name, derivative, way):
    """Those that JAX finds are the differences that they stand for, and have their shape."""
    assert table(mech, field).failure(name, derivative, way) is None


def test_all_are_drawn():
    """Every public function of a mechanism and its state, every field, every derivative in every way; and no field only
    where nothing depends on it."""
    taking = {
        name for name, f in vars(js).items() if inspect.isfunction(f) and "mechanism" in inspect.signature(f).parameters
    }
    # Derivatives of these are compared with differences in `test_convex_step` and `test_inverse_kinematics`.
    elsewhere = {"convex_step", "inverse_kinematics"}
    editing = {"random_configuration", "close_loops", "add_frames", "lock_joints", "subtree"}
    assert taking - {name.split(",")[0] for name in ALGORITHMS} == editing | elsewhere
    mechs, fields, names, *_ = map(set, zip(*DRAWN, strict=True))
    assert mechs == set(MECHANISMS) and names == set(ALGORITHMS)
    assert {"topology", *READ_BY_NONE} == {f.name for f in dataclasses.fields(js.Mechanism)} - fields
    assert {case[3:] for case in DRAWN} == set(itertools.product(DERIVATIVES, WAYS))
    for field in fields:
        differences = [table(x[0], field).differences(x[2]) for x in DRAWN if x[1] == field]
        assert any(abs(by).max() > 1e-3 for found in differences for _, by, _ in found), field


@pytest.mark.parametrize("way", ["jvp of grad", "grad of grad"])
def test_second_derivatives_over_blocks(way):
    """By what all states share, where these are no whole number of blocks: the sum of each one's."""
    mech, n = mechanism("single"), 601
    rng = np.random.default_rng(3)
    q, v = rng.standard_normal((2, n, 1))
    com, t = jnp.asarray(mech.inertias.com[0]), jnp.asarray(rng.standard_normal(3))

    def energy(com, q, v):
        inertias = js.SpatialInertia(mech.inertias.mass, com[None], mech.inertias.central)
        return js.kinetic_energy(mech.replace(inertias=inertias), q, v)

    gradient = jax.grad(lambda com: energy(com, q, v).sum())
    ways = {
        "jvp of grad": lambda com: jax.jvp(gradient, (com,), (t,))[1],
        "grad of grad": jax.grad(lambda com: gradient(com) @ t),
    }
    each = interpreted(jax.vmap(jax.hessian(energy), (None, 0, 0)))(com, q, v)
    np.testing.assert_allclose(interpreted(ways[way])(com), (each @ t).sum(0), rtol=0, atol=1e-12 * abs(each).sum())

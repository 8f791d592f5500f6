"""What is known of a scene while tracing leaves no operation behind: counted, next to the same call on arrays.

Counted are the multiplications and all flops that a call asks for in precision "fast", exactly. In "reproducible" the
same products are left, each behind its fence; in "compensated" those of the same sums, multiplied out.
"""

import functools

import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia
from jaxspatial.rotation.rotation import composed
from tests.helpers.counting import asked_for, compiled, flops
from tests.helpers.marks import slow

# -- scenes -----------------------------------------------------------------------------------------------------------

rng = np.random.default_rng(0)


def _x():
    return jnp.float32(rng.standard_normal())


def _vector(n=3):
    return jnp.asarray(rng.standard_normal(n), np.float32)


def _known(*numbers):
    return js.Components(*map(float, numbers), dtype=np.float32)


ZERO, PLANE, NORMAL = _known(0, 0, 0), js.Components(_x(), _x(), 0.0), js.Components(0.0, 0.0, _x())
F, V, A = (kind(_vector(), _vector()) for kind in (js.SpatialForce, js.SpatialVelocity, js.SpatialAcceleration))
F_PLANE, V_PLANE, A_PLANE = (type(x)(NORMAL, PLANE) for x in (F, V, A))
FORCE, COUPLE = js.SpatialForce(f=_vector()), js.SpatialForce(tau=_vector())
NO_SPIN, NO_TRANSLATION = js.SpatialVelocity(v=_vector()), js.SpatialVelocity(w=_vector())
P, W = _vector(), _vector()
R, R_Z = js.Rotation(_vector(9)), js.Rotation(js.Components(_x(), _x(), 0.0, _x(), _x(), 0.0, 0.0, 0.0, 1.0))
ONE = js.Rotation(_known(1, 0, 0, 0, 1, 0, 0, 0, 1))
X, X_PLANE = js.RigidTransform(R, P), js.RigidTransform(R_Z, PLANE)
IDENTITY, TURN, STEP = js.RigidTransform(ONE, ZERO), js.RigidTransform(R_Z, ZERO), js.RigidTransform(ONE, P)
MASS, MOMENT, ALL = _x(), _x(), _vector(6)
ISOTROPIC = js.Components(MOMENT, 0.0, MOMENT, 0.0, 0.0, MOMENT)
DIAGONAL = js.Components(_x(), 0.0, _x(), 0.0, 0.0, _x())
M, POINT_MASS = SpatialInertia(MASS, P, ALL), SpatialInertia(MASS, P, _known(0, 0, 0, 0, 0, 0))
BALL, BOX = SpatialInertia(MASS, P, ISOTROPIC), SpatialInertia(MASS, P, DIAGONAL)
CENTRED, CENTRED_BALL = SpatialInertia(MASS, ZERO, ALL), SpatialInertia(MASS, ZERO, ISOTROPIC)
M_PLANE = SpatialInertia(MASS, PLANE, js.Components(_x(), _x(), _x(), 0.0, 0.0, _x()))


def _applied(M, motion, precision):
    return M.apply(motion, precision=precision)


def _energy(M, V, precision):
    return M.kinetic_energy(V, precision=precision)


# operation: (function, {scene: (arguments, multiplications, flops)}), the scene of arrays first. A fourth number: of
# how many results an addition, and a selection, ties the layout to that of an argument; on top of the flops.
SCENES = {
    "shift_force": (js.shift, {
        "general": ((F, P), 6, 10), "pure_force": ((FORCE, P), 6, 12), "pure_couple": ((COUPLE, P), 0, 0),
        "plane": ((F_PLANE, PLANE), 2, 4), "along_an_axis": ((F, NORMAL), 2, 5), "nowhere": ((F, ZERO), 0, 0),
    }),
    "shift_velocity": (js.shift, {
        "general": ((V, P), 6, 10), "plane": ((V_PLANE, PLANE), 2, 5), "no_spin": ((NO_SPIN, P), 0, 0),
        "along_an_axis": ((V, NORMAL), 2, 5),
    }),
    "shift_acceleration": (js.shift, {
        "general": ((A, P, W), 18, 29), "plane": ((A_PLANE, PLANE, NORMAL), 6, 13), "no_spin": ((A, P, ZERO), 6, 10),
        "along_an_axis": ((A, NORMAL, W), 8, 17),
    }),
    "dot": (js.dot, {
        "general": ((F, V), 6, 11), "plane": ((F_PLANE, V_PLANE), 3, 5), "pure_force": ((FORCE, V), 3, 5),
        "pure_couple": ((COUPLE, V), 3, 5), "no_spin": ((F, NO_SPIN), 3, 5),
        "no_power": ((FORCE, NO_TRANSLATION), 0, 0),
    }),
    "cross": (js.cross, {
        "general": ((V, F), 18, 32), "plane": ((V_PLANE, F_PLANE), 4, 6), "pure_force": ((V, FORCE), 12, 18, 2),
        "pure_couple": ((V, COUPLE), 6, 9, 1), "no_spin": ((NO_SPIN, F), 6, 9, 1),
    }),
    "rotate": (js.rotate, {
        "general": ((R, F), 18, 32), "about_z": ((R_Z, F), 8, 12), "plane": ((R_Z, F_PLANE), 4, 6),
        "pure_force": ((R, FORCE), 9, 15, 1), "identity": ((ONE, F), 0, 0),
    }),
    "compose": (composed, {
        "general": ((R, R), 27, 46), "about_z": ((R_Z, R_Z), 8, 12), "one_about_z": ((R, R_Z), 12, 18),
        "identity": ((R, ONE), 0, 0),
    }),
    "act": (js.act, {
        "general": ((X, F), 24, 44), "plane": ((X_PLANE, F_PLANE), 6, 10), "about_z": ((TURN, F), 8, 12),
        "translation": ((STEP, F), 6, 12), "pure_force": ((X, FORCE), 15, 24, 2), "identity": ((IDENTITY, F), 0, 0),
    }),
    "act_inverse": (js.act_inverse, {
        "general": ((X, V), 24, 44), "plane": ((X_PLANE, V_PLANE), 6, 11), "identity": ((IDENTITY, V), 0, 0),
    }),
    "act_acceleration": (js.act, {
        "general": ((X, A, W), 45, 80), "plane": ((X_PLANE, A_PLANE, NORMAL), 10, 19),
        "no_spin": ((X, A, ZERO), 24, 42, 2), "identity": ((IDENTITY, A, W), 0, 0),
    }),
    "apply_to_acceleration": (_applied, {
        "general": ((M, A), 24, 44), "point_mass": ((POINT_MASS, A), 15, 24, 2), "ball": ((BALL, A), 18, 30),
        "diagonal": ((BOX, A), 18, 30), "centred": ((CENTRED, A), 12, 18, 2), "centred_ball": ((CENTRED_BALL, A), 6, 6),
        "plane": ((M_PLANE, A_PLANE), 7, 12),
    }),
    "apply_to_velocity": (_applied, {
        "general": ((M, V), 24, 44), "point_mass": ((POINT_MASS, V), 15, 24, 2), "centred": ((CENTRED, V), 12, 18, 2),
        "centred_ball": ((CENTRED_BALL, V), 6, 6), "plane": ((M_PLANE, V_PLANE), 7, 12),
        "no_spin": ((M, NO_SPIN), 9, 12, 2),
    }),
    "kinetic_energy": (_energy, {
        "general": ((M, V), 23, 40), "point_mass": ((POINT_MASS, V), 11, 19), "ball": ((BALL, V), 17, 28),
        "diagonal": ((BOX, V), 17, 28), "centred": ((CENTRED, V), 17, 28), "centred_ball": ((CENTRED_BALL, V), 11, 16),
        "plane": ((M_PLANE, V_PLANE), 8, 13), "no_spin": ((M, NO_SPIN), 5, 7),
    }),
    "shift_inertia": (js.shift, {
        "general": ((M, P), 0, 1), "plane": ((M_PLANE, PLANE), 0, 2), "nowhere": ((M, ZERO), 0, 0),
    }),
    "rotate_inertia": (js.rotate, {
        "general": ((R, M), 54, 92), "point_mass": ((R, POINT_MASS), 9, 15, 1), "diagonal": ((R, BOX), 36, 54),
        "centred": ((R, CENTRED), 45, 75, 1), "centred_ball": ((R, CENTRED_BALL), 27, 39),
        "plane": ((R_Z, M_PLANE), 18, 27), "identity": ((ONE, M), 0, 0),
    }),
}  # fmt: skip


def _cases(operations, *left_out):
    return [
        pytest.param(SCENES[name][0], arguments, products, total, sum(tied), id=f"{name}-{of}")
        for name in operations
        for of, (arguments, products, total, *tied) in SCENES[name][1].items()
        if of not in left_out
    ]


CASES, KNOWN_CASES = _cases(SCENES), _cases(SCENES, "general")
# Of these no output shares anything with another, so that XLA has nothing to compute twice.
UNSHARED = _cases(("shift_force", "dot", "cross", "rotate", "compose"))
NOTHING = [case for case in KNOWN_CASES if case.values[3] == 0]


@pytest.mark.parametrize(("function", "arguments", "products", "total", "tied"), CASES)
def test_flops_asked_for(function, arguments, products, total, tied):
    counted = asked_for(functools.partial(function, precision="fast"), *arguments)
    assert (counted["multiply"], flops(counted)) == (products, total + tied)


@pytest.mark.parametrize(("function", "arguments", "products", "total", "tied"), KNOWN_CASES)
def test_every_product_left_has_its_fence_and_nothing_else(function, arguments, products, total, tied):
    counted = asked_for(functools.partial(function, precision="reproducible"), *arguments)
    # The half in kinetic energy is exact.
    fences = products - (function is _energy)
    assert (counted["multiply"], counted["select"], flops(counted)) == (products, fences + tied, total + tied)


@pytest.mark.parametrize(("function", "arguments", "products", "total", "tied"), UNSHARED)
def test_the_compiler_adds_nothing(function, arguments, products, total, tied):
    counted = compiled(functools.partial(function, precision="fast"), *arguments)
    assert counted["multiply"] == products and total <= flops(counted) <= total + tied


@pytest.mark.parametrize("precision", [slow("fast"), "reproducible", "compensated", slow("faithful")])
@pytest.mark.parametrize(("function", "arguments", "products", "total", "tied"), NOTHING)
def test_what_vanishes_leaves_nothing(function, arguments, products, total, tied, precision):
    assert asked_for(functools.partial(function, precision=precision), *arguments) == {}
    assert compiled(functools.partial(function, precision=precision), *arguments) == {}


# Multiplied out: what a factor known to be 0 takes with it, of the products of the general case.
MULTIPLIED_OUT = {
    "shift_force": {"general": 6, "plane": 2, "pure_couple": 0},
    "shift_acceleration": {"general": 30, "plane": 6, "no_spin": 6},
    "dot": {"general": 6, "plane": 3},
    "cross": {"general": 18, "plane": 4},
    "act": {"general": 54, "plane": 12, "identity": 0},
    "kinetic_energy": {"general": 109, "plane": 27, "centred_ball": 13},
}


@pytest.mark.parametrize("operation", MULTIPLIED_OUT)
def test_products_of_whole_sums(operation):
    function, scenes = SCENES[operation]
    for of, expected in MULTIPLIED_OUT[operation].items():
        counted = asked_for(functools.partial(function, precision="compensated"), *scenes[of][0])
        assert counted["multiply"] == expected, of


def test_inertias_that_are_added_share_a_centre_of_mass():
    """What is left of the sum of two bodies are seven additions, and of two balls four."""
    counted = {
        name: asked_for(lambda M, M2: M + M2, M, M)
        for name, M in {"general": M, "point_mass": POINT_MASS, "centred": CENTRED, "ball": CENTRED_BALL}.items()
    }
    assert {name: (c["multiply"], flops(c)) for name, c in counted.items() if name != "general"} == {
        "point_mass": (15, 33), "centred": (0, 7), "ball": (0, 4)
    }  # fmt: skip
    assert flops(counted["general"]) > 44


# -- numbers known as NumPy arrays while tracing ----------------------------------------------------------------------


def test_numpy_numbers_fold_as_well():
    plane, zero = np.float32([2.0, 3.0, 0.0]), np.zeros(3, np.float32)
    F_fast = functools.partial(js.shift, precision="fast")
    assert flops(asked_for(lambda f, tau: F_fast(js.SpatialForce(tau, f), zero), P, W)) == 0
    assert asked_for(lambda f: F_fast(js.SpatialForce(zero, f), plane), P)["multiply"] == 4
    assert asked_for(lambda F: F_fast(F, plane), F_PLANE)["multiply"] == 2


def test_a_rotation_about_an_axis_is_known_off_its_plane():
    """Made of sine and cosine: turned vectors take four products each in place of nine."""
    R_z = js.Rotation.about_z(jnp.float32(0.3)).entries
    structured = js.Rotation(js.Components.from_array(R_z, (None, None, 0.0, None, None, 0.0, 0.0, 0.0, 1.0)))
    np.testing.assert_array_equal(structured.entries.to_array(), R_z)
    assert asked_for(functools.partial(js.rotate, precision="fast"), structured, F)["multiply"] == 8


# -- a known zero is exact --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", list(js.Precision))
@pytest.mark.parametrize("bad", [np.inf, np.nan])
def test_what_is_multiplied_by_a_known_zero_does_not_count(bad, precision):
    x = jnp.float32(bad)
    lost, ill = jnp.full(3, x), js.SpatialVelocity(jnp.full(3, x), _vector())
    assert np.isfinite(js.dot(FORCE, ill, precision=precision))
    assert np.isfinite(js.dot(js.SpatialForce(lost, FORCE.f), NO_SPIN, precision=precision))
    for precise in (
        js.shift(COUPLE, lost, precision=precision),
        js.shift(V_PLANE, js.Components(x, x, x), precision=precision),
    ):
        assert np.isfinite(js.from_components(precise.rotational)).all()
    turned = js.rotate(R_Z, js.SpatialForce(js.Components(x, 1.0, 1.0), P), precision=precision).tau.to_array()
    np.testing.assert_array_equal(np.isfinite(turned), [False, False, True])
    tau = _applied(CENTRED, js.SpatialAcceleration(P, lost), precision).tau
    assert np.isfinite(js.from_components(tau)).all()
    spinning = js.SpatialVelocity(js.Components(0.0, 0.0, x), js.Components(1.0, 0.0, 0.0))
    on_the_axis = SpatialInertia(MASS, NORMAL, _known(0, 0, 0, 0, 0, 0))
    assert np.isfinite(_energy(on_the_axis, spinning, precision))

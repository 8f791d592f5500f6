"""Every operation keeps the error bound of its docstring, held against exact rationals.

Operations x precisions x dtypes x hostile inputs x surroundings: what else a program computes decides whether a
compiler breaks error-free transforms. The tolerance is the promise itself. Which of these run by default: see `cases`.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.measure import error
from jaxspatial.measure.inputs import FAMILIES
from tests.helpers import formulas, hostile
from tests.helpers.marks import slow, slow_but
from tests.helpers.operation import violations
from tests.helpers.operations import DTYPES, EXACT, of_sum
from tests.laws import cases
from tests.laws.surroundings import OF_ITEMS

precisions = pytest.mark.parametrize("precision", js.Precision)
# In float64 the shortest of error-free sums by default: `test_bound_of_the_docstring` has all of them there.
BOTH = list(itertools.product(["float32", "float64"], js.Precision))
usual = pytest.mark.parametrize(
    ("dtype", "precision"), slow_but([x for x in BOTH if x[0] == "float32" or x[1] == "compensated"], BOTH)
)


@cases.BOUNDS_OP_BY_OP.parametrize
def test_bound_of_the_docstring_op_by_op(name, dtype, precision):
    case = hostile.case_of_few(name, dtype)
    case.check(precision, case.operation.op_by_op(*case.arrays, precision=precision), "op by op")


@cases.BOUNDS_COMPILED.parametrize
def test_bound_of_the_docstring(name, dtype, precision):
    case = hostile.case(name, dtype)
    with jax.enable_x64(dtype == "float64"):
        arrays = [jnp.asarray(x) for x in case.arrays]
        for how in cases.bound_surroundings(name, dtype, precision):
            case.check(precision, OF_ITEMS[how](case.operation.on_arrays(precision))(*arrays), how)


@cases.BOUNDS_SURROUNDED.parametrize
def test_bound_of_the_docstring_in_all_surroundings(name, dtype, precision):
    case = hostile.case(name, dtype)
    with jax.enable_x64(dtype == "float64"):
        arrays = [jnp.asarray(x) for x in case.arrays]
        for how, surrounded in OF_ITEMS.items():
            case.check(precision, surrounded(case.operation.on_arrays(precision))(*arrays), how)


@usual
@pytest.mark.parametrize("name", ["shift_force", slow("shift_acceleration"), slow("cross_force")])
def test_a_result_used_alone(name, dtype, precision):
    case = hostile.case(name, dtype)
    parts = [part for part, bound in enumerate(case.operation.bounds) if bound != EXACT]
    with jax.enable_x64(dtype == "float64"):
        for part in parts:
            for how in hostile.SURROUNDINGS:
                alone = OF_ITEMS[how](lambda *a, part=part: [case.operation.on_arrays(precision)(*a)[part]])
                case.check(precision, alone(*map(jnp.asarray, case.arrays)), how, [part])


@usual
def test_several_results_of_one_program(dtype, precision):
    """Moved there and on, and two powers: each keeps its own bound, whatever the compiler shares between them."""
    shift, power = (hostile.case(name, dtype) for name in ("shift_force", "dot_force_velocity"))
    n = min(len(shift.arrays[0]), len(power.arrays[0]))
    tau, f, p = (x[:n] for x in shift.arrays)
    t, g, w, v = (x[:n] for x in power.arrays)

    def program(tau, f, p, t, g, w, v):
        F, G, V = js.SpatialForce(tau, f), js.SpatialForce(t, g), js.SpatialVelocity(w, v)
        moved = js.shift(F, p, precision=precision)
        on, back = js.shift(moved, -p, precision=precision), js.shift(G, p, precision=precision)
        return moved.tau, on.tau, back.tau, js.dot(G, V, precision=precision), js.dot(V, moved, precision=precision)

    with jax.enable_x64(dtype == "float64"):
        moved, on, back, watts, others = map(np.asarray, jax.jit(jax.vmap(program))(tau, f, p, t, g, w, v))
    hostile.made("shift_force", [tau, f, p]).check(precision, [moved], "moved", [0])
    hostile.made("shift_force", [moved, f, -p]).check(precision, [on], "moved on", [0])
    hostile.made("shift_force", [t, g, p]).check(precision, [back], "beside", [0])
    hostile.made("dot_force_velocity", [t, g, w, v]).check(precision, [watts], "power")
    hostile.made("dot_force_velocity", [moved, f, w, v]).check(precision, [others], "power of what was moved")


CONSTANTS = {
    "an array": jnp.asarray,
    "a NumPy array": lambda x: x,
    "a NumPy array, one and zero among its components": lambda x: (
        np.where([True, False, False], x, x.dtype.type(1)) * np.asarray([1, 1, 0], x.dtype)
    ),
}


@pytest.mark.parametrize("how", slow_but(list(CONSTANTS)[1:], CONSTANTS))
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
@pytest.mark.parametrize(
    ("name", "precision"),
    [
        slow("shift_force", "compensated"),
        ("shift_force", "faithful"),
        ("dot_force_velocity", "compensated"),
        slow("dot_force_velocity", "faithful"),
    ],
)
def test_operands_that_are_constants_of_the_program(name, dtype, precision, how):
    """Each in turn, and all but each."""
    whole = hostile.case(name, dtype)
    with jax.enable_x64(dtype == "float64"):
        for i in range(len(whole.arrays)):
            _check_constants(whole, precision, CONSTANTS[how], {i})
            _check_constants(whole, precision, CONSTANTS[how], {*range(len(whole.arrays))} - {i})


def _check_constants(whole, precision, constant, places):
    arrays = [constant(x[::5]) if j in places else x[::5] for j, x in enumerate(whole.arrays)]
    function = whole.operation.on_arrays(precision)

    @jax.jit
    def program(*data):
        others = iter(data)
        return function(*(x if j in places else next(others) for j, x in enumerate(arrays)))

    results = program(*(jnp.asarray(x) for j, x in enumerate(arrays) if j not in places))
    hostile.made(whole.operation.name, [np.asarray(x) for x in arrays]).check(precision, results, places)


@usual
@pytest.mark.parametrize(
    "name", ["shift_force", slow("shift_velocity"), slow("dot_force_velocity"), slow("from_origin")]
)
def test_bound_when_all_terms_cancel(name, precision, dtype):
    """The torque is fl(p x f), the velocity orthogonal to fl, the inertia fl(that of a point): what is left is rounding
    errors only. Op by op `test_bound_of_the_docstring_op_by_op` has such inputs of all operations."""
    rng = np.random.default_rng(3)
    x, y, z = (rng.standard_normal((200, 3)).astype(dtype) for _ in range(3))
    squares = [(a * a).sum(-1, keepdims=True) for a in (x, y)]
    arrays = {
        "shift_force": [np.cross(z, y), y, z],
        "shift_velocity": [x, -np.cross(x, z), z],
        "dot_force_velocity": [x, y, x / 2, -y / 2 * squares[0] / squares[1]],
        "from_origin": [abs(x[:, 0]), y, formulas.steiner(abs(x[:, 0]), y)],
    }[name]
    case = hostile.made(name, arrays)
    with jax.enable_x64(dtype == "float64"):
        case.check(precision, jax.jit(jax.vmap(case.operation.on_arrays(precision)))(*arrays), "cancelling")


@precisions
@pytest.mark.parametrize("dtype", slow_but(["float32"], DTYPES))
@pytest.mark.parametrize("n", [1, 7, slow(64)])
def test_wrench_from_point_forces(n, dtype, precision):
    rng = np.random.default_rng(n)
    groups = [rng.standard_normal((2, 3, n, 3)).astype(jnp.dtype(dtype))]
    if n > 1 and dtype != "float16":  # whose range is too small for condition numbers of many products
        groups += [hostile.wrench(rng, 3, jnp.dtype(dtype), condition, n) for condition in hostile.conditions(dtype)]
    points, forces = (np.concatenate(x) for x in zip(*groups, strict=True))
    p, f = map(error.sized, (points, forces))
    expected = np.cross(p, f).sum(-2), f.sum(-2)
    with jax.enable_x64(dtype == "float64"):
        # All of one as it is; the compiler has more to add up of more.
        context = (lambda g: g) if n == 1 else lambda g: jax.jit(jax.vmap(g))
        F = context(lambda p, f: js.wrench_from_point_forces(p, f, precision=precision))(points, forces)
        for computed, exactly in zip((F.tau, F.f), expected, strict=True):
            assert not violations(of_sum(n, js.wrench_from_point_forces), precision, computed, exactly).any()


@pytest.mark.parametrize("dtype", DTYPES)
def test_scaling_rounds_once(dtype):
    x, y, s = FAMILIES["benign"](np.random.default_rng(5), 3, 50, jnp.dtype(dtype))
    factors = s[:, 0]
    with jax.enable_x64(dtype == "float64"):
        F = js.SpatialForce(x, y)
        for scaled, exactly in ((F * factors, error.rationals(x) * error.rationals(factors)[:, None]),
                                (F / factors, error.rationals(x) / error.rationals(factors)[:, None])):  # fmt: skip
            assert error.in_u_of(scaled.tau, exactly, abs(exactly)).max() <= 1

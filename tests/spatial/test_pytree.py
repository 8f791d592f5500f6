"""The four spatial vectors are ordinary JAX pytrees, and programs of them hold nothing that was not asked for.

They survive every rebuild JAX does, copies and pickles, cannot be changed, trace once, give their memory up when
donated, and are split over devices without communication. What is known while tracing leaves no arithmetic behind.
"""

import copy
import dataclasses
import json
import pickle
import re
import sys
import traceback

import chex
import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.sharding import AxisType, NamedSharding
from jax.sharding import PartitionSpec as P

import jaxspatial as js
from tests.helpers.marks import slow_but
from tests.helpers.operations import NAIVE, OPERATIONS
from tests.helpers.processes import python

KINDS = [js.SpatialForce, js.SpatialMomentum, js.SpatialVelocity, js.SpatialAcceleration]
# All kinds are made of one class; that of accelerations takes one argument more.
FEW_KINDS = [js.SpatialForce, js.SpatialAcceleration]
kinds = pytest.mark.parametrize("kind", slow_but(FEW_KINDS, KINDS))
on_host_and_device = pytest.mark.parametrize("array", [np.asarray, jnp.asarray], ids=["numpy", "jax"])


# -- trees ------------------------------------------------------------------------------------------------------------

FUNCTIONS = {
    "shape": lambda leaf: leaf.shape,
    "sum": jnp.sum,
    "none": lambda leaf: None,
    "string": lambda leaf: str(leaf.dtype),
    "object": lambda leaf: _MARK,
    "description": lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype),
    "negative": lambda leaf: -leaf,
}
_MARK = object()


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
@kinds
def test_tree_map_keeps_the_kind_whatever_the_leaves_become(kind, function):
    x = _vector(kind, (2,))
    mapped = jax.tree.map(function, x)
    assert type(mapped) is kind
    for name, leaf in zip(_names(kind), jax.tree.leaves(x), strict=True):
        assert str(getattr(mapped, name)) == str(function(leaf))


@pytest.mark.parametrize(
    "leaf",
    [object(), None, "text", 3, (1, 2), jax.ShapeDtypeStruct((3,), jnp.float32)],
    ids=["object", "None", "text", "3", "tuple", "shape"],
)
@kinds
def test_rebuilt_of_any_leaves_without_complaint(kind, leaf):
    x = jax.tree.unflatten(jax.tree.structure(_vector(kind)), [leaf, leaf])
    assert type(x) is kind
    assert all(getattr(x, name) is leaf for name in _names(kind))
    assert kind.__name__ in repr(x)


@kinds
def test_flattened_to_its_two_named_parts(kind):
    x = _vector(kind)
    paths, _ = jax.tree_util.tree_flatten_with_path(x)
    assert [jax.tree_util.keystr(path) for path, _ in paths] == [f".{name}" for name in _names(kind)]
    assert [leaf for _, leaf in paths] == [x.rotational, x.translational]


def test_kinds_are_different_trees():
    assert len({jax.tree.structure(_vector(kind)) for kind in KINDS}) == len(KINDS)


@kinds
def test_stacks_and_unstacks(kind):
    vectors = [_vector(kind, start=i) for i in range(3)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *vectors)
    assert type(stacked) is kind and stacked.batch_shape == (3,)
    for i, x in enumerate(vectors):
        _assert_equal(jax.tree.map(lambda leaf, i=i: leaf[i], stacked), x)


@kinds
def test_described_without_being_computed(kind):
    described = jax.eval_shape(lambda x, y: x + y * 2.0, _vector(kind, (4,)), _vector(kind))
    assert type(described) is kind
    assert jax.tree.leaves(described) == [jax.ShapeDtypeStruct((4, 3), jnp.float32)] * 2
    assert described.batch_shape == (4,) and described.dtype == jnp.float32


@kinds
def test_made_of_descriptions(kind):
    described = kind(*[jax.ShapeDtypeStruct((4, 3), jnp.float32)] * 2)
    assert jax.eval_shape(lambda x: -x, described).batch_shape == (4,)


# -- axes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tau_axis", "f_axis"), [(0, None), (None, 0), (0, 0), (1, 0)])
def test_each_part_of_an_argument_has_its_own_axis(tau_axis, f_axis):
    tau, f = (jnp.asarray(leaf) for leaf in _arrays(_vector(js.SpatialForce, (3,))))
    given = _unchecked(js.SpatialForce, _along(tau_axis, tau), _along(f_axis, f))
    result = jax.vmap(js.shift, in_axes=(js.SpatialForce(tau_axis, f_axis), None))(given, jnp.ones(3))
    for i in range(3):
        F = js.SpatialForce(tau[i * (tau_axis is not None)], f[i * (f_axis is not None)])
        _assert_equal(_item(result, i), js.shift(F, jnp.ones(3)))


@pytest.mark.parametrize(("F_axis", "p_axis"), [(0, None), (None, 0), (0, 0), (0, 1)])
def test_shift_over_axes_of_wrench_and_offset(F_axis, p_axis):
    F, p = _vector(js.SpatialForce, (3,)), jnp.cos(jnp.arange(9.0).reshape(3, 3))
    F_given = F if F_axis == 0 else _item(F, 0)
    result = jax.vmap(js.shift, in_axes=(F_axis, p_axis))(F_given, _along(p_axis, p))
    for i in range(3):
        F_i, p_i = _item(F, i * (F_axis is not None)), p[i * (p_axis is not None)]
        _assert_equal(_item(result, i), js.shift(F_i, p_i))


@pytest.mark.parametrize(
    ("axes", "shapes"),
    [
        (0, [(4, 3), (4, 3)]),
        (1, [(3, 4), (3, 4)]),
        (js.SpatialForce(0, None), [(4, 3), (3,)]),
        (js.SpatialForce(1, None), [(3, 4), (3,)]),
        (js.SpatialForce(1, 0), [(3, 4), (4, 3)]),
    ],
    ids=str,
)
def test_each_part_of_a_result_has_its_own_axis(axes, shapes):
    given = _unchecked(js.SpatialForce, jnp.arange(12.0).reshape(4, 3), jnp.ones(3))
    result = jax.vmap(lambda F: F * 2, in_axes=(js.SpatialForce(0, None),), out_axes=axes)(given)
    assert [leaf.shape for leaf in jax.tree.leaves(result)] == shapes


# -- copies -----------------------------------------------------------------------------------------------------------

COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "replace": dataclasses.replace,
    "tree": lambda x: jax.tree.unflatten(*reversed(jax.tree.flatten(x))),
}


@pytest.mark.parametrize("duplicate", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("dtype", ["bfloat16", "float32"])
@on_host_and_device
@kinds
def test_a_copy_is_equal(kind, array, dtype, duplicate):
    x = jax.tree.map(array, _vector(kind, (2,), dtype=dtype))
    twin = duplicate(x)
    assert twin is not x
    _assert_equal(twin, x)


@kinds
def test_replace_changes_one_part_and_checks_it(kind):
    x = _vector(kind)
    first, second = _names(kind)
    changed = dataclasses.replace(x, **{first: np.zeros(3, np.float32)})
    _assert_equal(changed, kind(np.zeros(3, np.float32), getattr(x, second)))
    with pytest.raises(ValueError, match=rf"{kind.__name__}: {second}: expected shape \(\*batch, 3\), got \(2,\)"):
        dataclasses.replace(x, **{second: np.zeros(2, np.float32)})


@kinds
def test_parts_cannot_be_set_nor_deleted(kind):
    x = _vector(kind)
    for name in _names(kind):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(x, name, jnp.zeros(3))
        with pytest.raises(dataclasses.FrozenInstanceError):
            delattr(x, name)


@kinds
def test_the_callers_array_stays_the_callers(kind):
    own = np.ones(3, np.float32)
    x = kind(own, own)
    own[:] = 7.0
    _assert_equal(x, kind(*[np.ones(3, np.float32)] * 2))
    with pytest.raises(ValueError, match="read-only"):
        x.rotational[0] = 7.0


# -- loops ------------------------------------------------------------------------------------------------------------

LOOPS = {
    "scan": lambda step, x: lax.scan(lambda carry, _: (step(carry), None), x, length=3)[0],
    "fori_loop": lambda step, x: lax.fori_loop(0, 3, lambda _, carry: step(carry), x),
    "while_loop": lambda step, x: lax.while_loop(lambda c: c[0] < 3, lambda c: (c[0] + 1, step(c[1])), (0, x))[1],
}


@pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS)
@on_host_and_device
@kinds
def test_carried_through_a_loop(kind, array, loop):
    x = jax.tree.map(array, _vector(kind))
    offsets = _offsets(kind)

    def step(X):
        return js.shift(X, *offsets) * 0.5 - X / 4

    _assert_equal(loop(step, x), step(step(step(x))))


# -- memory and traces ------------------------------------------------------------------------------------------------


@kinds
def test_a_donated_vector_is_shifted_in_place(kind):
    x, offsets = jax.tree.map(jnp.array, _vector(kind, (256,))), _offsets(kind)
    expected = js.shift(x, *offsets)
    before = [leaf.unsafe_buffer_pointer() for leaf in jax.tree.leaves(x)]
    result = jax.jit(js.shift, donate_argnums=0)(x, *offsets)
    assert [leaf.unsafe_buffer_pointer() for leaf in jax.tree.leaves(result)] == before
    assert all(leaf.is_deleted() for leaf in jax.tree.leaves(x))
    _assert_equal(result, expected)


@kinds
def test_one_trace_for_lists_numpy_and_jax(kind, x64):
    function = jax.jit(chex.assert_max_traces(lambda x: x * 2.0, n=1))
    numbers = [1.0, 2.0, 3.0]
    dtype = np.float64 if x64 else np.float32
    weak = jnp.broadcast_to(1.0, (3,))
    assert weak.weak_type
    for part in (numbers, tuple(numbers), np.array(numbers), np.array(numbers, dtype), jnp.array(numbers), weak):
        assert function(kind(part, part)).dtype == dtype


@pytest.mark.parametrize(("dtype", "x64"), [("float32", False), ("float32", True), ("float64", True)])
def test_one_trace_after_any_scalar(dtype, x64):
    function = jax.jit(chex.assert_max_traces(lambda x: -x, n=1))
    with jax.enable_x64(x64):
        F, two = _vector(js.SpatialForce, dtype=dtype), np.dtype(dtype).type(2)
        for scalar in (2, 2.0, two, np.asarray(two), jnp.asarray(two)):
            assert function(F * scalar).dtype == dtype
            assert function(F / scalar).dtype == dtype
        function(F)


def test_one_trace_for_offsets_of_lists_numpy_and_jax(x64):
    function = jax.jit(chex.assert_max_traces(lambda x: -x, n=1))
    F = _vector(js.SpatialForce)
    for offset in ([1.0, 2.0, 3.0], np.ones(3, np.float32), jnp.ones(3, jnp.float32)):
        assert function(js.shift(F, offset)).dtype == np.float32


SCALARS = {
    "int": lambda: 3,
    "float": lambda: 3.0,
    "numpy": lambda: np.float32(3),
    "numpy_array": lambda: np.float32([3, 4]),
    "jax": lambda: jnp.float32(3),
    "jax_array": lambda: jnp.asarray([3.0, 4.0], jnp.float32),
}


@pytest.mark.parametrize("make", SCALARS.values(), ids=SCALARS)
@kinds
def test_a_scalar_multiplies_from_either_side(kind, make, x64):
    x, scalar = _vector(kind, (2,)), make()
    expected = kind(*(leaf * np.float32(scalar).reshape(-1, 1) for leaf in _arrays(x)))
    _assert_equal(x * scalar, expected)
    _assert_equal(scalar * x, expected)


@kinds
def test_a_tracer_multiplies_from_either_side(kind):
    x = _vector(kind)
    left, right = jax.jit(lambda s: (s * x, x * s))(jnp.float32(3))
    _assert_equal(left, x * 3)
    _assert_equal(right, x * 3)


@kinds
def test_a_batch_along_the_last_axis(kind):
    """(3, n) leaves are built by vmap, which shows the constructor one item at a time."""
    x, offsets = _vector(kind, (4,)), _offsets(kind)
    last = jax.vmap(kind, in_axes=-1, out_axes=-1)(*(jnp.asarray(part).T for part in jax.tree.leaves(x)))
    assert [leaf.shape for leaf in jax.tree.leaves(last)] == [(3, 4), (3, 4)]
    shifted = jax.vmap(js.shift, in_axes=(-1, *(None for _ in offsets)), out_axes=-1)(last, *offsets)
    _assert_equal(jax.tree.map(jnp.transpose, shifted), js.shift(x, *offsets))


@kinds
def test_exported_and_called(kind):
    x, offsets = _vector(kind, (2,)), _offsets(kind)
    _assert_equal(jax.export.export(jax.jit(js.shift))(x, *offsets).call(x, *offsets), js.shift(x, *offsets))


@kinds
def test_exported_to_bytes_and_called_again(kind):
    x, offsets = _vector(kind, (2,)), _offsets(kind)
    blob = jax.export.export(jax.jit(js.shift))(x, *offsets).serialize()
    _assert_equal(jax.export.deserialize(blob).call(x, *offsets), js.shift(x, *offsets))


# -- programs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("transform", [lambda f: f, jax.vmap], ids=["broadcasting", "vmap"])
@pytest.mark.parametrize("name", NAIVE)
def test_program_has_no_library_call_no_gather_and_nothing_wider(name, transform):
    with jax.enable_x64(True):
        inputs = jax.tree.map(jnp.asarray, OPERATIONS[name].inputs((2,), "float32"))
        text = jax.jit(transform(OPERATIONS[name].function)).lower(*inputs).as_text()
    assert "f32" in text
    assert re.findall("dot_general|gather|f64", text) == []


ARITHMETIC = {"add", "sub", "mul", "div", "neg"}
ARITHMETIC |= {f"jaxspatial_{name}" for name in ("sum", "difference", "product", "quotient")}


@kinds
def test_no_offset_is_no_arithmetic(kind):
    w = _offsets(kind)[1:]
    assert ARITHMETIC.isdisjoint(_operations(lambda x: js.shift(x, np.zeros(3, np.float32), *w), _vector(kind)))


@kinds
def test_a_known_zero_adds_nothing(kind):
    for function in (lambda x: kind.zero() + x, lambda x: x + kind.zero(), lambda x: x - kind.zero((2,))):
        assert _operations(function, _vector(kind, (2,))) == []
    assert _operations(lambda x: kind.zero() - x, _vector(kind)) == ["neg", "neg"]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("kind", KINDS[:3])
def test_an_offset_along_an_axis_takes_four_flops(kind, axis):
    offset = np.zeros(3, np.float32)
    offset[axis] = 2.0
    operations = _operations(lambda x: js.shift(x, offset), _vector(kind))
    assert len([name for name in operations if name in ARITHMETIC - {"neg"}]) == 4


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize(("offset", "expected"), [([0, 0, 2], [7, 2, 5]), ([0, 0, 0], [3, 4, 5])], ids=str)
@pytest.mark.parametrize("kind", KINDS[:3])
def test_a_zero_next_to_no_number_is_a_zero_if_known(kind, offset, expected, bad):
    turned, moved = _names(kind) if kind is js.SpatialVelocity else reversed(_names(kind))
    x = kind(**{turned: np.asarray([1, 2, bad], np.float32), moved: np.asarray([3, 4, 5], np.float32)})
    p = np.asarray(offset, np.float32)
    known = getattr(jax.jit(lambda x: js.shift(x, p))(x), moved)
    data = getattr(jax.jit(js.shift)(x, p), moved)
    np.testing.assert_array_equal(known, np.asarray(expected, np.float32), strict=True)
    np.testing.assert_array_equal(np.isnan(data), [True, True, False])


# -- devices ----------------------------------------------------------------------------------------------------------

COLLECTIVES = "all-reduce|all-gather|all-to-all|reduce-scatter|collective"
LAWS = [
    f"{axis_type.name}-{offset}-{how}-{precision}"
    for axis_type in (AxisType.Auto, AxisType.Explicit)
    for offset in ("shared", "own")
    for how in ("broadcasting", "vmap", "shard_map")
    for precision in ("reproducible", "compensated")
]


# A quarter of them, in which every two of axis type, offset, way and precision meet.
BY_DEFAULT = [
    "Auto-shared-broadcasting-reproducible",
    "Explicit-own-broadcasting-compensated",
    "Auto-own-vmap-compensated",
    "Explicit-shared-vmap-reproducible",
    "Auto-own-shard_map-reproducible",
    "Explicit-shared-shard_map-compensated",
]


@pytest.fixture(scope="module")
def four_devices(request):
    """What came of the selected laws in a process with four devices: empty, or a traceback."""
    laws = [item.callspec.params["law"] for item in request.session.items if "four_devices" in item.fixturenames]
    return json.loads(python(__file__, *laws, n_devices=4).stdout)


@pytest.mark.parametrize("law", slow_but(BY_DEFAULT, LAWS))
def test_sharded_over_devices_without_communication(four_devices, law):
    assert four_devices[law] == ""


def test_a_mesh_that_only_an_argument_has():
    """Explicit axes, and no mesh in the context: the offset, which is of no mesh, is split as the wrenches are."""
    mesh = jax.make_mesh((1,), ("batch",), axis_types=(AxisType.Explicit,))
    F, _, p = _data("shared")
    result = jax.jit(js.shift)(jax.device_put(F, NamedSharding(mesh, P("batch"))), p)
    assert all(leaf.sharding.spec[0] == "batch" for leaf in jax.tree.leaves(result))
    _assert_equal(result, js.shift(F, p))


def _check_law(axis_type, offset, how):
    """Shift and power are split over the batch, bitwise those of one device; gradients too."""
    mesh = jax.make_mesh((4,), ("batch",), axis_types=(AxisType[axis_type],))
    split, spec = P("batch"), {"shared": P(), "own": P("batch")}[offset]
    F, V, p = _data(offset)
    shift, dot = (_over_the_batch(function, how, mesh, in_specs) for function, in_specs in _functions(split, spec))
    with jax.set_mesh(mesh):
        F_, V_, p_ = (_put(x, mesh, s) for x, s in ((F, split), (V, split), (p, spec)))
        for function, args, expected in ((shift, (F_, p_), js.shift(F, p)), (dot, (F_, V_), js.dot(F, V))):
            compiled = jax.jit(function).lower(*args).compile()
            assert re.findall(COLLECTIVES, compiled.as_text()) == []
            result = compiled(*args)
            assert all(leaf.sharding.spec[0] == "batch" for leaf in jax.tree.leaves(result))
            _assert_equal(result, expected)
        _assert_equal(jax.jit(lambda F: F.sum())(F_), F.sum())  # gathered before
        gradient = jax.jit(_gradient(shift, dot)).lower(F_, V_, p_).compile()
        assert offset == "shared" or re.findall(COLLECTIVES, gradient.as_text()) == []
        of_F, of_V, of_p = gradient(F_, V_, p_)
    each = _gradient(js.shift, js.dot)(F, V, jnp.broadcast_to(p, (8, 3)))
    _assert_equal((of_F, of_V), each[:2])
    if offset == "own":
        _assert_equal(of_p, each[2])
    else:
        bound = 8 * np.finfo(np.float32).eps / 2 * abs(np.asarray(each[2], np.float64)).sum(0)
        assert (abs(np.asarray(of_p, np.float64) - np.asarray(each[2], np.float64).sum(0)) <= bound).all()


def _data(offset):
    rng = np.random.default_rng(0)
    tau, f, w, v, own = (jnp.asarray(x, jnp.float32) for x in rng.standard_normal((5, 8, 3)))
    return js.SpatialForce(tau, f), js.SpatialVelocity(w, v), own if offset == "own" else own[0]


def _functions(split, spec):
    return (js.shift, (split, spec)), (js.dot, (split, split))


def _over_the_batch(function, how, mesh, in_specs):
    if how == "shard_map":
        return jax.shard_map(function, mesh=mesh, in_specs=in_specs, out_specs=P("batch"))
    return jax.vmap(function, tuple(0 if spec else None for spec in in_specs)) if how == "vmap" else function


def _put(tree, mesh, spec):
    return jax.device_put(tree, NamedSharding(mesh, spec))


def _gradient(shift, dot):
    return jax.grad(lambda F, V, p: jnp.sum(dot(shift(F, p), V) ** 2), (0, 1, 2))


def _outcome(law):
    try:
        *where, precision = law.split("-")
        with js.default_precision(precision):
            _check_law(*where)
    except Exception:
        return traceback.format_exc()
    return ""


# -- helpers ----------------------------------------------------------------------------------------------------------


def _vector(kind, batch_shape=(), start=0, dtype="float32"):
    """Six different numbers per item, none of them zero."""
    numbers = np.sin(1.0 + start + np.arange(6 * np.prod(batch_shape, dtype=int))).reshape(2, *batch_shape, 3)
    return kind(*(jnp.asarray(part.astype(jnp.dtype(dtype))) for part in numbers))


def _offsets(kind):
    """What `shift` takes beside a vector of this kind."""
    p, w = jnp.asarray([0.5, 0.25, -1.0], jnp.float32), jnp.asarray([2.0, -0.5, 1.0], jnp.float32)
    return (p, w) if kind is js.SpatialAcceleration else (p,)


def _names(kind):
    return [field.name for field in dataclasses.fields(kind)]


def _unchecked(kind, *leaves):
    return jax.tree.unflatten(jax.tree.structure(_vector(kind)), leaves)


def _item(x, i):
    return jax.tree.map(lambda leaf: leaf[i], x)


def _along(axis, x):
    """x with its batch along that axis, or its first item for None."""
    return x[0] if axis is None else jnp.moveaxis(x, 0, axis)


def _arrays(x):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(x)]


def _assert_equal(x, y):
    """Of one kind, shape and dtype, and bitwise equal."""
    assert jax.tree.structure(x) == jax.tree.structure(y)
    for a, b in zip(_arrays(x), _arrays(y), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        assert a.tobytes() == b.tobytes(), (a, b)


def _operations(function, *args):
    """The names of all primitives in the program of a function."""
    return list(_primitives(jax.make_jaxpr(function)(*args).jaxpr))


def _primitives(jaxpr):
    for equation in jaxpr.eqns:
        inner = [x.jaxpr for x in equation.params.values() if hasattr(x, "jaxpr")]
        yield from [equation.primitive.name] if not inner else (name for j in inner for name in _primitives(j))


if __name__ == "__main__":
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")
    print(json.dumps({law: _outcome(law) for law in sys.argv[1:]}))

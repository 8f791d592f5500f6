"""Arrays taken apart and put together: the same numbers as slices and stacks, under every transformation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.numerics.numbers import layout
from tests.helpers.interpreted import interpreted

# Small integers: whatever is contracted, results are exact.
X = np.random.default_rng(0).integers(-9, 9, (4, 5, 3)).astype(np.float32)


def mixed(x):
    a, b, c = layout.unstack(x)
    return a * b + c


def plainly_mixed(x):
    return x[..., 0] * x[..., 1] + x[..., 2]


def turned(x):
    a, b, c = layout.unstack(x)
    return layout.stacked([b * c, c, 2 * a], x.ndim - 1)


def plainly_turned(x):
    return jnp.stack([x[..., 1] * x[..., 2], x[..., 2], 2 * x[..., 0]], -1)


def middle(x):
    return layout.unstack(x)[1]


def plainly_middle(x):
    return x[..., 1]


def _total(function):
    return lambda x: function(x).sum()


TRANSFORMATIONS = {
    "value": lambda f: f,
    "vmap": jax.vmap,
    "vmap of vmap": lambda f: jax.vmap(jax.vmap(f)),
    "vmap of a later axis": lambda f: jax.vmap(f, in_axes=1, out_axes=1),
    "jvp": lambda f: lambda x: jax.jvp(f, (x,), (x,)),
    "grad": lambda f: jax.grad(_total(f)),
    "vmap of grad": lambda f: jax.vmap(jax.grad(_total(f))),
    "vmap of vmap of grad": lambda f: jax.vmap(jax.vmap(jax.grad(_total(f)))),
    "vmap of grad, a later axis": lambda f: jax.vmap(jax.grad(_total(f)), in_axes=1, out_axes=2),
    "vmap of hessian": lambda f: jax.vmap(jax.hessian(_total(f))),
    "gradient of gradient": lambda f: jax.grad(lambda x: (jax.grad(_total(f))(x) ** 2).sum()),
    "one item for many": lambda f: lambda x: jax.vmap(jax.grad(lambda y, z: _total(f)(y * z)), (None, 0))(x[0], x),
}
OP_BY_OP = ("value", "vmap", "grad", "vmap of grad")


@pytest.mark.parametrize("name", TRANSFORMATIONS)
@pytest.mark.parametrize(
    "pair", [(mixed, plainly_mixed), (turned, plainly_turned), (middle, plainly_middle)], ids=lambda p: p[0].__name__
)
def test_as_slices_and_stacks(pair, name):
    """Compiled, and a few outside of a program, op by op."""
    transformed, plain = (TRANSFORMATIONS[name](f) for f in pair)
    expected = jax.tree.leaves(interpreted(plain)(X))
    for run in (jax.jit(transformed), transformed) if name in OP_BY_OP else (jax.jit(transformed),):
        for x, y in zip(jax.tree.leaves(run(X)), expected, strict=True):
            assert x.shape == y.shape
            np.testing.assert_array_equal(np.asarray(x), np.asarray(y))


def test_lanes_of_which_some_have_the_batch():
    found = jax.vmap(lambda a, b: layout.stacked([a, b], 0), (0, None))(jnp.arange(3.0), jnp.float32(7))
    np.testing.assert_array_equal(found, [[0, 7], [1, 7], [2, 7]])


@pytest.mark.parametrize("is_checked", [True, False])
def test_in_parts_on_several_devices(is_checked):
    mesh = jax.make_mesh((1,), ("i",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec("i")
    gradient = jax.grad(_total(mixed))
    parted = jax.shard_map(gradient, mesh=mesh, in_specs=spec, out_specs=spec, check_vma=is_checked)
    np.testing.assert_array_equal(jax.jit(parted)(X), gradient(X))


def test_explicit_shardings_are_kept():
    mesh = jax.make_mesh((1,), ("i",), axis_types=(jax.sharding.AxisType.Explicit,))
    with jax.set_mesh(mesh):
        x = jax.device_put(X, jax.NamedSharding(mesh, jax.sharding.PartitionSpec("i")))
        found = jax.jit(jax.grad(_total(mixed)))(x)
        assert jax.typeof(found).sharding.spec[0] == "i"
        lanes = layout.unstack(x)
        assert jax.typeof(layout.stacked([lanes[0], jnp.ones((4, 5), np.float32)], 1)).shape == (4, 2, 5)
    np.testing.assert_array_equal(found, jax.grad(_total(plainly_mixed))(X))


def test_the_gradient_of_slices_is_picked():
    """No array of zeros but for one lane, and no concatenation."""
    text = jax.jit(jax.grad(_total(mixed))).lower(X).as_text()
    assert "stablehlo.select" in text and "stablehlo.pad" not in text and "stablehlo.concatenate" not in text

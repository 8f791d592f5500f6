"""Types that JAX knows as trees of arrays."""

import dataclasses
import typing

import jax
import jax.export


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree(cls):
    """Class decorator: a frozen dataclass, known to JAX as a pytree, that can be exported.

    JAX rebuilds it with whatever leaves it needs, without the checks that `__post_init__` makes of a caller's.
    """
    cls = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    names = [field.name for field in dataclasses.fields(cls)]
    keys = list(map(jax.tree_util.GetAttrKey, names))
    jax.tree_util.register_pytree_with_keys(
        cls,
        lambda x: (tuple((key, getattr(x, name)) for key, name in zip(keys, names, strict=True)), None),
        lambda _, leaves: rebuilt(cls, names, leaves),
        lambda x: (tuple(getattr(x, name) for name in names), None),
    )
    jax.export.register_pytree_node_serialization(
        cls,
        serialized_name=f"jaxspatial.{cls.__name__}",
        serialize_auxdata=lambda _: b"",
        deserialize_auxdata=lambda _: None,
    )
    return cls


def rebuilt(cls, names, parts):
    """An object of these parts, unchecked."""
    x = object.__new__(cls)
    for name, part in zip(names, parts, strict=True):
        object.__setattr__(x, name, part)
    return x

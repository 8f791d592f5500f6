"""Types that JAX knows as trees of arrays."""

import dataclasses
import typing
from collections.abc import Iterable
from typing import Any

import jax
import jax.export

from jaxspatial.arithmetic.check import TUPLE

_Class = typing.TypeVar("_Class")


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree(cls: type[_Class]) -> type[_Class]:
    """Class decorator: a frozen dataclass, known to JAX as a pytree, that can be exported.

    JAX rebuilds it with whatever leaves it needs, without the checks that `__post_init__` makes of a caller's.
    """
    cls = _registered(cls)
    jax.export.register_pytree_node_serialization(
        cls,
        serialized_name=f"jaxspatial.{cls.__name__}",
        serialize_auxdata=lambda _: b"",
        deserialize_auxdata=lambda _: (),
    )
    return cls


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree_of(structure: str) -> typing.Callable[[type[_Class]], type[_Class]]:
    """As `tree`, with one field that is no array but part of the structure: it has to be hashable."""
    return lambda cls: _registered(cls, structure)


def named_tuples(types: Iterable[Any]) -> None:
    """Makes exportable what of these types are NamedTuples: pytrees by nature, of which JAX wants a name to write."""
    for cls in types:
        if isinstance(cls, type) and issubclass(cls, TUPLE):
            jax.export.register_namedtuple_serialization(cls, serialized_name=f"jaxspatial.{cls.__name__}")


def _registered(cls: Any, *static: str) -> Any:
    cls = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    names = [field.name for field in dataclasses.fields(cls) if field.name not in static]
    keys: list[Any] = [jax.tree_util.GetAttrKey(name) for name in names]

    def structure(x: Any) -> tuple[Any, ...]:
        return tuple(getattr(x, name) for name in static)

    jax.tree_util.register_pytree_with_keys(
        cls,
        lambda x: (tuple((key, getattr(x, name)) for key, name in zip(keys, names, strict=True)), structure(x)),
        lambda static_parts, leaves: rebuilt(cls, [*static, *names], [*static_parts, *leaves]),
        lambda x: (tuple(getattr(x, name) for name in names), structure(x)),
    )
    return cls


def rebuilt(cls: type[_Class], names: Iterable[str], parts: Iterable[typing.Any]) -> _Class:
    """An object of these parts, unchecked."""
    x = object.__new__(cls)
    for name, part in zip(names, parts, strict=True):
        object.__setattr__(x, name, part)
    return x

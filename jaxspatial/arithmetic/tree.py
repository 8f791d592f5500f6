"""Types that JAX knows as trees of arrays."""

import dataclasses
import typing
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.export

T = typing.TypeVar("T")

_Class = typing.TypeVar("_Class")


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree(cls: type[_Class]) -> type[_Class]:
    """Class decorator: a frozen dataclass, known to JAX as a pytree, that can be exported.

    JAX rebuilds it with whatever leaves it needs, without the checks that `__post_init__` makes of a caller's.
    """
    cls = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    names = [field.name for field in dataclasses.fields(cls)]
    _register(cls, names, [])
    jax.export.register_pytree_node_serialization(
        cls,
        serialized_name=f"jaxspatial.{cls.__name__}",
        serialize_auxdata=lambda _: b"",
        deserialize_auxdata=lambda _: (),
    )
    return cls


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree_of(structure: str) -> typing.Callable[[type[T]], type[T]]:
    """As `tree`, with one field that is no array but part of the structure: it has to be hashable."""

    def decorated(cls: type[T]) -> type[T]:
        cls = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
        _register(cls, [field.name for field in dataclasses.fields(cls) if field.name != structure], [structure])
        return cls

    return decorated


def named_tuples(types: Iterable[Any]) -> None:
    """Makes exportable what of these types are NamedTuples: pytrees by nature, of which JAX wants a name to write."""
    for cls in types:
        if isinstance(cls, type) and issubclass(cls, tuple):
            jax.export.register_namedtuple_serialization(cls, serialized_name=f"jaxspatial.{cls.__name__}")


def _register(cls: type, names: Sequence[str], static: Sequence[str]) -> None:
    keys = list(map(jax.tree_util.GetAttrKey, names))

    def structure(x: Any) -> tuple[Any, ...]:
        return tuple(getattr(x, name) for name in static)

    jax.tree_util.register_pytree_with_keys(
        cls,
        lambda x: (tuple((key, getattr(x, name)) for key, name in zip(keys, names, strict=True)), structure(x)),
        lambda static_parts, leaves: rebuilt(cls, [*static, *names], [*static_parts, *leaves]),
        lambda x: (tuple(getattr(x, name) for name in names), structure(x)),
    )


def rebuilt(cls: type[_Class], names: Iterable[str], parts: Iterable[typing.Any]) -> _Class:
    """An object of these parts, unchecked."""
    x = object.__new__(cls)
    for name, part in zip(names, parts, strict=True):
        object.__setattr__(x, name, part)
    return x

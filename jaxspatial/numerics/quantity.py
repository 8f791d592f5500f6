"""Types that JAX knows as trees of arrays, and what all of them with a batch can do: change dtype, be indexed, stacked
and compared."""

import dataclasses
import functools
import json
import operator
import typing
from collections.abc import Callable, Iterable, Sequence

import jax
import jax.export
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.numbers.components import as_array
from jaxspatial.numerics.numbers.double_word import DoubleWord, to_double_word
from jaxspatial.numerics.types import BatchShape, DTypeLike

_Class = typing.TypeVar("_Class")
_Kind = typing.TypeVar("_Kind", bound="Quantity")


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree(cls: type[_Class]) -> type[_Class]:
    """Class decorator: a frozen dataclass, known to JAX as a pytree, that can be exported.

    JAX rebuilds it with whatever leaves it needs, without the checks that `__post_init__` makes of a caller's.
    """
    return exported_tree_of()(cls)


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def tree_of(*structure: str) -> typing.Callable[[type[_Class]], type[_Class]]:
    """As `tree`, with fields that are no arrays but part of the structure: they have to be hashable."""
    return lambda cls: _registered(cls, *structure)


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def exported_tree_of(*structure: str) -> typing.Callable[[type[_Class]], type[_Class]]:
    """As `tree_of`, of a type that can be exported: its structure is texts, numbers, and tuples of these."""

    def decorated(cls: type[_Class]) -> type[_Class]:
        cls = _registered(cls, *structure)
        jax.export.register_pytree_node_serialization(
            cls,
            serialized_name=f"jaxspatial.{cls.__name__}",
            serialize_auxdata=lambda structure: json.dumps(structure).encode() if structure else b"",
            deserialize_auxdata=lambda data: as_tuples(json.loads(data)) if data else (),
        )
        return cls

    return decorated


def as_tuples(x):
    """What JSON gives back of nested tuples."""
    return tuple(map(as_tuples, x)) if isinstance(x, list) else x


def exported(cls: type[_Class]) -> type[_Class]:
    """Class decorator of a NamedTuple, a pytree by nature: it can be exported, for which JAX wants a name to write."""
    jax.export.register_namedtuple_serialization(cls, serialized_name=f"jaxspatial.{cls.__name__}")
    return cls


def _registered(cls, *static: str):
    cls = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    names = [field.name for field in dataclasses.fields(cls) if field.name not in static]
    keys: list = [jax.tree_util.GetAttrKey(name) for name in names]
    order, parts = (*static, *names), _getter(names)
    # JAX asks for the parts often: no call more than they take.
    structure = _getter(static) if static else None

    def unflatten(static_parts: tuple, leaves: Iterable):
        x = object.__new__(cls)
        vars(x).update(zip(order, (*static_parts, *leaves), strict=True))
        return x

    jax.tree_util.register_pytree_with_keys(
        cls,
        lambda x: (tuple(zip(keys, parts(x), strict=True)), structure(x) if structure else ()),
        unflatten,
        lambda x: (parts(x), structure(x) if structure else ()),
    )
    return cls


def _getter(names: Sequence[str]) -> Callable:
    """The fields of these names, in a tuple."""
    return operator.attrgetter(*names) if len(names) > 1 else lambda x: tuple(getattr(x, name) for name in names)


def rebuilt(cls: type[_Class], names: Iterable[str], parts: Iterable) -> _Class:
    """An object of these parts, unchecked."""
    x = object.__new__(cls)
    vars(x).update(zip(names, parts, strict=True))
    return x


class OfOneDtype:
    """Base of trees of arrays of one dtype, with a batch shape."""

    if typing.TYPE_CHECKING:

        @property
        def batch_shape(self) -> tuple[int, ...]: ...

    def astype(self, dtype: DTypeLike | None) -> typing.Self:
        """The same with all numbers rounded to another dtype. NumPy stays NumPy.

        Example:
            >>> ball = js.Sphere(np.float64(0.1))
            >>> print(ball.dtype, ball.astype(np.float32).dtype)
            float64 float32
        """
        return jax.tree.map(lambda x: x.astype(floats.as_dtype(dtype)), self)


class Quantity:
    """Base of spatial vectors, rotations, transforms and inertias: one item, or a batch of them.

    `==` and `!=` compare numbers, one answer per item of the batch: True where all components are equal, never with
    NaN. What rounding leaves different is for `is_approx` and its like. Hashes are those of the object.

    Example:
        >>> F = js.SpatialForce.from_array(np.eye(6, dtype=np.float32)[:2])
        >>> print(F.batch_shape, F.dtype, F == F.at_batch(0))
        (2,) float32 [ True False]
    """

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    # The method that gives the numbers as an array.
    _as_array: typing.ClassVar[str] = "to_matrix"

    if typing.TYPE_CHECKING:
        # The names of the fields, as dataclasses have it.
        __match_args__: typing.ClassVar[tuple[str, ...]]

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return floats.batch_shape(*self._vectors)

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(self._vectors[0].dtype)

    @property
    def _vectors(self) -> tuple:
        """All that this consists of, as arrays (*batch, n): its fields, unless a kind says otherwise."""
        return tuple(getattr(self, name) for name in self.__match_args__)

    def _with_vectors(self, vectors: Iterable) -> typing.Self:
        """The same kind of other arrays, in the order of `_vectors`; *unchecked*."""
        return rebuilt(type(self), self.__match_args__, vectors)

    def astype(self, dtype: DTypeLike | None) -> typing.Self:
        """The same with all numbers rounded to another dtype.

        Args:
            dtype: any; of NumPy's numbers also one that JAX has switched off. None and Python's `float` are JAX's
                default.

        Returns:
            The same kind. NumPy stays NumPy.

        Raises:
            TypeError: the dtype is not floating point.

        Error: each number is rounded once.

        Example:
            >>> F = js.SpatialForce(tau=np.zeros(3), f=np.ones(3))
            >>> print(F.dtype, F.astype("float32").dtype)
            float64 float32
        """
        converted = operator.methodcaller("astype", floats.as_dtype(dtype))
        with np.errstate(all="ignore"):
            return jax.tree.map(converted, self, is_leaf=lambda x: isinstance(x, floats.StandIn))

    def at_batch(self, index: typing.Any) -> typing.Self:
        """The items at an index of the batch, as NumPy has it.

        Args:
            index: an integer, a slice, a mask, an array of integers, or a tuple of them (`numpy.s_[:, 0]`).

        Returns:
            The same kind, of the batch shape that NumPy gives.

        Raises:
            IndexError: it is known to be out of range; traced integers are clamped, as in JAX.

        Error: none, it is exact.

        Example:
            >>> F = js.SpatialForce.from_array([[0.0, 0.0, 3.0, 1.0, 2.0, 0.0], [0.0, 0.0, 0.0, 5.0, 0.0, 0.0]])
            >>> F.at_batch(1)
            SpatialForce(tau=[0.0, 0.0, 0.0], f=[5.0, 0.0, 0.0])
        """
        index = index if isinstance(index, tuple) else (index,)
        index = [np.asarray(i, None if i else np.int32) if isinstance(i, list) else i for i in index]
        # Integers of 32 bits: those of 64, first used while 64-bit types are off, fail for good once they are on.
        is_wide = [isinstance(i, floats.NUMPY) and i.dtype.kind in "iu" for i in index]
        index = tuple(i.astype(np.int32) if wide else i for i, wide in zip(index, is_wide, strict=True))
        _require_in_range(self, index)
        # Of what consists of known numbers alone there is one for any batch.
        items = (x if floats.goes_with_any_batch(x) else x[(*index, slice(None))] for x in self._vectors)
        return self._with_vectors(items)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> typing.NoReturn:
        """Says what to call: `np.asarray` would make an array of one object of it. `jnp.asarray` comes here, too."""
        raise TypeError(f"asarray: expected an array, got {type(self).__name__}; its numbers are x.{self._as_array}()")

    def __eq__(self, other: object):
        """Where all components are equal: a mask (*batch,)."""
        if type(other) is not type(self):
            # Numbers and arrays are no quantities, and unequal quantities of two kinds have no answer: say so.
            if isinstance(other, (Quantity, int, float, complex, *floats.ARRAYS)):
                kinds = f"{type(self).__name__} and {type(other).__name__}"
                message = f"==: expected two of one kind, got {kinds}; numbers are in x.to_array() or x.to_matrix()"
                raise TypeError(message)
            return NotImplemented
        # What is no array is a tree that describes trees, see `check.is_tree_mark`.
        leaves = (jax.tree.leaves(x, is_leaf=lambda leaf: leaf is None) for x in (self, other))
        numeric = [all(isinstance(leaf, floats.ARRAYS) for leaf in own) for own in leaves]
        if not all(numeric):
            fields = ([getattr(x, name) for name in self.__match_args__] for x in (self, other))
            return not any(numeric) and operator.eq(*fields)
        a, b = matched(self, other, "==")
        parts = ([as_array(v, x.batch_shape) for v in x._vectors] for x in (a, b))
        equal = (x == y for x, y in zip(*parts, strict=True))
        return functools.reduce(operator.and_, [mask[..., i] for mask in equal for i in range(mask.shape[-1])])

    def __ne__(self, other: object):
        equal = self == other
        return equal if equal is NotImplemented else not equal if isinstance(equal, bool) else ~equal

    __hash__ = object.__hash__


class Additive(Quantity):
    """Base of the quantities that can be zero: spatial vectors and inertias."""

    # The shapes of the fields of one item.
    _items: typing.ClassVar[tuple[tuple[int, ...], ...]] = ()

    if typing.TYPE_CHECKING:
        # What each kind has: how it is moved and re-expressed, see `jaxspatial.spatial.operations`.
        def _shift(self, p_PQ_E, w, precision) -> typing.Self: ...
        def _rotate(self, R_AE, precision) -> typing.Self: ...
        def _act(self, X_AB, w, precision) -> typing.Self: ...
        def _act_inverse(self, X_AB, w, precision) -> typing.Self: ...

    @classmethod
    def zero(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> typing.Self:
        """Zeros, known while tracing: what is added to them, or made of them, leaves no operation behind.

        Args:
            batch_shape: an integer or a tuple.
            dtype: of floating point; None takes JAX's default.

        Returns:
            The zero of this kind, over the batch shape.

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, it is exact.

        Example:
            >>> js.SpatialForce.zero()
            SpatialForce(tau=[0.0, 0.0, 0.0], f=[0.0, 0.0, 0.0])
        """
        return cls._filled(0, batch_shape, dtype)

    @classmethod
    def nan(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> typing.Self:
        """NaNs, for what is yet to be set.

        Args:
            batch_shape: an integer or a tuple.
            dtype: of floating point; None takes JAX's default.

        Returns:
            The kind, all of it NaN, over the batch shape.

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, nothing is computed.

        Example:
            >>> js.SpatialForce.nan()
            SpatialForce(tau=[nan, nan, nan], f=[nan, nan, nan])
        """
        return cls._filled(np.nan, batch_shape, dtype)

    @classmethod
    def _filled(cls, value: float, batch_shape: BatchShape, dtype: DTypeLike | None) -> typing.Self:
        batch, dtype = check.as_batch_shape(batch_shape), floats.as_dtype(dtype)
        arrays = [floats.numpy_for(batch).full((*batch, *item), value, dtype) for item in cls._items]
        return cls(*arrays)


def require_compatible(**arguments) -> tuple[int, ...]:
    """The common batch shape of arrays (*batch, n), and of what has a batch shape, by name; all are to be of one
    dtype."""
    check.require_same_dtype(**arguments)
    shapes = dict[str, tuple[int, ...]]()
    for name, x in arguments.items():
        shapes[name] = x.batch_shape if isinstance(x, (Quantity, OfOneDtype)) else x.shape[:-1]
    return floats.common_batch_shape(**shapes)


def matched(a: _Kind, b: _Kind, operation: str) -> tuple[_Kind, _Kind]:
    """a and b, of one kind and dtype, over their common batch."""
    if type(a) is not type(b):
        raise TypeError(f"{operation}: expected two of one kind, got {type(a).__name__} and {type(b).__name__}")
    a, b = check.same_dtype(left=a, right=b).values()
    batch = floats.common_batch_shape(left=a.batch_shape, right=b.batch_shape)
    over = functools.partial(floats.broadcast_batch, batch)
    return a._with_vectors(over(*a._vectors)), b._with_vectors(over(*b._vectors))


def stack(quantities: Iterable[_Kind], axis: int = 0) -> _Kind:
    """Quantities of one kind, dtype and batch shape as a batch, along a new axis of the batch.

        F = js.stack([F_1, F_2, F_3])          # batch shape (3,); F.at_batch(0) is F_1

    Args:
        quantities: spatial vectors, rotations, transforms or inertias, all of one kind.
        axis: where in the batch shape of the result the new axis is: -1 is the last axis of the batch.

    Returns:
        The same kind. All NumPy stays NumPy.

    Raises:
        TypeError: kinds or dtypes differ.
        ValueError: batch shapes differ, there is no such axis, or there is nothing to stack.

    Error: none, it is exact.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> many = js.stack([F, 2.0 * F])
        >>> print(many.batch_shape, many.at_batch(1) == 2.0 * F)
        (2,) True
    """
    if isinstance(quantities, Quantity) or not isinstance(quantities, Iterable):
        check.refuse("stack: quantities", "a sequence of spatial vectors or the like", quantities)
    arguments = {f"quantities[{i}]": x for i, x in enumerate(quantities)}
    _require_alike(arguments)
    items = list(check.same_dtype(**arguments).values())
    batch = items[0].batch_shape
    place = floats.batch_axis(axis, (*batch, len(items)), "stack")
    columns = zip(*(x._vectors for x in items), strict=True)
    return items[0]._with_vectors([_stack_of_vectors(vectors, batch, place) for vectors in columns])


def _require_alike(arguments: dict) -> None:
    if not arguments:
        raise ValueError("stack: expected at least one quantity, got none")
    for name, x in arguments.items():
        if not isinstance(x, Quantity):
            raise TypeError(f"stack: {name}: expected a spatial vector or the like, got {type(x).__name__}")
    kinds = {name: type(x).__name__ for name, x in arguments.items()}
    batch_shapes = {name: x.batch_shape for name, x in arguments.items()}
    for came, expected, error in ((kinds, "one kind", TypeError), (batch_shapes, "equal batch shapes", ValueError)):
        first, *others = came.items()
        for name, other in others:
            if other != first[1]:
                raise error(f"stack: expected {expected}, got {first[0]}: {first[1]}, {name}: {other}")


def _stack_of_vectors(vectors: Sequence, batch: tuple[int, ...], place: int):
    """What is known of Components stays so where it is the same in all."""
    forms: set = {jax.tree.structure(x) for x in vectors}
    if len(forms) > 1:
        vectors = [as_array(x, batch) for x in vectors]
        is_pair = any(isinstance(x, DoubleWord) for x in vectors)
        vectors = to_double_word(vectors) if is_pair else vectors

    def stacked_limbs(*limbs):
        is_numpy = all(isinstance(limb, np.ndarray) for limb in limbs)
        return np.stack(limbs, place) if is_numpy else jnp.stack([jnp.asarray(limb) for limb in limbs], place)

    return jax.tree.map(stacked_limbs, *vectors)


def moved_to_last(vectors: Iterable, place: int, batch_shape: tuple[int, ...]) -> list:
    """Arrays (*batch, n) with one axis of the batch behind the others; Components without data have none."""
    last = len(batch_shape) - 1
    moved = functools.partial(jnp.moveaxis, source=place, destination=last)
    return [jax.tree.map(moved, x) if place != last else x for x in vectors]


def _require_in_range(x, index: tuple) -> None:
    """JAX takes the last item for what is out of range."""
    if any(isinstance(i, jax.Array) for i in index):
        return
    try:
        # An axis whose size is a symbol of `jax.export` may be long.
        sizes = [n if floats.is_sized((n,)) else 2**20 for n in x.batch_shape]
        np.broadcast_to(np.False_, sizes)[index]
    except IndexError as error:
        kind = type(x).__name__
        raise IndexError(f"{kind}.at_batch: expected an index of a batch of shape {x.batch_shape}: {error}") from None

"""Arrays by their components, some of which are numbers known while tracing: planar forces, rotations about an axis.

What is known of an array is lost as soon as its components are stacked. Here they stay apart, and what is known is part
of the type: it survives jit, scan, vmap and derivatives, where a NumPy array becomes data.
"""

import functools
import json
import typing
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.export
import numpy as np
from jax.typing import DTypeLike

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers import component_operators, folding
from jaxspatial.arithmetic.numbers.component_operators import Operators
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import to_double_word


class _Structure(NamedTuple):
    """What is static: for every component the known number, None for data; the dtype's name, where no data has one."""

    known: tuple[float | None, ...]
    dtype: Any


class Components(Operators):
    """An array (*batch, n) by its n components, each data or a number known while tracing.

        f = js.Components(fx, fy, 0.0)                        # a force in the plane
        F = js.SpatialForce(js.Components(0.0, 0.0, tz), f)
        js.shift(F, js.Components(px, py, 0.0)).tau           # Components(0.0, 0.0, tz'): 2 products, not 6

    Each component is data: an array (*batch,) or a DoubleWord, with batches that broadcast; or known: a Python number
    or NumPy scalar. dtype: that of the data; of known numbers alone it may be named.

    Known numbers fold: a known 0, 1 or -1 leaves no operation behind, and a known 0 is an exact zero, also next to an
    infinity or a NaN (-0 is 0). Components take the place of an array wherever the library takes one. What is given any
    returns Components. What is known of these is decided by the structure of the arguments, not by where it is called:
    NumPy arrays beside them are known in those components that are 0, 1 or -1 throughout, eagerly too. Beside double
    words the data of results are double words. Where all Components given are known zeros, as in `SpatialForce(f=f)`,
    results are arrays, but for those that are zero, which are such Components again.

    A pytree whose leaves are the data, (*batch,) each. `jax.vmap` with in_axes=0 maps over the first axis of the batch,
    with -1 over the last one of the batch, not over components. Known numbers are static. Another number is another
    type, for which jit compiles again, and which a scan carry or the other branch of a cond does not take; without data
    there is no batch, and it goes with any. In gradients and tangents known numbers stand as they are: descend by
    `jax.tree.map(lambda x, g: x - rate * g, x, gradient)`, which leaves them alone.

    Operators: + - * / with arrays (*batch, n) or (*batch, 1), numbers and Components, each result rounded once.
    Raises TypeError for dtypes that differ or integers, ValueError for batches that do not broadcast.
    """

    structure: _Structure
    data: tuple[typing.Any, ...]

    def __init__(self, *components: Any, dtype: DTypeLike | None = None):
        """Checks what a caller passes. JAX rebuilds Components without it, with whatever leaves it needs."""
        if not components:
            raise ValueError("Components: expected at least one component, got none")
        given = [_checked(c, f"Components: component {i}", dtype) for i, c in enumerate(components)]
        dtype = component_operators.common_dtype(given, dtype)
        batches = {f"component {i}": c.shape for i, c in enumerate(given) if not isinstance(c, (float, np.generic))}
        batch = check.common_batch_shape(**batches) if batches else ()
        self._fill([component_operators.over(c, batch, dtype) for c in given])

    def _fill(self, components: Sequence[Any]) -> None:
        known = tuple(component_operators.plain(c) if folding.is_known(c) else None for c in components)
        self.data = tuple(c for c, number in zip(components, known, strict=True) if number is None)
        self.structure = _Structure(known, None if self.data else np.dtype(components[0].dtype).name)

    @classmethod
    def from_array(cls, x: Any, known: Sequence[float | None]) -> typing.Self:
        """The components of x (*batch, n), but for those of which the number is known: `known` has it, or None.

            js.Components.from_array(p, (None, None, 0.0))      # what a plane leaves of p

        Args:
            x: array (*batch, n). What it has where a number is known is not looked at.
            known: n entries, a number or None for data.

        Returns:
            The Components, of the dtype of x.

        Raises:
            TypeError: x is not floating point.
            ValueError: it has not as many components as `known` entries.

        Error: none, it is exact.
        """
        x = check.as_vectors(x, "Components.from_array: x", size=len(known))
        return cls(*(x[..., i] if number is None else number for i, number in enumerate(known)), dtype=x.dtype)

    # -- as an array --------------------------------------------------------------------------------------------------

    @property
    def components(self) -> tuple[typing.Any, ...]:
        """The n components: arrays or double words (*batch,), and NumPy scalars, which are known."""
        dtype, data = self.dtype, iter(self.data)
        return tuple(
            component_operators.as_data(next(data)) if c is None else dtype.type(c) for c in self.structure.known
        )

    @property
    def shape(self) -> tuple[int, ...]:
        return (*(self.data[0].shape if self.data else ()), len(self.structure.known))

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.data[0].dtype if self.data else self.structure.dtype)

    def to_array(self, batch_shape: tuple[int, ...] = ()) -> Any:
        """All components as one array.

        Args:
            batch_shape: what the batch is broadcast to, if it is wider than that of the data.

        Returns:
            (*batch, n), an array, or a DoubleWord where any component is one; NumPy's where all are known.

        Raises:
            ValueError: the batch shapes do not broadcast.

        Error: none, it is exact.
        """
        batch = np.broadcast_shapes(self.shape[:-1], batch_shape)
        parts = self.components
        parts = to_double_word(parts) if any(isinstance(c, DoubleWord) for c in parts) else parts
        return jax.tree.map(lambda *words: folding.stack(words, batch), *parts, is_leaf=folding.is_known)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.to_array(), dtype)

    def over_batch(self, batch_shape: tuple[int, ...]) -> "Components":
        """The data over another batch; what is known goes with any.

        Args:
            batch_shape: one that the batch of the data broadcasts to.

        Returns:
            The Components over it.

        Error: none, it is exact.
        """
        return _rebuild(self.structure, (component_operators.over(c, batch_shape, self.dtype) for c in self.data))

    def astype(self, dtype: DTypeLike) -> "Components":
        """Data and known numbers in another dtype.

        Args:
            dtype: one of floating point.

        Returns:
            The Components in it.

        Error: each number is rounded once, a double word as `DoubleWord.astype` does it.
        """
        return self.of([c.astype(dtype) for c in self.components])

    def reshape(self, *shape: Any) -> Any:
        """With another batch shape; with other components as an array.

        Args:
            shape: the new one, components included, as one tuple or number by number. -1 as in NumPy.

        Returns:
            The Components, or, where their number changes, an array or a DoubleWord.

        Raises:
            TypeError: the sizes do not fit.

        Error: none, it is exact.
        """
        new: Any = shape[0] if len(shape) == 1 and isinstance(shape[0], (check.TUPLE, check.LIST)) else shape
        if new[-1] != self.shape[-1]:
            return self.to_array().reshape(new)
        return _rebuild(self.structure, (c.reshape(tuple(new[:-1])) for c in self.data))

    def __getitem__(self, index: Any) -> Any:
        """As of the array: x[..., i] is component i, (*batch,), as a NumPy array where it is known; x[..., 1:] and x[3]
        of a batch are Components. What needs components as an axis, x[..., None], comes as an array."""
        batch, which = component_operators.split(index, self.ndim, bool(self.data))
        if which is None:
            return self.to_array()[index]
        parts = [c if folding.is_known(c) else c[batch] for c in self.components]
        if not isinstance(which, int):
            return self.of([parts[i] for i in np.arange(len(parts))[which]])
        shape = next((c.shape for c in parts if not folding.is_known(c)), ())
        return np.broadcast_to(parts[which], shape) if folding.is_known(parts[which]) else parts[which]

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Any]:
        # Without it Python would count up __getitem__ until an IndexError, which JAX never raises.
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        data = map(component_operators.shown, self.data)
        return f"Components({', '.join(next(data) if c is None else str(c) for c in self.structure.known)})"


def _rebuild(structure: _Structure, data: Iterable[Any]) -> Components:
    x = object.__new__(Components)
    x.structure, x.data = structure, tuple(data)
    return x


def _flattened_with_keys(x: Components) -> tuple[tuple[Any, ...], _Structure]:
    places = (i for i, c in enumerate(x.structure.known) if c is None)
    return tuple((jax.tree_util.SequenceKey(i), leaf) for i, leaf in zip(places, x.data, strict=True)), x.structure


def _restored(text: bytes | bytearray) -> _Structure:
    known, dtype = json.loads(text)
    return _Structure(tuple(None if c is None else component_operators.plain(float(c)) for c in known), dtype)


def _stored(structure: _Structure) -> bytes:
    known, dtype = structure
    return json.dumps(([None if c is None else repr(c) for c in known], dtype)).encode()


jax.tree_util.register_pytree_with_keys(Components, _flattened_with_keys, _rebuild, lambda x: (x.data, x.structure))
jax.export.register_pytree_node_serialization(
    Components, serialized_name="jaxspatial.Components", serialize_auxdata=_stored, deserialize_auxdata=_restored
)


def is_components(x: object) -> typing.TypeGuard[Components]:
    return isinstance(x, Components)


def as_components(x: Any) -> Components:
    """Any array (*batch, n) as Components: `alike` for NumPy arrays, all data for others."""
    return x if is_components(x) else Components.of_array(x)


of = Components.of


def _checked(c: Any, name: str, dtype: Any) -> Any:
    """A component as given: a Python number as a float, a NumPy scalar, an array or a DoubleWord."""
    if is_components(c):
        raise TypeError(f"{name}: expected an array (*batch,), a DoubleWord or a float, got Components")
    if type(c) in (float, int):
        return float(c)
    array = check.as_float_array(c, name, dtype)
    return array[()] if isinstance(c, np.generic) else array


# -- Components where arrays are meant, and arrays beside Components ---------------------------------------------------


def from_components(x: typing.Any) -> typing.Any:
    """Every Components of a tree as one array. All else stays as it is.

    What is known goes with any batch, and comes without one where all of it is known.

    Args:
        x: a pytree of anything, or one Components (*batch, n).

    Returns:
        The same tree, with an array (*batch, n), or a DoubleWord, in place of each Components.

    Error: none, it is exact.
    """
    return jax.tree.map(functools.partial(as_array, batch_shape=()), x, is_leaf=is_components)


def as_array(x: typing.Any, batch_shape: tuple[int, ...]) -> typing.Any:
    """Components as one array over a batch, of which known numbers have none; anything else as it is."""
    return x.to_array(batch_shape) if is_components(x) else x


def zero(size: int, dtype: DTypeLike) -> Components:
    """Components of known zeros, also of a dtype that JAX has switched off."""
    return of([np.dtype(dtype).type(0)] * size)


def is_zero(x: Any) -> bool:
    """True for what is known to be zero throughout: Components without data, or a NumPy array."""
    if isinstance(x, Components):
        return not x.data and not any(x.structure.known)
    return isinstance(x, check.NUMPY) and not x.any()


def alike(arrays: Sequence[Any]) -> Any:
    """The arguments of a formula; where one is Components, and not merely zero, NumPy arrays made such, known where
    they are 0, 1 or -1."""
    if all(is_zero(a) for a in arrays if is_components(a)):
        return arrays
    return tuple(as_components(a) if isinstance(a, np.ndarray) else a for a in arrays)


def has_pairs(x: Any) -> bool:
    """True for a DoubleWord, and for Components of which one is."""
    return isinstance(x, DoubleWord) or (is_components(x) and any(isinstance(c, DoubleWord) for c in x.data))

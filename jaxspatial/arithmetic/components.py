"""Arrays by their components, some of which are numbers known while tracing: planar forces, rotations about an axis.

What is known of an array is lost as soon as its components are stacked. Here they stay apart, and what is known is part
of the type: it survives jit, scan, vmap and derivatives, where a NumPy array becomes data.
"""

import functools
import json
import math
import typing
from typing import NamedTuple

import jax
import jax.export
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, folding
from jaxspatial.arithmetic.double_word import DoubleWord, to_double_word
from jaxspatial.arithmetic.polynomial import uniform
from jaxspatial.arithmetic.precision import Precision


class _Structure(NamedTuple):
    """What is static: for every component the known number, None for data; the dtype, where no data has one."""

    known: tuple
    dtype: str | None


class Components(check.StandIn):
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
    words the data of results are double words.

    A pytree whose leaves are the data, (*batch,) each. `jax.vmap` with in_axes=0 maps over the first axis of the batch,
    with -1 over the last one of the batch, not over components. Known numbers are static. Another number is another
    type, for which jit compiles again, and which a scan carry or the other branch of a cond does not take; without data
    there is no batch, and it goes with any. In gradients and tangents known numbers stand as they are: descend by
    `jax.tree.map(lambda x, g: x - rate * g, x, gradient)`, which leaves them alone.

    Operators: + - * / with arrays (*batch, n) or (*batch, 1), numbers and Components, each result rounded once.
    Raises TypeError for dtypes that differ or integers, ValueError for batches that do not broadcast.
    """

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    _structure: _Structure
    _data: tuple

    def __init__(self, *components, dtype=None):
        """Checks what a caller passes. JAX rebuilds Components without it, with whatever leaves it needs."""
        if not components:
            raise ValueError("Components: expected at least one component, got none")
        given = [_checked(c, f"Components: component {i}", dtype) for i, c in enumerate(components)]
        dtype = _common_dtype(given, dtype)
        batches = {f"component {i}": c.shape for i, c in enumerate(given) if not isinstance(c, (float, np.generic))}
        batch = check.common_batch_shape(**batches) if batches else ()
        self._fill([_over(c, batch, dtype) for c in given])

    def _fill(self, components):
        known = tuple(_plain(c) if folding.is_known(c) else None for c in components)
        self._data = tuple(c for c, number in zip(components, known, strict=True) if number is None)
        self._structure = _Structure(known, None if self._data else np.dtype(components[0].dtype).name)

    @classmethod
    def from_array(cls, x, known):
        """The components of x (*batch, n), but for those of which the number is known: `known` has it, or None.

            js.Components.from_array(p, (None, None, 0.0))      # what a plane leaves of p

        What x has there is not looked at.
        """
        x = check.as_vectors(x, "Components.from_array: x", size=len(known))
        return cls(*(x[..., i] if number is None else number for i, number in enumerate(known)), dtype=x.dtype)

    # -- as an array --------------------------------------------------------------------------------------------------

    @property
    def components(self) -> tuple[typing.Any, ...]:
        """The n components: arrays or double words (*batch,), and NumPy scalars, which are known."""
        dtype, data = self.dtype, iter(self._data)
        return tuple(_array(next(data)) if c is None else dtype.type(c) for c in self._structure.known)

    @property
    def shape(self):
        return (*(self._data[0].shape if self._data else ()), len(self._structure.known))

    @property
    def ndim(self):
        return len(self.shape)

    @property
    def dtype(self):
        return np.dtype(self._data[0].dtype if self._data else self._structure.dtype)

    def to_array(self, batch_shape=()):
        """(*batch, n) as one array, or double word; over a wider batch where a batch shape is given."""
        batch = np.broadcast_shapes(self.shape[:-1], batch_shape)
        parts = self.components
        parts = to_double_word(parts) if any(isinstance(c, DoubleWord) for c in parts) else parts
        return jax.tree.map(lambda *words: folding.stack(words, batch), *parts, is_leaf=folding.is_known)

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.to_array(), dtype)

    def over_batch(self, batch_shape):
        """The data over this batch; what is known goes with any."""
        return self._with(_over(c, batch_shape, self.dtype) for c in self._data)

    def astype(self, dtype):
        """Data and known numbers rounded to another dtype."""
        return of([c.astype(dtype) for c in self.components])

    def reshape(self, *shape):
        """With another batch shape; with other components as an array."""
        shape = shape[0] if len(shape) == 1 and isinstance(shape[0], (tuple, list)) else shape
        if shape[-1] != self.shape[-1]:
            return self.to_array().reshape(shape)
        return self._with(c.reshape(tuple(shape[:-1])) for c in self._data)

    def __getitem__(self, index):
        """As of the array: x[..., i] is component i, (*batch,), as a NumPy array where it is known; x[..., 1:] and x[3]
        of a batch are Components. What needs components as an axis, x[..., None], comes as an array."""
        batch, which = _split(index if self._data else _without_batch(index), self.ndim)
        if which is None:
            return self.to_array()[index]
        parts = [c if folding.is_known(c) else c[batch] for c in self.components]
        if not isinstance(which, int):
            return of([parts[i] for i in np.arange(len(parts))[which]])
        shape = next((c.shape for c in parts if not folding.is_known(c)), ())
        return np.broadcast_to(parts[which], shape) if folding.is_known(parts[which]) else parts[which]

    def __len__(self):
        return self.shape[0]

    def __iter__(self):
        # Without it Python would count up __getitem__ until an IndexError, which JAX never raises.
        return (self[i] for i in range(len(self)))

    def _with(self, data):
        return _rebuild(self._structure, data)

    # -- arithmetic ---------------------------------------------------------------------------------------------------

    def __neg__(self):
        return of([-c for c in self.components])

    def __abs__(self):
        return of([abs(c) for c in self.components])

    def __add__(self, other):
        return self._combined(folding.add, other)

    __radd__ = __add__

    def __sub__(self, other):
        return self._combined(folding.subtract, other)

    def __rsub__(self, other):
        return self._combined(folding.subtract, other, is_reflected=True)

    def __mul__(self, other):
        return self._combined(_product, other)

    __rmul__ = __mul__

    def __truediv__(self, other):
        return self._combined(folding.divide, other)

    def __rtruediv__(self, other):
        return self._combined(folding.divide, other, is_reflected=True)

    def _combined(self, operation, other, is_reflected=False):
        other = _beside(self, other)
        if other is NotImplemented:
            return NotImplemented
        return _each(operation, *((other, self) if is_reflected else (self, other)))

    def __repr__(self):
        data = map(_shown, self._data)
        return f"Components({', '.join(next(data) if c is None else str(c) for c in self._structure.known)})"


def _flattened(x):
    return x._data, x._structure


def _flattened_with_keys(x):
    places = (i for i, c in enumerate(x._structure.known) if c is None)
    return tuple((jax.tree_util.SequenceKey(i), leaf) for i, leaf in zip(places, x._data, strict=True)), x._structure


def _rebuild(structure, data):
    x = object.__new__(Components)
    x._structure, x._data = structure, tuple(data)
    return x


def _restored(text):
    known, dtype = json.loads(text)
    return _Structure(tuple(None if c is None else _plain(float(c)) for c in known), dtype)


def _stored(structure):
    known, dtype = structure
    return json.dumps(([None if c is None else repr(c) for c in known], dtype)).encode()


jax.tree_util.register_pytree_with_keys(Components, _flattened_with_keys, _rebuild, _flattened)
jax.export.register_pytree_node_serialization(
    Components, serialized_name="jaxspatial.Components", serialize_auxdata=_stored, deserialize_auxdata=_restored
)


def of(components):
    """Components of NumPy scalars, which are known, and data over one batch, of one dtype: not checked."""
    x = object.__new__(Components)
    x._fill(components)
    return x


def from_components(x: typing.Any) -> typing.Any:
    """Every Components of a tree as one array. All else stays as it is.

    What is known goes with any batch, and comes without one where all of it is known.

    Args:
        x: a pytree of anything, or one Components (*batch, n).

    Returns:
        The same tree, with an array (*batch, n), or a DoubleWord, in place of each Components.

    Error: none, it is exact.
    """
    return jax.tree.map(lambda leaf: leaf.to_array() if _is_components(leaf) else leaf, x, is_leaf=_is_components)


def as_array(x, batch_shape):
    """Components as one array over a batch, of which known numbers have none; anything else as it is."""
    return x.to_array(batch_shape) if _is_components(x) else x


def _is_components(x):
    return isinstance(x, Components)


def alike(arrays):
    """The arguments of a formula; where one is Components, NumPy arrays made such, known where they are 0, 1 or -1."""
    if not any(map(_is_components, arrays)):
        return arrays
    return tuple(as_components(a) if isinstance(a, np.ndarray) else a for a in arrays)


def as_components(x) -> Components:
    """Any array (*batch, n) as Components: `alike` for NumPy arrays, all data for others."""
    if isinstance(x, Components):
        return x
    columns = [x[..., i] for i in range(x.shape[-1])]
    return of([_known_if_unit(c) for c in columns] if isinstance(x, np.ndarray) else columns)


def _known_if_unit(column):
    number = uniform(column)
    return column.dtype.type(number) if number is not None and number in (0, 1, -1) else jnp.asarray(column)


def has_pairs(x):
    """True for a DoubleWord, and for Components of which one is."""
    return isinstance(x, DoubleWord) or (_is_components(x) and any(isinstance(c, DoubleWord) for c in x._data))


# -- components -------------------------------------------------------------------------------------------------------


def _checked(c, name, dtype):
    """A component as given: a Python number as a float, a NumPy scalar, an array or a DoubleWord."""
    if _is_components(c):
        raise TypeError(f"{name}: expected an array (*batch,), a DoubleWord or a float, got Components")
    if type(c) in (float, int):
        return float(c)
    array = check.as_float_array(c, name, dtype)
    return array[()] if isinstance(c, np.generic) else array


def _common_dtype(given, dtype):
    """That of what has one, or the one named; JAX's default for Python floats alone."""
    typed = {f"component {i}": c for i, c in enumerate(given) if hasattr(c, "dtype")}
    if dtype is not None:
        typed["dtype"] = np.empty((), jax.dtypes.canonicalize_dtype(dtype))
    check.require_same_dtype(**typed)
    return next(iter(typed.values())).dtype if typed else jax.dtypes.canonicalize_dtype(float)


def _over(c, batch, dtype):
    """The component over a batch; a number in its dtype."""
    if isinstance(c, (float, np.generic)):
        return folding.quietly(lambda t, number: t.type(number), np.dtype(dtype), c)
    return jax.tree.map(lambda word: _broadcast(word, batch), c)


def _broadcast(word, batch):
    # A copy of NumPy's: the caller may write to his own.
    word = jnp.array(word) if isinstance(word, np.ndarray) else word
    return word if word.shape == batch else jnp.broadcast_to(word, batch)


def _plain(number):
    """As a Python float that equals itself: 0 for -0, one NaN for all."""
    number = float(number)
    return math.nan if math.isnan(number) else number + 0.0


def _array(leaf) -> typing.Any:
    """Data as what a formula computes with: a NumPy array that JAX put there would be known."""
    return jnp.asarray(leaf) if isinstance(leaf, (np.ndarray, np.generic)) else leaf


def _split(index, ndim):
    """An index as that of the batch and that of the components, the latter None where they do not stay apart."""
    index = index if isinstance(index, tuple) else (index,)
    given = [i for i in index if i is not Ellipsis]
    if len(given) > ndim or any(i is None or _is_mask(i) for i in given):
        return (), None
    before = next((k for k, i in enumerate(index) if i is Ellipsis), len(index))
    *batch, last = *index[:before], *[slice(None)] * (ndim - len(given)), *index[before + 1 :]
    return tuple(batch), _which(last, is_alone=all(isinstance(i, (int, slice)) for i in batch))


def _without_batch(index):
    """Of an index [..., i, j] the last: what is known goes with any batch."""
    has_rank = isinstance(index, tuple) and len(index) > 2 and index[0] is Ellipsis and index[-1] is not None
    return index[-1:] if has_rank else index


def _is_mask(i):
    return isinstance(i, bool) or getattr(i, "dtype", None) == np.bool_


def _which(i, is_alone):
    """The index of components as an int, a slice or a list; None for traced ones, and lists beside arrays."""
    if isinstance(i, (int, np.integer)):
        return int(i)
    is_list = is_alone and isinstance(i, (list, np.ndarray)) and np.ndim(i) == 1
    return i if isinstance(i, slice) else np.asarray(i) if is_list else None


def _beside(x, other):
    """What stands beside Components in an operation: Components of as many; NotImplemented."""
    if isinstance(other, (int, float)) and not isinstance(other, bool):
        return of([_over(float(other), (), x.dtype)] * x.shape[-1])
    if not isinstance(other, (np.generic, np.ndarray, jax.Array, check.StandIn)):
        return NotImplemented
    array = check.as_float_array(other, "Components: other")
    check.require_same_dtype(Components=x, other=array)
    parts = [array[()]] if isinstance(other, np.generic) else _parts(array, x.shape[-1])
    return of(parts * x.shape[-1] if len(parts) == 1 else parts)


def _parts(array, n):
    """The components of an array (*batch, n), (*batch, 1) or ()."""
    array = array if array.ndim else array.reshape((1,))
    if array.shape[-1] not in (1, n):
        raise ValueError(f"Components: other: expected shape (*batch, {n}) or (*batch, 1), got {array.shape}")
    return as_components(array).components


def _each(operation, a, b):
    batch = check.common_batch_shape(left=a.shape[:-1], right=b.shape[:-1])
    return _compiled(operation, *check.broadcast_batch(batch, a, b))


def _combined(operation, a, b):
    return of([operation(x, y) for x, y in zip(a.components, b.components, strict=True)])


_compiled = jax.jit(_combined, static_argnums=0, inline=True)
_product = functools.partial(folding.multiply, Precision.REPRODUCIBLE)


def _shown(leaf):
    """A number, the shape of more or of something not computed yet."""
    concrete = isinstance(leaf, (np.ndarray, jax.Array)) and not isinstance(leaf, jax.core.Tracer)
    if concrete and leaf.ndim == 0:
        return f"Array({np.asarray(leaf)})"
    if hasattr(leaf, "shape") and hasattr(leaf, "dtype") and not isinstance(leaf, DoubleWord):
        return f"{np.dtype(leaf.dtype).name}[{','.join(map(str, leaf.shape))}]"
    return repr(leaf)

"""An index of an array (*batch, n) apart: that of the batch, and that of the components."""

from typing import Any

import numpy as np

from jaxspatial.arithmetic import check


def split(index: Any, ndim: int) -> tuple[tuple[Any, ...], Any]:
    """An index as that of the batch and that of the components, the latter None where they do not stay apart."""
    index = index if isinstance(index, tuple) else (index,)
    given = [i for i in index if i is not Ellipsis]
    if len(given) > ndim or any(i is None or _is_mask(i) for i in given):
        return (), None
    before = next((k for k, i in enumerate(index) if i is Ellipsis), len(index))
    *batch, last = *index[:before], *[slice(None)] * (ndim - len(given)), *index[before + 1 :]
    return tuple(batch), _which(last, is_alone=all(isinstance(i, (int, slice)) for i in batch))


def without_batch(index: Any) -> Any:
    """Of an index [..., i, j] the last: what is known goes with any batch."""
    has_rank = isinstance(index, tuple) and len(index) > 2 and index[0] is Ellipsis and index[-1] is not None
    return index[-1:] if has_rank else index


def _is_mask(i: Any) -> bool:
    return isinstance(i, bool) or (isinstance(i, check.ARRAYS) and i.dtype == np.bool_)


def _which(i: Any, is_alone: bool) -> Any:
    """The index of components as an int, a slice or a list; None for traced ones, and lists beside arrays."""
    if isinstance(i, (int, np.integer)):
        return int(i)
    is_list = is_alone and isinstance(i, (list, np.ndarray)) and np.ndim(i) == 1
    return i if isinstance(i, slice) else np.asarray(i) if is_list else None

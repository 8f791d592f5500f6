"""Programs over batches: the one place where what `vmap`, `jvp` and transposition do to an algorithm is decided.

An algorithm is one primitive. Its formula sees one axis of states, innermost in memory, however many times and along
whichever axes a caller maps it: (L, W, B), L joints along a chain, W chains side by side, B states. A batch that
leaves the cache runs in blocks that stay in it, on processors.

Derivatives are programs as well, made of the same formula, which they run again: what they keep are the arguments. The
tangent of a program is linear, its transpose the pull-back; of these there are tangents and pull-backs again, to any
order.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jax.interpreters import partial_eval as pe

# How many states run side by side: enough for long loops, few enough for the cache; and how many numbers of results.
LARGEST_BLOCK, SMALLEST_BLOCK, NUMBERS = 2048, 64, 2**18


class Program:
    """What is run: `evaluate(*arrays)`, of arrays (B, ...), or (1, ...) where all states share one, to a list of these.

    `outputs(avals, sizes)`: shape, without the batch, and dtype of the results, of arguments without it, with so many
    states of each.
    """

    # How many states make a block, on processors.
    block = LARGEST_BLOCK

    @functools.cached_property
    def _made(self):
        """What is made of a program lives as long as it does: derivatives and traces."""
        return {}

    def made(self, key, maker):
        if key not in self._made:
            self._made[key] = maker()
        return self._made[key]

    def tangent(self, moving):
        return self.made(("tangent", moving), lambda: Tangent(self, moving))

    def pullback(self, moving):
        return self.made(("pullback", moving), lambda: Pullback(self, moving))

    def traced(self, avals):
        """Traced once for the same shapes."""
        key = tuple((a.shape, np.dtype(a.dtype).name) for a in avals), bool(jax.config.jax_enable_x64)
        return self.made(key, lambda: _Traced(self, avals))

    def evaluate(self, *arrays):
        raise NotImplementedError

    def outputs(self, avals, sizes):
        raise NotImplementedError

    def owner(self, i):
        """The argument that result i is the cotangent of: it has its batch. None for results over all states."""
        return None

    def takes_cotangent(self, i):
        """Whether argument i is a cotangent: of states that only fill a block up it is 0."""
        return False

    def needs_own(self, i):
        """Whether argument i has to be one for every state, as its cotangents are not to be added up."""
        return False

    def jvp(self, primals, tangents, n_batch):
        """(results, their tangents)."""
        moving = tuple(not is_zero(t) for t in tangents)
        given = [t for t in tangents if not is_zero(t)]
        return bind(self, primals, n_batch), bind(self.tangent(moving), [*primals, *given], n_batch)

    def transposed(self, cotangents, arguments, n_batch):
        """The cotangents of the arguments that are linear, None for others."""
        linear = tuple(map(ad.is_undefined_primal, arguments))
        at = [_zeros(x.aval) if is_linear else x for x, is_linear in zip(arguments, linear, strict=True)]
        return _placed(linear, bind(self.pullback(linear), [*at, *cotangents], n_batch))


class Derived(Program):
    """Of another program, with respect to the arguments that `moving` tells."""

    def __init__(self, of, moving):
        self.of, self.moving = of, moving

    @property
    def block(self):
        return min(self.of.block, 512)

    def _split(self, arrays):
        """(the arguments of the program, what comes behind them)."""
        n = len(self.moving)
        return list(arrays[:n]), list(arrays[n:])

    def _chosen(self, arguments):
        return [x for x, yes in zip(arguments, self.moving, strict=True) if yes]

    def _of_chosen(self, arguments):
        """The program as a function of the arguments that move."""

        def run(*chosen):
            found = iter(chosen)
            return self.of.evaluate(*(next(found) if yes else x for x, yes in zip(arguments, self.moving, strict=True)))

        return run


class Tangent(Derived):
    """(arguments, tangents of those that move) -> the tangents of the results: linear in the latter."""

    def evaluate(self, *arrays):
        arguments, tangents = self._split(arrays)
        both = [_alike(x, t) for x, t in zip(self._chosen(arguments), tangents, strict=True)]
        return jax.jvp(self._of_chosen(arguments), *zip(*both, strict=True))[1]

    def outputs(self, avals, sizes):
        n = len(self.moving)
        return self.of.outputs(avals[:n], sizes[:n])

    def transposed(self, cotangents, arguments, n_batch):
        at, tangents = self._split(arguments)
        linear = list(map(ad.is_undefined_primal, tangents))
        places = [i for i, yes in enumerate(self.moving) if yes]
        moving = tuple(i in [p for p, yes in zip(places, linear, strict=True) if yes] for i in range(len(at)))
        at = [
            _over(x, tangents[places.index(i)].aval, n_batch) if yes else x
            for i, (x, yes) in enumerate(zip(at, moving, strict=True))
        ]
        found = bind(self.of.pullback(moving), [*at, *cotangents], n_batch)
        return [*[None] * len(at), *_placed(linear, found)]


class Pullback(Derived):
    """(arguments, cotangents of the results) -> the cotangents of the arguments that move."""

    def evaluate(self, *arrays):
        arguments, cotangents = self._split(arrays)
        run = self._of_chosen(arguments)
        n = max((x.shape[0] for x in arrays), default=1)

        def over_all(*chosen):
            return [jnp.broadcast_to(y, (n, *y.shape[1:])) for y in run(*chosen)]

        cotangents = [jnp.broadcast_to(c, (n, *c.shape[1:])) for c in cotangents]
        return list(jax.vjp(over_all, *self._chosen(arguments))[1](cotangents))

    def outputs(self, avals, sizes):
        return [(a.shape, a.dtype) for a in self._chosen(avals[: len(self.moving)])]

    def owner(self, i):
        return [j for j, yes in enumerate(self.moving) if yes][i]

    def takes_cotangent(self, i):
        return i >= len(self.moving)

    def needs_own(self, i):
        return i < len(self.moving) and self.moving[i]


def is_zero(tangent):
    return type(tangent) is ad.Zero


def no_tangent(x):
    return ad.Zero(jax.typeof(x).to_tangent_aval())


def over_own(x, aval):
    """A cotangent over the batch of what it is the cotangent of."""
    axes = [k for k, (a, b) in enumerate(zip(x.shape, aval.shape, strict=True)) if a != b]
    return x.sum(axes, keepdims=True) if axes else x


def _zeros(aval):
    return lax.full(aval.shape, 0, aval.dtype)


def _placed(linear, found):
    found = iter(found)
    return [next(found) if yes else None for yes in linear]


def _alike(x, t):
    shape = np.broadcast_shapes(x.shape, t.shape)
    return jnp.broadcast_to(x, shape), jnp.broadcast_to(t, shape)


def _over(x, aval, n_batch):
    """x over the batch of its tangent."""
    shape = np.broadcast_shapes(x.shape[:n_batch], aval.shape[:n_batch])
    return jnp.broadcast_to(x, (*shape, *x.shape[n_batch:]))


# -- the primitive ----------------------------------------------------------------------------------------------------


def bind(program, arrays, n_batch):
    """The results (*batch, ...) of arrays that have n_batch axes in front, of size 1 where they do not vary."""
    arrays = [c if not is_zero(c) else _zeros(c.aval) for c in arrays]
    return list(_program_p.bind(*arrays, program=program, n_batch=n_batch))


def _common(shapes):
    return np.broadcast_shapes(*shapes)


def _abstract(*avals, program, n_batch):
    batch = _common([a.shape[:n_batch] for a in avals])
    items = [jax.ShapeDtypeStruct(a.shape[n_batch:], a.dtype) for a in avals]
    size = block_size(math.prod(batch), program.block)
    sizes = [size if math.prod(a.shape[:n_batch]) > 1 else 1 for a in avals]
    specs = [a.sharding.spec for a in avals]
    common = [next((s[k] for s in specs if s[k] is not None), None) for k in range(n_batch)]
    varying = frozenset().union(*(a.mat.varying for a in avals))
    found = []
    for i, (shape, dtype) in enumerate(program.outputs(items, sizes)):
        owner = program.owner(i)
        if owner is not None:
            found.append(avals[owner].update(weak_type=False))
            continue
        spec = jax.sharding.PartitionSpec(*common, *[None] * len(shape))
        like = avals[0]
        aval = like.update(
            shape=(*batch, *shape),
            dtype=dtype,
            weak_type=False,
            sharding=like.sharding.update(spec=spec),
        )
        if varying:
            aval = aval.update(manual_axis_type=like.mat.update(varying=varying)) if hasattr(like, "mat") else aval
        found.append(aval)
    return found


def _jvp(primals, tangents, *, program, n_batch):
    return program.jvp(list(primals), list(tangents), n_batch)


def _transpose(cotangents, *arguments, program, n_batch):
    return program.transposed(list(cotangents), list(arguments), n_batch)


def _batch(arrays, axes, *, program, n_batch):
    """The new axis in front of those there are."""
    size = next(x.shape[axis] for x, axis in zip(arrays, axes, strict=True) if axis is not None)
    arrays = [_moved(x, axis, size, program.needs_own(i)) for i, (x, axis) in enumerate(zip(arrays, axes, strict=True))]
    found = bind(program, arrays, n_batch + 1)
    return found, [0] * len(found)


def _moved(x, axis, size, is_own):
    if axis is not None:
        return jnp.moveaxis(x, axis, 0)
    return jnp.broadcast_to(x, (size, *x.shape)) if is_own else x[None]


# -- running it -------------------------------------------------------------------------------------------------------


def run(program, n_batch, in_blocks, *arrays):
    """With one axis of states, in blocks where so asked."""
    batch = _common([x.shape[:n_batch] for x in arrays])
    flat = [_flat(x, n_batch, batch) for x in arrays]
    found = _in_blocks(program, program.block if in_blocks else None, math.prod(batch), flat)
    return [_unflat(y, program.owner(i), arrays, n_batch, batch) for i, y in enumerate(found)]


def _flat(x, n_batch, batch):
    """(B, ...), or (1, ...) where no axis of the batch varies."""
    own = x.shape[:n_batch]
    if math.prod(own) > 1 and own != batch:
        x, own = jnp.broadcast_to(x, (*batch, *x.shape[n_batch:])), batch
    return x.reshape((math.prod(own), *x.shape[n_batch:]))


def _unflat(y, owner, arrays, n_batch, batch):
    if owner is None:
        return y.reshape((*batch, *y.shape[1:]))
    own = arrays[owner].shape[:n_batch]
    if y.shape[0] == math.prod(own):
        return y.reshape((*own, *y.shape[1:]))
    whole = y.reshape((*batch, *y.shape[1:]))
    over = [k for k, (a, b) in enumerate(zip(own, batch, strict=True)) if a != b]
    return whole.sum(over, keepdims=True) if over else whole


def block_size(n, block):
    """How many of n states make a block."""
    return -(-n // -(-n // block)) if n else n


def _in_blocks(program, block, n, arrays):
    n_blocks = -(-n // block) if block else 1
    if n_blocks < 2:
        return program.traced([_aval(x) for x in arrays])(*arrays)
    size = block_size(n, block)
    varies = [x.shape[0] > 1 for x in arrays]
    filled = [
        _blocks(x, size, n_blocks, program.takes_cotangent(i)) if yes else x
        for i, (x, yes) in enumerate(zip(arrays, varies, strict=True))
    ]
    avals = [_aval(x[0] if yes else x) for x, yes in zip(filled, varies, strict=True)]
    one = program.traced(avals)
    adds = [program.owner(i) is not None and not varies[program.owner(i)] for i in range(len(one.out_avals))]

    def body(sums, own):
        own = iter(own)
        found = one(*(next(own) if yes else x for x, yes in zip(filled, varies, strict=True)))
        sums = [s + y for s, y in zip(sums, [y for y, yes in zip(found, adds, strict=True) if yes], strict=True)]
        return sums, [y for y, yes in zip(found, adds, strict=True) if not yes]

    start = [_zeros(a) for a, yes in zip(one.out_avals, adds, strict=True) if yes]
    sums, stacked = lax.scan(body, start, [x for x, yes in zip(filled, varies, strict=True) if yes])
    sums, stacked = iter(sums), iter(stacked)
    return [next(sums) if yes else _joined(next(stacked), n) for yes in adds]


def _blocks(x, size, n_blocks, is_cotangent):
    """(n_blocks, size, ...): filled up with the last state, and zeros of its cotangents."""
    missing = size * n_blocks - x.shape[0]
    if missing:
        last = jnp.broadcast_to(x[-1:], (missing, *x.shape[1:]))
        x = jnp.concatenate([x, jnp.zeros_like(last) if is_cotangent else last])
    return x.reshape((n_blocks, size, *x.shape[1:]))


def _joined(x, n):
    return x.reshape((-1, *x.shape[2:]))[:n]


def _aval(x):
    return jax.ShapeDtypeStruct(x.shape, x.dtype)


class _Traced:
    """The trace of a program, without what its results do not need."""

    def __init__(self, program, avals):
        def flat(*arrays):
            return list(program.evaluate(*arrays))

        closed = jax.make_jaxpr(flat)(*avals)
        jaxpr, _ = pe.dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars), instantiate=True)
        self.run = jax.extend.core.jaxpr_as_fun(jax.extend.core.ClosedJaxpr(jaxpr, closed.consts))
        self.out_avals = closed.out_avals

    def __call__(self, *arrays):
        return self.run(*arrays)


def _lowering(in_blocks):
    def rule(context, *arrays, program, n_batch):
        """Without shardings and manual axes in the types: the arithmetic is elementwise, for the compiler to split."""
        with jax.sharding.use_abstract_mesh(_NO_MESH):
            plain = [jax.core.ShapedArray(a.shape, a.dtype) for a in context.avals_in]
            evaluated = mlir.lower_fun(functools.partial(run, program, n_batch, in_blocks), multiple_results=True)
            return evaluated(context.replace(avals_in=plain), *arrays)

    return rule


@functools.lru_cache(maxsize=64)
def _compiled(program, n_batch):
    """The program on its own, for calls outside of any transformation."""
    return jax.jit(functools.partial(_program_p.bind, program=program, n_batch=n_batch))


_NO_MESH = jax.sharding.AbstractMesh((), ())
_program_p = Primitive("jaxspatial_program")
_program_p.multiple_results = True
_program_p.def_abstract_eval(_abstract)
_program_p.def_impl(lambda *arrays, program, n_batch: _compiled(program, n_batch)(*arrays))
mlir.register_lowering(_program_p, _lowering(False))
mlir.register_lowering(_program_p, _lowering(True), platform="cpu")
ad.primitive_jvps[_program_p] = _jvp
ad.primitive_transposes[_program_p] = _transpose
batching.primitive_batchers[_program_p] = _batch

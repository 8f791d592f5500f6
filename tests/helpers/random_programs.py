"""Programs drawn at random, in which operations of the library stand beside a caller's own arithmetic.

A compiler sees one program, and merges, contracts and moves what it likes. So a drawn program has products, sums and
constants of the caller's before, beside and behind operations of the library, and runs in a transformation that is
drawn, too. All that goes into an operation of the library is known to the last bit: the caller's part is evaluated by
NumPy, and nothing is drawn that a compiler may round in two ways, as the sum of a product. What comes out is compared
with exact rationals, or, where bits are promised, with the bits that the operation gives on its own.
"""

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxspatial as js
from jaxspatial.measure import error
from jaxspatial.measure.error import rationals
from jaxspatial.measure.operation import OPERATIONS as MEASURED
from jaxspatial.numerics.errorfree import transforms
from jaxspatial.numerics.errorfree.barrier import barrier, product, quotient


class Value(NamedTuple):
    """What a program computes: its bits, None where these are not known, and what the caller may do with it."""

    bits: Any
    is_product: bool = False  # a sum of it may be contracted
    has_constant: bool = False  # with another constant a compiler may combine it


class Operation(NamedTuple):
    """An operation of the library on so many arrays, and what holds for (operands, results): an array of masks."""

    n: int
    call: Callable[..., Any]
    holds: Callable[..., Any]
    bits: Callable[..., Any] | None = None  # the results in NumPy, where the operands decide on their bits
    is_vector: bool = False  # whether operands are vectors of three


def _with_error(operation):
    """(the rounded result of an operation, its error, which is a number of the format)."""

    def bits(a, b):
        rounded = operation(a, b)
        return rounded, (operation(rationals(a), rationals(b)) - rationals(rounded)).astype(a.dtype)

    return bits


def _has_bits(bits, operands, results):
    expected = bits(*operands)
    return np.array([x == y for x, y in zip(expected, results, strict=True) if y is not None])


def _exactly(call, operation):
    """Of two numbers an operation with its error."""
    bits = _with_error(operation)
    return Operation(2, call, functools.partial(_has_bits, bits), bits)


def _is_near(bound, formula, operands, results):
    """Within so many u^2 of the exact value."""
    value = functools.reduce(lambda x, y: x + y, map(rationals, results))
    expected = formula(*map(rationals, operands))
    return abs(value - expected) <= bound * error.unit_roundoff(operands[0].dtype) ** 2 * abs(expected)


def _keeps_promise(name, mag2, operands, results):
    """u |r| + mag2 u^2 mag, see `Promise`."""
    value, mag = MEASURED[name].exactly(*operands)[0]
    u = error.unit_roundoff(operands[0].dtype)
    return abs(rationals(results[0]) - value) <= u * abs(value) + mag2 * u * u * mag


def _is_within_an_ulp(name, operands, results):
    return error.in_ulps(results[0], MEASURED[name].exactly(*operands)[0][0]) <= 1


def _double_word(operation):
    return lambda a, b: operation(js.to_double_word(a), b).limbs


def _shift(precision):
    return lambda tau, f, p: js.shift(js.SpatialForce(tau, f), p, precision=precision).tau


def _dot(precision):
    return lambda tau, f, w, v: js.dot(js.SpatialForce(tau, f), js.SpatialVelocity(w, v), precision=precision)


def _from_outside(operation):
    """What works on numbers of the library's own: those of a caller are brought behind a barrier first."""
    return lambda *x: operation(*map(barrier, x))


def _bitwise(n, call, formula, is_vector=True):
    """The bits of a formula in NumPy."""

    def bits(*operands):
        return [np.asarray(formula(*operands))]

    return Operation(n, call, functools.partial(_has_bits, bits), bits, is_vector)


def _dot_in_numpy(tau, f, w, v):
    def of_three(a, b):
        return (a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]) + a[..., 2] * b[..., 2]

    return of_three(tau, w) + of_three(f, v)


def _sum(f, g):
    return (js.SpatialForce(f, g) + js.SpatialForce(g, f)).tau


OPERATIONS = {
    "two_product": _exactly(_from_outside(transforms.two_product), operator.mul),
    "two_sum": _exactly(_from_outside(transforms.two_sum), operator.add),
    "double word times word": _exactly(_double_word(operator.mul), operator.mul),
    "double word plus word": _exactly(_double_word(operator.add), operator.add),
    "double word over word": Operation(
        2, _double_word(operator.truediv), functools.partial(_is_near, 3, operator.truediv)
    ),
    "product": _bitwise(2, _from_outside(product), np.multiply, False),
    "quotient": _bitwise(2, _from_outside(quotient), np.divide, False),
    "shift": _bitwise(3, _shift("reproducible"), lambda tau, f, p: tau - np.cross(p, f)),
    "dot": _bitwise(4, _dot("reproducible"), _dot_in_numpy),
    "sum": _bitwise(2, _sum, np.add),
    "compensated shift": Operation(
        3, _shift("compensated"), functools.partial(_keeps_promise, "shift_force", 4), is_vector=True
    ),
    "faithful shift": Operation(
        3, _shift("faithful"), functools.partial(_is_within_an_ulp, "shift_force"), is_vector=True
    ),
    "compensated dot": Operation(4, _dot("compensated"), functools.partial(_keeps_promise, "dot", 8), is_vector=True),
    "faithful dot": Operation(4, _dot("faithful"), functools.partial(_is_within_an_ulp, "dot"), is_vector=True),
}

N_ARGUMENTS = 4
SURROUNDINGS = (
    "jit",
    "vmap",
    "vmap of the last axis",
    "scan",
    "scan with a carry",
    "map",
    "fori",
    "while",
    "cond",
    "switch",
    "checkpoint",
    "donated",
)


class Program:
    """One program: steps over the numbers of an item, in a surrounding that runs it for n items."""

    def __init__(self, seed: int):
        self.seed, self.rng = seed, (rng := np.random.default_rng(seed))
        self.dtype = np.dtype(rng.choice(["float32", "float64"], p=[0.3, 0.7]))
        self.surrounding = str(rng.choice(SURROUNDINGS))
        self.is_vector = bool(rng.integers(3))
        self.size = 3 if self.is_vector else int(rng.choice([0, 8]))
        self.n = int(rng.choice([5, 20]))
        shape = (N_ARGUMENTS, self.n, self.size) if self.size else (N_ARGUMENTS, self.n)
        reach = 10 if self.dtype == np.float32 else 100
        scales = 2.0 ** rng.integers(-reach, reach, shape)
        self.arguments = (rng.standard_normal(shape) * (scales if rng.integers(2) else 1)).astype(self.dtype)
        self.values = [Value(x) for x in self._of_items()]
        self.steps: list[Callable[..., list[Any]]] = []
        # (name, operation, operands, where its results are) of every operation of the library
        self.checks: list[tuple[str, Operation, list[Any], list[int]]] = []
        self.beside: list[int] = []
        for _ in range(int(rng.integers(2, 9))):
            self._draw_own() if rng.integers(2) else self._draw_of_library()
        for _ in range(int(rng.integers(1, 4))):
            self._draw_of_library()
        for _ in range(int(rng.integers(0, 5))):
            self._draw_beside()
        self.returned = self._drawn_results()

    def _of_items(self):
        """The arguments of all items; the first as that of the item before, where it is carried."""
        if self.surrounding != "scan with a carry":
            return list(self.arguments)
        first = np.concatenate([self.arguments[0, -1:], self.arguments[0, :-1]])
        return [first, *self.arguments[1:]]

    # -- steps --------------------------------------------------------------------------------------------------------

    def _place(self, allowed=lambda value: True):
        """One of the values whose bits are known; the last ones oftener."""
        places = [i for i, v in enumerate(self.values) if v.bits is not None and allowed(v)]
        return int(places[-1 - min(int(self.rng.exponential(3)), len(places) - 1)])

    def _add(self, step, *values):
        self.steps.append(step)
        self.values += values

    def _draw_own(self):
        """One of the caller's: a product, a sum, a product or sum with a constant, reversed, one for all, negative."""
        kinds = ["times", "times", "plus", "times constant", "constant", "reversed", "one for all", "negative"]
        kind = str(self.rng.choice(kinds))
        if kind == "times":
            i, j = self._place(), self._place()
            a, b = self.values[i], self.values[j]
            if not (a.has_constant and b.has_constant):
                bits = a.bits * b.bits
                return self._add(lambda x: [x[i] * x[j]], Value(bits, True, a.has_constant or b.has_constant))
        if kind == "plus":
            i, j = (self._place(lambda v: not (v.is_product or v.has_constant)) for _ in range(2))
            return self._add(
                lambda x: [x[i] + x[j]], Value(self.values[i].bits + self.values[j].bits, has_constant=True)
            )
        if kind == "times constant":
            i, c = self._place(lambda v: not v.has_constant), self.dtype.type(self.rng.choice([0.1, 0.7, -3.0, 1 / 3]))
            return self._add(lambda x: [x[i] * c], Value(self.values[i].bits * c, True, True))
        if kind == "constant":
            i, c = self._place(), self.dtype.type(self.rng.choice([0.7, -1.3, 2.0, 1 / 3]))
            return self._add(
                lambda x: [jnp.full_like(x[i], c)], Value(np.full_like(self.values[i].bits, c), False, True)
            )
        if kind == "reversed" and self.size:
            i = self._place()
            return self._add(lambda x: [x[i][..., ::-1]], self.values[i]._replace(bits=self.values[i].bits[..., ::-1]))
        if kind == "one for all" and self.size:
            i = self._place()
            first = np.broadcast_to(self.values[i].bits[..., :1], self.values[i].bits.shape)
            # XLA combines it with constants: x (c y) of (x c) y.
            value = self.values[i]._replace(bits=first, has_constant=True)
            return self._add(lambda x: [jnp.broadcast_to(x[i][..., :1], x[i].shape)], value)
        i = self._place()
        return self._add(lambda x: [-x[i]], self.values[i]._replace(bits=-self.values[i].bits))

    def _draw_of_library(self):
        names = [name for name, o in OPERATIONS.items() if not o.is_vector or self.is_vector]
        name = str(self.rng.choice(names))
        operation = OPERATIONS[name]
        places = [self._place() for _ in range(operation.n)]
        operands = [self.values[i].bits for i in places]
        is_quotient = name in ("quotient", "double word over word")
        if is_quotient and not operands[1].all():
            return
        results = operation.bits and operation.bits(*operands)
        if results and not all(map(_is_usual, results)):
            return
        n_results = len(results) if results else len(self._shapes(operation, operands))
        at = list(range(len(self.values), len(self.values) + n_results))
        self.checks.append((name, operation, operands, at))
        is_known = results and results[0].shape == operands[0].shape
        self._add(
            lambda x: jax.tree.leaves(operation.call(*(x[i] for i in places))),
            *(Value(y, has_constant=True) for y in (results if results and is_known else [None] * n_results)),
        )

    @staticmethod
    def _shapes(operation, operands):
        return jax.tree.leaves(jax.eval_shape(operation.call, *operands))

    def _draw_beside(self):
        """What the caller makes of a result, and of the same numbers: nobody looks at it, but the compiler."""
        of_library = [k for *_, at in self.checks for k in at if self.values[k].bits is not None]
        if not of_library:
            return
        i, j = int(self.rng.choice(of_library)), self._place()
        k = self._place()
        kind = int(self.rng.integers(4))
        step = [
            lambda x: [x[i] * x[j]],
            lambda x: [x[i] + x[j] * x[k]],
            lambda x: [x[j] * x[k]],
            lambda x: [x[i] * x[j] - x[k]],
        ][kind]
        self._add(step, Value(None))
        self.beside.append(len(self.values) - 1)

    def _drawn_results(self):
        """Of every operation of the library all its results, or some alone; and what stands beside."""
        returned = []
        for _, operation, _, at in self.checks:
            taken = [k for k in at if operation.bits is None or self.rng.integers(3)]
            returned += taken or [at[-1]]
        return sorted({*returned, *self.beside})

    # -- running it ---------------------------------------------------------------------------------------------------

    def item(self, *arguments):
        values = list(arguments)
        for step in self.steps:
            values += step(values)
        return [values[k] for k in self.returned]

    def function(self):
        """Of (4, n, ...) arguments, one result for each that is returned: (n, ...)."""
        item, n = self.item, self.n

        def at(x, i):
            return [lax.dynamic_index_in_dim(y, i, keepdims=False) for y in x]

        def like(x):
            shapes = jax.eval_shape(jax.vmap(item), *x)
            return [jnp.zeros(s.shape, s.dtype) for s in shapes]

        def stored(i, found, x):
            return [y.at[i].set(z) for y, z in zip(found, item(*at(x, i)), strict=True)]

        def with_carry(x):
            def body(carry, y):
                return y[0], item(carry, *y[1:])

            return lax.scan(body, x[0][-1], tuple(x))[1]

        def chosen(*x):
            return [-y for y in item(*x)]

        by_name = {
            "jit": lambda x: item(*x),
            "donated": lambda x: item(*x),
            "vmap": lambda x: jax.vmap(item)(*x),
            "vmap of the last axis": lambda x: jax.vmap(item, -1, 0)(*(jnp.moveaxis(y, 0, -1) for y in x)),
            "scan": lambda x: lax.scan(lambda c, y: (c, item(*y)), 0, tuple(x))[1],
            "scan with a carry": with_carry,
            "map": lambda x: lax.map(lambda y: item(*y), tuple(x)),
            "fori": lambda x: lax.fori_loop(0, n, lambda i, found: stored(i, found, x), like(x)),
            "while": lambda x: lax.while_loop(
                lambda s: s[0] < n, lambda s: (s[0] + 1, stored(s[0], s[1], x)), (0, like(x))
            )[1],
            "cond": lambda x: lax.cond(x[0].ravel()[0] < np.inf, item, chosen, *x),
            "switch": lambda x: lax.map(
                lambda y: lax.switch((y[0].ravel()[0] >= np.inf).astype(np.int32), [item, chosen], *y), tuple(x)
            ),
            "checkpoint": lambda x: jax.checkpoint(item)(*x),
        }
        return by_name[self.surrounding]

    def run(self, **options: Any):
        donated = {"donate_argnums": 0} if self.surrounding == "donated" else {}
        # Copies: what is donated may be written to.
        found = jax.jit(self.function(), **donated, **options)([jnp.array(x) for x in self.arguments])
        return [np.asarray(x) for x in found]

    def wrong(self, found: list[np.ndarray]):
        """(operation, how many numbers of its results are not what they must be) for all that have some."""
        results = dict(zip(self.returned, found, strict=True))
        wrong = []
        for name, operation, operands, at in self.checks:
            count = int(np.sum(~np.asarray(operation.holds(operands, [results.get(k) for k in at]), bool)))
            if count:
                wrong.append((name, count))
        return wrong


def _is_usual(x: np.ndarray):
    """Neither so small that errors of products are lost, nor so large that they overflow."""
    exponent = np.frexp(x)[1][x != 0]
    reach = 40 if x.dtype == np.float32 else 400
    return (abs(exponent) < reach).all()

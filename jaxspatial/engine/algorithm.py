"""Calls algorithms: a formula over a MechanismState becomes a function of a mechanism and arrays.

    @algorithm(*BODIES, "gravity")
    def _potential_energy(state): ...

    _potential_energy(precision, mechanism, q)

NumPy numbers of the mechanism are constants of the program, which is compiled once for their values; while tracing, so
are NumPy arrays of coordinates. A program depends only on the fields of the mechanism that its formula reads. It
computes with the numbers that the precision requires, see `numerics.numbers`, and rounds once at the end.
"""

import functools
import inspect
import warnings
import weakref
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxspatial.engine import program
from jaxspatial.engine.derivatives import Differentiable
from jaxspatial.engine.program import Aval
from jaxspatial.engine.stacking import Array, Shape
from jaxspatial.engine.state import MechanismState, is_vector
from jaxspatial.mechanism import AppliedForces, Mechanism
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check, floats, numbers
from jaxspatial.numerics.errorfree.barrier import barrier_or_nan
from jaxspatial.numerics.errorfree.primitives import computed_at_once, is_zero, same_sharding
from jaxspatial.numerics.formula import from_outside
from jaxspatial.numerics.numbers import components
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.quantity import tree_of
from jaxspatial.numerics.types import named
from jaxspatial.spatial import SpatialForce

# The fields of a mechanism that algorithms read, by subject.
JOINTS = ("axes", "second_axes", "pitches", "parameters", "mimics")
GEOMETRY = ("placements", *JOINTS)
BODIES = (*GEOMETRY, "inertias")
DYNAMICS = (*BODIES, "armature", "gravity")
FRAMES = ("child_placements", "frame_placements")

# What callers pass: SpatialForces by name of a frame, or AppliedForces, or several of these in a list, which add up.
_OneSource = dict[str, SpatialForce] | AppliedForces | None
ExternalForces = _OneSource | Sequence[_OneSource]
if not TYPE_CHECKING:
    ExternalForces = named("ExternalForces", ExternalForces)
Frames = int | tuple[int, ...] | None  # by number, None for all bodies
Static = tuple[tuple[str, Any], ...]  # arguments that are no arrays, by name


@tree_of("frames", "in_world")
class WrenchesOnFrames:
    """AppliedForces with numbers in place of names. Numbers of all n frames are side by side: (*batch, 3 n).

    frames: the numbers of the frames. in_world: whether wrenches are in world axes, or in those of their frames.
    tau, f, points: None for known zeros.
    """

    frames: tuple[int, ...]
    in_world: bool
    tau: Array | None
    f: Array | None
    points: Array | None


Wrenches = tuple[WrenchesOnFrames, ...]


def algorithm(
    *reads: str,
    program_class: "type[Algorithm] | None" = None,
    result_shape: Callable[[Topology, dict[str, Any]], Shape | list[Shape]] | None = None,
    at: str = "q",
) -> Callable[[Callable], Any]:
    """Makes of `formula(state, *arrays, **static)` a function of (precision, mechanism, q, *arrays, **static).

    Arguments are checked by their names in the formula, see `checked`. Messages of errors begin with the name of the
    formula, or with `operation` if the caller passes one.

    Args:
        reads: the fields of a Mechanism that the formula uses.
        program_class: the subclass of Algorithm to use, for special rules of differentiation or batching.
        result_shape: a function of the Topology and of the static arguments: the shape of the result without its batch,
            where it is a single array; a list of shapes for a tuple of arrays. No trace is then needed to know it.
        at: the name of the argument q in messages.

    Returns:
        The decorator. q and the arrays are (*batch, n), with batch shapes that broadcast, or trees of such arrays.
    """

    def decorated(formula):
        formula.result_shape = result_shape
        formula.program_class = program_class or Algorithm
        names, name = [at, *list(inspect.signature(formula).parameters)[1:]], formula.__name__.lstrip("_")

        @functools.wraps(formula)
        def call(precision, mechanism: Mechanism, *arrays, operation: str = name, **static):
            arguments = checked(operation, mechanism, **dict(zip(names, arrays, strict=False)), **static)
            options = tuple(sorted(zip(static, arguments[len(arrays) :], strict=True)))
            fields = {name: getattr(mechanism, name) for name in reads}
            leaves, tree = jax.tree.flatten((fields, arguments[: len(arrays)]))
            trees, is_rigid = (tree, tree.children()[0]), not len(mechanism.topology)
            return run_formula(
                operation, formula, resolve(precision), mechanism, reads, leaves, *trees, options, is_rigid
            )

        vars(call).update(formula=formula)
        return call

    return decorated


# -- arguments --------------------------------------------------------------------------------------------------------

# What functions of ours pass for velocities or accelerations that are zero and cost nothing. Callers may not leave an
# array out: None is refused.
NO_ARRAY = object()


def checked_mechanism(operation: str, mechanism: object) -> Mechanism:
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"{operation}: expected a Mechanism first, got {type(mechanism).__name__}")
    if mechanism._misshapen:
        raise ValueError(f"{operation}: mechanism: {mechanism._misshapen}")
    return mechanism


def checked(operation: str, mechanism: object, **arguments) -> tuple:
    """Checks and converts the arguments of an algorithm, by their names.

    q, q0 and q1 become arrays (*batch, nq), v, vdot and tau (*batch, nv), a time dt or t (*batch, 1), with a common
    dtype and batch shapes that broadcast; external_forces become Wrenches, frames their numbers. NO_ARRAY becomes None.
    Other arguments pass unchanged.
    """
    mechanism = checked_mechanism(operation, mechanism)
    arrays = _arrays(operation, mechanism, {name: x for name, x in arguments.items() if x is not NO_ARRAY})
    data = mechanism._first_data
    by_name = dict(arrays) if data is None else {**arrays, "mechanism": data}
    if "external_forces" in arguments:
        forces, arguments["external_forces"] = _external(operation, mechanism, arguments["external_forces"])
        by_name |= forces
    refuse_double_words(operation, **by_name)
    check.require_same_dtype(**by_name)
    by_name.pop("mechanism", None)
    _require_one_batch(by_name)
    if arguments.get("frames") is not None:
        arguments["frames"] = _frame_numbers(f"{operation}: frames", mechanism, arguments["frames"])
    return tuple(None if x is NO_ARRAY else x for x in {**arguments, **arrays}.values())


def refuse_double_words(operation: str, **arguments) -> None:
    """Algorithms take arrays: only within one do numbers have two limbs, where its precision asks for it."""
    for name, x in arguments.items():
        leaves = [] if isinstance(x, jax.Array) else jax.tree.leaves(x, is_leaf=lambda y: isinstance(y, DoubleWord))
        if any(isinstance(leaf, DoubleWord) for leaf in leaves):
            what = f"{operation}: {name}"
            raise TypeError(f"{what}: expected arrays, got a DoubleWord; from_double_word rounds it to an array")


def _arrays(operation: str, mechanism: Mechanism, arguments: dict[str, Any]) -> dict[str, jax.Array]:
    sizes = dict.fromkeys(("q", "q0", "q1"), mechanism.nq) | dict.fromkeys(("v", "vdot", "tau"), mechanism.nv)
    # Lists of numbers take the dtype of an array beside them.
    dtype = floats.floating_dtype(*(x for name, x in arguments.items() if name in sizes), mechanism._first_data)
    arrays = {
        name: floats.as_vectors(x, f"{operation}: {name}", dtype, sizes[name])
        for name, x in arguments.items()
        if name in sizes
    }
    for name in {"dt", "t"} & arguments.keys():
        dtype = next(iter(arrays.values())).dtype
        arrays[name] = floats.as_float_array(arguments[name], f"{operation}: {name}", dtype)[..., None]
    return arrays


def _external(operation: str, mechanism: Mechanism, forces) -> tuple[dict[str, Any], Wrenches]:
    """(external forces by their names in messages, the same as Wrenches in the order of frames)."""
    if isinstance(forces, tuple) and all(isinstance(x, WrenchesOnFrames) for x in forces):
        return {}, forces  # checked before
    if isinstance(forces, list | tuple):
        parts = [_of_one_source(f"external_forces[{i}]", operation, mechanism, x) for i, x in enumerate(forces)]
        by_name = dict(item for names, _ in parts for item in names.items())
        return by_name, tuple(x for _, wrenches in parts for x in wrenches)
    return _of_one_source("external_forces", operation, mechanism, forces)


def _of_one_source(argument: str, operation: str, mechanism: Mechanism, forces) -> tuple[dict[str, Any], Wrenches]:
    """`_external` of what is no list, and has this name in messages."""
    what, number = f"{operation}: {argument}", functools.partial(mechanism.topology.index, mechanism.frame_names)
    if isinstance(forces, AppliedForces):
        F = floats.narrowed(forces)
        frames = tuple(number(name, f"{what}: frames") for name in F.frames)
        if not frames:
            return {argument: F}, ()
        n, batch = len(frames), F.wrenches.batch_shape
        tau, f, points = (_array_or_none(x, batch, n) for x in (*F.wrenches._vectors, F.points))
        on_frames = WrenchesOnFrames(frames, F.axes == "world", tau, f, points)
        return {argument: F}, (on_frames,)
    if not isinstance(forces, dict | None):
        expected = "SpatialForces in a dict by name of a frame, AppliedForces, or a list of these"
        raise TypeError(f"{what}: expected {expected}, got {type(forces).__name__}")
    by_name = cast(dict[str, Any], forces or {})
    numbers = {name: number(name, what) for name in by_name}
    for name, F in by_name.items():
        if not isinstance(F, SpatialForce):
            raise TypeError(f"{what}[{name!r}]: expected a SpatialForce, got {type(F).__name__}")
    by_name = floats.narrowed(by_name)
    wrenches: list[WrenchesOnFrames] = []
    for name, F in sorted(by_name.items(), key=lambda item: numbers[item[0]]):
        tau, f = (_array_or_none(x, F.batch_shape) for x in F._vectors)
        wrenches.append(WrenchesOnFrames((numbers[name],), True, tau, f, None))
    return {f"{argument}[{name!r}]": F for name, F in by_name.items()}, tuple(wrenches)


def _array_or_none(x, batch_shape: tuple[int, ...], n: int | None = None):
    """The array (*batch, 3); of n frames the last axis of the batch becomes part of the rows: (*batch, 3 n).

    None for Components that are known to be zero, so that no operation on them is left.
    """
    if x is None or (isinstance(x, components.Components) and components.is_zero(x)):
        return None
    array = components.as_array(x, batch_shape)
    return array if n is None else array.reshape((*array.shape[:-2], 3 * n))


def _require_one_batch(arguments: dict[str, Any]) -> None:
    forces = SpatialForce, AppliedForces
    shapes = {name: x.batch_shape if isinstance(x, forces) else x.shape[:-1] for name, x in arguments.items()}
    try:
        floats.common_batch_shape(**shapes)
    except ValueError as error:
        if not any(isinstance(x, SpatialForce) and x.batch_shape for x in arguments.values()):
            raise
        raise ValueError(
            f"{error}; a batch of forces under one name acts on one frame, in as many states: forces on several "
            "frames, or at several points, are AppliedForces(frames, wrenches)"
        ) from None


def _frame_numbers(what: str, mechanism: Mechanism, names) -> int | tuple[int, ...]:
    number = functools.partial(mechanism.topology.index, mechanism.frame_names)
    if isinstance(names, str):
        return number(names, what)
    if not isinstance(names, Iterable):
        raise TypeError(f"{what}: expected the name of a frame, or a sequence of names, got {names!r}")
    result = tuple(number(name, what) for name in cast(Iterable[str], names))
    if not result:
        raise ValueError(f"{what}: expected at least one name, got none")
    return result


# -- the program of an algorithm --------------------------------------------------------------------------------------


class Algorithm(Differentiable):
    """The program of a formula for one topology, with constants in place of some arguments.

    tree: the structure of (fields by name, arrays). known: for each of its leaves a constant, or None for data.
    cache: a weak reference to the ProgramCache that owns this program.
    """

    def __init__(
        self,
        formula,
        precision: Precision,
        cache: "ProgramCache",
        tree,
        known: tuple[np.ndarray | None, ...],
        static: Static,
        dtype: np.dtype,
    ):
        self.formula, self.precision, self.topology, self.tree = formula, precision, cache.topology, tree
        self.known, self.static, self.dtype = known, static, dtype
        self.cache = weakref.ref(cache)
        self.out_tree = None

    @property
    def is_wide(self) -> bool:
        return self.precision.sees_whole_sums

    def from_outside(self, x: jax.Array) -> jax.Array:
        return barrier_or_nan(x) if self.is_wide else from_outside(x, self.precision)

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        state, others = self.state_of(arrays, program.n_states(arrays))
        results = self.formula(state, *others, **dict(self.static))
        rounded = jax.tree.map(state.rounded, results, is_leaf=lambda x: numbers.is_number(x) or is_vector(x))
        leaves, self.out_tree = jax.tree.flatten(rounded)
        return [lax.transpose(y, (y.ndim - 1, *range(y.ndim - 1))) for y in leaves]

    def state_of(self, arrays: Sequence[jax.Array], n: int) -> tuple[MechanismState, list]:
        """(the MechanismState of n states, the arrays after q), of the data of this program."""
        data = (lax.transpose(self.from_outside(x), (*range(1, x.ndim), 0)) for x in arrays)
        fields, (q, *others) = jax.tree.unflatten(self.tree, [next(data) if x is None else x for x in self.known])
        return MechanismState(self.topology, fields, q, n, self.precision, self.dtype), others

    def outputs(self, avals: Sequence[Aval]) -> list[Aval]:
        if self.formula.result_shape is not None:
            shape = self.formula.result_shape(self.topology, dict(self.static))
            shapes = shape if isinstance(shape, list) else [shape]
            self.out_tree = jax.tree.structure((0,) * len(shapes) if isinstance(shape, list) else 0)
            return [Aval(shape, self.dtype) for shape in shapes]
        of_one_state = [Aval((1, *a.shape), a.dtype) for a in avals]
        return [Aval(y.shape[1:], y.dtype) for y in self.traced(of_one_state).out_avals]

    def __call__(self, data: Sequence[jax.Array], n_batch: int):
        leaves = program.bind(self, data, n_batch)
        # Known only now that the program has been traced.
        return jax.tree.unflatten(self.out_tree, leaves)

    def constants(self, data: Sequence[Aval], n_batch: int):
        """The results, with n_batch axes of size 1, where no number of the data is part of them."""

        def computed() -> list[np.ndarray]:
            with computed_at_once():
                arrays = [jnp.zeros((1, *x.shape), x.dtype) for x in data]
                return [np.asarray(y[0]) for y in self.traced([jax.typeof(x) for x in arrays])(*arrays)]

        key = tuple((x.shape, np.dtype(x.dtype).name) for x in data)
        results = self.cached(("constants", key), computed)
        return jax.tree.unflatten(self.out_tree, [y.reshape((*[1] * n_batch, *y.shape)) for y in results])

    # -- programs of other algorithms ---------------------------------------------------------------------------------

    @property
    def n_fields(self) -> int:
        return self.tree.children()[0].num_leaves

    def program_of(self, call, at: int | None = None, arrays: int | None = None, **more) -> "Algorithm":
        """The program of another algorithm, with the same fields and arrays.

        Args:
            call: the other algorithm.
            at: a leaf that is data in the other program, even if it is a constant here.
            arrays: how many arrays the other takes. The first is that of this program, the others are data.
            more: static arguments.
        """

        def made() -> Algorithm:
            known, tree, static = list(self.known), self.tree, self.static
            if at is not None:
                known[at] = None
            if arrays is not None:
                leaves = jax.tree_util.treedef_tuple([jax.tree.structure(0)] * arrays)
                tree = jax.tree_util.treedef_tuple((tree.children()[0], leaves))
                known, static = [*known[: self.n_fields + 1], *[None] * (arrays - 1)], ()
            static = tuple(sorted((*static, *more.items())))
            cache = self.cache() or ProgramCache(self.topology, tuple(known))
            return cache.program(call.formula, self.precision, tree, tuple(known), static, self.dtype)

        return self.cached((call, at, arrays, tuple(sorted(more.items()))), made)

    def place(self, leaf: int) -> int:
        """The index of a leaf among the data."""
        return sum(x is None for x in self.known[:leaf])

    def with_leaf(self, data: Sequence, leaf: int, x) -> list:
        """The data with x in place of a leaf, which may be a constant of this program."""
        place = self.place(leaf)
        return [*data[:place], x, *data[place + (self.known[leaf] is None) :]]

    def tangents(self, primals: Sequence, tangents: Sequence, n_batch: int) -> list:
        """The tangents of the results at tangents of the arguments. None stands for zero in both."""
        moving = tuple(t is not None and not is_zero(t) for t in tangents)
        if not any(moving):
            return [None]
        of_moving = [t for t, yes in zip(tangents, moving, strict=True) if yes]
        return program.bind(self.tangent_program(moving), [*primals, *of_moving], n_batch)


# -- caches of programs -----------------------------------------------------------------------------------------------


class ManyProgramsWarning(UserWarning):
    """One algorithm was compiled for the numbers of many mechanisms of one structure."""


class ProgramCache:
    """The programs that were made for one set of constants: the fields of a mechanism that an algorithm reads.

    Mechanisms with equal constants share one cache, and its programs live as long as such a mechanism. Compiled calls
    are stored here and not in the programs, which JAX's own caches would then keep alive for good. They hold their
    programs: the trace of a caller that has such a call may be all that is left of a mechanism.

    called: of programs that ran on their own, what does not depend on the constants.
    """

    def __init__(self, topology: Topology, known: tuple[np.ndarray | None, ...]):
        self.topology, self.known = topology, known
        self.programs, self.called = dict[Hashable, Algorithm](), set[Hashable]()
        self.calls: dict[Algorithm, Callable[[int, list], Any]] = {}

    def program(self, formula, precision: Precision, tree, known: tuple, static: Static, dtype: np.dtype) -> Algorithm:
        """The program of an algorithm. known: the constants among all leaves of the tree."""
        of_arrays = tuple(map(contents, known[len(self.known) :]))
        key = formula, precision, tree, of_arrays, static, dtype
        if key not in self.programs:
            self.programs[key] = formula.program_class(formula, precision, self, tree, known, static, dtype)
        return self.programs[key]

    def call(self, program: Algorithm) -> Callable[[int, list], Any]:
        """A program as a compiled function of (n_batch, data), outside of any transformation."""
        if program not in self.calls:
            self.calls[program] = jax.jit(lambda n_batch, data: program(data, n_batch), static_argnums=0)
        return self.calls[program]


def contents(x: np.ndarray | None):
    """A hashable copy of a constant."""
    return None if x is None else (x.dtype.str, x.shape, x.tobytes())


# All caches by the contents of their constants. Those without constants serve any mechanism, and are kept for good.
_CACHES: weakref.WeakValueDictionary[Hashable, ProgramCache] = weakref.WeakValueDictionary()
_WITHOUT_CONSTANTS: dict[Hashable, ProgramCache] = {}
# The caches of each mechanism by the fields that are read, found without comparing numbers.
_BY_MECHANISM: weakref.WeakKeyDictionary[Mechanism, dict[tuple[Any, ...], ProgramCache]] = weakref.WeakKeyDictionary()


def program_cache(mechanism: Mechanism | None, reads: tuple, tree, leaves: Sequence) -> ProgramCache:
    """The cache of programs for the fields of a mechanism; None: of programs without one."""
    topology: Any = None if mechanism is None else mechanism.topology.skeleton
    of_mechanism: dict = {} if mechanism is None else _BY_MECHANISM.setdefault(mechanism, {})
    if reads in of_mechanism:
        return of_mechanism[reads]
    known = tuple(x if isinstance(x, np.ndarray) else None for x in leaves)
    key = topology, tree, tuple(map(contents, known))
    cache = _CACHES.setdefault(key, ProgramCache(topology, known))
    if not any(x is not None for x in known):
        _WITHOUT_CONSTANTS[key] = cache
    # Arrays that can be written to are compared in each call: their entry only keeps the cache alive.
    is_fixed = all(x is None or (x.base is None and not x.flags.writeable) for x in known)
    of_mechanism[reads if is_fixed else ("", *reads)] = cache
    return cache


def run_formula(
    operation: str,
    formula: Callable,
    precision: Precision,
    mechanism: Mechanism | None,
    reads: tuple,
    leaves: list,
    tree,
    of_fields,
    static: Static,
    is_rigid: bool = False,
):
    """Runs the program of a formula: as a part of the caller's while that is traced, else as one of its own.

    leaves, tree: of (fields, arrays): numbers of a mechanism and of its surroundings, whose tree is `of_fields`, and
    arrays (*batch, n). reads: says, for a mechanism, which fields these are. is_rigid: whether nothing varies with q
    and v, as without joints.
    """
    n_fields = of_fields.num_leaves
    is_traced = any(isinstance(x, Tracer) for x in leaves)
    batch = floats.broadcast_shapes((), *(x.shape[:-1] for x in leaves[n_fields:]))
    dtype = np.dtype(leaves[n_fields].dtype)
    if is_rigid:
        # The results get the batch at the end.
        for i, x in enumerate(leaves):
            if 0 in x.shape:  # An array without numbers, of one state, is a constant.
                leaves[i] = np.zeros(x.shape if i < n_fields else x.shape[-1:], x.dtype)
    cache = program_cache(mechanism, reads, of_fields, leaves[:n_fields])

    def is_known(x) -> bool:
        return isinstance(x, np.ndarray) and x.ndim == 1 and (is_traced or is_rigid and not x.size)

    known = *cache.known, *(x if is_known(x) else None for x in leaves[n_fields:])
    made = cache.program(formula, precision, tree, known, static, dtype)
    n_batch = len(batch)
    data: list = [_with_batch_axes(x, i < n_fields, n_batch) for i, x in enumerate(leaves) if known[i] is None]
    if is_rigid:
        items = [Aval(x.shape[n_batch:], x.dtype) for x in data]
        is_constant = not data or all(0 in y.shape for y in made.outputs(items))
        results = made.constants(items, n_batch) if is_constant else made(data, n_batch)
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, *x.shape[n_batch:])), results)
    if is_traced:
        return made(data, n_batch)
    _warn_of_many_programs(operation, cache, (formula, tree, static, dtype))
    return cache.call(made)(n_batch, data)


def _with_batch_axes(x, is_field: bool, n_batch: int):
    """The array with n_batch axes in front, those that it lacks of size 1."""
    shape = (1,) * n_batch + x.shape if is_field else (1,) * (n_batch - x.ndim + 1) + x.shape
    return x.reshape(shape) if shape != x.shape else x


def _warn_of_many_programs(operation: str, cache: ProgramCache, key: tuple) -> None:
    """Warns once when one algorithm is compiled for the constants of a fourth mechanism.

    key: the formula, and what else of a program does not depend on these constants.
    """
    if key in cache.called:
        return
    cache.called.add(key)
    if not any(x is not None for x in cache.known):
        return
    same = [c for ref in _CACHES.valuerefs() if (c := ref()) and c.topology == cache.topology and key in c.called]
    if len(same) == 4:
        warnings.warn(
            f"{operation}: compiled for the fourth mechanism of one structure, each for its own numbers. One program "
            "for all of them: mechanism.as_data(), or a jitted function that takes the mechanism as an argument.",
            ManyProgramsWarning,
            stacklevel=5,
        )


def over_batch(function: Callable, *arguments):
    """The function of one state, over the common batch of its arguments: trees of arrays (*batch, n)."""
    leaves, tree = jax.tree.flatten(arguments)
    batch = floats.broadcast_shapes(*(x.shape[:-1] for x in leaves))

    def of_leaves(*leaves):
        return function(*jax.tree.unflatten(tree, leaves))

    for _ in batch:
        of_leaves = jax.vmap(of_leaves)
    arrays = floats.broadcast_batch(batch, *leaves)
    meshes = (jax.typeof(x).sharding.mesh for x in arrays)
    mesh = next((mesh for mesh in meshes if jax.sharding.AxisType.Explicit in mesh.axis_types), None)
    if mesh is None:
        return of_leaves(*arrays)

    def in_mesh(*arrays):
        """What the function makes of its own is of the mesh of its arguments, which may be nobody's context."""
        with jax.sharding.use_abstract_mesh(mesh):
            return of_leaves(*same_sharding(*arrays, components=len(batch)))

    return jax.jit(in_mesh)(*arrays)


def velocity_shape(topology: Topology, _: dict[str, Any]) -> Shape:
    """The shape (nv,) of a result with one number per velocity."""
    return (topology.nv,)

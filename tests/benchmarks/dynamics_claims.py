"""What is asked of the dynamics of robots, and whether what was measured meets it."""

from typing import NamedTuple

import numpy as np

OURS, PINOCCHIO, MUJOCO, FRAX, MJX = "jaxspatial", "Pinocchio C++", "MuJoCo C", "frax", "MJX"
PEERS = (PINOCCHIO, MUJOCO, FRAX, MJX)

INVERSE, FORWARD, MASS = "inverse dynamics", "forward dynamics", "mass matrix"
KINEMATICS, JACOBIAN = "kinematics", "Jacobian"
INVERSE_DERIVATIVES, FORWARD_DERIVATIVES = "derivatives of inverse dynamics", "derivatives of forward dynamics"
JACFWD_INVERSE, JACFWD_FORWARD = "jacfwd of inverse dynamics", "jacfwd of forward dynamics"
GRADIENT, BY_INERTIAS = "gradient of forward dynamics", "gradient by inertial parameters"
STEP, GRADIENT_OF_STEP = "step", "gradient of a step"
# Matrices where they are used: what is returned is a vector.
MASS_TIMES, INVERSE_MASS_TIMES = "mass matrix times a vector", "inverse mass matrix times a vector"
JACOBIAN_TIMES = "Jacobian transposed times a wrench"
MASS_BY_DYNAMICS, JACOBIAN_BY_PULLBACK = f"{MASS_TIMES}, by inverse dynamics", f"{JACOBIAN_TIMES}, by pull-back"
INVERSE_BY_MATRICES, INVERSE_BY_JVP = (f"{INVERSE_DERIVATIVES} times vectors, by {x}" for x in ("matrices", "jvp"))
FORWARD_BY_MATRICES, FORWARD_BY_JVP = (f"{FORWARD_DERIVATIVES} times vectors, by {x}" for x in ("matrices", "jvp"))

ONE, FEW, MANY, LARGE = 1, 64, 4096, 65536  # the batches that the claims are about


class Case(NamedTuple):
    algorithm: str
    batch: int
    who: str


class Compiling(NamedTuple):
    """Seconds, without anything in the caches."""

    trace: float
    compile: float

    @property
    def total(self):
        return self.trace + self.compile


class Results(NamedTuple):
    """Of a robot in a dtype. seconds: Case -> per state, one per round; compiling: Case -> Compiling; errors: Case ->
    the largest error over the largest number of Pinocchio's in float64; many, large: the batches."""

    robot: str
    dtype: str
    many: int
    large: int
    seconds: dict
    compiling: dict
    errors: dict


class Shape(NamedTuple):
    """Mechanisms of one kind that differ in size. compiling: size -> seconds, one per round; seconds: size -> per state
    and link, likewise."""

    name: str
    algorithm: str
    compiling: dict
    seconds: dict


class Claim(NamedTuple):
    """Of `found` that it is at most, or at least, what is asked."""

    where: str
    what: str
    is_at_most: bool
    asked: float
    found: float
    unit: str = ""

    @property
    def is_met(self):
        """False for NaN."""
        return bool(self.found <= self.asked if self.is_at_most else self.found >= self.asked)


# algorithm -> seconds to trace and compile, at most, of (the Panda, the floating G1)
SECONDS = {
    INVERSE: (1.0, 3.0),
    FORWARD: (2.0, 6.0),
    MASS: (1.5, 4.0),
    GRADIENT: (4.0, 12.0),
    GRADIENT_OF_STEP: (4.0, 12.0),
    BY_INERTIAS: (4.0, 12.0),
    INVERSE_DERIVATIVES: (3.0, 8.0),
    FORWARD_DERIVATIVES: (5.0, 12.0),
}
ROBOTS = ("panda", "g1")
# algorithm -> Pinocchio's time over ours at batch 4096, at least
OVER_PINOCCHIO = dict.fromkeys((INVERSE, FORWARD), {"float32": 5.0, "float64": 2.5})
OVER_PINOCCHIO |= dict.fromkeys((MASS, INVERSE_DERIVATIVES, FORWARD_DERIVATIVES), {"float32": 3.0, "float64": 1.5})
PRODUCTS = (MASS_TIMES, MASS_BY_DYNAMICS, INVERSE_MASS_TIMES, JACOBIAN_TIMES, JACOBIAN_BY_PULLBACK)
PRODUCTS += (INVERSE_BY_MATRICES, INVERSE_BY_JVP, FORWARD_BY_MATRICES, FORWARD_BY_JVP)
# Likewise of the floating G1, in both dtypes, of products computed as the documentation tells to. Of those by matrices,
# which are measured beside them, nothing is claimed.
RECOMMENDED = (MASS_BY_DYNAMICS, INVERSE_MASS_TIMES, JACOBIAN_BY_PULLBACK, INVERSE_BY_JVP, FORWARD_BY_JVP)
PRODUCTS_OVER_PINOCCHIO = 1.0
FEW_OVER_PINOCCHIO = 1.5
GRADIENT_OVER_VALUE = 4.0
# Of autodiff's time to that of the same derivatives in closed form.
JACFWD_OVER_CLOSED_FORMS = 1.0
CLOSED_FORMS = {JACFWD_INVERSE: INVERSE_DERIVATIVES, JACFWD_FORWARD: FORWARD_DERIVATIVES}
LARGE_OVER_MANY = 1.1
# algorithm -> microseconds for one state, at most, of (the Panda, the floating G1)
ONE_STATE = {INVERSE: (20.0, 60.0), FORWARD: (40.0, 120.0)}
# Of results that are right, over the largest number: what is left of the digits is the condition's.
TOLERANCES = {"float32": 3e-4, "float64": 1e-8}
# What is the same whatever the size: the larger over the smallest, at most.
SAME = 1.3


def ratio(seconds, above, below):
    """The median over the rounds: both sides of a round saw the same machine."""
    return float(np.median(seconds[above] / seconds[below]))


def asked_seconds(robot, algorithm):
    """To trace and compile, None where nothing is asked."""
    return SECONDS[algorithm][ROBOTS.index(robot)] if algorithm in SECONDS else None


def best_peer(results, case):
    """(who, its time over that of the case), None without one."""
    others = [case._replace(who=who) for who in PEERS]
    found = {x.who: ratio(results.seconds, x, case) for x in others if x in results.seconds}
    return min(found.items(), key=lambda x: x[1]) if found else None


def claims(results):
    """Of all that was measured: Claim by Claim."""
    for kind in (_compiling, _many, _products, _large, _gradient, _jacfwd, _few, _one, _agreeing):
        yield from kind(results)


def _where(results):
    return f"{results.robot}, {results.dtype}"


def _compiling(results):
    for algorithm in SECONDS:
        found = results.compiling.get(Case(algorithm, results.many, OURS))
        if found:
            what, asked = f"{algorithm}: trace and compile", asked_seconds(results.robot, algorithm)
            yield Claim(_where(results), what, True, asked, found.total, "s")


def _many(results):
    for algorithm, asked in OVER_PINOCCHIO.items():
        what = f"{algorithm}, batch {results.many}: {PINOCCHIO}'s time over ours"
        yield from _over_peer(results, Case(algorithm, results.many, OURS), PINOCCHIO, asked[results.dtype], what)


def _products(results):
    for algorithm in RECOMMENDED if results.robot == "g1" else ():
        what = f"{algorithm}, batch {results.many}: {PINOCCHIO}'s time over ours"
        yield from _over_peer(results, Case(algorithm, results.many, OURS), PINOCCHIO, PRODUCTS_OVER_PINOCCHIO, what)


def _over_peer(results, case, peer, asked, what):
    other = case._replace(who=peer)
    if case in results.seconds and other in results.seconds:
        yield Claim(_where(results), what, False, asked, ratio(results.seconds, other, case))


def _large(results):
    for algorithm in (INVERSE, FORWARD):
        many, large = (Case(algorithm, n, OURS) for n in (results.many, results.large))
        if many in results.seconds and large in results.seconds:
            what = f"{algorithm}, per state: batch {results.large} over batch {results.many}"
            yield Claim(_where(results), what, True, LARGE_OVER_MANY, ratio(results.seconds, large, many))


def _gradient(results):
    value, gradient = (Case(x, results.many, OURS) for x in (FORWARD, GRADIENT))
    if value in results.seconds and gradient in results.seconds:
        what = f"{GRADIENT} over its value"
        yield Claim(_where(results), what, True, GRADIENT_OVER_VALUE, ratio(results.seconds, gradient, value))


def _jacfwd(results):
    for algorithm, closed in CLOSED_FORMS.items():
        found, below = (Case(x, results.many, OURS) for x in (algorithm, closed))
        if found in results.seconds and below in results.seconds:
            asked = JACFWD_OVER_CLOSED_FORMS
            yield Claim(
                _where(results), f"{algorithm} over {closed}", True, asked, ratio(results.seconds, found, below)
            )


def _few(results):
    what = f"{INVERSE}, batch {FEW}: {PINOCCHIO}'s time over ours"
    yield from _over_peer(results, Case(INVERSE, FEW, OURS), PINOCCHIO, FEW_OVER_PINOCCHIO, what)


def _one(results):
    for algorithm, limits in ONE_STATE.items():
        case = Case(algorithm, ONE, OURS)
        if case in results.seconds:
            found, asked = float(np.median(results.seconds[case])) * 1e6, limits[ROBOTS.index(results.robot)]
            yield Claim(_where(results), f"{algorithm}, one state", True, asked, found, "us")
        yield from _over_peer(results, case, FRAX, 1.0, f"{algorithm}, one state: {FRAX}'s time over ours")


def _agreeing(results):
    """Times of results that are not the same would say nothing."""
    errors = {case: error for case, error in results.errors.items() if case.who == OURS}
    if errors:
        worst = max(errors, key=lambda x: (errors[x] != errors[x], errors[x]))  # NaN is the worst
        what = f"largest error over largest number ({worst.algorithm})"
        yield Claim(_where(results), what, True, TOLERANCES[results.dtype], errors[worst])


def claims_of_shape(shape):
    """That what grows along a chain, or side by side, compiles as the smallest does, and a link costs the same."""
    for what, times in (("trace and compile", shape.compiling), ("time per link", shape.seconds)):
        for size in list(times)[1:]:
            said = f"{shape.algorithm}, {what}: {size} over {next(iter(times))}"
            yield Claim(shape.name, said, True, SAME, ratio(times, size, next(iter(times))))

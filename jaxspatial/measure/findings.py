"""What a self-check finds, and what its checks have in common."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike

from jaxspatial.arithmetic.precision import DEFAULT
from jaxspatial.measure.operation import OPERATIONS

DTYPES = ("float32", "float64")
_SUSPECTS = ("fast_math", "disable_hlo_passes", "xla_backend_extra_options", "fp_mode")

# What a check says: of a `Finding` all but the name.
Found = tuple[bool | None, str, str]

# What a program is run in, of which the stubs know no result.
Context = Callable[[Callable[..., Any]], Callable[..., Any]]
jit = cast(Context, jax.jit)


class Finding(NamedTuple):
    """One thing looked at. holds: True, False, or None for what is no promise, but good to know."""

    name: str
    holds: bool | None
    measured: str
    advice: str = ""

    @property
    def verdict(self):
        return {True: "holds", False: "BROKEN", None: "note"}[self.holds]


class Report(NamedTuple):
    """What `self_check` found; `print(report)` shows it."""

    findings: tuple[Finding, ...]
    surroundings: str

    @property
    def holds(self):
        """True if every promise holds."""
        return all(finding.holds is not False for finding in self.findings)

    @property
    def conclusion(self):
        broken = sum(finding.holds is False for finding in self.findings)
        return "All promises hold here." if self.holds else f"{broken} of the promises do not hold here."

    def __str__(self):
        rows = [line for finding in self.findings for line in _lines(finding)]
        return "\n".join([self.surroundings, "", *rows, "", self.conclusion])

    __repr__ = __str__

    def to_dict(self) -> dict[str, Any]:
        """As it goes into JSON."""
        found = [finding._asdict() for finding in self.findings]
        return {"holds": self.holds, "surroundings": self.surroundings, "findings": found}


def _lines(finding: Finding):
    yield f"{finding.verdict:<7}{finding.name}: {finding.measured}"
    if finding.advice:
        yield f"       -> {finding.advice}"


def _cause():
    """What usually is to blame, by name."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    suspects = [flag for flag in flags if any(word in flag for word in _SUSPECTS)]
    if suspects:
        return f"XLA_FLAGS has {' '.join(suspects)}: take it out"
    return (
        "no flag to blame in XLA_FLAGS; what breaks it is --xla_cpu_enable_fast_math (also given as compiler_options), "
        "or a compiler or device that this library was not tested on: please report it with this text"
    )


def verdict(shares: Mapping[str, float], what: str, advice: str = ""):
    """holds, measured and advice of a promise that no result may break; shares: dtype -> share of results that do."""
    text = ", ".join(f"{share:.0%} in {name}" for name, share in shares.items() if share)
    return held(not text, f"broken for {text} of the results" if text else what, advice)


def held(holds: bool, measured: str, advice: str = "") -> Found:
    """Of a promise: what usually is to blame, where it does not hold and nothing better is known."""
    return holds, measured, "" if holds else advice or _cause()


def rng():
    return np.random.default_rng(2026)


def in_dtype(dtype: str):
    """The 64-bit types off for all other dtypes: what the caller has switched on does not matter."""
    return jax.enable_x64(dtype == "float64")


def differing(computed: Iterable[ArrayLike], expected: Iterable[np.ndarray]):
    """The share of numbers that differ, bit by bit but for the bits of a NaN."""
    return float(np.mean([_differs(np.asarray(x), y).ravel() for x, y in zip(computed, expected, strict=True)]))


def _differs(x: np.ndarray, y: np.ndarray):
    same = (x == y) & (np.signbit(x) == np.signbit(y))
    return ~np.where(np.isnan(y), np.isnan(x), same)


def scanned(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *arrays: lax.scan(lambda _, x: (None, function(*x)), None, arrays)[1]


def finite(x: ArrayLike):
    x = np.asarray(x)
    return np.where(np.isfinite(x), x, np.zeros_like(x))


def differing_from_numpy(name: str, dtype: str, arrays: Sequence[np.ndarray], context: Context):
    with in_dtype(dtype):
        computed = context(OPERATIONS[name].batched(DEFAULT))(*[jnp.asarray(x) for x in arrays])
    return differing(computed, [formula(*arrays) for formula in OPERATIONS[name].formulas])

"""The common sections of docstrings that are not written out yet: arguments, exceptions, and the error bound."""

import inspect
import re
import textwrap
from typing import Any

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.numerics.promise import Normwise, promises

_ARGUMENTS = {
    "mechanism": "the mechanism, see `Mechanism`.",
    "q": "(*batch, nq) coordinates: rad, m, quaternions (read normalised).",
    "v": "(*batch, nv) generalized velocities: rad/s, m/s.",
    "vdot": "(*batch, nv) generalized accelerations: rad/s^2, m/s^2.",
    "tau": "(*batch, nv) generalized forces of the joints: N m, N.",
    "dt": "the time, s: a number or (*batch,).",
    "external_forces": """AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
    axes; or a list of several of these, which add up. See `AppliedForces`.""",
    "frames": "a name of `mechanism.frame_names`, or several, in the order of the results.",
    "loops": "LoopClosures, such as `mechanism.loops`; none at all leave the tree.",
    "compliance": "of friction and limits; None takes the default, see `Compliance`.",
    "contacts": "PointContacts: spheres on frames, how stiff and how rough they are.",
    "ground": """HalfSpace, HeightField or another shape, whose normals and distances count; or a function f from a
    point (3,) in world axes to a number (): zero on the surface of the ground, above zero outside. Its gradient is the
    direction out of the ground, and the distance is f / |grad f|: a height z - h(x, y) does. That is exact for planes
    of any slope and for signed distances, and else to first order. Where the gradient is zero or not finite there is no
    normal, and the result is NaN, outside of the ground too. None is the plane z = 0.""",
    "precision": "name of a precision; None takes the default.",
}
_SECTIONS = ("Args", "Returns", "Raises", "Error", "Source")

_ERROR = """of every number {bound}; n, r and mag as in `jaxspatial.dynamics.bounds`."""


def documented(function: Any = None, **bounds: Normwise) -> Any:
    """Decorator that completes the sections of an algorithm's docstring, and attaches its error bounds.

    The docstring itself says only what is special: under `Args` parameters with a meaning of their own, under `Error`
    bounds other than `ALGORITHM`, by name in braces.
    """
    if function is None:
        return lambda function: documented(function, **bounds)
    doc = inspect.cleandoc(function.__doc__ or "")
    head, *rest = re.split(rf"^({'|'.join(_SECTIONS)}):", doc, flags=re.M)
    sections = dict(zip(rest[::2], map(str.rstrip, rest[1::2]), strict=True))
    parameters = inspect.signature(function).parameters
    sections["Args"] = "".join(f"\n    {text}" for text in _arguments(parameters, sections.get("Args", "")))
    sections.setdefault("Raises", _raises(parameters))
    if "Error" not in sections:
        sections["Error"], bounds = " " + _ERROR, {"bound": ALGORITHM}
    parts = [head.rstrip()]
    for name in (name for name in _SECTIONS if name in sections):
        gap = "" if name == "Source" else "\n"
        parts.append(f"{gap}{name}:{sections[name]}")
    function.__doc__ = "\n".join(parts).replace("Error: " + sections["Error"].lstrip(), _error(sections, bounds))
    return promises(**bounds)(function) if bounds else function


def _error(sections: dict[str, str], bounds: dict[str, Normwise]) -> str:
    words = f"Error: {sections['Error']}".format_map(bounds).split()
    return textwrap.fill(" ".join(words), 116, subsequent_indent="    ", break_on_hyphens=False)


def _arguments(parameters, special: str) -> list[str]:
    """One entry for each parameter, in the order of the signature."""
    entries = re.split(r"^    (?=\w+: )", special, flags=re.M)[1:]
    by_name = {entry.partition(":")[0]: entry.rstrip() for entry in entries}
    return [by_name.get(name) or f"{name}: {_ARGUMENTS[name]}".replace("\n", "\n    ") for name in parameters]


def _raises(parameters) -> str:
    reasons = ["the first argument is no Mechanism"]
    reasons += ["frames no names"] if "frames" in parameters else []
    reasons += ["dtypes differ or are not floating point"]
    reasons += ["loops are no LoopClosures"] if "loops" in parameters else []
    reasons += ["contacts are no PointContacts"] if "contacts" in parameters else []
    reasons += (
        ["forces are neither a dict of SpatialForces nor AppliedForces, nor a list of these"]
        if "external_forces" in parameters
        else []
    )
    errors = [f"TypeError: {', '.join(reasons[:-1])}, or {reasons[-1]}.", "ValueError: shapes do not fit."]
    if {"frames", "external_forces", "loops", "contacts"} & {*parameters}:
        errors.append("KeyError: there is no such frame.")
    indented = (textwrap.fill(error, 116, initial_indent="    ", subsequent_indent="        ") for error in errors)
    return "\n" + "\n".join(indented)

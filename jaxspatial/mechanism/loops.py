"""Loop closures: what holds two frames of a mechanism together, beside the joints of its tree."""

from typing import TYPE_CHECKING, Literal, get_args

import jax
import numpy as np

from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import exported_tree_of
from jaxspatial.numerics.types import ArrayLike

Kind = Literal["weld", "hinge", "universal", "ball", "distance"]
# The number of coordinates of motion that each kind takes away.
ROWS = {"weld": 6, "hinge": 5, "universal": 4, "ball": 3, "distance": 1}


@exported_tree_of("frame_a", "frame_b", "kind")
class LoopClosure:
    """A closure of a loop: holds frame B against frame A as a joint of this kind would.

    Both frames are frames of the mechanism, or "world"; `add_frames` makes those that there are not.

    Args:
        frame_a: the name of frame A; static.
        frame_b: the name of frame B; static.
        kind: what is held; static. "weld": the origins and all axes of A and B coincide. "hinge": the origins and the
            z-axes coincide; B turns about z of A. "universal": the origins coincide, and x of B stays perpendicular to
            z of A; B turns about z of A and about its own x, as in a "universal" joint. "ball": the origins coincide.
            "distance": the origins are a distance apart.
        distance: of "distance", and of no other kind: a number above 0 or (*batch,), m. NumPy numbers are converted to
            the dtype of q, data must have it. An origin that is to stay at another is a "ball".

    Raises:
        TypeError: a name is no text, or the distance no number of floating point.
        ValueError: there is no such kind, a "distance" has no distance above 0, or another kind has one.

    Example:
        >>> pin = js.LoopClosure("rod_end", "crank_pin", "hinge")
        >>> print(pin.rows, js.LoopClosure("rail", "slider", "distance", 0.25))
        5 LoopClosure('rail', 'slider', 'distance', 0.25)
    """

    frame_a: str
    frame_b: str
    kind: Kind
    distance: jax.Array | None = None

    if TYPE_CHECKING:

        def __init__(self, frame_a: str, frame_b: str, kind: Kind, distance: ArrayLike | None = None): ...

    def __post_init__(self) -> None:
        for name in ("frame_a", "frame_b"):
            if not isinstance(getattr(self, name), str):
                check.refuse(f"LoopClosure: {name}", "the name of a frame", getattr(self, name))
        if self.kind not in ROWS:
            known, near = ", ".join(map(repr, get_args(Kind))), check.did_you_mean(self.kind, ROWS)
            raise ValueError(f"LoopClosure: kind: expected one of {known}, got {self.kind!r}{near}")
        if self.kind != "distance":
            if self.distance is not None:
                raise ValueError(f"LoopClosure: distance: expected none for {self.kind!r}, got {self.distance!r}")
            return
        expected = "LoopClosure: distance: expected a number above 0"
        if self.distance is None:
            raise ValueError(f"{expected}, got None")
        distance = floats.owned(
            floats.as_float_array(self.distance, "LoopClosure: distance", np.float64, keep_dtype=True)
        )
        if isinstance(distance, np.ndarray) and not (distance > 0).all():
            raise ValueError(f"{expected}, got {distance.tolist()}")
        object.__setattr__(self, "distance", distance)

    @property
    def rows(self) -> int:
        """The number of rows that it adds to `constraint_jacobian`."""
        return ROWS[self.kind]

    def __repr__(self) -> str:
        d = self.distance
        shown = "" if d is None else f", {d.tolist() if isinstance(d, np.ndarray) else check.in_short(d)}"
        return f"LoopClosure({self.frame_a!r}, {self.frame_b!r}, {self.kind!r}{shown})"


def checked_loops(loops, topology: Topology, what: str) -> tuple[LoopClosure, ...]:
    """A sequence of closures between frames that there are, as a tuple."""
    closures = check.as_tuple(loops, LoopClosure, what, "LoopClosures")
    frames = tuple(name for name, _ in topology.frames)
    for name in (name for loop in closures for name in (loop.frame_a, loop.frame_b)):
        topology.index(frames, name, what)
    return closures

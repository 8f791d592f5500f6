"""What is said of a model file, besides the mechanism that is made of it."""

import warnings
from collections.abc import Iterable, Mapping

# How many names of each kind a message shows.
_SHOWN = 4


class ModelFileWarning(UserWarning):
    """What a file has that is no part of the mechanism made of it, or that no rigid body can have.

    left_out: names (or lines) of what was left out, by kind
    doubtful: likewise, what was taken as it is
    Silence it with `warnings.simplefilter("ignore", jaxspatial.interop.ModelFileWarning)`.
    """

    def __init__(self, operation: str, left_out: Mapping[str, Iterable[str]], doubtful: Mapping[str, Iterable[str]]):
        self.left_out = {kind: tuple(names) for kind, names in left_out.items()}
        self.doubtful = {kind: tuple(names) for kind, names in doubtful.items()}
        heads = ("left out, for it is no part of a mechanism", self.left_out), ("taken as it is", self.doubtful)
        said = (f"{head}: {'; '.join(_counted(*item) for item in found.items())}" for head, found in heads if found)
        super().__init__(f"{operation}: {'. '.join(said)}")


def _counted(kind: str, names: tuple[str, ...]):
    some = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
    return f"{kind} ({len(names)}: {some})"


class Notes:
    """What a reader has to tell about a file, once, at its end."""

    def __init__(self, operation: str):
        self.operation = operation
        self.left_out, self.doubtful = dict[str, list[str]](), dict[str, list[str]]()

    def leave_out(self, kind: str, name: str):
        self.left_out.setdefault(kind, []).append(name)

    def doubt(self, kind: str, name: str):
        self.doubtful.setdefault(kind, []).append(name)

    def tell(self, stacklevel: int = 4):
        """To whom called `Mechanism.from_...`: by way of it, of a reader, and of this."""
        if self.left_out or self.doubtful:
            warnings.warn(ModelFileWarning(self.operation, self.left_out, self.doubtful), stacklevel=stacklevel)

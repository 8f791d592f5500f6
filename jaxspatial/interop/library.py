"""Other libraries, imported when one of their objects is made."""

import importlib
from typing import Any


def library(name: str) -> Any:
    """The module of that name; what it has is not said by its stubs, of those that have any."""
    return importlib.import_module(name)

"""What only the extra `peers` installs: other libraries to compare with, robots, learners, notebooks."""

import importlib
import importlib.util
import warnings

import pytest

# What no other extra brings: where one of them is, the extra was asked for, and nothing of it may be missing.
PEERS = ("brax", "jaxlie", "pinocchio", "pydrake")


def needs(module):
    """The module, imported; skips the test, or the whole file, where it is absent and the extra as a whole is."""
    if not any(map(importlib.util.find_spec, (module.partition(".")[0], *PEERS))):
        reason = f'{module} is not installed: python -m pip install -e ".[test,peers]"'
        pytest.skip(reason, allow_module_level=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return importlib.import_module(module)

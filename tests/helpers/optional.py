"""What only the extra `peers` installs: other libraries to compare with, robots, learners, notebooks."""

import importlib
import importlib.util
import warnings

import pytest

# What no other extra brings: where one of them is, the extra was asked for, and nothing of it may be missing.
PEERS = ("brax", "jaxlie", "pinocchio", "pydrake")


def needs(module):
    """The module, imported; skips the test, or the whole file, where it is absent and the extra as a whole is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return importlib.import_module(module)
        except ModuleNotFoundError as error:
            # What the module itself imports is no extra's business; mujoco is there without its mjx.
            if any(map(importlib.util.find_spec, PEERS)) or not f"{module}.".startswith(f"{error.name}."):
                raise
    reason = f'{module} is not installed: python -m pip install -e ".[test,peers]"'
    return pytest.skip(reason, allow_module_level=True)

"""What the default run leaves out: cases that tell, of another dtype, precision or program, what the ones kept tell."""

import pytest


def slow(*case):
    """A case that runs with `-m slow`."""
    return pytest.param(*case, marks=pytest.mark.slow)


def slow_but(kept, cases):
    """The cases, those slow that are not among the kept ones."""
    return [case if case in kept else slow(*case) if isinstance(case, tuple) else slow(case) for case in cases]

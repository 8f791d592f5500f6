"""Every test runs under JAX's strictest rules, and knows how to ask for 64 bits."""

import jax
import mpmath
import pytest

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")
# One for all modules, whichever is imported last: of what cancels at an angle of 1e-30, 60 digits are left.
mpmath.mp.dps = 160


@pytest.fixture(params=[False, True], ids=["x32", "x64"])
def x64(request):
    """Runs the test twice, with 64-bit types off and on."""
    with jax.enable_x64(request.param):
        yield request.param


@pytest.fixture(autouse=True, scope="module")
def forget_programs():
    """Thousands of compiled programs would take gigabytes."""
    yield
    jax.clear_caches()

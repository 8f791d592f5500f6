"""Computing with known numbers, whatever JAX is doing around."""

import contextlib

import jax


@contextlib.contextmanager
def in_double():
    """Within, numbers that are known stay known, also while JAX traces a function around; in float64."""
    with jax.ensure_compile_time_eval(), jax.enable_x64(True):
        yield

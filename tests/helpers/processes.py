"""Python in a process of its own."""

import os
import subprocess
import sys


def python(*arguments, n_devices=1, **environment):
    """What came of a process that ended well: `stdout`, `stderr`. n_devices: as which JAX sees the processor."""
    if n_devices > 1:
        environment["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={n_devices}"
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": os.pathsep.join(sys.path), **environment}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=1800)
    assert done.returncode == 0, done.stderr
    return done

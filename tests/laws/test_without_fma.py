"""The laws of the precisions that need error-free transforms, once more without fused multiply-add: on the instruction
set of a machine that has none.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

# By default the values of the two kernels that all others are made like; "slow" is everything, slow cases included.
FEW = " and test_bound_of_the_docstring and (shift_force or dot_force_velocity)"
CHOSEN = {
    "test_error_bounds.py": "(compensated or faithful) and (float32 or float64) and not bfloat16 and not constants"
    " and not compose and not inverse and not act_acceleration",
    "test_derivatives.py": "(compensated or faithful) and float64 and not of_all_results and not cross_velocity",
    "test_extremes.py": "(compensated or faithful) and float64",
}


def test_few_without_fma():
    _run("test_error_bounds.py", CHOSEN["test_error_bounds.py"] + FEW, "not slow")


@pytest.mark.slow
@pytest.mark.parametrize("file", CHOSEN)
def test_all_without_fma(file):
    _run(file, CHOSEN[file], "")


def _run(file, names, marks):
    environment = {**os.environ, "XLA_FLAGS": "--xla_cpu_max_isa=AVX"}
    command = [sys.executable, "-m", "pytest", "-q", str(Path(__file__).with_name(file)), "-k", names, "-m", marks]
    run = subprocess.run(
        [*command, "-p", "no:cacheprovider"], env=environment, capture_output=True, text=True, timeout=3600
    )
    assert run.returncode == 0, run.stdout[-4000:]

"""The laws of the precisions that need error-free transforms, once more without fused multiply-add: on the instruction
set of a machine that has none.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

# By default the two kernels that all others are made like; "slow" are all of them.
FEW = " and (shift_force or dot_force_velocity)"
CHOSEN = {
    "test_error_bounds.py": "(compensated or faithful) and (float32 or float64) and not bfloat16 and not constants"
    " and not compose and not inverse and not act_acceleration",
    "test_derivatives.py": "(compensated or faithful) and float64 and not of_all_results and not cross_velocity",
    "test_extremes.py": "(compensated or faithful) and float64",
}


@pytest.mark.parametrize("which", [FEW, pytest.param("", marks=pytest.mark.slow)], ids=["few", "all"])
@pytest.mark.parametrize("file", CHOSEN)
def test_without_fma(file, which):
    environment = {**os.environ, "XLA_FLAGS": "--xla_cpu_max_isa=AVX"}
    command = [sys.executable, "-m", "pytest", "-q", str(Path(__file__).with_name(file)), "-k", CHOSEN[file] + which]
    run = subprocess.run(
        [*command, "-p", "no:cacheprovider"], env=environment, capture_output=True, text=True, timeout=900
    )
    assert run.returncode == 0, run.stdout[-4000:]

"""The self-check: it holds on compilers that keep promises, and sees those that do not; without the plot extra."""

import json
import os
import subprocess
import sys

import jax
import pytest

import jaxspatial as js
from jaxspatial.__main__ import main
from jaxspatial.measure import checks, self_check
from jaxspatial.numerics.sums import faithful
from tests.helpers.marks import slow

# The command where neither tables nor pictures can be shown, of some dtypes.
_BARE = "import sys; sys.modules.update(rich=None, matplotlib=None); from jaxspatial.__main__ import main"
_BARE += "; from jaxspatial.measure import checks; checks.DTYPES = {dtypes}"


def _run(dtypes, flags, *options):
    """The command in a process whose compiler has these flags and that has no rich and no matplotlib."""
    program = f"{_BARE.format(dtypes=dtypes)}; sys.exit(main(['--self-check', *{list(options)}]))"
    environment = {**os.environ, "XLA_FLAGS": flags}
    return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=300)


def _found(run):
    return {finding["name"]: finding for finding in json.loads(run.stdout)["findings"]}


@pytest.fixture(scope="module")
def quick():
    """The checks that are quick, for what does not depend on their number."""
    kept = {name: check for name, check in checks._CHECKS.items() if not name.startswith("precision")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checks, "_CHECKS", kept)
        yield kept


# In float64 `laws` hold the same promises, and sums that are faithful there compile longest.
@pytest.mark.parametrize("dtypes", [("float32",), slow(("float32", "float64"))], ids="-".join)
def test_holds_here_and_says_what_was_looked_at(dtypes, monkeypatch):
    monkeypatch.setattr(checks, "DTYPES", dtypes)
    before = dict(jax.config.values)
    report = self_check()
    assert report.holds and report.findings and dict(jax.config.values) == before
    assert {f.name for f in report.findings if f.holds} >= {"error-free sums", "precision 'faithful'", "double words"}
    assert {f.name for f in report.findings if f.holds is None} >= {
        "subnormal numbers",
        "products fused with additions",
    }
    text = str(report)
    assert repr(report) == text and all(f"{f.verdict:<7}{f.name}: " in text for f in report.findings)
    assert text.endswith("All promises hold here.")


def test_64_bit_types_on_or_off_by_the_caller(x64, quick):
    report = self_check()
    assert report.holds and len(report.findings) == len(quick)


# In float64 all precisions need what the flag breaks; in float32 some have float64 to compute in. By default
# `numerics.errorfree.test_barrier` tells that results are NaN then.
@pytest.mark.parametrize("dtypes", [slow(("float64",)), slow(("float32", "float64"))], ids="-".join)
def test_fast_math_is_seen(dtypes):
    run = _run(dtypes, "--xla_cpu_enable_fast_math=true", "--json")
    assert run.returncode == 1, run.stderr
    found = _found(run)
    broken = {name for name, finding in found.items() if finding["holds"] is False}
    # Error-free products break under jaxlib 0.10.2; 0.12 leaves them alone.
    assert broken >= {"error-free sums", "precision 'compensated'", "precision 'faithful'"}
    assert all("--xla_cpu_enable_fast_math=true: take it out" in found[name]["advice"] for name in broken)


# By default `laws.test_without_fma` holds the same promises.
@pytest.mark.slow
def test_without_fma_all_holds():
    run = _run(("float32", "float64"), "--xla_cpu_max_isa=AVX")
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.endswith("All promises hold here.\n") and "products fused with additions: no" in run.stdout


@pytest.mark.slow
def test_scaling_that_the_compiler_takes_back_on_single_items_is_seen(monkeypatch):
    """Where nothing hides the factors, jaxlib 0.10.2 (0.12 does not) makes `(a b) (c c)` of `(a c) (b c)` on scalars:
    what overflows does so again."""
    scaled = faithful._scaled_parts

    def taken_back(unscaled, sign, factors, scale):
        right = scaled(unscaled, sign, factors, scale)
        return right if scale.shape else [x * scale * scale for x in unscaled]

    monkeypatch.setattr(faithful, "_scaled_parts", taken_back)
    assert checks._values_over(js.Precision.FAITHFUL, "float64") == float("inf")


def test_command_prints_a_table(quick, capsys):
    assert main(["--self-check"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in quick) and "All promises hold here." in text


def test_what_cannot_be_run_does_not_hold(quick, monkeypatch, capsys):
    def fails():
        raise NotImplementedError("no 64 bits on this device")

    monkeypatch.setattr(checks, "_CHECKS", {"float64": fails})
    report = self_check()
    assert not report.holds and "no 64 bits on this device" in str(report) and "--xla_cpu" in report.findings[0].advice
    assert main(["--self-check"]) == 1 and "1 of the promises do not hold" in capsys.readouterr().out

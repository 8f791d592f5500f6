"""Which laws hold again in a process whose compiler may not use fused multiply-add: see `test_without_fma`.

What a case is about is in its parameters: the name of an operation, a dtype, a precision, a size.
"""

import pytest

import jaxspatial as js

ERROR_FREE = (js.Precision.COMPENSATED, js.Precision.FAITHFUL)
# Expansions of many products, which compile for minutes.
LONG = ("compose", "inverse", "act_acceleration")


def _is_error_free(case, dtypes):
    return case.get("precision") in ERROR_FREE and case.get("dtype") in dtypes


def _of_bounds(test, case):
    is_compiled = test != "test_bound_of_the_docstring_op_by_op"
    is_short = test != "test_operands_that_are_constants_of_the_program" and not any(
        word in str(case.get("name")) for word in LONG
    )
    return is_compiled and is_short and _is_error_free(case, ("float32", "float64"))


def _of_derivatives(test, case):
    is_short = test != "test_pull_back_of_all_results" and case.get("name") != "cross_velocity"
    return is_short and _is_error_free(case, ("float64",))


# Per file whether a case runs again at all, and whether by default: one dtype of the kernel that all others are
# made like, one size of the bits of an operation, and derivatives.
CHOSEN = {
    "test_error_bounds": (
        _of_bounds,
        lambda test, case: (
            test == "test_bound_of_the_docstring"
            and case["name"] == "dot_force_velocity"
            and _is_error_free(case, ("float64",))
        ),
    ),
    "test_derivatives": (_of_derivatives, lambda test, case: False),
    "test_extremes": (lambda test, case: _is_error_free(case, ("float64",)), lambda test, case: False),
    "test_reproducible": (
        lambda test, case: True,
        lambda test, case: (
            test == "test_derivatives_are_reproducible_too" or (case.get("name"), case.get("n")) == ("shift_force", 257)
        ),
    ),
}


def pytest_collection_modifyitems(items):
    for item in items:
        runs_again = CHOSEN.get(item.path.stem) if item.path.parent.name == "laws" else None
        if runs_again:
            case = item.callspec.params if hasattr(item, "callspec") else {}
            for mark, holds in zip(("without_fma", "without_fma_by_default"), runs_again, strict=True):
                if holds(item.originalname, case):
                    item.add_marker(getattr(pytest.mark, mark))

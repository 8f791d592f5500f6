"""Finds sums in a trace that a compiler could make an fma of, with a product that a caller computed.

What passes a number on, and is not behind a barrier, passes a product on as well.
"""

import numpy as np
from jax.extend.core import Literal

# `stop_gradient` stands where an array is only asked for its layout: see `layout.stack_like`.
_PASS_ON = {
    "broadcast_in_dim", "concatenate", "copy", "dynamic_slice", "gather", "neg", "pad", "reshape", "rev", "select_n",
    "slice", "split", "squeeze", "stack", "transpose", "jaxspatial_unstack",
}  # fmt: skip
_SUMS = {"add", "add_any", "sub", "reduce_sum", "cumsum", "dot_general", "jaxspatial_sum", "jaxspatial_difference"}


def sums_of_arguments(closed):
    """The equations of a closed jaxpr that add an argument, as it came, to something."""
    found = []
    _walk(closed.jaxpr, [np.issubdtype(x.aval.dtype, np.floating) for x in closed.jaxpr.invars], found)
    return found


def _walk(jaxpr, are_arguments, found):
    """Which results are arguments, as they came; sums of such are appended to `found`."""
    arguments = {x for x, yes in zip(jaxpr.invars, are_arguments, strict=True) if yes}

    def asked(variables):
        return [not isinstance(x, Literal) and x in arguments for x in variables]

    for equation in jaxpr.eqns:
        inputs = asked(equation.invars)
        name, parameters = equation.primitive.name, equation.params
        outputs = [False] * len(equation.outvars)
        if name in _SUMS and any(inputs):
            found.append(equation)
        elif name in _PASS_ON:
            outputs = [any(inputs)] * len(outputs)
        elif name == "cond":
            each = [_walk(branch.jaxpr, inputs[1:], found) for branch in parameters["branches"]]
            outputs = list(map(any, zip(*each, strict=True)))
        elif name == "while":
            a, b = parameters["cond_nconsts"], parameters["body_nconsts"]
            _walk(parameters["cond_jaxpr"].jaxpr, inputs[:a] + inputs[a + b :], found)
            outputs = _walk(parameters["body_jaxpr"].jaxpr, inputs[a:], found)
        else:
            programs = [x for x in parameters.values() if hasattr(x, "eqns")]
            if programs:
                program = programs[0]
                outputs = _walk(getattr(program, "jaxpr", program), inputs, found)
        arguments.update(x for x, yes in zip(equation.outvars, outputs, strict=True) if yes)
    return asked(jaxpr.outvars)

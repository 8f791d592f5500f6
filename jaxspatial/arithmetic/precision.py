"""The precisions a caller can name, and what each promises."""

import enum


class Precision(enum.StrEnum):
    """How sums of products are evaluated; the plain string is accepted wherever a precision is.

    `FAST`: the compiler may contract `a * b + c` to one fused multiply-add, so that results depend on the program
    around them.
    `REPRODUCIBLE` (the default): every product is rounded on its own. Results are bitwise those of the same formula in
    NumPy, whatever the batch size and whether compiled or not; `cross(a, a) == 0`, `cross(a, b) == -cross(b, a)`;
    inputs scaled by powers of two give outputs scaled by powers of two.

    Both hold the bounds stated by each operation in terms of u, the unit roundoff of the inputs' dtype, and mag, the
    sum of the absolute values of the terms of a component.
    """

    FAST = "fast"
    REPRODUCIBLE = "reproducible"


def resolve(precision: Precision | str | None) -> Precision:
    """The named precision, or the default for None."""
    if precision is None:
        return Precision.REPRODUCIBLE
    try:
        return Precision(precision)
    except ValueError:
        names = ", ".join(repr(str(p)) for p in Precision)
        raise ValueError(f"precision: expected one of {names} or None, got {precision!r}") from None

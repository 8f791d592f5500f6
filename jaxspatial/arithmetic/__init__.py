"""Layer 0: how numbers are added and multiplied. Every formula of the library goes through here.

The way from a formula to the bits:

1. A law is a function of vectors of numbers, written with `+ - * /` and `vectors` (`jaxspatial.spatial.algebra` has
   most of them). It does not know what its numbers are.
2. `formula` makes of it a function of arrays: `@formula(of_sums=True)` for sums of products, `@formula` for all with
   roots, quotients and selections. It checks nothing: `check` has done that at the public edge.
3. What a call is given decides what the numbers are (`numbers`, `stacking`):
   - in "fast" and "reproducible" `Rounded`, one array over the batch for each component, or a number known while
     tracing, which folds (`folding`). Products and quotients are rounded by the primitives of `reproducible`, behind a
     `fence` that the compiler cannot look through;
   - in "compensated" and "faithful" a sum of products runs over `polynomial`: `symbolic` collects the terms of each
     result, and one primitive, `sums`, evaluates them all;
   - everything else runs there over float64, or for float64 over a `DoubleWord` (`pairs`, `double_word`).
4. The primitive `sums` has its own derivatives: tangents and pull-backs of sums of products are sums of products.
   `evaluation` lowers it: narrow types in float64 (`wide`); float64 by error-free transforms (`eft`) with one of three
   accumulators: `compensated` (twice the precision), `certified` (three times, or NaN where that is not enough) and
   `faithful` (as much as it takes). Sums over a batch are taken by halving: `sum3` and `pairwise`.
5. Results are rounded once, to the dtype that came, and stacked in the layout of an argument (`stacking`).

Beside this way: `functions` (series, sine and cosine, exponential and logarithm, as formulas over numbers), `symmetric`
(3 x 3 matrices as six numbers), `components` (arrays of which some components are known, also across jit), `scaling` by
powers of two, `quantity` and `tree` (what all types with a batch can do), `precision` and `promise` (the four
precisions, and what each promises), `types` (names of array types in signatures); and what the primitives share:
`elementwise`, `lowering`, `contraction` and `layout`.
"""

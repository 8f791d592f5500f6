"""Layer 0: how numbers are added and multiplied. Every formula of the library goes through here.

The way from a formula to the bits:

1. A law is a function of vectors of numbers, written with `+ - * /` and `vectors` (`jaxspatial.spatial.algebra` has
   most of them). It does not know what its numbers are.
2. `formula` makes of it a function of arrays: `@formula(of_sums=True)` for sums of products, `@formula` for all with
   roots, quotients and selections. It checks nothing: `check` has done that at the public edge.
3. What a call is given decides what the numbers are (`numbers`, made from arrays by `numbers.stacking`):
   - in "fast" and "reproducible" `Rounded`, one array over the batch for each component, or a number known while
     tracing, which folds (`numbers.folding`). Products and quotients are rounded by the primitives of
     `errorfree.reproducible`, and arguments read behind a `barrier`: the compiler cannot look through either;
   - in "compensated" and "faithful" a sum of products runs over `numbers.polynomial`: `sums.symbolic` collects the
     terms of each result, and one primitive, `sums.primitive`, evaluates them all;
   - everything else runs there over float64, or for float64 over a `DoubleWord` (`numbers.pairs`);
   - algorithms of mechanisms, whose promise is relative to their terms, run for float64 over `Corrected` numbers:
     plain ones with the first-order correction of their rounding errors.
4. The primitive has its own derivatives: tangents and pull-backs of sums of products are sums of products.
   `sums.evaluation` lowers it with one of the `sums.accumulators`, forms of one kind: `wide` (narrow types, in
   float64); by the error-free transforms of `errorfree`, `compensated` (twice the precision), `estimated` and
   `certified` (NaN where their digits are not enough) and `faithful` (as much as it takes). Sums over a batch are
   taken by halving: `sums.pairwise`.
5. Results are rounded once, to the dtype that came, and stacked in the layout of an argument (`numbers.stacking`).

The folders stand on one another: `errorfree` (single operations), `numbers` (the protocol and its kinds), `sums`.
On top of them: `functions` (series, sine and cosine, exponential and logarithm, as formulas over numbers), `vectors`,
`symmetric` (3 x 3 matrices as six numbers), `quantity` and `tree` (what all types with a batch can do), `precision` and
`promise` (the four precisions, and what each promises), `types` (names of array types in signatures).
"""

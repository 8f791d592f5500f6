"""How numbers are added and multiplied. Every formula of the library goes through here.

The way from a formula to the bits:

1. A formula is a function of vectors and matrices of numbers, written with the operators of `linear`
   (`jaxspatial.spatial.algebra` has most of them). It does not know what its numbers are.
2. `formula` makes of it a function of arrays: `@formula(of_sums=True)` for sums of products, `@formula` for all with
   roots, quotients and selections. It checks nothing: `check` has done that at the public edge.
3. The arguments and the precision of a call decide what the numbers are (`numbers`):
   - in "fast" and "reproducible" `Rounded`, one array over the batch for each component, or a number known while
     tracing, which folds. Products and quotients are rounded by primitives (`errorfree.barrier`), and arguments are
     read behind a `barrier`: the compiler cannot look through either;
   - in "compensated" and "faithful" a sum of products runs over `numbers.polynomial`: `sums.symbolic` collects the
     terms of each result, and one primitive, `sums.primitive`, evaluates them all;
   - everything else runs there over float64, or for float64 over a `DoubleWord` (`numbers.pairs`);
   - algorithms of mechanisms, whose promise is relative to their terms, run for float64 over `Corrected` numbers:
     plain ones with the first-order correction of their rounding errors.
4. The primitive has derivatives of its own: tangents and pull-backs of sums of products are sums of products.
   `sums.evaluation` lowers it with one of the accumulators: `WIDE` (narrow types, in float64); by the error-free
   transforms of `errorfree`, `compensated` (twice the precision), `estimated` and `certified` (NaN where their digits
   are not enough) and `faithful` (as much as it takes). Sums over a batch are taken by halving: `sums.pairwise`.
5. Results are rounded once, to the dtype of the arguments, and stacked in the layout of one (`numbers.layout`).

The folders stand on one another: `errorfree` (single operations), `numbers` (the interface and its kinds), `sums`.
On top of them: `linear` (vectors, matrices, motions, wrenches), `functions` (series, sine and cosine, exponential and
logarithm, as formulas over numbers), `eigen` (axes of symmetric matrices), `elimination` (linear equations), `formula`
(functions of arrays made of formulas), `quantity` (what all types with a batch can do), `check` (of arguments),
`precision` and `promise` (the four precisions, and what each promises), `types` (of public arguments), `jax_internals`
(parts of JAX that may change).
"""

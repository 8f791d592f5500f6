"""Layer 5: what mechanisms do.

From a call to its result:

1. A public function says what it computes, and calls an `algorithm`: a formula over the state of a mechanism. There its
   `arguments` are checked, and the `program` for the numbers that are known is found, or made. `primitive` runs it,
   over any batch; `tangents` has its derivatives.
2. `state` makes the numbers of a mechanism at its coordinates, bundle by bundle, with joints turned to common axes
   (`alignment`); `along` has operations on such numbers, `dense` equations in them.
3. `recursion` goes outward and inward over the tree, each bundle in a `loop`, with steps for one body (`links`);
   `pairs` makes matrices, entry by entry. No step returns to the mechanism.
4. `results` puts what was found in the order of bodies, rates and coordinates, rounded once.
"""

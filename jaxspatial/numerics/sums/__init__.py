"""Sums of products evaluated as a whole: collected by `symbolic`, one primitive, lowered by `evaluation`."""

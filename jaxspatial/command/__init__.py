"""Layer 8: `python -m jaxspatial`, the trade of speed for accuracy on this machine, and wrenches in files."""

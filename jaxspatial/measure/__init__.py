"""Layer 7: measuring accuracy and speed, on this machine and on the user's own numbers. `python -m jaxspatial`."""

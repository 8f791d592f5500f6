"""The command `jaxspatial`, or `python -m jaxspatial`; `main` is what it runs.

`options` is what it accepts, `first_look` what it does without any, `measuring` the rest of what it measures.
"""

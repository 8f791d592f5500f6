"""What a figure shows are numbers that differ: no bars of zero, no lines of NaN."""

import functools

import numpy as np


def shown(ax):
    """The numbers of each kind of things in some axes, things one after the other: (n, m), where m numbers may differ.

    Of lines in a plane these are heights: along it they differ anyhow. Rules across the axes are no data."""
    of_rules = {id(ax.get_xaxis_transform(which="grid")), id(ax.get_yaxis_transform(which="grid"))}
    lines = [line for line in ax.lines if id(line.get_transform()) not in of_rules]
    bars = [patch for box in ax.containers for patch in box if hasattr(patch, "get_width")]
    clouds = [x.get_offsets() for x in ax.collections if len(x.get_offsets()) > 1]
    images = [image.get_array() for image in ax.images]
    is_room = hasattr(ax, "get_zlim")
    found = {
        "lines": [np.stack(line.get_data_3d(), -1) if is_room else line.get_ydata() for line in lines],
        "bars": [[[bar.get_width(), bar.get_height()] for bar in bars]] if bars else [],
        "points": clouds,
        "images": [np.reshape(image, -1) for image in images],
    }
    in_rows = {kind: [_filled(x).reshape(len(x), -1) for x in arrays] for kind, arrays in found.items()}
    return {kind: arrays for kind, arrays in in_rows.items() if sum(map(len, arrays)) > 1}


def _filled(x):
    return np.ma.filled(np.ma.asarray(x).astype(float), np.nan)


def require_numbers(figure):
    """Refuses lines, bars, points or images of which one is nowhere finite, or all have the same numbers."""
    for ax in figure.axes:
        for kind, arrays in shown(ax).items():
            where = f"{kind} of the axes {ax.get_title() or ax.get_xlabel()!r}"
            assert all(np.isfinite(x).any() for x in arrays), f"{where}: nowhere finite"
            assert np.ptp(np.nan_to_num(np.concatenate(arrays)), axis=0).max() > 0, f"{where}: all numbers are equal"


def watch():
    """From now on `pyplot.show` looks at the numbers of what it shows first: what a notebook begins with."""
    from matplotlib import pyplot

    show = pyplot.show

    @functools.wraps(show)
    def looked_at(*arguments, **named):
        for number in pyplot.get_fignums():
            require_numbers(pyplot.figure(number))
        return show(*arguments, **named)

    pyplot.show = looked_at

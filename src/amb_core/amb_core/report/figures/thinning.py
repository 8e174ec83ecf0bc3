"""Fewer points for the same picture: a long record is drawn by its extremes, an orbit without what a pixel hides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SPANS = 1200
"""Number of spans whose extremes are kept: about one per pixel of a figure's width."""


def extremes(
    x: NDArray[np.float64], y: NDArray[np.float64], spans: int = SPANS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The samples of a curve that a picture of it needs: joined by lines they look like all of them.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Ascending, finite.
    y : ndarray, shape (n,)
        Signal over x; NaN where there is none.
    spans : int, optional
        Number of equally wide spans of x. Of each, the first, smallest, largest and last sample are kept. A curve of at
        most four samples a span is returned as it is.
    """
    if len(x) <= 4 * spans:
        return x, y
    starts = np.unique(np.searchsorted(x, np.linspace(x[0], x[-1], spans, endpoint=False)))
    stops = np.append(starts[1:], len(x))
    gaps = np.isnan(y)
    low, high = np.where(gaps, np.inf, y), np.where(gaps, -np.inf, y)
    inner = [
        start + np.array([np.argmin(low[start:stop]), np.argmax(high[start:stop])])
        for start, stop in zip(starts, stops, strict=True)
    ]
    kept = np.unique(np.concatenate([starts, stops - 1, np.ravel(inner)]))
    return x[kept], y[kept]


def thinned_path(path: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """A path in the plane without the points that lie within a distance of the last one kept.

    Parameters
    ----------
    path : ndarray, shape (n, 2)
        Points in order; NaN where there is none.
    distance : float
        Distance along an axis, in the unit of the path.

    Returns
    -------
    ndarray, shape (m, 2)
        The points that are kept, with one row of NaN for each gap between them.
    """
    known = np.isfinite(path).all(axis=1)
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    gap = np.full((1, path.shape[1]), np.nan)
    parts = [gap]
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        parts += [_thinned(path[start:stop], distance), gap]
    return np.concatenate(parts[1:-1] or parts)


def _thinned(path: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Without gaps; the first and the last point are kept."""
    kept = [0]
    for row, step in enumerate(path[1:], start=1):
        if np.abs(step - path[kept[-1]]).max() > distance:
            kept.append(row)
    return path[kept] if kept[-1] == len(path) - 1 else path[[*kept, len(path) - 1]]

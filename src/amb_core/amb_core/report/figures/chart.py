"""A figure that draws itself: `figure()` with matplotlib, `page()` with plotly, `save()` both to files."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from amb_core.report.figures.drawing import Drawing
from amb_core.report.figures.matplotlib_figure import draw_figure
from amb_core.report.figures.plotly_page import draw_page
from amb_core.report.figures.saving import write_image, write_page

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]
    from matplotlib.figure import Figure


class Chart(Drawing):
    """A drawing as a figure and as an interactive page, which show the same.

    The `..._chart` functions of `amb_core.report.figures` make charts of results, `plot` that of any result which has
    one.
    """

    def figure(self) -> Figure:
        """The chart as a matplotlib figure, made without pyplot: it needs no display and leaves no state behind.

        Returns
        -------
        Figure
            The figure, of `size`.
        """
        return draw_figure(self)

    def _repr_png_(self) -> bytes:
        """The figure, as notebooks show it."""
        image = BytesIO()
        self.figure().savefig(image, format="png")
        return image.getvalue()

    def page(self) -> go.Figure:
        """The chart as a plotly figure: to zoom in, and to read values by pointing at them.

        Returns
        -------
        plotly Figure
            The page, with alt text and table in its metadata.
        """
        return draw_page(self)

    def save(self, folder: str | Path, name: str) -> tuple[Path, Path]:
        """Write the figure as name.png and the page as name.html; the PNG's metadata have title and alt text.

        Parameters
        ----------
        folder : path
            Made if it does not exist.
        name : str
            Name of both files, without their endings.

        Returns
        -------
        tuple of Path
            The PNG and the page.

        Raises
        ------
        AmbError
            If a file cannot be written.
        """
        image = write_image(Path(folder), name, self.figure(), self.title, self.alt)
        return image, write_page(Path(folder), name, self.page())

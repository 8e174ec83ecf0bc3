"""What the data say about the order of a model: singular values, criteria and cross-validation, the choice marked."""

from __future__ import annotations

import numpy as np

from amb_core.identification.estimate.order_selection import OrderSelection
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Points, Rule, Table
from amb_core.report.figures.style import BLUE, GREEN, VERMILION, Marker, Stroke

ORDER = "order"


def order_chart(selection: OrderSelection, title: str = "Order of the model") -> Chart:
    """Singular values, criteria of Akaike and Schwarz, and the error of cross-validation over the order.

    Parameters
    ----------
    selection : OrderSelection
        From `select_order`.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    values = selection.singular_values[: selection.orders[-1]]
    values = values[values > 0.0]
    chosen = Rule(selection.chosen, f"order {selection.chosen}, chosen by BIC", Stroke(VERMILION, "dot"))
    places = np.arange(1, len(values) + 1)
    panels = [
        Panel(
            Axis(ORDER),
            Axis("singular value (-)", log=True),
            (chosen, Points(places, values, "singular value of the subspace method", BLUE, "circle")),
            "How strongly the states show, relative to the strongest",
        ),
        Panel(
            Axis(ORDER),
            Axis("criterion, its least value 1 (-)", log=True),
            (
                chosen,
                *_line(selection, 1.0 + selection.bic, "Schwarz (BIC)", BLUE, "circle"),
                *_line(selection, 1.0 + selection.aic, "Akaike (AIC)", GREEN, "square"),
            ),
            f"Criteria: the least BIC at order {selection.chosen}, the least AIC at {selection.best_by_aic}",
        ),
        Panel(
            Axis(ORDER),
            Axis("prediction error (%)", log=True),
            (chosen, *_line(selection, 100.0 * selection.validation_error, "cross-validation", BLUE, "circle")),
            f"Prediction of data unknown to the model: the least error at order {selection.best_by_validation}",
        ),
    ]
    alt = (
        f"Singular values, criteria and cross-validation for the orders {selection.orders[0]} to "
        f"{selection.orders[-1]}. The criterion of Schwarz chooses order {selection.chosen}, that of Akaike "
        f"{selection.best_by_aic}; cross-validation is best at {selection.best_by_validation}."
    )
    return Chart(title, alt, tuple(panels), shared_x=True, size=(8.0, 9.0), table=_table(selection))


def _table(selection: OrderSelection) -> Table:
    rows = tuple(
        (str(order), f"{bic:.4g}", f"{aic:.4g}", f"{100.0 * error:.5g}")
        for order, bic, aic, error in zip(
            selection.orders, selection.bic, selection.aic, selection.validation_error, strict=True
        )
    )
    return Table((ORDER, "BIC less its least", "AIC less its least", "cross-validation error (%)"), rows)


def _line(selection: OrderSelection, values: np.ndarray, label: str, colour: str, marker: Marker) -> tuple[Item, Item]:
    known = np.isfinite(values)
    x, y = np.array(selection.orders)[known], values[known]
    hover = tuple(f"order {order}: {value:.5g}" for order, value in zip(x, y, strict=True))
    return Curve(x, y, "", Stroke(colour, width=0.8)), Points(x, y, label, colour, marker, hover=hover)

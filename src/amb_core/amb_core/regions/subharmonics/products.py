"""Intermodulation products of three tones, and the frequencies to which sampling folds them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import product as pairs


@dataclass(frozen=True)
class Product:
    """The product a f1 + b f2 + c f3 of the tones, after sampling: at a f1 + b f2 + c f3 - folds f_s >= 0.

    Attributes
    ----------
    a, b, c : int
        Multiples of the tones.
    folds : int
        Multiples of the sample rate that are subtracted. 0: intermodulation that a loop without sampling would have
        too. Otherwise the line has this frequency because the loop is sampled.
    """

    a: int
    b: int
    c: int
    folds: int

    @property
    def order(self) -> int:
        """Order abs(a) + abs(b) + abs(c)."""
        return abs(self.a) + abs(self.b) + abs(self.c)

    @property
    def label(self) -> str:
        """Text such as `f2 - f1` or `fs - 3f3`."""
        factors = ((self.a, "f1"), (self.b, "f2"), (self.c, "f3"), (-self.folds, "fs"))
        terms = sorted((term for term in factors if term[0]), key=lambda term: term[0] < 0)
        text = ""
        for factor, name in terms:
            sign = ("-" if factor < 0 else "") if not text else (" - " if factor < 0 else " + ")
            text += f"{sign}{abs(factor) if abs(factor) > 1 else ''}{name}"
        return text


def products_by_bin(periods: tuple[int, int, int], block: int, order: int) -> dict[int, tuple[Product, ...]]:
    """All products up to an order, by the bin of a block on which they fall.

    Parameters
    ----------
    periods : tuple of int
        Periods of the three tones in a block; 0 for a tone that is absent.
    block : int
        Samples in a block.
    order : int
        Highest order.

    Returns
    -------
    dict of int to tuple of Product
        From bin 0 (0 Hz) to `block // 2`; in each bin the products in order, of equal order the unfolded first.
    """
    ranges = [range(-order, order + 1) if count else range(1) for count in periods]
    by_bin: dict[int, list[Product]] = defaultdict(list)
    for a, b, c in pairs(*ranges):
        if (a, b, c) <= (0, 0, 0) or abs(a) + abs(b) + abs(c) > order:
            continue  # a product and its negative are the same line: only one of them counts
        cycles = a * periods[0] + b * periods[1] + c * periods[2]
        folds = (2 * cycles + block) // (2 * block)  # nearest whole number, exact
        place = cycles - folds * block
        by_bin[abs(place)].append(Product(a, b, c, folds) if place >= 0 else Product(-a, -b, -c, -folds))
    return {
        place: tuple(sorted(products, key=lambda item: (item.order, abs(item.folds), abs(item.c))))
        for place, products in sorted(by_bin.items())
    }

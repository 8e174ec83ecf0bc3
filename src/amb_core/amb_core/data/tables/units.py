"""Units that files have, and their factors to SI. Sources: SI brochure, 9th ed., 2019; 1 mil = 25.4 um exactly."""

from __future__ import annotations

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 25.4e-3, "inch": 25.4e-3, "mil": 25.4e-6}
CURRENTS = {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "kA": 1e3}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
OTHERS = {"V": ("V", 1.0), "mV": ("V", 1e-3), "uV": ("V", 1e-6), "kV": ("V", 1e3), "N": ("N", 1.0), "kN": ("N", 1e3)}
_SPELLINGS = {
    "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometer": "um", "mils": "mil", "thou": "mil",
    "µa": "uA", "μa": "uA", "µs": "us", "μs": "us", "usec": "us", "msec": "ms", "sec": "s", "secs": "s", "second": "s",
    "seconds": "s", "sekunden": "s", "amp": "A", "amps": "A", "ampere": "A", "volt": "V", "volts": "V", "meter": "m",
    "metre": "m", "millimeter": "mm", "inches": "in", "ma": "mA", "mv": "mV", "µv": "uV", "μv": "uV",
}  # fmt: skip
KNOWN = ", ".join([*LENGTHS, *CURRENTS, *TIMES])


def spelled(unit: str) -> str:
    """A unit as this module writes it; unchanged where it is not known."""
    unit = unit.strip()
    return unit if unit in LENGTHS or unit in CURRENTS or unit in TIMES else _SPELLINGS.get(unit.casefold(), unit)


def si(unit: str) -> tuple[str, float]:
    """SI unit of a unit, and the factor to it; an unknown one is kept, with the factor 1."""
    word = spelled(unit)
    for known, name in ((LENGTHS, "m"), (CURRENTS, "A"), (TIMES, "s")):
        if word in known:
            return name, known[word]
    return OTHERS.get(word, (word, 1.0))


def is_known(unit: str) -> bool:
    """Whether the factor of a unit is known."""
    word = spelled(unit)
    return word in LENGTHS or word in CURRENTS or word in TIMES or word in OTHERS

"""Units of length: their names in files, and lengths as people read them."""

from typing import Any

SCALES = {"km": 3, "m": 0, "dm": -1, "cm": -2, "mm": -3, "µm": -6, "nm": -9, "Å": -10, "pm": -12}
SHOWN = ("km", "m", "mm", "µm", "nm", "Å")  # units of scale bars
NAMES = {"inch": "in", "inche": "in", '"': "in", "micron": "µm", "um": "µm", "a": "Å", "å": "Å"}
NAMES |= {"angstrom": "Å", "ångström": "Å", "foot": "ft", "feet": "ft"}
PREFIXES = {"kilo": "k", "": "", "deci": "d", "centi": "c", "milli": "m", "micro": "µ"}
PREFIXES |= {"nano": "n", "pico": "p"}
NAMES |= {f"{prefix}meter": f"{short}m" for prefix, short in PREFIXES.items()}
OTHERS = {"in": 25.4, "ft": 304.8}  # mm


def unit_of_length(word: str) -> tuple[str, float]:
    """Our unit for a file's unit of length, by its name there, and the factor to it.

    These are mm, and µm for shorter ones. The unit is empty for anything else, such as pixels.

    Examples
    --------
    >>> from resample.lengths import unit_of_length
    >>> unit_of_length("microns"), unit_of_length("inch"), unit_of_length("pixel")
    (('µm', 1.0), ('mm', 25.4), ('', 1.0))
    """
    word = word.strip(" \0\"'").replace("\\u00B5", "µ").replace("μ", "µ").replace("\u212b", "Å")
    name = word.lower().replace("metre", "meter")
    symbol = word if word in SCALES else NAMES.get(name) or NAMES.get(name.removesuffix("s"), name)
    if symbol in OTHERS:
        return "mm", OTHERS[symbol]
    if symbol not in SCALES:
        return "", 1.0
    unit = "mm" if SCALES[symbol] >= SCALES["mm"] else "µm"
    return unit, ratio(symbol, unit)


def times(length: Any, by: float) -> Any:
    """A length times a power of 10, without the rounding of powers below 1.

    Examples
    --------
    >>> from resample.lengths import times
    >>> 69 * 0.001, times(69, 0.001)
    (0.069, 0.069)
    """
    return length * by if by >= 1 else length / round(1 / by)


def ratio(unit: str, to: str) -> float:
    """Number of one unit in another, by their symbols.

    Examples
    --------
    >>> from resample.lengths import ratio
    >>> ratio("mm", "µm"), ratio("Å", "nm")
    (1000.0, 0.1)
    """
    power = SCALES[unit] - SCALES[to]
    return 10.0**power if power >= 0 else 1 / 10.0**-power


def length_text(length: float, unit: str) -> str:
    """A length with the unit that suits its magnitude; without a unit, the number.

    Examples
    --------
    >>> from resample.lengths import length_text
    >>> length_text(0.01, "mm"), length_text(200, "nm"), length_text(3, "")
    ('10 µm', '200 nm', '3')
    """
    if unit not in SCALES:
        return f"{length:g}"
    each = {shown: length * ratio(unit, shown) for shown in SHOWN}
    shown = next((one for one in SHOWN if abs(each[one]) >= 1 - 1e-9), unit)
    return f"{length if shown == unit else each[shown]:.12g} {shown}"

"""Isosurfaces in the scene of a volume, and their look."""

import math
from dataclasses import dataclass
from importlib.util import find_spec

from resample_volume.surfaces.meshes import GRAY, choices_of, chosen_color, chosen_opacity

KEYS = ("color", "opacity")
FORM = "give a value, and after a colon color and opacity, as in 300:color=ivory,opacity=0.5"


@dataclass(frozen=True)
class IsoSurface:
    """An isosurface of the field, shaded as meshes are.

    Examples
    --------
    >>> from resample_volume import IsoSurface
    >>> IsoSurface.of("300:opacity=0.5")
    IsoSurface(value=300.0, color=(0.6, 0.6, 0.6), opacity=0.5)
    """

    value: float  # data units
    color: tuple[float, float, float] = (GRAY, GRAY, GRAY)  # linear light
    opacity: float = 1.0

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise ValueError(f"surface of {self.value}; {FORM}")
        if not 0 <= self.opacity <= 1:
            raise ValueError(f"opacity {self.opacity} of a surface; give 0 to 1")
        if find_spec("vtkmodules") is None:
            raise ValueError(
                f"the surface of {self.value:g} is found by VTK; pip install "
                "'hybrid-resample[vtk]', or show it alone by the projection first-hit"
            )

    @classmethod
    def of(cls, text: str) -> "IsoSurface":
        """Parse `300` or `300:color=ivory,opacity=0.5`.

        Raises
        ------
        ValueError
            The text is not of this form, a choice is unknown or not allowed, or VTK is missing.
        """
        number, _, rest = text.partition(":")
        choices = choices_of("surface", text, rest, KEYS, FORM)
        try:
            value = float(number)
        except ValueError:
            raise ValueError(f"surface {text!r}; {FORM}") from None
        color = (GRAY, GRAY, GRAY)
        if "color" in choices:
            color = chosen_color("surface", choices["color"])
        return cls(value, color, chosen_opacity("surface", choices))

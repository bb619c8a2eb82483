"""Slabs of the scene outside of which nothing is shown."""

from typing import NamedTuple

import numpy as np

from resample.types import Doubles

FORM = (
    "give its center (0 is the volume's center) and thickness in scene units along the view, or "
    "along a scene direction: 20/10 or 20/10/0/0/1"
)


class Section(NamedTuple):
    """The slab between two parallel planes."""

    center: float  # scene units from the volume's center, along the normal
    thickness: float  # scene units, > 0
    normal: tuple[float, float, float] | None = None  # scene direction; None: away from the eye

    @classmethod
    def of(cls, text: str) -> "Section":
        """Parse `center/thickness` or `center/thickness/nx/ny/nz`."""
        try:
            numbers = [float(part) for part in text.split("/")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 5) or not np.isfinite(numbers).all():
            raise ValueError(f"slab {text!r}; {FORM}")
        center, thickness, *normal = numbers
        if not thickness > 0:
            raise ValueError(f"slab {text!r}: its thickness must be above 0; {FORM}")
        if not normal:
            return cls(center, thickness)
        if not any(normal):
            raise ValueError(f"slab {text!r}: the normal must not be 0/0/0; {FORM}")
        x, y, z = normal
        return cls(center, thickness, (x, y, z))

    @property
    def clips(self) -> tuple[str, ...]:
        """Both planes as `cropping.planes` takes them; none for a slab across the view."""
        if self.normal is None:
            return ()
        near, far = self.center - self.thickness / 2, self.center + self.thickness / 2
        toward = "/".join(map(repr, self.normal))
        back = "/".join(repr(-part) for part in self.normal)
        return f"{toward}/{near!r}", f"{back}/{-far!r}"

    def planes(self, forward: Doubles) -> Doubles:
        """Return both planes (2, 4) around the scene's origin, as `cropping.planes` does.

        Parameters
        ----------
        forward
            (3,) direction of the view, used if there is no normal.
        """
        normal = np.asarray(forward if self.normal is None else self.normal, np.float64)
        normal = normal / np.abs(normal).max()
        normal /= np.linalg.norm(normal)
        near, far = self.center - self.thickness / 2, self.center + self.thickness / 2
        return np.array([[*normal, -near], [*-normal, far]])

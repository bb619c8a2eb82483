"""Labels of voxels, and rules for their looks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.types import Flags, Floats
from resample_volume.classification.transfer import Color
from resample_volume.data.values import values_of
from resample_volume.types import Volume

LISTED = 16  # labels listed in an error message
MOST_RULES = 254  # rules with distinct 8-bit numbers, see `Labels.numbers`

FORM = "give label:color=tomato,opacity=0.5, either of them, or label:hidden"


@dataclass(frozen=True)
class Rule:
    """Look of the voxels of a label."""

    color: Color | None = None  # sRGB as displayed, 0..1; None: as the transfer function says
    opacity: float = 1.0  # factor of opacities, 0 or more; results are clipped to 1

    def __post_init__(self) -> None:
        if not 0 <= self.opacity < np.inf:
            raise ValueError(f"opacity must be 0 or more (got {self.opacity:g})")

    def applied(self, color: Floats, opacity: Floats) -> tuple[Floats, Floats]:
        """Return colors (N, 3) in linear light and opacities (N,) of voxels of the label."""
        if self.color is not None:
            color = np.broadcast_to(from_srgb(np.array(self.color)), color.shape)
        return np.asarray(color, np.float32), np.minimum(opacity * self.opacity, 1)


@dataclass(frozen=True, eq=False)
class Labels:
    """A label for each voxel, and rules for some labels; others are unchanged."""

    values: NDArray[Any]  # (Z, Y, X) integers
    rules: Mapping[int, Rule] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.values.dtype.kind not in "iu":
            raise ValueError(
                f"labels must be whole numbers, not {self.values.dtype}; convert the file"
            )

    @property
    def are_few(self) -> bool:
        """Whether each rule has an 8-bit number of its own, see `numbers`."""
        return len(self.rules) <= MOST_RULES

    def check(self, volume: Volume) -> None:
        """Raise a ValueError if the volume is of another shape."""
        if self.values.shape != volume.values.shape:
            own, other = (" x ".join(map(str, one.values.shape[::-1])) for one in (self, volume))
            raise ValueError(f"labels of {own} voxels do not fit a volume of {other}")

    def numbers(self, part: slice) -> Flags:
        """Number voxels of some slices (Z, Y, X): 1 without rule, otherwise from 2, cyclically."""
        values = self.values[part]
        found = np.ones(values.shape, np.uint8)
        for n, label in enumerate(self.rules):
            found[values == label] = n + 2
        return found

    def applied(
        self, voxel: NDArray[np.int64], color: Floats, opacity: Floats
    ) -> tuple[Floats, Floats]:
        """Apply the rules to linear colors (N, 3) and opacities (N,) of voxels by flat index."""
        if not self.rules:
            return color, opacity
        label = self.values[np.unravel_index(voxel, self.values.shape)]
        color, opacity = color.copy(), opacity.copy()
        for number, rule in self.rules.items():
            chosen = label == number
            color[chosen], opacity[chosen] = rule.applied(color[chosen], opacity[chosen])
        return color, opacity


def parse_rules(rules: Sequence[str]) -> dict[int, Rule]:
    """Parse rules such as `1:color=tomato,opacity=0.5` and `2:hidden`, by label."""
    found: dict[int, Rule] = {}
    for text in rules:
        try:
            label, rule = _rule(text)
        except ValueError as error:
            raise ValueError(f"rule {text!r}: {error}") from None
        if label in found:
            raise ValueError(f"rule {text!r}: label {label} has another rule already")
        found[label] = rule
    return found


def _rule(text: str) -> tuple[int, Rule]:
    from resample_volume.classification.files import displayed_color

    name, _, changes = text.partition(":")
    try:
        label = int(name)
    except ValueError:
        raise ValueError(f"{name!r} is not a label; {FORM}") from None
    if not changes.strip():
        raise ValueError(f"it changes nothing; {FORM}")
    color, opacity = None, 1.0
    for change in changes.split(","):
        key, _, value = (part.strip() for part in change.partition("="))
        match key:
            case "hidden" if not value:
                opacity = 0.0
            case "opacity":
                try:
                    opacity = float(value)
                except ValueError:
                    raise ValueError(f"opacity must be a number (got {value!r})") from None
            case "color":
                color = displayed_color(value)
            case _:
                raise ValueError(f"{change.strip()!r} is unknown; {FORM}")
    return label, Rule(color, opacity)


def check_known(labels: Labels) -> None:
    """Reject rules for labels that no voxel has."""
    if not labels.rules:
        return
    present = values_of(labels.values).unique()
    for label in labels.rules:
        if label not in present:
            some = ", ".join(map(str, sorted(present)[:LISTED]))
            more = f" and {len(present) - LISTED} more" if len(present) > LISTED else ""
            raise ValueError(f"no voxel has the label {label}; there are {some}{more}")

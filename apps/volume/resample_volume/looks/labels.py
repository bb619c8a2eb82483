"""Labels of voxels, and what is changed for some of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.types import Floats
from resample_volume.looks.transfer import Color
from resample_volume.types import Volume
from resample_volume.voxels.parts import slabs

LISTED = 16  # labels that an error message names

FORM = "give label:color=tomato,opacity=0.5, one of both, or label:hidden"


@dataclass(frozen=True)
class Rule:
    """What voxels of a label look like.

    Raises
    ------
    ValueError
        A number is outside its range.
    """

    color: Color | None = None  # sRGB as displayed, 0..1; None: as the transfer function says
    opacity: float = 1.0  # what opacities are multiplied by, 0 or more; 1 is the most they can be

    def __post_init__(self) -> None:
        if not 0 <= self.opacity < np.inf:
            raise ValueError(f"opacity must be 0 or more (got {self.opacity:g})")


@dataclass(frozen=True, eq=False)
class Labels:
    """A label for each voxel, and rules for some labels; others look as if there were none.

    Raises
    ------
    ValueError
        The labels are no whole numbers.
    """

    values: NDArray[Any]  # (Z, Y, X) integers
    rules: Mapping[int, Rule] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.values.dtype.kind not in "iu":
            raise ValueError(
                f"labels must be whole numbers, not {self.values.dtype}; convert the file"
            )

    def check(self, volume: Volume) -> None:
        """Raise a ValueError if the volume is of another shape."""
        if self.values.shape != volume.values.shape:
            raise ValueError(
                f"labels of {_size(self.values)} voxels do not fit a volume of "
                f"{_size(volume.values)}"
            )

    def applied(
        self, voxel: NDArray[np.int64], color: Floats, opacity: Floats
    ) -> tuple[Floats, Floats]:
        """Colors and opacities of voxels by the rules.

        Parameters
        ----------
        voxel
            (N,) indices into the flat volume, z slowest.
        color
            (N, 3) linear light.
        opacity
            (N,) 0..1.
        """
        if not self.rules:
            return color, opacity
        label = self.values[np.unravel_index(voxel, self.values.shape)]
        color, opacity = color.copy(), opacity.copy()
        for number, rule in self.rules.items():
            chosen = label == number
            opacity[chosen] = np.minimum(opacity[chosen] * rule.opacity, 1)
            if rule.color is not None:
                color[chosen] = from_srgb(np.array(rule.color))
        return color, opacity


def read_labels(path: str, rules: Sequence[str], volume: Volume) -> Labels:
    """Labels of a volume's voxels from a file.

    Parameters
    ----------
    path
        What `open_volume` takes.
    rules
        Each such as `1:color=tomato,opacity=0.5` or `2:hidden`, one for a label.
    volume
        Whose voxels; of the same shape.

    Raises
    ------
    ValueError
        The file holds no whole numbers, or is of another shape than the volume; a rule cannot be
        read, or no voxel has its label.
    OSError
        The file cannot be read.
    """
    from resample_volume.files.source import open_volume

    chosen = parse_rules(rules)
    try:
        found = open_volume(path)
        if found.colors is not None:
            raise ValueError("labels are whole numbers, one for each voxel, not colors")
        labels = Labels(found.values, chosen)
        labels.check(volume)
        _check_known(labels)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return labels


def parse_rules(rules: Sequence[str]) -> dict[int, Rule]:
    """Rules by label, from texts such as `1:color=tomato,opacity=0.5` and `2:hidden`.

    Raises
    ------
    ValueError
        A text is no rule, or two are for one label.
    """
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
    from resample_volume.looks.files import displayed_color

    name, _, changes = text.partition(":")
    try:
        label = int(name)
    except ValueError:
        raise ValueError(f"{name!r} is no label; {FORM}") from None
    if not changes.strip():
        raise ValueError(f"it changes nothing; {FORM}")
    color, opacity = None, 1.0
    for change in changes.split(","):
        key, _, value = (part.strip() for part in change.partition("="))
        match key:
            case "hidden" if not value:
                opacity = 0.0
            case "opacity":
                opacity = _number(value)
            case "color":
                color = displayed_color(value)
            case _:
                raise ValueError(f"{change.strip()!r} is unknown; {FORM}")
    return label, Rule(color, opacity)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"opacity must be a number (got {text!r})") from None


def _check_known(labels: Labels) -> None:
    if not labels.rules:
        return
    present: set[int] = set()
    for slab in slabs(labels.values):
        present.update(np.unique(slab).tolist())
    for label in labels.rules:
        if label not in present:
            some = ", ".join(map(str, sorted(present)[:LISTED]))
            more = f" and {len(present) - LISTED} more" if len(present) > LISTED else ""
            raise ValueError(f"no voxel has the label {label}; there are {some}{more}")


def _size(values: NDArray[Any]) -> str:
    return " x ".join(map(str, values.shape[::-1]))

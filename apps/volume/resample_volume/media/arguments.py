"""Check what an appearance is made of: objects of other kinds are refused in one line."""

from typing import Any

from resample.words import check_kind, doubles_of, shortly
from resample_volume.media.xrays import XRay
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import GRADIENTS

TWO = "two fractions of the steepest slope, such as (0.1, 0.3)"


def check_transfer(name: str, given: Any) -> None:
    """Refuse what is no transfer function, and no name of one."""
    if not isinstance(given, str) and not hasattr(given, "needs_gradient"):
        raise TypeError(
            f"{name} {shortly(given)}; give a name, such as bone, a range of values, such as "
            "300..900, or a TransferFunction"
        )


def check_kinds(look: Any) -> None:
    """Refuse objects of another kind than the one that an attribute takes."""
    from resample_volume.classification.labels import Labels

    kinds: dict[str, tuple[type, str]] = {
        "light": (Light, "a Light, or None for colors as they are"),
        "labels": (Labels, "Labels, such as those of read_labels"),
        "cue": (DepthCue, "a DepthCue"),
        "crop": (str, "ranges of voxels along x, y and z, such as '64:192,:,10:'"),
        "slab": (str, "center and thickness, such as '20,5'"),
        "xray": (XRay, "an XRay"),
    }
    for name, (kind, wanted) in kinds.items():
        if getattr(look, name) is not None:
            check_kind(name, getattr(look, name), kind, wanted)
    if look.gradient not in list(GRADIENTS):
        raise ValueError(f"gradient {shortly(look.gradient)}; known: {', '.join(GRADIENTS)}")
    if look.gradient_opacity is not None:
        pair = doubles_of("gradient_opacity", look.gradient_opacity, TWO)
        if pair.shape != (2,):
            raise ValueError(f"gradient_opacity {shortly(look.gradient_opacity)}; give {TWO}")


def several_of(name: str, given: Any, *kinds: type) -> list[Any]:
    """Return objects of some kinds; one is given as such, or in a list."""
    if isinstance(given, kinds):
        return [given]
    wanted = " or ".join(kind.__name__ for kind in kinds)
    try:
        found = list(given or ())
    except TypeError:
        found = [given]
    for one in found:
        check_kind(name, one, kinds, f"a sequence of {wanted}")
    return found

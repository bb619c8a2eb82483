"""What a volume looks like, and who paints it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

from resample.memory import available_memory
from resample.painting.choices import MEASURING, Projection
from resample.painting.splines import LARGEST, bytes_of_field
from resample.profiles.orders import OF_FIELDS, EverySample, Rays, Summing
from resample.resampler import Resampler
from resample_volume.data.bricks import Bricks, Values
from resample_volume.looks.automatic import levels
from resample_volume.looks.labels import MOST_RULES
from resample_volume.looks.presets import Window, transfer_for
from resample_volume.looks.surveys import survey
from resample_volume.looks.transfer import Transfer
from resample_volume.media.xrays import XRay
from resample_volume.surfaces.image_planes import ImagePlane
from resample_volume.surfaces.iso_surfaces import IsoSurface
from resample_volume.surfaces.meshes import SceneMesh
from resample_volume.surfaces.sections import Section
from resample_volume.types import Volume
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import finite_range

if TYPE_CHECKING:
    from resample_volume.looks.labels import Labels

# Each keeps tables of its own.
OF_VOXELS, ALONG_RAYS = Resampler(), Resampler(order=Rays())
BY_DEFAULT = Resampler(order=Rays(quality="usual"))
GRADIENT = "central"  # if none is asked for
MET = ("mesh", "plane", "surface")  # what rays meet besides the volume
X_RAYS = Resampler(order=Rays(), projection=Projection.XRAY)


class Classification(StrEnum):
    """When values get their color and opacity."""

    AUTO = "auto"  # post where rays can go through the field, else pre; see `decided`
    PRE = "pre"  # voxels get them, and colors are reconstructed
    POST = "post"  # the field is reconstructed, and gets them after that


@dataclass(frozen=True)
class Appearance:
    """What of a volume is seen, and what it looks like.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import Appearance, Light, render
    >>> values = np.random.default_rng(1).integers(0, 255, (12, 12, 12), np.uint8)
    >>> look = Appearance("120..400", Light(ambient=0.5), crop="2:10,:,:")
    >>> render(values, look, size=(32, 24))
    Frame(32 × 24 px, 21.2 % covered, depth from 40.05)
    """

    transfer: Transfer | str = "auto"  # function, or what `load_transfer` takes
    light: Light | None = field(default_factory=Light)  # None: colors as they are
    gradient: str = GRADIENT  # or sobel
    gradient_opacity: tuple[float, float] | None = None  # see `classify`
    classification: Classification = Classification.AUTO
    labels: "Labels | None" = None
    cue: DepthCue | None = None
    crop: str | None = None  # ranges of voxels along x, y and z, see `cropping.planes`
    clip: tuple[str, ...] = ()  # planes through the middle, see `cropping.planes`
    framing: Transfer | str | None = None  # what it shows is in the picture; None: `transfer`
    meshes: tuple[SceneMesh, ...] = ()  # that stand in the volume's scene; cuts leave them whole
    planes: tuple[ImagePlane, ...] = ()  # that show values as they are; cuts leave them whole
    surfaces: tuple[IsoSurface, ...] = ()  # of one value; cuts leave them whole
    slab: str | None = None  # outside of which nothing is shown, see `Section.of`
    xray: XRay | None = None  # of the projection xray, which it chooses; None: the usual one
    invert: bool = False  # black and white are exchanged, for projections of values

    def __post_init__(self) -> None:
        object.__setattr__(self, "classification", Classification(self.classification))
        planes = (ImagePlane.of(one) if isinstance(one, str) else one for one in self.planes)
        object.__setattr__(self, "planes", tuple(planes))
        surfaces = (IsoSurface.of(one) if isinstance(one, str) else one for one in self.surfaces)
        object.__setattr__(self, "surfaces", tuple(surfaces))
        if self.slab is not None:
            Section.of(self.slab)

    @property
    def section(self) -> Section | None:
        """Slab outside of which nothing is shown."""
        return None if self.slab is None else Section.of(self.slab)

    @property
    def cuts(self) -> tuple[str, ...]:
        """Planes of clip and of a slab across a scene direction, see `cropping.planes`."""
        return self.clip if self.section is None else (*self.clip, *self.section.clips)

    @property
    def extras(self) -> list[str]:
        """Names of what was chosen and is not for all projections."""
        chosen = {
            "labels": self.labels,
            "gradient-opacity": self.gradient_opacity,
            "depth-cue": self.cue,
            "mesh": self.meshes or None,
            "plane": self.planes or None,
            "surface": self.surfaces or None,
            "xray": self.xray,
            "invert": self.invert or None,
        }
        return [name for name, choice in chosen.items() if choice is not None]

    @property
    def met(self) -> list[str]:
        """Names of what rays meet besides the volume."""
        return [name for name in self.extras if name in MET]

    @property
    def needed_gradient(self) -> str | None:
        """How gradients are found; None where light does not need them."""
        return None if self.light is None else self.gradient


Medium = tuple[Volume, Appearance]  # one of several in a scene, and its look


class Met(NamedTuple):
    """What rays meet besides the volume."""

    meshes: tuple[SceneMesh, ...]
    planes: tuple[ImagePlane, ...]
    surfaces: tuple[IsoSurface, ...]

    def within(self, span: tuple[float, float]) -> "Met":
        """The same, planes without a window with one of this least and greatest value."""
        return self._replace(planes=tuple(plane.within(span) for plane in self.planes))

    def beside(self, look: Appearance) -> Appearance:
        """The same look, with these."""
        return replace(look, **self._asdict()) if any(self) else look


def transfer_of(
    volume: Volume, appearance: Appearance, projection: Projection = Projection.COMPOSITE
) -> Transfer:
    """Transfer function, also where it was given by name."""
    return named_or_own(appearance.transfer, volume, projection)


def named_or_own(
    given: Transfer | str, volume: Volume, projection: Projection = Projection.COMPOSITE
) -> Transfer:
    """Transfer function, which may be given by its name."""
    return named_transfer(given, volume, projection) if isinstance(given, str) else given


def named_transfer(
    name: str, volume: Volume, projection: Projection, window: Window | None = None
) -> Transfer:
    """Transfer function by name; `auto` shows values as opaque gray, where they are projected."""
    if name == "auto" and projection in MEASURING:
        return levels(volume, survey(volume), projection, window)
    return transfer_for(name, volume, window)


def check_together(
    resampler: Resampler, classification: Classification, extras: Collection[str] = ()
) -> None:
    """Refuse choices that do not go together, and say which do.

    Parameters
    ----------
    resampler
        Renderer.
    classification
        When values get their colors.
    extras
        Names of what else was chosen, see `Appearance.extras`.

    Raises
    ------
    ValueError
        The order composites colors, where the field is wanted; or the field has no labels, lights
        or gradients to show.
    """
    projection = resampler.projection
    is_composite = projection is Projection.COMPOSITE
    _check_values(projection, extras)
    _check_met([name for name in MET if name in extras], resampler, classification)
    if is_composite and _in_effect(classification, resampler) is Classification.PRE:
        if resampler.order.summing is Summing.RAYS:
            raise ValueError(
                "the order rays gathers values, so it needs the classification post, or a "
                "projection of values; for the classification pre take another order"
            )
        return
    if resampler.order.summing not in OF_FIELDS:
        raise ValueError(
            f"the classification post needs the order rays or image-sheets, not {resampler.order}"
        )
    if "labels" in extras and not (is_composite and resampler.order.summing is Summing.RAYS):
        raise ValueError(
            "labels color voxels, so they need the projection composite, and along rays or in the "
            "classification pre"
        )
    if "gradient-opacity" in extras and not is_composite:
        raise ValueError(
            f"gradient-opacity fades voxels, so it needs the projection composite, not {projection}"
        )
    if "depth-cue" in extras and projection in MEASURING:
        raise ValueError(
            "depth-cue dims light, so it needs the projection composite or first-hit, not "
            f"{projection}"
        )


def _in_effect(classification: Classification, resampler: Resampler) -> Classification:
    """What `auto` is for a renderer, if nothing of the volume hinders it."""
    if classification is not Classification.AUTO:
        return classification
    is_by_rays = resampler.order.summing is Summing.RAYS
    return Classification.POST if is_by_rays else Classification.PRE


def _check_values(projection: Projection, extras: Collection[str]) -> None:
    """Refuse what is of projections of values, where these are not projected."""
    if "xray" in extras and projection is not Projection.XRAY:
        raise ValueError(
            f"mu-water and what else is of X-rays needs the projection xray, not {projection}"
        )
    if "invert" in extras and projection not in MEASURING:
        raise ValueError(
            "invert exchanges black and white of values, so it needs the projection "
            f"{', '.join(MEASURING[:-1])} or {MEASURING[-1]}, not {projection}"
        )


def _check_met(names: list[str], resampler: Resampler, classification: Classification) -> None:
    """Refuse meshes and planes where no ray ends on them."""
    if not names:
        return
    name = names[0]
    if resampler.projection in MEASURING:
        raise ValueError(
            f"a {name} is seen through the volume, so it needs the projection composite or "
            f"first-hit, not {resampler.projection}"
        )
    is_pre = _in_effect(classification, resampler) is Classification.PRE and resampler.iso is None
    if is_pre or resampler.order.summing is not Summing.RAYS:
        raise ValueError(
            f"a {name} ends rays through the field, so it needs the order rays and the "
            "classification post or auto"
        )


def resampler_for(appearance: Appearance) -> Resampler:
    """Renderer by default: along rays, but for voxels that have colors before they are summed."""
    if appearance.xray is not None:
        return X_RAYS
    return {
        Classification.AUTO: BY_DEFAULT,
        Classification.PRE: OF_VOXELS,
        Classification.POST: ALONG_RAYS,
    }[appearance.classification]


def of_voxels(resampler: Resampler) -> Resampler:
    """The same renderer for samples that have colors, if it is one for fields along rays."""
    if resampler.order.summing is not Summing.RAYS:
        return resampler
    changed = replace(resampler, order=EverySample())
    return OF_VOXELS if changed == OF_VOXELS else changed


def decided(media: Sequence[Medium], resampler: Resampler) -> tuple[list[Medium], Resampler]:
    """Looks in which `auto` has become pre or post, and the renderer that goes with them.

    A field along rays is truer to the scene at any size on screen. Of several volumes together, of
    what memory does not hold as a field, and where gradients of voxels are asked for (`sobel`),
    voxels are painted; but where a mesh or a plane is among them, rays have to meet it.

    Parameters
    ----------
    media
        Volumes with their looks.
    resampler
        Renderer; of samples, if it is to paint voxels whatever they are.
    """
    looks = [look.classification for _, look in media]
    if Classification.AUTO not in looks:
        return list(media), resampler
    is_by_rays = resampler.order.summing is Summing.RAYS
    if resampler.projection is not Projection.COMPOSITE:
        is_of_field = True
    else:
        is_of_field = is_by_rays and len(media) == 1 and _suits_rays(*media[0])
        is_of_field = is_of_field or any(look.met for _, look in media)
        resampler = resampler if is_of_field else of_voxels(resampler)
    found = Classification.POST if is_of_field else Classification.PRE
    of_auto = {Classification.AUTO: found}
    return [
        (volume, replace(look, classification=of_auto.get(kind, kind)))
        for (volume, look), kind in zip(media, looks, strict=True)
    ], resampler


def _suits_rays(volume: Volume, look: Appearance) -> bool:
    """Whether a volume is one field that memory holds, lit by its own gradients."""
    if look.gradient != GRADIENT:
        return False
    if look.labels is not None and len(look.labels.rules) > MOST_RULES:
        return False
    return fits_as_field(volume) and max(map(abs, finite_range(volume.values))) < LARGEST


def fits_as_field(volume: Volume) -> bool:
    """Whether memory holds a volume as a field, and its values beside it if they are in a file."""
    values: Values = volume.values
    size = bytes_of_field(values.shape, values.dtype)
    if isinstance(values, Bricks):
        return values.memory is None or size + values.size * values.dtype.itemsize <= values.memory
    free = available_memory()
    return free is None or size <= free


def check_several(media: Sequence[Medium], resampler: Resampler) -> None:
    """Refuse several volumes where there is one field at a time to show."""
    if not media:
        raise ValueError("a scene is a list of volumes with their looks; give at least one")
    if resampler.projection is not Projection.COMPOSITE:
        raise ValueError(
            f"several volumes are composited; the projection {resampler.projection} shows the "
            "values of one"
        )
    if any(look.classification is Classification.POST for _, look in media):
        raise ValueError(
            "several volumes need the classification pre: post reconstructs the field of one"
        )
    check_together(of_voxels(resampler), Classification.PRE, media[0][1].extras)

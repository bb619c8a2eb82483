"""Appearance of a volume, the renderer that suits it, and X-rays of CT volumes."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, to_srgb
from resample.memory.mapped import array_like, most_of
from resample.messages import check_kind, check_numbers, doubles_of, shortly
from resample.outofcore.passes import memoized
from resample.painting.choices import MEASURING, Projection
from resample.painting.splines import LARGEST
from resample.profiles.orders import EverySample, Rays, Summing
from resample.registry import OneOf
from resample.resampler import Resampler
from resample.types import Frame
from resample_volume.classification.presets import BRIGHT, Window, levels, transfer_for
from resample_volume.classification.transfer import Transfer
from resample_volume.classification.value_statistics import Survey, survey
from resample_volume.data.recordings import how
from resample_volume.data.values import require_memory, slabs
from resample_volume.types import Volume
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import GRADIENTS, finite_range

if TYPE_CHECKING:
    from resample_volume.classification.labels import Labels
    from resample_volume.meshes import ImagePlane, IsoSurface, SceneMesh, Section

# Of water, per mm, near 70 keV. NIST's tables (Hubbell and Seltzer, NISTIR 5632, 2004) have 0.0206
# at 60 keV and 0.0184 at 80 keV.
MU_WATER = 0.02
WATER = 1000.0  # HU from air (no attenuation) to water
LEAST_WINDOW = 1e-6  # white level of line integrals where nothing attenuates


@dataclass(frozen=True)
class XRay:
    """Options of X-rays of Hounsfield units.

    The transmittance of a ray is exp(-p), with p the integral of mu_water · max(0, 1 + HU / 1000)
    along it. Gray levels are linear in p, bones are white.

    Raises
    ------
    ValueError
        A number is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import Appearance, XRay, as_volume, render
    >>> water = as_volume(np.zeros((8, 8, 8), np.float32))._replace(units="hu")
    >>> frame = render(water, Appearance(xray=XRay(0.02)), "front", size=(32, 32))
    >>> round(float(frame.value[16, 16]), 2)  # 8 mm of it
    0.16
    """

    mu_water: float = MU_WATER  # attenuation of water per scene unit, mm
    window: Window | None = None  # None: 0 to about the greatest along the volume's own axes
    # Offset to Hounsfield units; None: as the volume says, or guessed from its values.
    added: float | None = None

    def __post_init__(self) -> None:
        check_numbers(self, "mu_water", "added")
        if not 0 < self.mu_water < math.inf:
            raise ValueError(
                f"mu-water is {self.mu_water:g}; it must be above 0, such as {MU_WATER} per mm"
            )
        if self.window is None:
            return
        if doubles_of("window", self.window, "two ascending values").shape != (2,):
            raise ValueError(f"window {shortly(self.window)}; give two ascending values")
        if not -math.inf < self.window[0] < self.window[1] < math.inf:
            raise ValueError(f"the window {self.window} of line integrals must ascend")


class Tone(NamedTuple):
    """Tone mapping of a frame's values and light."""

    scale: float = 1.0  # factor of values
    window: Window | None = None  # values of black and white; None: light is as it is
    is_negative: bool = False  # whether black and white are swapped

    def developed(self, frame: Frame) -> Frame:
        """Return the tone mapped frame; opaque if inverted or windowed."""
        if self.window is not None and frame.value is not None:
            low, high = self.window
            value = frame.value * np.float32(self.scale)
            gray = from_srgb(np.clip((value - np.float32(low)) / np.float32(high - low), 0, 1))
            rgba = np.stack([gray, gray, gray, np.ones_like(gray)], axis=-1)
            frame = frame._replace(value=value, rgba=rgba)
        if not self.is_negative:
            return frame
        rgba = np.ones_like(frame.rgba)
        rgba[..., :3] = negative(frame.rgba[..., :3])
        return frame._replace(rgba=rgba)


AS_IT_IS = Tone()


def negative(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Invert displayed levels, of linear light."""
    return np.asarray(from_srgb(1 - to_srgb(np.clip(light, 0, 1))))


def settled(xray: XRay, volume: Volume, known: Survey | None = None) -> XRay:
    """Return the options with units and window resolved for a volume of known statistics."""
    if volume.colors is not None:
        raise ValueError(
            f"{volume.name} has colors, and X-rays are of Hounsfield units; "
            + how("channel", volume.colors.shape[-1])
        )
    if xray.added is None:
        known = known or survey(volume)
        if known.units.added is None:
            why = f"its units are {volume.units}"
            if not volume.units:
                why = "neither its file nor its values show that they are Hounsfield units"
            raise ValueError(
                f"X-rays are of Hounsfield units, but {volume.name} holds {known.low:g} to "
                f"{known.high:g}, and {why}; give its units, hu or hu+1024, or take the projection "
                "additive"
            )
        xray = replace(xray, added=known.units.added)
    if xray.window is not None:
        return xray
    water = attenuation(volume.values, xray.added)
    most = xray.mu_water * _longest(water, *map(float, volume.spacing))
    return replace(xray, window=(0.0, max(most, LEAST_WINDOW)))


@memoized(lambda values: values)
def attenuation(values: NDArray[Any], added: float | None) -> NDArray[Any]:
    """Return attenuation relative to water; NaN for missing values."""
    if most_of(values) is None:
        require_memory(4 * values.size, f"attenuation of {values.size} voxels")
    found = array_like(values, values.shape, np.float32, "attenuation")
    for part, given in zip(slabs(found), slabs(values), strict=True):
        part[:] = given
        np.subtract(part, np.float32((added or 0.0) - WATER), out=part)
        np.divide(part, np.float32(WATER), out=part)
        np.maximum(part, 0, out=part)
    return found


@memoized(lambda values: values)
def _longest(values: NDArray[Any], x: float, y: float, z: float) -> float:
    """Estimate the greatest integral along lines of voxels with these spacings, scene units."""
    deep, down, across = values.shape
    sizes = ((down, across), (deep, across), (deep, down))
    along_z, along_y, along_x = map(np.zeros, sizes)
    for n, plane in enumerate(values):
        known = np.nan_to_num(plane.astype(np.float64), nan=0.0)
        along_z += known
        along_y[n], along_x[n] = known.sum(axis=0), known.sum(axis=1)
    ends = [z * along_z.ravel(), y * along_y.ravel(), x * along_x.ravel()]
    return float(np.percentile(np.concatenate(ends), BRIGHT))


# Each keeps its own tables.
OF_VOXELS, ALONG_RAYS = Resampler(), Resampler(order=Rays())
BY_DEFAULT = Resampler(order=Rays(quality="usual"))
Gradient = Literal["central", "sobel"]
GRADIENT: Gradient = "central"  # if none is asked for
SCENE_OBJECTS = ("mesh", "plane", "surface")  # objects that rays meet besides the volume
EXTRAS = {  # options that not all projections allow, and their fields of a look
    **{"labels": "labels", "gradient-opacity": "gradient_opacity", "depth-cue": "cue"},
    **{"mesh": "meshes", "plane": "planes", "surface": "surfaces"},
    **{"xray": "xray", "invert": "invert"},
}
X_RAYS = Resampler(order=Rays(), projection=Projection.XRAY)
TWO = "two fractions of the steepest slope, such as (0.1, 0.3)"


class Classification(StrEnum):
    """When values are classified: before or after interpolation."""

    AUTO = "auto"  # post where rays can be cast through the field, else pre; see `decided`
    PRE = "pre"  # voxels are classified, and colors are interpolated
    POST = "post"  # values are interpolated, then classified


@dataclass(frozen=True)
class Appearance:
    """Visible part of a volume, and its look.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import Appearance, Light, render
    >>> values = np.random.default_rng(1).integers(0, 255, (12, 12, 12), np.uint8)
    >>> look = Appearance("120..400", Light(ambient=0.5), crop="2:10,:,:")
    >>> render(values, look, size=(32, 24))
    Frame(32 × 24 px, 31.6 % covered, depth from 32.95)
    """

    transfer: Transfer | str = "auto"  # function, or an argument of `load_transfer`
    light: Light | None = field(default_factory=Light)  # None: colors as they are
    gradient: Gradient = GRADIENT  # or sobel
    gradient_opacity: tuple[float, float] | None = None  # see `classify`
    classification: OneOf[Classification, Literal["auto", "pre", "post"]] = OneOf(
        Classification, Classification.AUTO
    )
    labels: "Labels | None" = None
    cue: DepthCue | None = None
    crop: str | None = None  # ranges of voxels along x, y and z, see `framing.planes`
    clip: tuple[str, ...] = ()  # planes through the middle, see `framing.planes`
    framing: Transfer | str | None = None  # the camera frames what this shows; None: `transfer`
    meshes: "tuple[SceneMesh, ...]" = ()  # in the volume's scene; not clipped
    planes: "tuple[ImagePlane, ...]" = ()  # show unshaded values; not clipped
    surfaces: "tuple[IsoSurface, ...]" = ()  # isosurfaces; not clipped
    slab: str | None = None  # only its inside is shown, see `Section.of`
    xray: XRay | None = None  # selects the projection xray; None: the default
    invert: bool = False  # swap black and white, for projections of values

    def __post_init__(self) -> None:
        # Check the types of attributes.
        for name in ("transfer", "framing"):
            given = getattr(self, name)
            is_none = given is None and name == "framing"
            if not is_none and not isinstance(given, str) and not hasattr(given, "needs_gradient"):
                raise TypeError(
                    f"{name} {shortly(given)}; give a name, such as bone, a range of values, such "
                    "as 300..900, or a TransferFunction"
                )
        kinds: dict[str, tuple[type, str]] = {
            "light": (Light, "a Light, or None for colors as they are"),
            "cue": (DepthCue, "a DepthCue"),
            "crop": (str, "ranges of voxels along x, y and z, such as '64:192,:,10:'"),
            "slab": (str, "center and thickness, such as '20,5'"),
            "xray": (XRay, "an XRay"),
        }
        for name, (kind, wanted) in kinds.items():
            if getattr(self, name) is not None:
                check_kind(name, getattr(self, name), kind, wanted)
        if self.labels is not None:
            from resample_volume.classification.labels import Labels

            check_kind("labels", self.labels, Labels, "Labels, such as read_labels returns")
        if self.gradient not in list(GRADIENTS):
            raise ValueError(f"gradient {shortly(self.gradient)}; known: {', '.join(GRADIENTS)}")
        if self.gradient_opacity is not None:
            pair = doubles_of("gradient_opacity", self.gradient_opacity, TWO)
            if pair.shape != (2,):
                raise ValueError(f"gradient_opacity {shortly(self.gradient_opacity)}; give {TWO}")
        object.__setattr__(self, "clip", _several_of("clip", self.clip, str))
        for name in ("meshes", "planes", "surfaces"):
            if given := getattr(self, name) or ():
                from resample_volume.meshes import ImagePlane, IsoSurface, SceneMesh

                own = {"meshes": (SceneMesh,), "planes": (ImagePlane, str)}
                given = _several_of(name, given, *own.get(name, (IsoSurface, str)))
            object.__setattr__(self, name, given)
        _ = self.section  # raises an error if it is invalid

    @property
    def section(self) -> "Section | None":
        """Slab to which the picture is limited."""
        if self.slab is None:
            return None
        from resample_volume.meshes import Section

        return Section.of(self.slab)

    @property
    def cuts(self) -> tuple[str, ...]:
        """Clip planes, and the two of a slab across a scene direction, see `framing.planes`."""
        return self.clip if self.section is None else (*self.clip, *self.section.clips)

    @property
    def extras(self) -> list[str]:
        """Names of chosen options that some projections do not allow."""
        chosen = ((name, getattr(self, field)) for name, field in EXTRAS.items())
        return [name for name, choice in chosen if choice not in (None, (), False)]


def _several_of(name: str, given: Any, *kinds: Any) -> tuple[Any, ...]:
    """Return objects of a kind, given alone or in a list; some may be texts."""
    wanted = " or ".join(kind.__name__ for kind in kinds)
    try:
        found = [given] if isinstance(given, kinds) else list(given or ())
    except TypeError:
        found = [given]
    for one in found:
        check_kind(name, one, kinds, f"a sequence of {wanted}")
    return tuple(kinds[0].of(one) if not isinstance(one, kinds[0]) else one for one in found)


VolumeLayer = tuple[Volume, Appearance]  # one of several in a scene, and its look


def transfer_of(
    volume: Volume,
    look: Appearance | Transfer | str,
    projection: Projection = Projection.COMPOSITE,
) -> Transfer:
    """Return the transfer function of a look, or one given, also by name."""
    given = look.transfer if isinstance(look, Appearance) else look
    return named_transfer(given, volume, projection) if isinstance(given, str) else given


def named_transfer(
    name: str, volume: Volume, projection: Projection, window: Window | None = None
) -> Transfer:
    """Return a transfer function by name; `auto` is opaque gray for projections of values."""
    if name == "auto" and projection in MEASURING:
        return levels(volume, survey(volume), projection, window)
    return transfer_for(name, volume, window)


def check_together(
    resampler: Resampler, classification: Classification, extras: Collection[str] = ()
) -> None:
    """Reject options that exclude each other, and list the allowed ones."""
    projection = resampler.projection
    is_composite = projection is Projection.COMPOSITE
    # Reject options for projections of values under other projections
    if "xray" in extras and projection is not Projection.XRAY:
        raise ValueError(
            f"mu-water and other options of X-rays need the projection xray, not {projection}"
        )
    if "invert" in extras and projection not in MEASURING:
        raise ValueError(
            "invert swaps black and white of values, so it needs the projection "
            f"{', '.join(MEASURING[:-1])} or {MEASURING[-1]}, not {projection}"
        )
    # Resolve `auto`, regardless of the volume
    is_by_rays = resampler.order.summing is Summing.RAYS
    is_pre = classification is Classification.PRE
    is_pre = is_pre or (classification is Classification.AUTO and not is_by_rays)
    for name in [name for name in SCENE_OBJECTS if name in extras]:
        if projection in MEASURING:
            raise ValueError(
                f"a {name} is seen through the volume, so it needs the projection composite or "
                f"first-hit, not {projection}"
            )
        if (is_pre and resampler.iso is None) or not is_by_rays:
            raise ValueError(
                f"a {name} ends rays through the field, so it needs the order rays and the "
                "classification post or auto"
            )
    if is_composite and is_pre:
        if is_by_rays:
            raise ValueError(
                "the order rays gathers values, so it needs the classification post, or a "
                "projection of values; for the classification pre take another order"
            )
        return
    if not is_by_rays:
        raise ValueError(f"the classification post needs the order rays, not {resampler.order}")
    if "labels" in extras and not is_composite:
        raise ValueError("labels color voxels, so they need the projection composite")
    if "gradient-opacity" in extras and not is_composite:
        raise ValueError(
            f"gradient-opacity fades voxels, so it needs the projection composite, not {projection}"
        )
    if "depth-cue" in extras and projection in MEASURING:
        raise ValueError(
            "depth-cue dims light, so it needs the projection composite or first-hit, not "
            f"{projection}"
        )


def resampler_for(appearance: Appearance) -> Resampler:
    """Return the default renderer: rays, or voxels for classification pre."""
    if appearance.xray is not None:
        return X_RAYS
    defaults = {Classification.PRE: OF_VOXELS, Classification.POST: ALONG_RAYS}
    return defaults.get(appearance.classification, BY_DEFAULT)


def of_voxels(resampler: Resampler) -> Resampler:
    """Return the renderer for colored samples, if this one casts rays through fields."""
    if resampler.order.summing is not Summing.RAYS:
        return resampler
    changed = replace(resampler, order=EverySample())
    return OF_VOXELS if changed == OF_VOXELS else changed


def decided(
    media: Sequence[VolumeLayer], resampler: Resampler
) -> tuple[list[VolumeLayer], Resampler]:
    """Resolve `auto` to pre or post in all looks, and return the renderer for them.

    Fields are more accurate at any size on screen. A single volume is painted by voxels if its look
    needs their gradients (`sobel`) or has more labels than fields tell apart.
    """
    looks = [look.classification for _, look in media]
    if Classification.AUTO not in looks:
        return list(media), resampler
    if resampler.projection is not Projection.COMPOSITE or Classification.POST in looks:
        is_of_field = True
    else:
        is_of_field = resampler.order.summing is Summing.RAYS and Classification.PRE not in looks
        volume, look = media[0]
        if is_of_field and len(media) == 1:  # can rays show what the look asks for?
            is_of_field = look.gradient == GRADIENT and (look.labels is None or look.labels.are_few)
            is_of_field = is_of_field and max(map(abs, finite_range(volume.values))) < LARGEST
        has_objects = any(look.meshes or look.planes or look.surfaces for _, look in media)
        is_of_field = is_of_field or has_objects
        resampler = resampler if is_of_field else of_voxels(resampler)
    found = Classification.POST if is_of_field else Classification.PRE
    of_auto = {Classification.AUTO: found}
    return [
        (volume, replace(look, classification=of_auto.get(kind, kind)))
        for (volume, look), kind in zip(media, looks, strict=True)
    ], resampler


def check_several(media: Sequence[VolumeLayer], resampler: Resampler) -> None:
    """Reject several volumes that cannot be shown together."""
    if not media:
        raise ValueError("a scene is a list of volumes with their looks; give at least one")
    if resampler.projection is not Projection.COMPOSITE:
        raise ValueError(
            f"several volumes need the projection composite; {resampler.projection} shows the "
            "values of one"
        )
    if len(media) > 1:
        # Reject looks that rays through several fields cannot show.
        if resampler.order.summing is not Summing.RAYS:
            raise ValueError(f"several volumes need the order rays, not {resampler.order}")
        for volume, look in media:
            if look.classification is Classification.PRE:
                raise ValueError(
                    "several volumes are interpolated, then classified; leave the classification "
                    "pre out, or show one of them"
                )
            if look.gradient != GRADIENT:
                raise ValueError(
                    f"gradient {look.gradient} is of the voxels of one volume, and several are "
                    "fields; leave it out"
                )
            if look.labels is not None and not look.labels.are_few:
                from resample_volume.classification.labels import MOST_RULES

                raise ValueError(
                    f"{len(look.labels.rules)} labels of {volume.name} have looks; beside other "
                    f"volumes at most {MOST_RULES} may"
                )
    check_together(resampler, media[0][1].classification, media[0][1].extras)

"""Options of the command line for a volume and its look."""

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from resample.command import flags
from resample.command.settings import Choices, Resampling
from resample.console import Color
from resample.messages import parts_of
from resample_volume.classification import PRESETS, TISSUES

if TYPE_CHECKING:
    from pathlib import Path

    from resample.cameras.viewpoints import Viewpoint
    from resample.resampler import Resampler
    from resample_volume.annotations import Annotations
    from resample_volume.appearance import Appearance
    from resample_volume.classification.labels import Labels
    from resample_volume.rendering import Fitted
    from resample_volume.types import Volume

Lit = flags.under(flags.LIGHT)
FROM_ABOVE = "30,20,1"  # the camera if none is asked for
TRANSFER = flags.Inline(rule="resample_volume.classification.presets:names_file")


def described(default: Any, text: str, **limits: Any) -> Any:
    """Declare an option: its default, its help, and the limits of pydantic's `Field`."""
    return Field(default, description=text, **limits)


optional, off, several = (partial(described, default) for default in (None, False, ()))


class ReadOptions(Choices):
    """Options for reading the input, where the file does not state them."""

    heading: ClassVar[str] = "Input"
    about: ClassVar[flags.OptionTopic] = flags.OptionTopic.APPEARANCE

    reader: str | None = optional(
        "Name of the reader, such as raw:offset=512. [default: the one for the file's suffix]"
    )
    shape: str | None = optional(
        "Size of a raw file's grid along x, y, z, and number of times: "
        "256x256x128. [default: from the header or the file's name]"
    )
    dtype: str | None = optional(
        "Data type of a raw file: uint8, int16, >i2 (big-endian) ... "
        "[default: from the header or the file's name]"
    )
    endian: Literal["little", "big"] | None = optional(
        "Byte order of a raw file. [default: little]"
    )
    spacing: Annotated[str | None, flags.Hyphen] = optional(
        "Distances between voxels along x, y and z, such as 1,1,1.4 or "
        "0.2x0.2x1um. [default: those in the file, otherwise 1,1,1]"
    )
    memory: Annotated[str | None, flags.OptionTopic.RESOURCE] = optional(
        f"{flags.MEMORY}. [default: all free memory; half of it for the voxels of a chunked volume "
        "(OME-Zarr, zarr)]"
    )
    level: int | None = optional(
        "Level of detail; 0 is the finest. Of a multiscale OME-Zarr; its "
        "levels are listed by info. [default: 0]",
        ge=0,
    )
    units: Literal["hu", "hu+1024", "none"] | None = optional(
        "Units of the values: Hounsfield units, these plus 1024, or others. "
        "[default: those in the file, or guessed from the values]"
    )
    scale: str = described(
        "linear",
        "Scale on which values are shown: linear, log, or symlog:linear=0.01, which is linear from "
        "-0.01 to 0.01. Transfer functions and windows stay in the values' own units.",
    )
    time: Annotated[int | None, flags.Hyphen] = optional(
        "Index of the time, from 0; -1 is the last. [default: 0; animate shows all]"
    )
    channel: Annotated[int | None, flags.Hyphen] = optional(
        "Index of the channel, from 0. [default: all, if these are colors; otherwise 0]"
    )


class Added(Choices):
    """Further volumes in the scene."""

    heading: ClassVar[str] = "Further volumes"
    about: ClassVar[flags.OptionTopic] = flags.OptionTopic.APPEARANCE

    also: Annotated[tuple[str, ...], flags.OptionTopic.SOURCE, flags.Several] = several(
        "Another file in the scene, placed by its coordinates: pet.nrrd, or "
        "pet.nrrd:window=5,10,transfer=hot:opacity=0.3. Settings: time, channel, level, units, "
        "spacing, window and, last, transfer. Where volumes overlap, extinctions add up."
    )
    channels: Annotated[str | None, TRANSFER] = optional(
        "Appearance of each channel of the file: a color, a transfer function or "
        "none (hidden), such as red,#00ff80,none or gray,300..900,auto:opacity=0.2."
    )


class AppearanceChoices(Choices):
    """Appearance of voxels, and the viewpoint."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[flags.OptionTopic] = flags.OptionTopic.APPEARANCE

    transfer: Annotated[str, TRANSFER, flags.Hyphen] = described(
        "auto",
        f"Transfer function: auto, which adapts to the values; {', '.join(PRESETS)}; for CT "
        f"{', '.join(TISSUES)}; a matplotlib colormap; a range of values such as 300..900; control "
        "points value,color,opacity such as '40,red,0 90,white,0.5'; or a .json or .toml file of "
        "control points over values, or of regions over values and gradients. After a name, "
        ":opacity=0.2,low=0.3 makes it thinner, color=tomato colors it, gradient=0.1,0.5 keeps "
        "only its surfaces. Several materials: skin:opacity=0.1+bone.",
    )
    window: Annotated[str | None, flags.Hyphen] = optional(
        "Window of values that auto, gray, bone, vessels, surfaces and colormaps "
        "span, as center,width or low..high: 40,400, -160..240; for X-rays, of line "
        "integrals. [default: all values but padding and outliers]"
    )
    opacity_unit: float | None = optional(
        "Length in scene units to which opacities refer. [default: a voxel's size]",
        gt=0,
        allow_inf_nan=False,
    )
    camera: flags.Viewed = FROM_ABOVE
    fov: flags.FieldOfView = 30.0
    up: flags.Up = "z"
    fit: Annotated[Literal["visible", "volume"], flags.under(flags.CAMERA)] = described(
        "visible", "How the picture is filled: by the visible part, or by the whole volume."
    )
    shading: Annotated[bool, Lit] = described(
        True, "Light surfaces: by the light that --light gives."
    )
    light: Annotated[str, flags.Hyphen, Lit] = described(
        "eye", "Where light comes from: eye, or a scene direction such as 1,-1,2."
    )
    ambient: Annotated[float, Lit] = described(0.3, "Ambient light.", ge=0, allow_inf_nan=False)
    diffuse: Annotated[float, Lit] = described(0.7, "Diffuse light.", ge=0, allow_inf_nan=False)
    specular: Annotated[float, Lit] = described(
        0.2, "Strength of specular highlights.", ge=0, allow_inf_nan=False
    )
    shininess: Annotated[float, Lit] = described(
        32.0,
        "Specular exponent: the greater, the smaller the highlights.",
        gt=0,
        allow_inf_nan=False,
    )
    shadows: Annotated[bool, Lit] = off("Cast shadows; needs --light.")
    ambient_occlusion: Annotated[bool, Lit] = off(
        "Dim ambient light where the surroundings are dense."
    )
    gradient: Literal["central", "sobel"] = described(
        "central", "How gradients, and so normals, are computed."
    )
    gradient_opacity: str | None = optional(
        "Fade homogeneous regions: opacity rises between these fractions of the "
        "steepest gradient, such as 0.1,0.5."
    )
    classify: Literal["auto", "pre", "post"] = described(
        "auto",
        "Pre: classify voxels, then interpolate colors. Post: interpolate values, then classify, "
        "which is sharper. Auto: post along rays; pre if a method is given.",
    )
    labels: Annotated[str | None, flags.OptionTopic.SOURCE] = optional(
        "Volume of integers: the label of each voxel."
    )
    label: Annotated[tuple[str, ...], flags.Several] = several(
        "Appearance of a label: 1:color=tomato,opacity=0.5 or 2:hidden."
    )
    crop: Annotated[str | None, flags.Hyphen] = optional(
        "Crop to ranges along x, y, z: 64:192,:,10: in voxels."
    )
    clip: Annotated[tuple[str, ...], flags.Several] = several(
        "Clip by a plane through the center, keep the side the normal points to: "
        "1,0,-1, or 1,0,-1,20 shifted by 20 scene units."
    )
    slab: Annotated[str | None, flags.Hyphen] = optional(
        "Show only a slab: offset,thickness such as 20,10, in scene units along "
        "the view, offset from the volume's center; or 20,10,0,0,1, along a scene direction."
    )
    mu_water: float | None = optional(
        "Attenuation of water in an X-ray, per mm. [default: 0.02, as near 70 keV]",
        gt=0,
        allow_inf_nan=False,
    )
    invert: Annotated[bool, flags.Switch] = off(
        "Invert projections of values, so that bones are black."
    )
    depth_cue: float | None = optional(
        "Fraction of the light lost at the far end. [default: 0]", ge=0, le=1
    )

    def of_voxels(self) -> "AppearanceChoices":
        """Return this look with classification pre, unless post was chosen."""
        return self if self.classify == "post" else self.model_copy(update={"classify": "pre"})

    def renderer(self, resampling: Resampling, scale: str = "") -> "Resampler":
        """Return the renderer for this look, of values on a scale."""
        from resample_volume.appearance import Classification, check_together
        from resample_volume.classification.scales import scale_named

        if self.label and self.labels is None:
            raise ValueError("label sets the look of a label; give the volume of labels, too")
        if (by := scale_named(scale)) is not None and resampling.iso is not None:
            place = by.place(resampling.iso, "iso")
            resampling = resampling.model_copy(update={"iso": place})
        is_auto = self.classify == "auto"
        is_of_field = self.classify == "post" or (is_auto and not resampling.is_of_samples)
        quality = "usual" if is_auto else "best"
        resampler = resampling.resampler(of_field=is_of_field, quality=quality)
        chosen = {
            "labels": self.labels,
            "gradient-opacity": self.gradient_opacity,
            "depth-cue": self.depth_cue,
            "xray": self.mu_water,
            "invert": self.invert or None,
        }
        if self.slab is not None:
            from resample_volume.meshes import Section

            Section.of(self.slab)  # raises an error if it is invalid
        extras = [name for name, choice in chosen.items() if choice is not None]
        check_together(resampler, Classification(self.classify), extras)
        return resampler

    def appearance(self, volume: "Volume", resampler: "Resampler | None" = None) -> "Appearance":
        """Return the look of the voxels for a renderer; None: a compositing one."""
        from resample.painting.choices import MEASURING, Projection
        from resample_volume.appearance import (
            MU_WATER,
            Appearance,
            Classification,
            XRay,
            named_transfer,
        )
        from resample_volume.data.recordings import mm_of
        from resample_volume.voxels.shading import DepthCue, Light

        projection = Projection.COMPOSITE if resampler is None else resampler.projection
        window, xray = self._window(volume.scale), None
        if projection is Projection.XRAY:
            xray, window = XRay((self.mu_water or MU_WATER) * mm_of(volume), window), None
        transfer = named_transfer(self.transfer, volume, projection, window)
        framing = None
        if self.transfer == "auto" and projection in MEASURING:  # shares the camera of the others
            framing = named_transfer(self.transfer, volume, Projection.COMPOSITE, window)
        if self.opacity_unit is not None:
            transfer = replace(transfer, opacity_unit=self.opacity_unit)
        if not self.shading and (self.shadows or self.ambient_occlusion):
            raise ValueError("shadows and ambient-occlusion need shading; leave no-shading out")
        toward = None if self.light == "eye" else tuple(_numbers("light", self.light, 3))
        strengths = (self.ambient, self.diffuse, self.specular, self.shininess)
        light = Light(toward, *strengths, self.shadows, self.ambient_occlusion)
        ramp = self.gradient_opacity
        ends = None if ramp is None else tuple(_numbers("gradient-opacity", ramp, 2))
        return Appearance(
            transfer,
            light if self.shading else None,
            self.gradient,
            ends,
            classification=Classification(self.classify),
            labels=self.labels_of(volume),
            cue=None if self.depth_cue is None else DepthCue(self.depth_cue),
            crop=self.crop,
            clip=self.clip,
            framing=framing,
            slab=self.slab,
            xray=xray,
            invert=self.invert,
        )

    def labels_of(self, volume: "Volume") -> "Labels | None":
        """Read the labels of a volume, if there are some."""
        if self.labels is None:
            return None
        from resample_volume.files.source import read_labels

        return read_labels(self.labels, self.label, volume)

    def _window(self, scale: str) -> tuple[float, float] | None:
        """Return the least and greatest value of the window, on a scale."""
        from resample_volume.classification.scales import scale_named

        if self.window is None:
            return None
        by_ends = ".." in self.window
        if not by_ends and len(parts_of(self.window)) != 2:
            raise ValueError(
                f"window {self.window!r}; give a center and a width, 40,400, or a range, -160..240"
            )
        low, high = _numbers("window", self.window, 2, ".." if by_ends else ",")
        if not by_ends:  # a center and a width
            low, high = low - high / 2, low + high / 2
        if not -math.inf < low < high < math.inf:
            raise ValueError(f"window {self.window!r}; its width must be above 0, as in 40,400")
        if (by := scale_named(scale)) is None:
            return low, high
        return by.place(low, "the window's end"), by.place(high, "the window's end")

    def viewpoint(self) -> "Viewpoint":
        """Return the viewpoint."""
        return flags.viewpoint(self.camera, self.fov, self.up)


class Extras(Choices):
    """Annotations, meshes and planes in the volume's scene."""

    heading: ClassVar[str] = "Annotations and objects"
    about: ClassVar[flags.OptionTopic] = flags.OptionTopic.APPEARANCE

    axes: Annotated[bool, flags.Switch] = off(
        "Draw the scene's axes x, y and z at the volume's corner."
    )
    box: Annotated[bool, flags.Switch] = off(
        "Draw the edges of the volume's bounding box, with hidden lines removed."
    )
    cube: Annotated[bool, flags.Switch] = off(
        "Draw an orientation cube: R L A P S I for patients, otherwise +X -X and so on."
    )
    scale_bar: Annotated[bool, flags.Switch] = off(
        "Draw a scale bar of a round length; in perspective it holds at the volume's center."
    )
    mesh: Annotated[tuple[str, ...], flags.OptionTopic.SOURCE, flags.Several] = several(
        "Mesh in the scene: stent.ply:color=tomato,opacity=1 (.ply, .obj, .stl, .glb). Needs the "
        "order rays and composite or first-hit. Not clipped by --clip; --fit visible includes it."
    )
    plane: Annotated[tuple[str, ...], flags.Several] = several(
        "Plane that shows unshaded values: z=40 (voxels), x=50%, or 1,0,-1,20 as "
        "for --clip; after a colon window=40,400 (or -160..240), colors=gray (or a "
        "matplotlib colormap), opacity=1. Needs what a mesh needs; not clipped by --clip."
    )
    surface: Annotated[tuple[str, ...], flags.Several] = several(
        "Isosurface in the scene: 300:color=ivory,opacity=0.5. Needs what a mesh "
        "needs, and the extra vtk; not clipped by --clip."
    )

    @property
    def is_annotated(self) -> bool:
        """Whether anything is drawn around the volume."""
        return self.axes or self.box or self.cube or self.scale_bar

    def annotations(self, background: Color | None = None) -> "Annotations":
        """Return the annotations, over a background of this linear color."""
        from resample.measuring.color_bars import DARK, ink_on
        from resample_volume.annotations import Annotations

        is_dark = background is not None and ink_on(background) == DARK
        return Annotations(self.axes, self.box, self.cube, self.scale_bar, is_dark)

    def scene_objects(self, look: AppearanceChoices, resampler: "Resampler") -> dict[str, Any]:
        """Read planes, surfaces and meshes for a renderer that shows them: fields of a look."""
        from resample_volume.appearance import Classification, check_together

        given = {"mesh": self.mesh, "plane": self.plane, "surface": self.surface}
        names = [name for name, texts in given.items() if texts]
        if not names:
            return {}
        from resample_volume.meshes import ImagePlane, IsoSurface, read_mesh

        check_together(resampler, Classification(look.classify), names)
        planes, surfaces = map(ImagePlane.of, self.plane), map(IsoSurface.of, self.surface)
        found = {"planes": tuple(planes), "surfaces": tuple(surfaces)}
        return {**found, "meshes": tuple(map(read_mesh, self.mesh))}


class FilmExtras(Extras):
    """The same, plus a color bar."""

    color_bar: Annotated[bool, flags.Switch] = off(
        "Add a bar to the right: colors, opacities and values."
    )

    def check_bar(self, output: "Path", height: int) -> None:
        """Reject an impossible color bar before any work is done."""
        if self.color_bar:
            from resample.measuring.color_bars import check_bar

            check_bar(output, height)


class PictureExtras(FilmExtras):
    """The same, plus options of a single picture."""

    zoom_in: Annotated[bool, flags.Switch] = off(
        "Zoom and pan so that everything visible fills the picture, and print "
        "that camera. The zoom of --camera multiplies it. Without --camera, --fit and lines "
        "in space, the visible part fills most of it."
    )
    deep: int | None = optional(
        "Write a deep .exr with this many slabs of depth instead of one layer.", ge=1, le=1024
    )

    def fit(self, look: AppearanceChoices) -> "Fitted":
        """Return the object that the camera frames."""
        if self.zoom_in:
            return "picture"
        is_free = look.camera == FROM_ABOVE and look.fit == "visible"
        return "most" if is_free and not self.is_annotated else look.fit

    def check(self, output: "Path", resampler: "Resampler", height: int) -> None:
        """Reject an impossible color bar or deep picture before any work is done."""
        self.check_bar(output, height)
        if self.deep is None:
            return
        from resample.files.saving import check_deep
        from resample_volume.rendering import check_slabs

        check_deep(output)
        check_slabs(self.deep, resampler)
        if self.color_bar or self.is_annotated:
            raise ValueError(
                "deep pictures hold only slabs; leave out axes, box, cube, scale-bar and color-bar"
            )


def _numbers(name: str, text: str, count: int, joint: str = ",") -> list[Any]:
    try:
        numbers = [float(part) for part in (parts_of(text) if joint == "," else text.split(joint))]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        form = joint.join("abc"[:count])
        raise ValueError(f"{name} {text!r}; give {count} numbers as {form}")
    return numbers

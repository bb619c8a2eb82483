"""Meshes in the viewer's page, and `mesh_picture` without a page.

The page's state is a set of `mesh` options.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resample.command.settings import Choices, chosen
from resample.files.saving import screen_levels, write_frame
from resample.progress import Cancel, cancellable
from resample.scene import pixel_at, position_at, preview_size
from resample.types import Frame
from resample.view.files import FileView, image_of
from resample.view.views import PagePicture, Settings, Size, is_free, placed_by, settings_of
from resample_meshes.choices import MeshDrawing, MeshFormat, MeshView
from resample_meshes.rendering import load_mesh, render_mesh
from resample_meshes.shapes import Mesh

if TYPE_CHECKING:
    from PIL.Image import Image

COMMAND = "resample-texture mesh"
SHOWN = (MeshView, MeshDrawing, MeshFormat)  # option models that a page can change
LEFT_OUT = ("size", "bits")


@dataclass
class ModelPainter:
    """Painter of a mesh for one page.

    Parameters
    ----------
    path
        File of the mesh.
    """

    path: Path
    _kept: tuple[Path | None, Mesh] | None = field(init=False, default=None)  # (texture, mesh)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        view, drawing, form = _checked(settings)
        with cancellable(cancel):
            size = preview_size(size) if quick else size
            seen = self._rendered(view, drawing, form, size)
        levels = screen_levels(seen.rgba, background=form.behind())
        camera = view.placed(self.mesh(form.texture), size[::-1])
        return PagePicture(levels, quick, placed_by(camera, size))

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return position and depth at a pixel, see `resample.view.views.Painter`."""
        view, drawing, form = _checked(settings)
        pixel = pixel_at(size, x, y)
        depth = float(self._rendered(view, drawing, form, size).depth[pixel])
        if not np.isfinite(depth):
            return {}
        camera = view.placed(self.mesh(form.texture), size[::-1])
        place = position_at(camera.view(), pixel, depth).tolist()
        return {"position": ", ".join(f"{part:.6g}" for part in place), "depth": f"{depth:.5g}"}

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does.

        Raises
        ------
        ValueError, LookupError, OSError
            An option is not allowed, or a file cannot be read or written.
        """
        view, drawing, form = _checked(settings)
        seen = self._rendered(view, drawing, form, size)
        write_frame(path, seen, bits=form.bits, background=form.behind())

    def mesh(self, texture: Path | None = None) -> Mesh:
        """Return the mesh, read again only for another texture; raises as `save` does."""
        if self._kept is None or self._kept[0] != texture:
            self._kept = texture, load_mesh(self.path, texture)
        return self._kept[1]

    def _rendered(
        self, view: MeshView, drawing: MeshDrawing, form: MeshFormat, size: Size
    ) -> Frame[Any]:
        mesh = self.mesh(form.texture)
        camera = view.placed(mesh, size[::-1])
        return render_mesh(mesh, camera, size=size, style=drawing.style(view.shading))


def model_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of a mesh.

    Parameters
    ----------
    path
        File of the mesh.
    begin
        Initial options.
    """
    first = ModelPainter(path)

    def described() -> dict[str, Any]:
        return {
            "title": path.name,
            "subtitle": f"{len(first.mesh().triangle):,} triangles",
            "command": COMMAND,
            "package": "resample_meshes",
            "function": "mesh_picture",
            "inputs": [str(path)],
            "settings": {"camera": "30,20,1", **settings_of(begin)},
            "fills": is_free(begin),
            "measures": True,
        }

    return FileView(first, described, _checked, left_out=LEFT_OUT)


def mesh_picture(path: str | Path, settings: Mapping[str, Any]) -> "Image":
    """Return the picture that `resample-texture mesh` makes with these options.

    Parameters
    ----------
    path
        File of the mesh.
    settings
        Options by name, as in settings files: `{"camera": "120,20,1.2"}`.

    Returns
    -------
    A Pillow image of 8 bits per channel.

    Raises
    ------
    ValueError, LookupError, OSError
        As the command does.
    """
    size = _checked(settings)[2].height_and_width()[::-1]
    return image_of(ModelPainter(Path(path)), settings, size)


def _checked(settings: Settings) -> tuple[MeshView, MeshDrawing, MeshFormat]:
    """Return the options, checked."""
    view, drawing, form = chosen(settings, SHOWN)
    view.viewpoint()
    return view, drawing, form

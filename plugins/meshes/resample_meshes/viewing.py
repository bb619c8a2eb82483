"""Meshes in the viewer's page, and `mesh_picture` without a page.

The page's state is a set of `mesh` options.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from resample.command.settings import Choices, chosen
from resample.files.saving import screen_levels, write_frame
from resample.profiles.interpolation import Bilinear
from resample.progress import Cancel, cancellable
from resample.scene import pixel_at, position_at, preview_size
from resample.types import Frame
from resample.view.files import FileView, picture_function
from resample.view.views import PagePicture, Settings, Size, is_free, placed_by, settings_of
from resample_meshes.choices import MeshDrawing, MeshFormat, MeshView
from resample_meshes.rendering import ball_around, load_mesh, render_mesh
from resample_meshes.shapes import Mesh

COMMAND = "resample-texture mesh"
SHOWN = (MeshView, MeshDrawing, MeshFormat)  # option models that a page can change
LEFT_OUT = ("size", "bits")


@dataclass
class ModelPainter:
    """Painter of a mesh for one page.

    `path`: file of the mesh.
    """

    path: Path
    _kept: tuple[Path | None, Mesh] | None = field(init=False, default=None)  # (texture, mesh)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        view, drawing, form = _checked(settings)
        with cancellable(cancel):
            size = preview_size(size) if quick else size
            seen = self._rendered(view, drawing, form, size, quick=quick)
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
        write_frame(path, seen, bits=form.bits, background=form.behind(path.suffix))

    def mesh(self, texture: Path | None = None) -> Mesh:
        """Return the mesh, read again only for another texture; raises as `save` does."""
        if self._kept is None or self._kept[0] != texture:
            self._kept = texture, load_mesh(self.path, texture)
        return self._kept[1]

    def _rendered(
        self,
        view: MeshView,
        drawing: MeshDrawing,
        form: MeshFormat,
        size: Size,
        *,
        quick: bool = False,
    ) -> Frame[Any]:
        mesh, style = self.mesh(form.texture), drawing.style(view.shading)
        if quick:  # without a prefilter, which takes longer than the picture
            style = replace(style, interpolation=Bilinear(), samples=2)
        camera = view.placed(mesh, size[::-1])
        return render_mesh(mesh, camera, size=size, style=style)


def model_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of a mesh.

    `path`: file of the mesh. `begin`: initial options.
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
            "middle": ball_around(first.mesh())[0].tolist(),  # where the scale bar holds
        }

    return FileView(first, described, _checked, left_out=LEFT_OUT)


def _checked(settings: Settings) -> tuple[MeshView, MeshDrawing, MeshFormat]:
    """Return the options, checked."""
    view, drawing, form = chosen(settings, SHOWN)
    view.viewpoint()
    return view, drawing, form


mesh_picture = picture_function(model_view)

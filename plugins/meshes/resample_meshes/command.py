"""`resample-texture mesh`."""

from pathlib import Path
from typing import Annotated

from resample.command import flags
from resample_meshes.choices import MeshDrawing, MeshFormat, MeshView

VIEW, DRAWING, FORM = MeshView.usual(), MeshDrawing.usual(), MeshFormat.usual()
BYTES_PER_PIXEL = 100


def mesh(
    model: Path,
    /,
    *,
    output: flags.FrameOutput,
    view: Annotated[MeshView, flags.Flat] = VIEW,
    drawing: Annotated[MeshDrawing, flags.Flat] = DRAWING,
    form: Annotated[MeshFormat, flags.Flat] = FORM,
) -> None:
    """Render a textured mesh.

    For example:

        resample-texture mesh sample:knot -o knot.png
        resample-texture mesh sample:knot --camera 120,20,1.2 --shading -o shaded.png
        resample-texture mesh sample:knot --texture sample:test-card -o card.png

    Parameters
    ----------
    model
        OBJ with its MTL, GLB, glTF or PLY.
    """
    from resample.command.session import Session, require_picture
    from resample.files.saving import check_frame, tell_empty, write_frame
    from resample.files.writing import check_targets
    from resample_meshes.rendering import load_mesh, render_mesh

    behind = form.behind(output.suffix)
    check_frame(output, form.bits, behind)
    height, width = form.height_and_width()
    view.viewpoint()
    style = drawing.style(view.shading)
    check_targets(output)
    require_picture((height, width), BYTES_PER_PIXEL)
    shape = load_mesh(model, form.texture)
    camera = view.placed(shape, (height, width))
    with Session().stage("paint", bar="painting"):
        frame = render_mesh(shape, camera, size=(width, height), style=style)
    write_frame(output, frame, bits=form.bits, background=behind)
    tell_empty(output, not frame.coverage.any())

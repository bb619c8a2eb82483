"""
Show a volume
=============

You have values on a lattice: a scan, a microscope stack, a simulation. In ten minutes you will render them,
choose what is visible, light them, cut them open, and save the results.
"""

# %%
# A picture
# ---------
#
# ``render`` takes an array (Z, Y, X), a path, or an image of SimpleITK, nibabel or xarray. Generated volumes
# have names; this one is a vessel tree with an aneurysm. ``(40, 15)`` is the viewpoint: azimuth and elevation
# in degrees; a third number is a zoom.

from resample_volume import open_volume, render

vessels = open_volume("vessel-tree")
frame = render(vessels, camera=(40, 15, 0.95), size=(300, 300))
frame.save("vessels.png", background=(1, 1, 1))
print(frame)

# %%
# The result
# ----------
#
# A frame has linear light premultiplied by its opacity, coverage, and two depths. Save it as PNG, TIFF or OpenEXR.

print(
    frame.rgba.shape,
    frame.rgba.dtype,
    f"first seen at {frame.first_depth[frame.coverage > 0.5].min():.1f}",
)
frame.to_image("depth").save("depth.png")

# %%
# Transfer functions
# ------------------
#
# A transfer function assigns colors and opacities to values. It is a name (``resample-volume render --help``
# lists them), a range of values as a material, or several of these joined by ``+``.

render(
    vessels, "10..:color=deepskyblue,opacity=0.06+250..:color=tomato,opacity=0.2", (40, 15, 0.95)
).save("two-materials.png", background=(1, 1, 1))

# %%
# An ``Appearance`` holds the transfer function together with light, crops, cuts and more:

from resample_volume import Appearance, Light

lamp = Light(direction=(1, -1, 1), specular=0.4, shadows=True, occlusion=True)
render(vessels, Appearance("vessels", lamp), (40, 15, 0.95), size=(300, 300)).save(
    "lit.png", background=(1, 1, 1)
)
render(vessels, Appearance("vessels", crop=":,:,:64"), (40, 15, 0.95), size=(300, 300)).save(
    "lower.png", background=(1, 1, 1)
)

# %%
# Rays or splats
# --------------
#
# By default rays are cast through a spline that interpolates the voxels, and values get their colors along the
# ray (post-classification, ``post``). The paper does the opposite: voxels get their colors first and are drawn as
# splats (pre-classification, ``pre``), which thickens thin structures.

for classification in ("pre", "post"):
    look = Appearance("vessels", classification=classification)
    render(vessels, look, (40, 15, 4.0), size=(300, 300)).save(
        f"{classification}.png", background=(1, 1, 1)
    )

# %%
# Many pictures of one volume
# ---------------------------
#
# A ``Scene`` caches what does not depend on the view, and returns the voxel at a pixel.

from resample_volume import Scene

scene = Scene(vessels)
for azimuth in (0, 60, 120):
    scene.render("vessels", (azimuth, 15), size=(200, 200)).save(
        f"{azimuth}.png", background=(1, 1, 1)
    )
print(scene.pick(100, 130, "vessels", (0, 15), size=(200, 200)))

# %%
# From the command line
# ---------------------
#
# .. code-block:: console
#
#     $ resample-volume render vessel-tree --camera 40,15,0.95 -o vessels.png
#     $ resample-volume render vessel-tree --transfer vessels --light 1,-1,1 --shadows --ambient-occlusion -o lit.png
#     $ resample-volume animate sample:vessel-tree --transfer vessels -o turn.webp
#     $ resample-volume view vessel-tree
#
# Next: :doc:`choose a transfer function </howto/looks>`, or :doc:`volumes larger than memory </scale>`.

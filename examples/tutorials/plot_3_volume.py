"""
Show a volume
=============

You have values on a lattice: a scan, a stack of a microscope, a simulation. After ten minutes you can show
them, choose what is seen of them, put light on them, cut them open and save all of it.
"""

# %%
# A picture
# ---------
#
# ``render`` takes an array (Z, Y, X), a path, or the images of SimpleITK, nibabel and xarray. Generated
# volumes have names; this one is a tree of vessels with an aneurysm. ``(40, 15)`` is where the camera
# stands: azimuth and elevation in degrees; a third number is a zoom.

from resample_volume import open_volume, render

vessels = open_volume("vessel-tree")
frame = render(vessels, camera=(40, 15, 0.95), size=(300, 300))
frame.save("vessels.png", background=(1, 1, 1))
print(frame)

# %%
# What comes back
# ---------------
#
# A frame is light, premultiplied with its coverage, and two depths. It is saved as PNG, TIFF or OpenEXR.

print(
    frame.rgba.shape,
    frame.rgba.dtype,
    f"first seen at {frame.first_depth[frame.coverage > 0.5].min():.1f}",
)
frame.to_image("depth").save("depth.png")

# %%
# What is seen
# ------------
#
# A *look* gives values their color and opacity: a name (``resample-volume render --help`` lists them), a
# range of values as a material, or several of them joined.

render(
    vessels, "10..:color=deepskyblue,opacity=0.06+250..:color=tomato,opacity=0.2", (40, 15, 0.95)
).save("two-materials.png", background=(1, 1, 1))

# %%
# An ``Appearance`` holds the look together with light, crops, cuts and more:

from resample_volume import Appearance, Light

lamp = Light(direction=(1, -1, 1), specular=0.4, shadows=True, occlusion=True)
render(vessels, Appearance("vessels", lamp), (40, 15, 0.95), size=(300, 300)).save(
    "lit.png", background=(1, 1, 1)
)
render(vessels, Appearance("vessels", crop=":,:,:64"), (40, 15, 0.95), size=(300, 300)).save(
    "lower.png", background=(1, 1, 1)
)

# %%
# Along rays, or splats
# ---------------------
#
# By default rays pass through a spline that goes through all voxels, and values get their colors on the
# way (``post``). The paper's way is the other one: voxels get their colors first, and are splatted
# (``pre``), which draws thin things too thick.

for classification in ("pre", "post"):
    look = Appearance("vessels", classification=classification)
    render(vessels, look, (40, 15, 4.0), size=(300, 300)).save(
        f"{classification}.png", background=(1, 1, 1)
    )

# %%
# Many pictures of one volume
# ---------------------------
#
# A ``Scene`` keeps what does not depend on the view, and tells which voxel is seen at a pixel.

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
#     $ resample-volume render vessel-tree --camera 40/15/0.95 -o vessels.png
#     $ resample-volume render vessel-tree --transfer vessels --light 1/-1/1 --shadows --ambient-occlusion -o lit.png
#     $ resample-volume animate sample:vessel-tree --transfer vessels -o turn.webp
#     $ resample-volume view vessel-tree
#
# Next: :doc:`choose a look </howto/looks>`, or :doc:`volumes larger than memory </scale>`.

"""
Shadows and ambient occlusion
=============================

Shadows and ambient occlusion are computed once per look. They show which vessel lies in front of
which.

The same from the command line:

.. code-block:: console

    $ resample-volume render vessel-tree --transfer vessels --shadows --ambient-occlusion --light 1,-1,1 --ambient 0.2 -o lit.png
"""

from resample_volume import Appearance, Light, render

lights = {
    "a headlight": Light(),
    "a lamp": Light((1, -1, 1), ambient=0.2),
    "its shadows": Light((1, -1, 1), ambient=0.2, shadows=True, occlusion=True),
}
for name, light in lights.items():
    look = Appearance("vessels", light)
    frame = render("vessel-tree:size=192", look, (35, 20, 0.95), size=(280, 280))
    frame.save(f"{name}.png", background=(1, 1, 1))

# sphinx_gallery_thumbnail_number = -1

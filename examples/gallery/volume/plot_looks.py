"""
Looks by name
=============

A look assigns colors and opacities to values. It is a name, a range of values, or names joined by
``+``, each with its own modifications.

The same from the command line:

.. code-block:: console

    $ resample-volume render vessel-tree --transfer "10..:color=deepskyblue,opacity=0.06+250..:color=tomato,opacity=0.2" --camera 40,15,0.95 -o vessels.png
"""

from resample_volume import render

looks = {
    "auto": "auto",
    "hot": "hot",
    "glass": "10..:color=deepskyblue,opacity=0.06+250..:color=tomato,opacity=0.2",
}
for name, look in looks.items():
    frame = render("vessel-tree", look, (40, 15, 0.95), size=(280, 280))
    frame.save(f"{name}.png", background=(1, 1, 1))

"""
A halo in column density
========================

Particles of a simulation are masses that a kernel spreads over a smoothing length. A map holds the
mass along each pixel's column; zooming in keeps it. Colors are logarithmic.

The same from the command line, for a snapshot of SWIFT, GADGET, AREPO or Phantom:

.. code-block:: console

    $ resample-points density snapshot.hdf5 --type dark --size 480 --color-bar -o halo.png
    $ resample-points density snapshot.hdf5 --type dark -o turn.mp4
"""

import numpy as np

from resample.files.saving import write_png
from resample_particles import Particles, column_density
from resample_particles.mapping import map_picture

# A halo with subhalos: as many particles within each radius as in the profile of Hernquist.
rng = np.random.default_rng(7)


def clump(count, scale, center, squeezed=(1.0, 1.0, 1.0)):
    """Places (N, 3) of a clump."""
    share = np.sqrt(rng.uniform(0, 0.85, count))
    away = scale * share / (1 - share)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return away[:, None] * direction * squeezed + center


parts = [clump(60_000, 1.0, np.zeros(3), (1.0, 0.7, 0.6))]
for _ in range(60):
    far = clump(1, 3.0, np.zeros(3))[0]
    parts.append(clump(int(200 * 10 ** rng.uniform(0, 1)), 0.06, far))
place = np.concatenate(parts)
halo = Particles(place, 1e6, units={"mass": "Msun", "length": "kpc"}).smoothed()

for name, half in {"whole": 6.0, "zoomed-in": 1.5}.items():
    region = half * np.array([[-1.0, -1, -np.inf], [1, 1, np.inf]])
    found = column_density(halo, "z", size=(360, 360), region=region)
    picture = map_picture(found)
    shown = np.concatenate([picture.rgba, picture.bar()], axis=1)
    write_png(f"{name}.png", shown, background=(0, 0, 0))

"""A volume in PyVista's trame viewer: `python -m benchmarks.trame_page FILE MAPPER PORT SIDE`.

The file (.npz) holds values, spacing, and 256 colors (sRGB) and opacities over the values' range.
Everything else is PyVista's default; pictures are rendered by the server, as ours are.
"""

import sys

import numpy as np


def main() -> None:
    """Serve the page until the process is ended."""
    import pyvista
    from matplotlib.colors import ListedColormap
    from trame.app import get_server
    from trame.ui.vuetify3 import VAppLayout
    from trame_pyvista.ui import plotter_ui

    path, mapper = sys.argv[1:3]
    port, side = map(int, sys.argv[3:5])
    server = get_server("benchmark", client_type="vue3")
    plotter = pyvista.Plotter(off_screen=True, window_size=(side, side))
    with np.load(path, allow_pickle=False) as given:
        grid = pyvista.ImageData(dimensions=given["values"].shape[::-1], spacing=given["spacing"])
        grid["values"] = given["values"].ravel()
        plotter.add_volume(
            grid,
            cmap=ListedColormap(given["color"]),
            opacity=np.rint(255 * given["opacity"]).astype(np.uint8),
            opacity_unit_distance=float(given["spacing"].min()),
            shade=True,
            mapper=mapper,
            show_scalar_bar=False,
        )
    plotter.set_background("black")
    plotter.view_isometric()
    with VAppLayout(server):
        plotter_ui(plotter, mode="server", server=server, add_menu=False)
    server.start(port=port, open_browser=False, show_connection_info=False)


if __name__ == "__main__":
    main()

"""Background colors by name."""

Color = tuple[float, float, float]  # linear light

SPLAT_COLOR: Color = (0.8, 0.02, 0.02)  # linear red, the paper's Figure 8a
COLORS: dict[str, Color] = {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}


def linear_color(name: str) -> Color | None:
    """Linear RGB of a color name or #rrggbb; None for "none"."""
    if name.lower() == "none":
        return None
    if name in COLORS:
        return COLORS[name]
    import matplotlib.colors
    import numpy as np

    from resample.colors import from_srgb

    if not matplotlib.colors.is_color_like(name):
        raise ValueError(f"background {name!r}; give none, #rrggbb or a color's name")
    red, green, blue = from_srgb(np.array(matplotlib.colors.to_rgb(name))).tolist()
    return red, green, blue

"""Check that VTK is installed."""

from importlib.util import find_spec


def require_vtk(name: str) -> None:
    """Reject a file if VTK is not installed."""
    if find_spec("vtkmodules") is None:
        raise ValueError(
            f"{name} holds a grid of cells, which VTK resamples; pip install 'hybrid-resample[vtk]'"
        )

"""Order of times, slices and channels in a multi-page file, from its description."""

import re
from typing import Any, NamedTuple

from numpy.typing import NDArray

OME = {"Z": r'SizeZ="(\d+)"', "C": r'SizeC="(\d+)"', "T": r'SizeT="(\d+)"'}
IMAGEJ = {"Z": r"^slices=(\d+)", "C": r"^channels=(\d+)", "T": r"^frames=(\d+)"}
IMAGEJ_ORDER = "CZT"  # channels change from page to page


class PageOrder(NamedTuple):
    """Order of pages of several times, slices and channels."""

    times: int
    channels: int
    slices: int
    fastest: str  # Z, C and T in the order in which they change, the first from page to page

    def sorted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Reshape pages (N, Y, X) to (T, C, Z, Y, X); further axes are kept."""
        size = {"T": self.times, "C": self.channels, "Z": self.slices}
        slowest = self.fastest[::-1]
        split = values.reshape(*(size[axis] for axis in slowest), *values.shape[1:])
        places = [slowest.index(axis) for axis in "TCZ"]
        return split.transpose(*places, *range(3, split.ndim))


def page_order(description: str, pages: int, parts: int, name: str) -> PageOrder | None:
    """Parse the page order from a file's description, as of OME and ImageJ.

    Parameters
    ----------
    parts
        Numbers per pixel: color components are not channels.

    Returns
    -------
    None if it says nothing, or that all pages are slices of one volume.
    """
    if "<OME" in description:
        found = re.search(r'DimensionOrder="XY([ZCT]{3})"', description)
        fastest, forms = (found[1] if found else "ZCT"), OME
    elif description.startswith("ImageJ="):
        fastest, forms = IMAGEJ_ORDER, IMAGEJ
    else:
        return None
    size = {axis: re.search(form, description, re.MULTILINE) for axis, form in forms.items()}
    count = {axis: int(match[1]) if match else 1 for axis, match in size.items()}
    if parts > 1:
        count["C"] = max(1, count["C"] // parts)
    if count["C"] * count["T"] == 1:
        return None
    said = count["T"] * count["C"] * count["Z"]
    if said != pages or (parts > 1 and count["C"] > 1):
        raise ValueError(
            f"{name} has {pages} pages and says that they are {count['T']} times, {count['C']} "
            f"channels and {count['Z']} slices; convert it to one file with a page for each"
        )
    return PageOrder(count["T"], count["C"], count["Z"], fastest)

"""Parse spacings and sizes as users write them: 1x1x1.4."""

Numbers = str | tuple[float, ...]  # three of them, x, y, z: (1, 1, 1.4) or "1x1x1.4"


def three_numbers(what: str, numbers: Numbers) -> tuple[float, ...]:
    """Return three positive numbers, given as such or as text like 1x1x1.4."""
    found = _numbers(numbers)
    if len(found) != 3 or not all(0 < number < float("inf") for number in found):
        raise ValueError(f"{what} is three positive numbers like 1x1x1.4 (x, y, z), not {numbers}")
    return found


def steps_of(spacing: Numbers) -> tuple[float, ...]:
    """Parse a spacing; one number applies to x, y and z; empty if nothing is given."""
    given = _numbers(spacing)
    if spacing == "":
        return ()
    return three_numbers("spacing", given * 3 if len(given) == 1 else spacing)


def _numbers(numbers: Numbers) -> tuple[float, ...]:
    """Parse numbers; empty if any is invalid."""
    pieces = numbers.lower().split("x") if isinstance(numbers, str) else numbers
    try:
        return tuple(float(piece) for piece in pieces)
    except (TypeError, ValueError):
        return ()


def sizes_of(shape: Numbers) -> tuple[int, ...]:
    """Parse the voxels along x, y, z, and times, if there are several."""
    found = _numbers(shape)
    if len(found) not in (3, 4) or not all(0 < number < float("inf") for number in found):
        raise ValueError(
            "shape is three positive numbers like 256x256x128 (x, y, z), or four, with times, not "
            f"{shape}"
        )
    if not all(number.is_integer() for number in found):
        raise ValueError(f"shape is three whole numbers like 256x256x128 (x, y, z), not {shape}")
    return tuple(map(int, found))

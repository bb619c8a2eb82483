"""Steps between voxels, and numbers of voxels, as users write them: 1x1x1.4."""

Numbers = str | tuple[float, ...]  # three of them, x, y, z: (1, 1, 1.4) or "1x1x1.4"


def three_numbers(what: str, numbers: Numbers) -> tuple[float, ...]:
    """Three positive numbers, given as such or as text like 1x1x1.4.

    Raises
    ------
    ValueError
        They are not.
    """
    found = _numbers(numbers)
    if len(found) != 3 or not all(0 < number < float("inf") for number in found):
        raise ValueError(f"{what} is three positive numbers like 1x1x1.4 (x, y, z), not {numbers}")
    return found


def steps_of(spacing: Numbers) -> tuple[float, ...]:
    """Steps that are the same along x, y, z where one is given; none where nothing is."""
    given = _numbers(spacing)
    if spacing == "":
        return ()
    return three_numbers("spacing", given * 3 if len(given) == 1 else spacing)


def _numbers(numbers: Numbers) -> tuple[float, ...]:
    """Numbers, or none where some are not."""
    pieces = numbers.lower().split("x") if isinstance(numbers, str) else numbers
    try:
        return tuple(float(piece) for piece in pieces)
    except (TypeError, ValueError):
        return ()


def sizes_of(shape: Numbers) -> tuple[int, ...]:
    """Voxels along x, y, z, and times, where there are several."""
    found = _numbers(shape)
    if len(found) not in (3, 4) or not all(0 < number < float("inf") for number in found):
        raise ValueError(
            "shape is three positive numbers like 256x256x128 (x, y, z), or four, with times, not "
            f"{shape}"
        )
    if not all(number.is_integer() for number in found):
        raise ValueError(f"shape is three whole numbers like 256x256x128 (x, y, z), not {shape}")
    return tuple(map(int, found))

"""Transfer functions for computed tomography, in Hounsfield units.

Air is at -1000, lung at -900 to -500, fat at -100, muscle and organs at 20 to 80, vessels with a
contrast agent at 150 to 450, spongy bone at 150 to 400 and compact bone from 500 on; metal is
above 2500.
"""

from resample_volume.classification.transfer import Point, TransferFunction, from_points

METAL = 2500.0  # HU; denser than any tissue

FLESH, MUSCLE, FAT = (0.85, 0.6, 0.48), (0.72, 0.25, 0.2), (0.92, 0.8, 0.5)
BLOOD, RUST = (0.8, 0.12, 0.1), (0.85, 0.6, 0.4)
IVORY, WHITE, STEEL = (0.95, 0.9, 0.8), (1.0, 1.0, 1.0), (0.75, 0.82, 0.9)
SKY, ROSE = (0.55, 0.7, 0.85), (0.9, 0.55, 0.5)

BONE: list[Point] = [(350.0, RUST, 0.35), (600.0, IVORY, 0.7), (1500.0, WHITE, 0.95)]

POINTS: dict[str, list[Point]] = {
    # Bone in translucent flesh: the default for CT.
    "ct": [
        (-350.0, FLESH, 0.0),
        (-150.0, FLESH, 0.02),
        (60.0, FLESH, 0.03),
        (150.0, MUSCLE, 0.06),
        *BONE,
    ],
    "bone": [(150.0, RUST, 0.0), *BONE],
    "soft-tissue": [
        (-160.0, FAT, 0.0),
        (-90.0, FAT, 0.06),
        (-20.0, FAT, 0.08),
        (30.0, MUSCLE, 0.35),
        (120.0, FLESH, 0.45),
        *BONE,
    ],
    "muscle": [(0.0, MUSCLE, 0.0), (40.0, MUSCLE, 0.5), (120.0, ROSE, 0.6), *BONE[1:]],
    "skin": [(-400.0, FLESH, 0.0), (-200.0, FLESH, 0.6), (0.0, FLESH, 0.9)],
    "lung": [
        (-880.0, SKY, 0.0),
        (-820.0, SKY, 0.03),
        (-650.0, SKY, 0.05),
        (-500.0, ROSE, 0.2),
        (-400.0, ROSE, 0.25),
        (-250.0, ROSE, 0.0),
    ],
    "vessels": [
        (120.0, BLOOD, 0.0),
        (200.0, BLOOD, 0.4),
        (400.0, ROSE, 0.7),
        (550.0, IVORY, 0.75),
        (1500.0, WHITE, 0.95),
    ],
    "metal": [(METAL - 300.0, STEEL, 0.0), (METAL, STEEL, 0.9)],
}


LUNG, LUNG_VEIL = (-930.0, -550.0), 0.05  # HU where lungs have their peak, and their opacity
THINNER = 0.4  # of the flesh before lungs


def with_lungs(before: float, peak: float, after: float, added: float) -> TransferFunction:
    """Return the look `ct` with thinner flesh and visible lungs."""
    lungs = [(before, SKY, 0.0), (peak, SKY, LUNG_VEIL), (after, SKY, 0.0)]
    flesh, bone = POINTS["ct"][: -len(BONE)], POINTS["ct"][-len(BONE) :]
    thin = [(value, color, THINNER * opacity) for value, color, opacity in flesh]
    body = [(value + added, color, opacity) for value, color, opacity in thin + bone]
    return from_points([*lungs, *(point for point in body if point[0] > after)])


def tissue(name: str, added: float = 0.0) -> TransferFunction:
    """Return a look of `POINTS` by name."""
    return from_points([(value + added, color, opacity) for value, color, opacity in POINTS[name]])

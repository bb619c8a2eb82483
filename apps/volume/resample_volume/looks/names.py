"""Names of looks, for help texts and messages; no numerics in here."""

# For data of any kind, or of the volume that they are called after.
PRESETS = (
    "bone",
    "vessels",
    "engine",
    "lobster",
    "checker",
    "gray",
    "surfaces",
    "paper-engine",
    "paper-aneurism",
    "paper-lobster",
)
# For computed tomography, in Hounsfield units.
TISSUES = ("ct", "bone", "soft-tissue", "muscle", "skin", "lung", "vessels", "metal")

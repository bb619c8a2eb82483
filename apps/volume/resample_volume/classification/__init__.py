"""Transfer functions: presets, files, labels, and statistics behind them."""

# Names for help texts, without loading their modules.
# For data of any kind, or for the volume that they are named after.
# fmt: off
PRESETS = ("bone", "vessels", "engine", "lobster", "checker", "gray", "surfaces", "paper-engine",
           "paper-aneurism", "paper-lobster")
# fmt: on
# For computed tomography, in Hounsfield units.
TISSUES = ("ct", "bone", "soft-tissue", "muscle", "skin", "lung", "vessels", "metal")

"""Small snapshots as SWIFT, GADGET, AREPO and Phantom write them."""

from pathlib import Path

import numpy as np

COUNT = 60
RNG = np.random.default_rng(9)
PLACE = RNG.uniform(0, 10, (COUNT, 3))
HEAT = RNG.uniform(10, 20, COUNT)
KPC, SUN = 3.085678e21, 1.98841e33


def put(path, groups):
    """Write groups of attributes and datasets, each with its own attributes."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, (attributes, datasets) in groups.items():
            group = file.require_group(name)
            group.attrs.update(attributes)
            for part, (values, own) in datasets.items():
                group.create_dataset(part, data=values).attrs.update(own)
    return Path(path)


def swift(path, a=0.5):
    """Comoving Mpc and 10^10 Msun; temperatures in K."""
    header = {"BoxSize": np.full(3, 10.0), "Scale-factor": np.array([a]), "NumFilesPerSnapshot": 1}
    units = {
        "Unit length in cgs (U_L)": np.array([1e3 * KPC]),
        "Unit mass in cgs (U_M)": np.array([1e10 * SUN]),
    }
    said = {
        "a-scale exponent": np.array([0.0]),
        "h-scale exponent": np.array([0.0]),
        "Conversion factor to CGS (not including cosmological corrections)": np.array([1.0]),
    }
    length = {"a-scale exponent": np.array([1.0])}
    kelvin = said | {"Expression for physical CGS units": b"U_t  [ K ]"}
    speed = RNG.normal(size=(COUNT, 3)).astype(np.float32)
    gas = {
        "Coordinates": (PLACE, length),
        "Masses": (np.full(COUNT, 2.0, np.float32), said),
        "SmoothingLengths": (np.full(COUNT, 0.4, np.float32), length),
        "Temperatures": (HEAT.astype(np.float32), kelvin),
        "Velocities": (speed, {}),
        "ParticleIDs": (np.arange(COUNT), {}),
    }
    dark = {name: gas[name] for name in ("Coordinates", "Masses")}
    groups = {
        "Header": (header, {}), "Units": (units, {}),
        "PartType0": ({}, gas), "PartType1": ({}, dark),
    }  # fmt: skip
    return put(path, groups)


def gadget(path, rows=slice(None), files=1, redshift=1.0, h=0.5):
    """Comoving kpc/h and 10^10 Msun/h; dark matter has its mass in the header."""
    header = {
        "BoxSize": 10.0, "Redshift": redshift, "HubbleParam": h, "NumFilesPerSnapshot": files,
        "MassTable": np.array([0, 3.0, 0, 0, 0, 0]), "UnitLength_in_cm": KPC,
        "UnitMass_in_g": 1e10 * SUN,
    }  # fmt: skip
    count = len(PLACE[rows])
    gas = {
        "Coordinates": (PLACE[rows].astype(np.float32), {}),
        "Masses": (np.full(count, 2.0, np.float32), {}),
        "SmoothingLength": (np.full(count, 0.6), {}),
        "InternalEnergy": (HEAT[rows], {}),
    }
    dark = {"Coordinates": (PLACE[rows], {})}
    return put(path, {"Header": (header, {}), "PartType0": ({}, gas), "PartType1": ({}, dark)})


def arepo(path):
    """Cells that have densities and no smoothing lengths."""
    gas = {
        "Coordinates": (PLACE, {"a_scaling": 1.0, "h_scaling": -1.0}),
        "Masses": (np.full(COUNT, 2.0), {"a_scaling": 0.0, "h_scaling": -1.0}),
        "Density": (np.full(COUNT, 4.0), {"a_scaling": -3.0, "h_scaling": 2.0}),
    }
    header = {"BoxSize": 10.0, "Redshift": 0.0, "HubbleParam": 1.0, "NumFilesPerSnapshot": 1}
    return put(path, {"Header": (header, {}), "PartType0": ({}, gas)})


def phantom(path):
    """Two types of particles, one of them accreted."""
    kind = np.where(np.arange(COUNT) % 2, 7, 1).astype(np.int8)
    length = np.full(COUNT, 0.3, np.float32)
    length[0] = -1
    parts = {"xyz": (PLACE, {}), "h": (length, {}), "itype": (kind, {}), "u": (HEAT, {})}
    header = {"massoftype": (np.arange(1.0, 8.0), {})}
    return put(path, {"particles": ({}, parts), "header": ({}, header)})

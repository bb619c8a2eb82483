"""Check licences of all dependencies: `python tools/licences.py`.

With `--write` it writes docs/licences.md. Licences that are unknown or would bind users of this
project are reported, with exit status 1.
"""

import re
import sys
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "licences.md"
LOCK = ROOT / "requirements" / "run.txt"
WANTED = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "BSD",
    "CC0-1.0", "MIT", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Zlib",
}  # fmt: skip
CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
HEAD = """# Licences of dependencies

What `pip install hybrid-resample` brings along, without extras, and under which licence, as each
package's own metadata says; made by `python tools/licences.py --write`, checked by `make lint`. The
project itself is under the MIT licence.

Wheels hold compiled libraries as well. One of them binds whoever passes it on: wheels of `av`, the
extra `film`, may come with FFmpeg built with x264, which is under the GPL. This project calls it
where it is installed, and ships none. Lossless JPEG in DICOM, the extra `dicom`, is unpacked by
python-gdcm (Apache-2.0), not by pylibjpeg-libjpeg, which is under the GPL. SimpleITK (Apache-2.0)
is what tests compare readers of volumes with; no command needs it.

| package | licence |
|---|---|
"""


def packages() -> list[str]:
    """Names in the lock file, in order."""
    text = LOCK.read_text(encoding="utf-8")
    return sorted(set(re.findall(r"^([A-Za-z0-9][\w.-]*)==", text, re.MULTILINE)))


def licence(name: str) -> str:
    """Licence of a package, as an SPDX expression if possible; empty if unknown."""
    facts = metadata(name)
    if facts["License-Expression"]:
        return str(facts["License-Expression"])
    classifiers = facts.get_all("Classifier") or []
    named = {line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License :: ")}
    told = sorted(CLASSIFIERS.get(each, each) for each in named - {"OSI Approved"})
    return " AND ".join(told) or str(facts["License"] or "").partition("\n")[0]


def unwanted(expression: str) -> list[str]:
    """Parts of a licence that are not accepted."""
    parts = re.split(r"\s+(?:AND|OR)\s+", expression.replace("(", "").replace(")", ""))
    return [part for part in parts if part not in WANTED]


def main() -> int:
    """Check licences, and write their page if requested."""
    lines, complaints = [], []
    for name in packages():
        try:
            found = licence(name)
        except PackageNotFoundError:  # needed on another platform only
            continue
        lines.append(f"| {name} | {found} |\n")
        complaints += [f"{name}: licence {part or 'not told'}" for part in unwanted(found)]
    page = HEAD + "".join(lines)
    if "--write" in sys.argv:
        PAGE.write_text(page, encoding="utf-8")
    elif not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != page:
        complaints.append(f"{PAGE.name} is not what tools/licences.py --write makes")
    sys.stdout.writelines(f"{line}\n" for line in complaints)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())

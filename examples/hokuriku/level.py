"""Make level.csv, the reference: the mean of the two rails' measured levels in section_a.csv."""

from __future__ import annotations

import sys
from pathlib import Path

from trackprofile import write
from trackprofile.contracts import build_profile
from trackprofile.io.table import read_columns


def main(folder: Path) -> None:
    """Read section_a.csv in ``folder``, write level.csv beside it."""
    rails = ("level_rail1_mm", "level_rail2_mm")
    table = read_columns(folder / "section_a.csv", ["distance_m", *rails])
    level = 1e-3 * (table[rails[0]] + table[rails[1]]) / 2
    reference = build_profile(table["distance_m"], level, kind="truth", loading="loaded")
    write(reference, folder / "level.csv")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))

"""Reports: an assessment in words, charts and tables, for the screen and for print."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from trackprofile import __version__
from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.trend import Trend
from trackprofile.errors import FileError, importing_extra
from trackprofile.io.atomic import check_places, whole_files
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.reporting.contents import Report
from trackprofile.reporting.html import html

SUFFIXES = (".html", ".pdf")


def report_files(*paths: str | Path) -> tuple[Path, ...]:
    """The files that `report` would write.

    Raises
    ------
    FileError : a suffix is none of `SUFFIXES`, or a file could not be written there.
    MissingExtraError : a PDF is wanted, and matplotlib is not installed.
    """
    files = tuple(map(Path, paths))
    for path in files:
        if path.suffix.lower() not in SUFFIXES:
            raise FileError(f"{path}: a report goes to a file that ends in {', '.join(SUFFIXES)}.")
    if any(path.suffix.lower() == ".pdf" for path in files):
        with importing_extra("plot", "A PDF report"):
            import matplotlib  # noqa: F401
    check_places(*files)
    return files


def report(
    assessment: Assessment,
    *paths: str | Path,
    title: str = "Track report",
    way: ChainageTable | None = None,
    sources: Mapping[str, str] | None = None,
    beside: Assessment | None = None,
    beside_name: str = "another profile",
    changes: Trend | None = None,
) -> tuple[Path, ...]:
    """Write an assessment as a page (.html) that needs no network, and for print (.pdf); all of them, or none.

    Parameters
    ----------
    assessment : as `assess` gives it
    paths : to write to
    title : of the report
    way : kilometre posts and coordinates; None counts kilometres from where distance is 0
    sources : what was used, by what it is, to be told with the method
    beside, beside_name : an assessment of another profile of the same place, drawn and compared
    changes : since earlier passes

    Raises
    ------
    FileError, MissingExtraError : as of `report_files`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from trackprofile import assess
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits_toml import read_limits
    >>> at = np.arange(0.0, 600.0, 0.25)
    >>> dip = build_profile(at, -0.04 * np.exp(-0.5 * ((at - 300) / 2) ** 2), kind="truth")
    >>> found = assess(dip, read_limits("en-13848"), 40.0)
    >>> file, = report(found, Path(tempfile.mkdtemp()) / "report.html")
    >>> "1 place calls for immediate action" in file.read_text(encoding="utf-8")
    True
    """
    files = report_files(*paths)
    made = Report(
        title,
        assessment,
        way or ChainageTable(),
        sources or {},
        __version__,
        beside,
        beside_name,
        changes,
    )
    with whole_files(*files) as parts:
        for part in parts:
            if part.suffix.lower() == ".pdf":
                from trackprofile.reporting.pdf import write_pdf

                write_pdf(made, part)
            else:
                part.write_text(html(made), encoding="utf-8")
    return files

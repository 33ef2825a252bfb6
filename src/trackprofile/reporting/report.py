"""Reports: an assessment as text, charts and tables, in HTML for the screen and in PDF for print."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from trackprofile import __version__
from trackprofile.assessment.assess import Assessment
from trackprofile.assessment.trend import Trend
from trackprofile.errors import FileError, importing_extra
from trackprofile.io.atomic import check_writable, whole_files
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.reporting.contents import Report
from trackprofile.reporting.html import html

SUFFIXES = (".html", ".pdf")


def report_files(*paths: str | Path) -> tuple[Path, ...]:
    """The files that `report` would write.

    Raises
    ------
    FileError : a suffix is not one of `SUFFIXES`, or a file cannot be written.
    MissingExtraError : a PDF is requested, and matplotlib is not installed.
    """
    files = tuple(map(Path, paths))
    for path in files:
        if path.suffix.lower() not in SUFFIXES:
            raise FileError(
                f"{path}: expected a file name that ends in {' or '.join(SUFFIXES)} for a report."
            )
    if any(path.suffix.lower() == ".pdf" for path in files):
        with importing_extra("plot", "A PDF report"):
            import matplotlib  # noqa: F401
    check_writable(*files)
    return files


def report(
    assessment: Assessment,
    *paths: str | Path,
    title: str = "Track report",
    chainage: ChainageTable | None = None,
    sources: Mapping[str, str] | None = None,
    compared: Assessment | None = None,
    compared_name: str = "another profile",
    trend: Trend | None = None,
) -> tuple[Path, ...]:
    """Write a report as HTML (.html, one self-contained file) or PDF (.pdf); all of the files, or none.

    Parameters
    ----------
    assessment : result of `trackprofile.assess`
    paths : files to write
    title : title of the report
    chainage : kilometre posts and coordinates; None: kilometres from distance 0
    sources : files and settings that were used, by name; listed with the method
    compared, compared_name : assessment of another profile of the same track, and its name
    trend : change since earlier passes

    Raises
    ------
    FileError, MissingExtraError : see `report_files`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from trackprofile import assess
    >>> from trackprofile.contracts import build_profile
    >>> from trackprofile.assessment.limits_toml import read_limits
    >>> at = np.arange(0.0, 600.0, 0.25)
    >>> dip = build_profile(at, -0.04 * np.exp(-0.5 * ((at - 300) / 2) ** 2), kind="truth")
    >>> assessment = assess(dip, read_limits("en-13848"), 40.0)
    >>> file, = report(assessment, Path(tempfile.mkdtemp()) / "report.html")
    >>> "1 location requires immediate action" in file.read_text(encoding="utf-8")
    True
    """
    files = report_files(*paths)
    contents = Report(
        title,
        assessment,
        chainage or ChainageTable(),
        sources or {},
        __version__,
        compared=compared,
        compared_name=compared_name,
        trend=trend,
    )
    with whole_files(*files) as parts:
        for part in parts:
            if part.suffix.lower() == ".pdf":
                from trackprofile.reporting.pdf import write_pdf

                write_pdf(contents, part)
            else:
                part.write_text(html(contents), encoding="utf-8")
    return files

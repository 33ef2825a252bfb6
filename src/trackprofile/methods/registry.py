"""The registry of methods: names and where to import them from; it imports none of them."""

from __future__ import annotations

from dataclasses import dataclass

INTERRUPTED = "interrupted"
"""Value of ``stopped`` of a result that Ctrl-C ended early."""


@dataclass(frozen=True)
class MethodEntry:
    """A registered method.

    Parameters
    ----------
    function, settings : module and name of the function and of the settings class, as "module:name"
    summary : one sentence, for help texts and tables
    source : publication
    resumable : whether the function takes ``checkpoint``, a mapping of solved parts, and continues from it
    """

    function: str
    settings: str
    summary: str
    source: str
    resumable: bool = False


METHODS: dict[str, MethodEntry] = {
    "smoother": MethodEntry(
        "trackprofile.inference.infer:estimate",
        "trackprofile.inference.settings:InferenceSettings",
        "optimal smoother with a Markov prior of the profile; gives the uncertainty of every point and band",
        "docs/theory.md, section 7",
        resumable=True,
    ),
    "cross-entropy": MethodEntry(
        "trackprofile.methods.cross_entropy.estimator:cross_entropy",
        "trackprofile.methods.cross_entropy.search_settings:CrossEntropySettings",
        "cross-entropy search of the profile, window by window; gives no uncertainty",
        "O'Brien, Bowe, Quirke, Cantero 2017, doi 10.1177/0954409716664936",
    ),
}
"""The registered methods by name."""

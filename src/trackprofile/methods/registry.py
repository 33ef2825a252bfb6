"""The registry of methods: names and where to import them from; it imports none of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MethodEntry:
    """A registered method.

    Parameters
    ----------
    function, settings : module and name of the function and of the settings class, as "module:name"
    summary : one sentence, for help texts and tables
    source : publication
    """

    function: str
    settings: str
    summary: str
    source: str


METHODS: dict[str, MethodEntry] = {
    "smoother": MethodEntry(
        "trackprofile.inference.infer:estimate",
        "trackprofile.inference.settings:InferenceSettings",
        "optimal smoother with a Markov prior of the profile; gives the uncertainty of every point and band",
        "docs/theory.md, section 7",
    ),
    "cross-entropy": MethodEntry(
        "trackprofile.methods.cross_entropy.estimator:cross_entropy",
        "trackprofile.methods.cross_entropy.search_settings:CrossEntropySettings",
        "cross-entropy search of the profile, window by window; gives no uncertainty",
        "O'Brien, Bowe, Quirke, Cantero 2017, doi 10.1177/0954409716664936",
    ),
}
"""The registered methods by name."""

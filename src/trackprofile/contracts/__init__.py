"""The two data contracts of this package: a recording and a profile.

Both are an ``xarray.Dataset`` in SI units, with the unit of each variable in its attribute ``units``.

=========  ==============  ===========================================================
contract   dimension       variables
=========  ==============  ===========================================================
recording  ``sample``      ``time`` and/or ``distance``, ``speed``; per sensor channel a
                           variable of any name, and ``<channel>_valid``
profile    ``distance``    ``elevation``, ``standard_deviation``, the same per band with
                           ``_D1`` and so on, and ``quality`` flags (CF conventions, 3.5);
                           for a profile per rail, ``elevation_left`` and so on; for a
                           fusion of passes, ``rate`` and ``rate_deviation``
both                       ``distance_deviation``: standard deviation of the distance
=========  ==============  ===========================================================
"""

from trackprofile.contracts.identity import content_digest as content_digest
from trackprofile.contracts.identity import legacy_fingerprint as legacy_fingerprint
from trackprofile.contracts.identity import recording_identity as recording_identity
from trackprofile.contracts.operations import append_provenance as append_provenance
from trackprofile.contracts.operations import select_stretch as select_stretch
from trackprofile.contracts.operations import validate as validate
from trackprofile.contracts.profile import KINDS as KINDS
from trackprofile.contracts.profile import LOADINGS as LOADINGS
from trackprofile.contracts.profile import Quality as Quality
from trackprofile.contracts.profile import build_profile as build_profile
from trackprofile.contracts.profile import known_elevation as known_elevation
from trackprofile.contracts.profile import validate_profile as validate_profile
from trackprofile.contracts.rails import SEPARATE_RAILS as SEPARATE_RAILS
from trackprofile.contracts.rails import Rail as Rail
from trackprofile.contracts.rails import RailLevel as RailLevel
from trackprofile.contracts.rails import available_rails as available_rails
from trackprofile.contracts.rails import select_rail as select_rail
from trackprofile.contracts.rails import with_rails as with_rails
from trackprofile.contracts.rates import has_rate as has_rate
from trackprofile.contracts.rates import with_rate as with_rate
from trackprofile.contracts.recording import QUANTITIES as QUANTITIES
from trackprofile.contracts.recording import Channel as Channel
from trackprofile.contracts.recording import build_recording as build_recording
from trackprofile.contracts.recording import channels as channels
from trackprofile.contracts.recording import validate_recording as validate_recording

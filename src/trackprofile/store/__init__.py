"""The store: every pass over a network's lines, in one folder, here or at any fsspec URL.

====================  =================================================================================
``store.json``        the schema
``profiles/``         a pass's profile and its level per band, every 0.25 m (Parquet)
``overviews/``        the same by least and greatest value of every 16 m, to draw a whole line at once
``defects/`` ...      the assessment's tables: defects, sections, not_assessed, spectra (Parquet)
``entries/``          what stands in the catalogue, one small JSON for each pass, written last
``index/``            the entries gathered in one file (Parquet), to open a large store at once
====================  =================================================================================

Below each of them but the index ``line=L/direction=D/day=YYYY-MM-DD/``. What has no entry does not exist: so a pass is
there whole or not at all, whoever else writes and whatever dies.
"""

from trackprofile.store.catalogue import StoredLine as StoredLine
from trackprofile.store.catalogue import find as find
from trackprofile.store.catalogue import lines as lines
from trackprofile.store.entry import Entry as Entry
from trackprofile.store.entry import Origin as Origin
from trackprofile.store.entry import StoredFile as StoredFile
from trackprofile.store.entry import digest as digest
from trackprofile.store.entry import entry_id as entry_id
from trackprofile.store.envelopes import Envelope as Envelope
from trackprofile.store.envelopes import envelope as envelope
from trackprofile.store.index import build_index as build_index
from trackprofile.store.layout import DATA as DATA
from trackprofile.store.layout import PassKey as PassKey
from trackprofile.store.reading import defects as defects
from trackprofile.store.reading import read_columns as read_columns
from trackprofile.store.reading import read_profile as read_profile
from trackprofile.store.reading import rows_of as rows_of
from trackprofile.store.reading import sections as sections
from trackprofile.store.reading import table as table
from trackprofile.store.store import Store as Store
from trackprofile.store.store import create as create
from trackprofile.store.store import open_store as open_store
from trackprofile.store.verification import StoreProblem as StoreProblem
from trackprofile.store.verification import verify as verify
from trackprofile.store.writing import LIVING as LIVING
from trackprofile.store.writing import AddResult as AddResult
from trackprofile.store.writing import add as add
from trackprofile.store.writing import check_claim as check_claim
from trackprofile.store.writing import clean as clean

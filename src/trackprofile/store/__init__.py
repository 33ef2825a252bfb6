"""The store: all passes over the lines of a network, in one local folder or at any URL that fsspec supports.

====================  =================================================================================
``store.json``        the schema
``profiles/``         profile of a pass and its level in each band, every 0.25 m (Parquet)
``overviews/``        minimum and maximum of the same in bins of 16 m, for figures of a whole line
``defects/`` ...      tables of the assessment: defects, sections, not_assessed, spectra (Parquet)
``entries/``          the catalogue, one small JSON document per pass, written last
``index/``            all entries in one file (Parquet), so that a large store opens quickly
====================  =================================================================================

All but ``store.json`` and the index lie in subfolders ``line=L/direction=D/day=YYYY-MM-DD/``. A pass exists only if it
has an entry: so a pass is stored completely or not at all, with any number of writers, and whenever one is killed.
"""

from trackprofile.store.catalogue import StoredLine as StoredLine
from trackprofile.store.catalogue import find as find
from trackprofile.store.catalogue import lines as lines
from trackprofile.store.entry import Entry as Entry
from trackprofile.store.entry import Origin as Origin
from trackprofile.store.entry import StoredFile as StoredFile
from trackprofile.store.entry import entry_id as entry_id
from trackprofile.store.envelopes import Envelope as Envelope
from trackprofile.store.envelopes import envelope as envelope
from trackprofile.store.index import build_index as build_index
from trackprofile.store.layout import DATA as DATA
from trackprofile.store.layout import PassKey as PassKey
from trackprofile.store.reading import defects as defects
from trackprofile.store.reading import read_columns as read_columns
from trackprofile.store.reading import read_profile as read_profile
from trackprofile.store.reading import read_table as read_table
from trackprofile.store.reading import read_table_rows as read_table_rows
from trackprofile.store.reading import sections as sections
from trackprofile.store.recording_conflicts import check_conflict as check_conflict
from trackprofile.store.store import Store as Store
from trackprofile.store.store import create as create
from trackprofile.store.store import open_store as open_store
from trackprofile.store.verification import StoreProblem as StoreProblem
from trackprofile.store.verification import verify as verify
from trackprofile.store.writing import ABANDONED_AFTER as ABANDONED_AFTER
from trackprofile.store.writing import AddResult as AddResult
from trackprofile.store.writing import add as add
from trackprofile.store.writing import clean as clean

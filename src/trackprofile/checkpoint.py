"""Checkpoints of a long inference: solved blocks are kept on disk, so that it can be resumed."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import zipfile
from collections.abc import Iterator, MutableMapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from trackprofile import __version__
from trackprofile.contracts.identity import content_digest, digest
from trackprofile.errors import DataError, FileError
from trackprofile.inference import blocks
from trackprofile.inference.blocks import BlockResult
from trackprofile.io.atomic import whole_files
from trackprofile.preprocessing.faults import Fault, FaultKind

_KEY_FILE = "of.json"
_BAND = "band "


class CheckpointStore(MutableMapping[int, BlockResult]):
    """Solved blocks of one inference by number, one file each, in a hidden folder next to the profile.

    A block is stored completely or not at all. The folder is created with the first block.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key

    def __getitem__(self, number: int) -> BlockResult:
        path = self._path(number)
        if not path.is_file():
            raise KeyError(number)
        return _read(path)

    def __setitem__(self, number: int, piece: BlockResult) -> None:
        if not self.folder.is_dir():
            self.folder.mkdir()
            with whole_files(self.folder / _KEY_FILE) as (file,):
                file.write_text(json.dumps({"key": self.key}), encoding="utf-8")
        packed = io.BytesIO()
        np.savez(packed, allow_pickle=False, **_arrays(piece))
        with whole_files(self._path(number)) as (path,), path.open("wb") as file:
            file.write(packed.getbuffer())
            file.flush()
            os.fsync(file.fileno())  # so that the file is complete before it gets its name

    def __delitem__(self, number: int) -> None:
        self._path(number).unlink()

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(int(path.stem) for path in self.folder.glob("[0-9]*.npz")))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def discard(self) -> None:
        """Remove the folder with all blocks."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:06d}.npz"


def checkpoint_store(
    profile: Path, key: str, *, resume: bool
) -> tuple[CheckpointStore, tuple[str, ...]]:
    """Checkpoints of an interrupted inference, and a sentence about them.

    Parameters
    ----------
    profile : file that the inference writes
    key : see `checkpoint_key`
    resume : resume with the kept blocks; otherwise they are discarded

    Raises
    ------
    DataError : the blocks are of another recording, other options or another version.
    """
    store = CheckpointStore(profile.with_name(f".{profile.name}.blocks"), key)
    exists = store.folder.is_dir()
    if resume and not exists:
        return store, ("no interrupted run to resume: starting from the beginning",)
    if not exists:
        return store, ()
    blocks_kept = f"{len(store)} {'block' if len(store) == 1 else 'blocks'}"
    if not resume:
        store.discard()
        return store, (f"{blocks_kept} of an interrupted run discarded; use --resume to keep them",)
    if _stored_key(store.folder) != key:
        raise DataError(
            f"{store.folder}: the blocks of the interrupted run are of another recording, other options or another "
            "version; run without --resume to start from the beginning."
        )
    _remove_unfinished_files(profile, store.folder)
    return store, (f"resuming after {blocks_kept} of the interrupted run",)


def checkpoint_key(recording: xr.Dataset, **options: object) -> str:
    """Digest of all that a result depends on: recording, options, block lengths and software versions."""
    attributes = {str(name): variable.attrs for name, variable in recording.variables.items()}
    return digest(
        {
            "recording": [content_digest(recording), attributes],
            "options": options,
            "blocks": [blocks.LENGTH, blocks.OVERLAP, blocks.FADE],
            "versions": [__version__, np.__version__],
        }
    )


def _stored_key(folder: Path) -> Any:
    try:
        return json.loads((folder / _KEY_FILE).read_text(encoding="utf-8"))["key"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _remove_unfinished_files(profile: Path, folder: Path) -> None:
    """Remove incomplete files of a killed run, by the names that `whole_files` gives them."""
    unfinished = re.compile(rf"\.({re.escape(profile.stem)}|\d{{6}})\.[0-9a-f]{{8}}\.\w+")
    for path in (*profile.parent.iterdir(), *folder.iterdir()):
        if unfinished.fullmatch(path.name):
            path.unlink()


def _arrays(piece: BlockResult) -> dict[str, np.ndarray]:
    """A block as arrays of numbers, with its texts as bytes of JSON."""
    texts = {
        "faults": [asdict(fault) for fault in piece.faults],
        "notes": list(piece.notes),
        "bands": list(piece.bands),
    }
    return {
        "position": piece.position,
        "elevation": piece.elevation,
        "standard_deviation": piece.standard_deviation,
        "flags": piece.flags,
        "residual": piece.residual,
        "log_likelihood": np.array(piece.log_likelihood),
        "texts": np.frombuffer(json.dumps(texts).encode(), np.uint8),
    } | {_BAND + name: values for name, values in piece.bands.items()}


def _read(path: Path) -> BlockResult:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        texts = json.loads(arrays["texts"].tobytes())
        faults = tuple(Fault(**(one | {"kind": FaultKind(one["kind"])})) for one in texts["faults"])
        return BlockResult(
            arrays["position"], arrays["elevation"], arrays["standard_deviation"],
            {name: arrays[_BAND + name] for name in texts["bands"]},
            arrays["flags"], arrays["residual"], faults,
            float(arrays["log_likelihood"]), tuple(texts["notes"]),
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise FileError(
            f"{path}: the block is damaged; remove the file, the block is then computed again."
        ) from error

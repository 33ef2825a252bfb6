"""Batch processing of recordings: each is read, inferred, assessed and stored, by local or Dask workers."""

"""One of each: verbs, readers of files, kinds of components; what must run wherever the package is installed.

Needs pytest and what the package itself needs; what needs an extra (h5py, asammdf, distributed) is skipped without it.
"""

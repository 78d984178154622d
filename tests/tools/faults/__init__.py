"""Runs that are killed, disks that are full, caches that are damaged: the next run is right, and no result is half."""

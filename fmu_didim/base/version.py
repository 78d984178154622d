"""The version of the package, and of those that it uses."""

from functools import cache

__version__ = "0.1.0"


@cache
def release_of(package: str) -> str:
    """The installed release of a package, read once; raises PackageNotFoundError without one."""
    from importlib.metadata import version

    return version(package)

"""The versions of other packages and of Python with which the package is tried; needs nothing but Python."""

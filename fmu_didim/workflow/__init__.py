"""The verbs of the Python API, one module each, and what they return; :mod:`fmu_didim` has them all.

A verb loads its own module alone: that of another one would cost a command a tenth of its time.
"""

"""An open benchmark of naming what a model of a drive lacks: cases, rules, a scorer, and methods beside ours.

``python -m examples.benchmark --help``, from the folder of the project; what counts as right stands in README.md.
"""

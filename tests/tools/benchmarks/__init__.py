"""Benchmarks: each figure is a ratio against a competitor or a limit that is measured in the same run.

python -m tests.tools.benchmarks --json benchmarks.json
"""

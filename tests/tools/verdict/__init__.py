"""What is said of wrong inputs, wrong models and right ones, from the data to the verdict.

python -m tests.tools.verdict [--seeds N] [--robots scara arm tx40] [--only TEXT]    one line a run, then what must hold
"""

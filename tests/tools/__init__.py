"""Tools that measure and compare: benchmarks, blind cases, regression, fuzzing, faults, mutation, Monte Carlo."""

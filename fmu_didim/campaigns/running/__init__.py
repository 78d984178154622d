"""How runs are run and kept: processes, workers, slots of FMUs, the store."""

"""FMUs that misbehave in known ways, built from C of our own: :func:`tests.awkward.build.awkward_fmu`."""

"""The misfit away from the answer: other minima, profiles."""

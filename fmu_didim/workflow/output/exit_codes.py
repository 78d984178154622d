"""Exit codes of the command line."""

from __future__ import annotations

from fmu_didim.checks.judgement import Verdict

EXIT_CODES: dict[Verdict, int] = {"valid": 0, "doubtful": 4, "not_settled": 3, "refused": 1}
"""Of each verdict; an error is 1 too, and 2 is wrong usage."""
CHANGED_EXIT = 5
"""Of a comparison that finds a change."""

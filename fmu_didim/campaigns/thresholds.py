"""Numbers that decide how a campaign is run, kept and told."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("campaign")
CHUNK_S = TABLE(
    "CHUNK_S", 4.0, "s",
    "Work that is handed over at once: a hundred times what an engine takes for it, and little to lose.",
)  # fmt: skip
CHUNK_RUNS = TABLE("CHUNK_RUNS", 200, "runs", "Most runs of a chunk, however short: failures are told soon.")
CHUNKS_AHEAD = TABLE(
    "CHUNKS_AHEAD", 2, "chunks", "Handed over for each worker: one it works on and one so that it never waits."
)
PART_ROWS = TABLE(
    "PART_ROWS", 1000, "rows",
    "Rows of a journal from which they become a Parquet file: 100 000 runs are then a hundred files, read in a second.",
)  # fmt: skip
TIME_LIMIT_S = TABLE(
    "TIME_LIMIT_S",
    3600.0,
    "s",
    "For one run where the campaign states none: the longest discovery takes a third of it.",
)
MEMORY_LIMIT_MB = TABLE(
    "MEMORY_LIMIT_MB", 4096.0, "MB", "For one run where the campaign states none: four times the largest that is known."
)
KILLS = TABLE(
    "KILLS", 2, "times", "A run whose process is killed from outside so often has failed; once may be mere chance."
)
SEAT_POLL_S = TABLE(
    "SEAT_POLL_S", 0.05, "s", "Between two looks for a free seat of an FMU: little beside a chunk of runs."
)
FEW_RUNS = TABLE(
    "FEW_RUNS", 20, "runs",
    "Data sets of a group below which its coverage says little: 19 of 20 inside leave 75 % to 99.9 %.",
)  # fmt: skip
ROWS_OPEN = TABLE(
    "ROWS_OPEN", 48, "rows", "Of the table of parameters up to which the page shows it unfolded: six groups of eight."
)
PREPARED = TABLE("PREPARED", 4, "cases", "Loaded cases that a worker keeps; runs of one case follow each other.")
TRIED = TABLE(
    "TRIED",
    64,
    "cases",
    "Most cases that are loaded before the first run; further values are checked by their form only.",
)
LOOKED_AT = TABLE("LOOKED_AT", 1000, "cases", "Most cases whose form is checked before the first run: two seconds.")
SCHEDULER_S = TABLE("SCHEDULER_S", 30.0, "s", "For a scheduler to answer, or to write its file.")
WORKERS_S = TABLE("WORKERS_S", 60.0, "s", "For the first worker of a cluster to appear: a queue may take longer.")
ALIVE_S = TABLE("ALIVE_S", 60.0, "s", "After its last sign a runner on the same folder counts as ended.")
GROUPS_PRINTED = TABLE("GROUPS_PRINTED", 12, "groups", "Most groups that are printed; else those by each field alone.")
ROWS_SHOWN = TABLE("ROWS_SHOWN", 5000, "rows", "Most runs that the page lists one by one; files hold all of them.")
CELL_RUNS = TABLE("CELL_RUNS", 25, "runs", "Most runs that a group of the page links to, those without answer first.")

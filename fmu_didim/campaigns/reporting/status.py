"""The progress of a campaign; quick to read, as it needs no tables."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from fmu_didim.campaigns.running.store import FAILURES, Store

VERDICTS = ("valid", "doubtful", "not_settled", "refused")


@dataclass(frozen=True)
class Status:
    """The progress of a campaign.

    Attributes:
        planned: number of runs; verdicts: verdict -> runs; failures: status -> runs; open: runs to do.
        elsewhere: rows in the folder that belong to another plan, to other files or to another version of the code.
    """

    name: str
    planned: int
    verdicts: dict[str, int]
    failures: dict[str, int]
    open: int
    elsewhere: int
    others: list[str]

    def lines(self) -> list[str]:
        """For the terminal."""
        done = self.planned - self.open
        counts = [f"{n} {name.replace('_', ' ')}" for name, n in {**self.verdicts, **self.failures}.items() if n]
        lines = [f"{self.name}: {done} of {self.planned} runs done" + (f" ({', '.join(counts)})" if counts else "")]
        if self.open:
            lines.append(f"{self.open} open" + (f", running: {', '.join(self.others)}" if self.others else ""))
        if self.elsewhere:
            lines.append(f"{self.elsewhere} further rows belong to another plan, version or file; they are ignored")
        return lines


def status_of(store: Store) -> Status:
    """The progress of the campaign of a folder; raises InputError where there is none."""
    name = store.head()["campaign"]["name"]
    planned = set(store.planned()["id"].to_pylist())
    rows = store.rows(())
    columns = [rows[column].to_pylist() for column in ("id", "status", "verdict")]
    own = Counter((status, verdict) for id_, status, verdict in zip(*columns, strict=True) if id_ in planned)
    done = sum(own.values())
    return Status(
        name=name, planned=len(planned),
        verdicts={v: sum(n for (_, verdict), n in own.items() if verdict == v) for v in VERDICTS},
        failures={s: sum(n for (status, _), n in own.items() if status == s) for s in FAILURES},
        open=len(planned) - done, elsewhere=len(rows) - done, others=store.other_runners(),
    )  # fmt: skip

"""Diagnostics of how files were read."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK

FILE_LAYOUT = CATALOGUE(
    "file-layout", REMARK, rank=90,
    meaning="A data file is not plain (comma-separated, decimal point, UTF-8, one line of names): how it was read.",
    next_step="Nothing if that is right; else csv: {delimiter: ..., decimal: ..., skip_lines: ...} beside file:.",
)  # fmt: skip
UNIT_FROM_FILE = CATALOGUE(
    "unit-from-file", REMARK, rank=91,
    meaning="A file states the unit of its columns, and the numbers were converted from it to SI.",
    next_step="Nothing if that is right; else columns: {q1: {name: ..., unit: ...}}.",
)  # fmt: skip
UNIT_CONTRADICTS = CATALOGUE(
    "unit-contradicts-file", DOUBT, rank=3, at_once=True,
    meaning="The case gives another unit for a column than the file does; that of the case was taken.",
    next_step="Find out which is right; a wrong unit scales all that is identified.",
)  # fmt: skip
UNIT_UNKNOWN = CATALOGUE(
    "unit-unknown", DOUBT, rank=3, at_once=True,
    meaning="A file states a unit that is not known, and the case gives none: the numbers were taken as SI.",
    next_step="Give it: columns: {q1: {name: ..., unit: ..., scale: ...}}.",
)  # fmt: skip
COUNTED_TIME = CATALOGUE(
    "time-counted", REMARK, rank=92,
    meaning="The rows of a file were counted to know their instants; a row that the logger dropped goes unnoticed.",
    next_step="Nothing if the logger drops none; else log the time, too.",
)  # fmt: skip
TIME_CONTRADICTS = CATALOGUE(
    "time-contradicts-file", DOUBT, rank=3,
    meaning="The rate that the case gives for a file is not that of the time column in it.",
    next_step="Correct time: {rate_hz: ...}, or leave it out so that the stamps count.",
)  # fmt: skip
STAMPS_ON_GRID = CATALOGUE(
    "stamps-on-grid", REMARK, rank=92,
    meaning="The stamps of a file were taken as rounded: each row belongs to the nearest instant of the rate given.",
    next_step="Nothing if the clock of the logger only rounds; else leave out time: {rate_hz: ...}.",
)  # fmt: skip
STAMPS_REBUILT = CATALOGUE(
    "stamps-rebuilt", REMARK, rank=92,
    meaning="The stamps of a file are jittered readings of an even clock, as the case says: its instants were taken "
    "instead. How late stamps are on average cannot be seen: all instants may be late by a constant.",
    next_step="Nothing if torque and positions stand in the same rows; else look for a late clock (torque: "
    "{log_shift_s: ...}, or fmu-didim discover).",
)  # fmt: skip
STAMPS_POLLED = CATALOGUE(
    "stamps-polled", REMARK, rank=92,
    meaning="A program read the samples of a machine at its own pace, as the case says: the tick of each row was found "
    "in the motion, and rows that show a tick again were left out. How late readings are on average cannot be seen: "
    "all instants may be late by a constant.",
    next_step="Nothing if torque and positions stand in the same rows; else look for a late clock (torque: "
    "{log_shift_s: ...}, or fmu-didim discover).",
)  # fmt: skip
ROWS_READ_AGAIN = CATALOGUE(
    "rows-read-again", DOUBT, rank=4,
    meaning="Rows of a file are the same as the one before in all columns, now and then, while the others change: a "
    "program read the samples at a pace of its own, so that stamps do not tell when a sample was taken.",
    next_step="State it, with the clock of the machine: time: {name: t, rate_hz: 1000, polled: [q1, q2]}; or log where "
    "the samples are taken. If the values are right to a fraction of a sample, acknowledge it.",
)  # fmt: skip

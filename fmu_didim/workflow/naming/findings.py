"""What is said of a law that was named: where it may mislead."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK

UNEXPLAINED = CATALOGUE(
    "law-unexplained", PROBLEM, rank=10,
    meaning="The best law of the catalogue leaves more of the torque than its noise: the controller is none of them, "
    "or the logs do not belong together.",
    next_step="Ask the vendor for an FMU of the controller, or use controller: {kind: tracking}, which needs no law.",
)  # fmt: skip
CLOCKS_APART = CATALOGUE(
    "law-clocks-apart", PROBLEM, rank=5,
    meaning="A law fits once the torque is moved in time against the positions: the clocks of the two logs differ.",
    next_step="Bring both on one clock (offset_s under torque: or positions:), and name the law again.",
)  # fmt: skip
RATE_ASSUMED = CATALOGUE(
    "law-rate-assumed", DOUBT, rank=20,
    meaning="The control rate is not known, and that of the log was taken for it. Integrators, differences, filters "
    "and delays depend on it.",
    next_step="State it: loop: {rate_hz: ...}.",
)  # fmt: skip
NOT_DETERMINED = CATALOGUE(
    "law-gain-undetermined", DOUBT, rank=30,
    meaning="The log does not determine a gain: its 95 % interval contains zero or is as wide as the gain itself. The "
    "motion excites too little of what the gain acts on.",
    next_step="Log a longer or livelier motion (fmu-didim excite), or less noisy positions.",
)  # fmt: skip
TIED = CATALOGUE(
    "law-tied", DOUBT, rank=31,
    meaning="Several laws explain the torque equally well: the data cannot tell them apart. All of them are named.",
    next_step="Log positions and torque at each tick of the controller, on a livelier motion.",
)  # fmt: skip
FROM_SLOW_POSITIONS = CATALOGUE(
    "law-from-slow-positions", DOUBT, rank=33,
    meaning="The positions are too slow to show what the controller saw. The law was named in the closed loop with the "
    "robot of the case, whose errors, and a filter or a lag that is hardly seen, may pass for parts of it.",
    next_step="Log positions and torque at each tick of the controller, or check the law in its manual.",
)  # fmt: skip
DELAY_OR_CLOCK = CATALOGUE(
    "law-delay-or-clock", DOUBT, rank=32,
    meaning="A delay of the controller cannot be told from a clock of the torque log that is late against that of the "
    "positions.",
    next_step="Check that both were logged by one clock.",
)  # fmt: skip
CLOCK_REBUILT = CATALOGUE(
    "law-clock-rebuilt", DOUBT, rank=21,
    meaning="The stamps of a log jitter and were put right, as the case asks for, which leaves a constant within the "
    "jitter unknown. A log that is late against the reference by a part of a control period moves all gains.",
    next_step="Log set points, torque and positions in the same rows, or take the stamps of the machine's own clock; "
    "else move the log by a part of its jitter (offset_s) and see what it does to the gains.",
)  # fmt: skip
INTEGRATOR_UNSEEN = CATALOGUE(
    "law-integrator-unseen", REMARK, rank=60,
    meaning="The law was named without an integrator, and a weak one would not have shown in this log.",
    next_step="Nothing, unless slow errors matter; a longer log with a constant load shows it.",
)  # fmt: skip
LIMITED = CATALOGUE(
    "law-limited", REMARK, rank=61,
    meaning="The command was at its limit for some of the time, where the log tells nothing of the gains.",
    next_step="Nothing; the limit is part of the law that was named.",
)  # fmt: skip
SAME_IN_EFFECT = CATALOGUE(
    "law-same-in-effect", REMARK, rank=62,
    meaning="Two laws, or two sets of gains of one, are the same in effect: no log can tell them apart, and either "
    "simulates the same.",
    next_step="Nothing; take the one that the machine's manual names.",
)  # fmt: skip
SCALED = CATALOGUE(
    "law-scaled", REMARK, rank=63,
    meaning="All gains are those of the controller in the case times one factor: a gain of the drive or a unit.",
    next_step="Look for a unit or a torque constant that differs by it.",
)  # fmt: skip

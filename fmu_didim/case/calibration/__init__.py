"""Cases of a ``model:`` without robot or controller: recorded inputs, instants of the simulation, measured outputs.

    inputs file -> u(t) ─┐
                         ├─> instants t_k -> inputs at the ticks (T, m) -> reference of the experiment
    measured files ──────┘                   samples of each output     -> its log and its channels

Nothing below knows the difference: the model is the only component of a system whose inputs come from the reference.
"""

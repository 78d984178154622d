"""The PD control of the SCARA as a python-control system, in place of ``scara_pd.yaml``:

    controller: {kind: control, source: "../../controllers/scara_pd_control.py:controller"}

The names of its inputs and outputs are the roles in the loop, so no mapping is needed.
"""

import control
import numpy as np

KP, KD = np.diag([3700.0, 62.0]), np.diag([230.0, 4.0])
PERIOD_S = 0.005

controller = control.ss(
    [],
    [],
    [],
    np.hstack([KP, KD, -KP, -KD]),
    PERIOD_S,
    inputs=["q_ref1", "q_ref2", "dq_ref1", "dq_ref2", "q1", "q2", "dq1", "dq2"],
    outputs=["command1", "command2"],
    name="scara_pd",
)

"""A loop whose controller nobody knows: a virtual one that follows measured positions.

    positions -> even grid -> zero-phase low-pass -> q, dq, ddq at the ticks: the reference of the loop
    torque = W(q, dq, ddq) chi by least squares -> gains from the inertia matrix, and the torque that is fed forward

Nothing above knows the difference but by a flag of the loop, so that no word is said of a real controller.
"""

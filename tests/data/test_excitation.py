"""Reference motions given by a formula."""

import numpy as np

from fmu_didim.data.excitation import Fourier, FourierJoint

TIME = np.linspace(0.0, 3.0, 301)


def test_each_joint_of_a_series_has_its_own_harmonics() -> None:
    """Joints may have different numbers of them: sums of each, written out."""
    few, many = FourierJoint(offset=0.3, cosine=(0.2,), sine=(-0.1,)), FourierJoint(cosine=(0.5, 0.0), sine=(0.1, 0.4))
    q, dq, ddq = Fourier(fundamental_hz=0.5, duration_s=3.0, joints=(few, many)).motion(TIME)
    c, s, c2, s2 = (f(k * np.pi * TIME) for k in (1, 2) for f in (np.cos, np.sin))
    np.testing.assert_allclose(q.T, [0.3 + 0.2 * c - 0.1 * s, 0.5 * c + 0.1 * s + 0.4 * s2], atol=1e-14)
    rate = [np.pi * (-0.2 * s - 0.1 * c), np.pi * (-0.5 * s + 0.1 * c) + 2 * np.pi * 0.4 * c2]
    np.testing.assert_allclose(dq.T, rate, atol=1e-13)
    np.testing.assert_allclose(ddq.T[1], -(np.pi**2) * (0.5 * c + 0.1 * s) - 4 * np.pi**2 * 0.4 * s2, atol=1e-12)

"""The quick error function against the library's."""

import numpy as np
from scipy.special import erf as exact

from rcdn.corners.erf import erf


def test_erf_is_right_to_six_digits_and_odd():
    x = np.concatenate([np.linspace(-6, 6, 20001), [-1e4, 1e4, 0]]).astype(np.float32)
    value = erf(x)
    assert value.dtype == np.float32
    np.testing.assert_allclose(value, exact(x.astype(float)), rtol=0, atol=4e-6)
    np.testing.assert_array_equal(erf(-x), -value)
    assert erf(x.reshape(4, -1)).shape == (4, len(x) // 4)


def test_erf_leaves_its_argument_alone():
    x = np.array([0.3, -1.2], np.float32)
    erf(x)
    assert x.tolist() == np.array([0.3, -1.2], np.float32).tolist()

"""The test suite of NIST SP 1065, section 12.4: NBS14, of nine values, and the 1000-point set.

W. J. Riley, Handbook of Frequency Stability Analysis (2008): data in table 29 (p. 107) and by the
recurrence on p. 108, deviations in tables 30 (p. 107) and 31 (p. 108). Compared digit by digit with
other copies of these tables, allantools' tests/nbs14 among them.
"""

import numpy as np

from imuloop.noise.allan import allan_variance

NINE = np.array([892.0, 809, 823, 798, 671, 644, 883, 903, 677])


def thousand_values():
    """n_{i+1} = 16807 n_i mod (2^31 - 1), n_0 = 1234567890, over 2^31 - 1."""
    n = [1234567890]
    for _ in range(999):
        n.append(16807 * n[-1] % 2147483647)
    assert n[1:4] == [395529916, 1209410747, 633705974]
    return np.array(n) / 2147483647


def test_all_printed_digits_agree():
    nine = np.sqrt(allan_variance([NINE], [1, 2]))
    assert [f"{v:.7g}" for v in nine] == ["91.22945", "85.95287"]
    thousands = np.sqrt(allan_variance([thousand_values()], [1, 10, 100]))
    assert [f"{v:.6e}" for v in thousands] == ["2.922319e-01", "9.159953e-02", "3.241343e-02"]

"""Where on the body the error of an answer is to be expected."""

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.records.answer import Answer


def error_field(answer: Answer) -> FloatArray | None:
    """Expected Euclidean error of each node [mm], shape (n,); None where the bundle knows no errors.

    The bundle knows the mean error that is to be expected, ê, and not where it lies. It is spread as the displacement
    is, e_i = ê |u_i| / mean |u|, whose mean is ê: what moves far is likely to err more. Only the mean is calibrated.
    """
    if answer.trust is None or answer.trust.expected is None:
        return None
    size: FloatArray = np.linalg.norm(np.asarray(answer.displacement, dtype=np.float64), axis=1)
    mean = float(size.mean())
    return size * (answer.trust.expected / mean) if mean > 0.0 else size

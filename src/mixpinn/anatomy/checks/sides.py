"""Where left is: structures that come in pairs, and the liver, say whether an image is mirrored."""

from collections.abc import Mapping

from mixpinn.anatomy.finding import Finding
from mixpinn.base.arrays import FloatArray

LANDMARKS = ("kidney", "hip", "autochthon", "iliopsoas", "gluteus_maximus", "lung_lower_lobe", "femur")
"""Pairs that are read for this alone where a folder holds them, best first."""


def check_sides(centres: Mapping[str, FloatArray]) -> tuple[Finding, ...]:
    """Compare ``X_left`` with ``X_right``, and the liver with the spleen.

    Args:
        centres: of structures, by name, in the scanner's RAS frame [mm], shape (3,).

    Returns:
        an error where a structure of the left lies on the right of its counterpart.
    """
    pairs = [(name, name.replace("_left", "_right")) for name in centres if "_left" in name]
    pairs.append(("spleen", "liver"))
    known = [(left, right) for left, right in pairs if left in centres and right in centres]
    wrong = [(left, right) for left, right in known if centres[left][0] > centres[right][0]]
    if not wrong:
        return ()
    left, right = wrong[0]
    detail = (
        f"{left} (R {centres[left][0]:.0f} mm) lies on the patient's right of {right} (R {centres[right][0]:.0f} mm): "
        "the image is mirrored or turned, or the names are exchanged"
    )
    return (Finding("direction", f"{left} and {right}", detail, 0, repairable=False, error=True),)

"""VTK's readers as ones that raise: by themselves they warn on a terminal and hand back what they could make out."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

_DAMAGE = ("rror", "nexpected", "premature", "mismatch")
"""Words in what VTK calls warnings that mean a damaged file: it fills what is absent with whatever lies in memory."""


@contextmanager
def strict_vtk() -> Iterator[None]:
    """Errors that VTK reports while this lasts are raised at its end; it writes nothing on standard error.

    Raises:
        ValueError: VTK reported an error, or warned of damage; its first message.
    """
    import pyvista as pv

    with pv.vtk_verbosity("off"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pv.VtkErrorCatcher(send_to_logging=False) as said:
            yield
    damage = [event for event in said.warning_events if any(word in event.alert for word in _DAMAGE)]
    for event in (*said.error_events, *damage):
        raise ValueError(" ".join(event.alert.split()) or "VTK cannot read it")

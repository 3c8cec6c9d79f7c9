"""Presets of the joints of the spine, the pelvis and the ribs, each stiffness with its source and range.

What was read and what was not: of Miller et al. 1986, Gardner-Morse & Stokes 2004, Lee et al. 2005 (both papers) and
Nachemson et al. 1979 the abstracts were read, not the papers. The figures of the review PMC4844119 are quoted at second
hand: from the abstract, not seen in full; the review itself was not to be had. Ranges are those of specimens, or one
standard deviation; a patient may lie outside of them.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum

from mixpinn.anatomy.articulations import are_costovertebral, are_sacroiliac
from mixpinn.base.errors import InputError
from mixpinn.fem.rigid.pelvis_and_ribs import COSTOVERTEBRAL, SACROILIAC
from mixpinn.fem.rigid.sourced_stiffness import SourcedStiffness, turning
from mixpinn.physics.joint_system import Joint
from mixpinn.physics.joints import LinearBushing
from mixpinn.records.joint_frame import JointFrame

MILLER = (
    "J. A. A. Miller, A. B. Schultz, D. N. Warwick, D. L. Spencer, Mechanical properties of lumbar spine motion "
    "segments under large loads, J. Biomech. 19, 1986, 79-84 (abstract)"
)
REVIEW = "the review PMC4844119 (at second hand, from the abstract, not seen in full)"
GARDNER_MORSE = (
    "M. G. Gardner-Morse, I. A. F. Stokes, Structural behavior of human lumbar spinal motion segments, J. Biomech. "
    "2004, doi:10.1016/j.jbiomech.2003.10.003 (abstract)"
)
LEE = (
    "R. Y. W. Lee, B. Y. S. Tsung, J. H. Evans, P. Tong, Analysis of the bending behaviour of the lumbar spine during "
    "posteroanterior mobilization, J. Mech. Med. Biol. 2005, 55-61 (abstract); method: J. Rehabil. Res. Dev. 42, 2005, "
    "167-174 (abstract)"
)


class JointPreset(StrEnum):
    """Which joints tie the bones.

    Attributes:
        NONE: none, the vertebrae float in the tissue: the paper's set-up, and the default.
        IN_VITRO: motion segments as a testing machine finds them, without muscles and preload.
        IN_VIVO_PRONE: the same, stiffened to what is measured on people who lie prone.
    """

    NONE = "none"
    IN_VITRO = "in-vitro"
    IN_VIVO_PRONE = "in-vivo-prone"


IN_VITRO: tuple[SourcedStiffness, ...] = (
    SourcedStiffness("lateral shear", 97.0, 53.0, 140.0, f"{MILLER}: all directions of shear; the middle"),
    SourcedStiffness("anterior-posterior shear", 97.0, 53.0, 140.0, f"{MILLER}: all directions of shear; the middle"),
    SourcedStiffness("axial", 1400.0, 920.0, 1880.0, f"{REVIEW}: 1.4 ± 0.48 kN/mm"),
    turning(
        "flexion-extension", 4.0, 2.6, 5.5,
        f"{REVIEW}: flexion 1.8-5.5, extension 2.6-7.6 N m/°; a linear law has one value for both: the middle of where "
        "the intervals overlap",
    ),
    turning(
        "lateral bending", 6.5, 6.0, 11.0,
        f"{MILLER}: all moments, up to 95 N m; near its lower end, since smaller loads meet less",
    ),
    turning("torsion", 8.4, 7.3, 9.5, f"{REVIEW}: 8.4 ± 1.1 N m/°; within the 6-11 N m/° of {MILLER}"),
)
"""Stiffness of one motion segment along and about the joint's axes: x right, y back, z caudal.

One table serves every level from T12-L1 to the sacrum: over 42 segments the means of levels differ little against the
scatter between specimens (A. L. Nachemson, A. B. Schultz, M. H. Berkson, Mechanical properties of human lumbar spine
motion segments: influences of age, sex, disc level, and degeneration, Spine 1979, abstract).
"""

WILKE = (
    "H.-J. Wilke et al., In vitro analysis of the segmental flexibility of the thoracic spine, PLoS ONE 12, 2017, "
    "e0177823 (abstract)"
)
THORACIC: tuple[SourcedStiffness, ...] = (
    *IN_VITRO[:3],
    turning("flexion-extension", 2.1, 1.9, 2.5, f"{WILKE}: 15 N m over a range of 6-8°"),
    turning("lateral bending", 1.8, 1.7, 1.9, f"{WILKE}: 15 N m over a range of 8-9°"),
    turning("torsion", 2.0, 1.9, 2.1, f"{WILKE}: 15 N m over a range of 7-8° (T10-T12)"),
)
"""The same of the lower thoracic segments, T7-T8 to T11-T12, with the joints of their ribs: mean slopes of the whole
range at ± 7.5 N m, which the lax middle makes smaller than slopes at its end. Shear and axial stiffness are those of
the lumbar table: none were found for the thoracic spine."""

PRELOAD_FACTOR = 1.71
"""Mean factor of the stiffnesses under 250 N of axial preload against none, 2.11 under 500 N: Gardner-Morse, Stokes."""

BENDING_STIFFNESS = 38.5e6
"""EI of the lumbar spine of people lying prone under a posteroanterior force [N mm²]: Lee et al., mean 38.5 N m².

The abstracts give no scatter. EI was derived from three-point bending of the whole trunk: muscles and what lies before
the spine take part in it.
"""

FACTORS: Mapping[str, str] = {
    "lateral shear": f"× {PRELOAD_FACTOR}: {GARDNER_MORSE}",
    "anterior-posterior shear": f"× {PRELOAD_FACTOR}: {GARDNER_MORSE}",
    "axial": f"× {PRELOAD_FACTOR}: {GARDNER_MORSE}",
    "flexion-extension": f"replaced by EI / spacing of the two bodies, some 4.5 times the in-vitro value: {LEE}",
    "lateral bending": f"× {PRELOAD_FACTOR}: {GARDNER_MORSE}",
    "torsion": f"× {PRELOAD_FACTOR}: {GARDNER_MORSE}",
}
"""What `in-vivo-prone` scales, and why; thoracic levels alike. Lee et al. bend the spine in the sagittal plane alone:
only that stiffness is fitted to it; nothing measured in vivo was found for the others."""

_FLEXION = 3
_LEVELS = ("T7", "T8", "T9", "T10", "T11", "T12", "L1", "L2", "L3", "L4", "L5", "S1")
_FIRST_LUMBAR = _LEVELS.index("T12")


def preset_joints(frames: Sequence[JointFrame], preset: JointPreset | str) -> tuple[Joint, ...]:
    """Joints of a preset at the given frames.

    Args:
        frames: of neighbouring bones: `mixpinn.mesh.joint_frames`.
        preset: or its name.

    Raises:
        InputError: an unknown preset, a pair that has no figures (`with_figures`), or, in vivo, a frame whose bodies'
            spacing is not known.
    """
    try:
        chosen = JointPreset(preset)
    except ValueError as error:
        raise InputError(
            "joints", expected=" or ".join(JointPreset), got=repr(preset), fix="name one of the presets",
        ) from error
    if chosen is JointPreset.NONE:
        return ()
    return tuple(Joint(frame, LinearBushing.of_diagonal(_stiffness(frame, chosen))) for frame in frames)


def with_figures(first: str, second: str) -> bool:
    """Whether the presets have figures for a joint of these parts.

    Two neighbours from T7 to the sacrum, the sacrum and a hip, or a rib and the vertebra of its number.
    """
    return _are_spinal(first, second) or are_sacroiliac(first, second) or are_costovertebral(first, second)


def _are_spinal(first: str, second: str) -> bool:
    levels = [_level(name) for name in (first, second)]
    return None not in levels and abs(_LEVELS.index(str(levels[0])) - _LEVELS.index(str(levels[1]))) == 1


def _stiffness(frame: JointFrame, preset: JointPreset) -> list[float]:
    if not with_figures(frame.first, frame.second):
        raise InputError(
            f"joint {frame.name}",
            expected="two neighbours from T7 to the sacrum, sacrum and hip, or a rib and its vertebra, for which the "
            "preset has figures",
            got="another pair", fix="leave this joint out, or give it a law of its own (Joint(frame, law))",
        )
    if are_sacroiliac(frame.first, frame.second):
        return [entry.value for entry in SACROILIAC]
    if are_costovertebral(frame.first, frame.second):
        return [entry.value for entry in COSTOVERTEBRAL]
    upper = min(_LEVELS.index(str(_level(name))) for name in (frame.first, frame.second))
    values = [entry.value for entry in (IN_VITRO if upper >= _FIRST_LUMBAR else THORACIC)]
    if preset is JointPreset.IN_VITRO:
        return values
    if frame.spacing <= 0.0:
        raise InputError(
            f"joint {frame.name}", expected="the spacing of the two bodies, from which EI gives the stiffness",
            got="0 mm", fix="make the frame with mixpinn.mesh.joint_frames, or set its spacing",
        )
    values = [PRELOAD_FACTOR * value for value in values]
    values[_FLEXION] = BENDING_STIFFNESS / frame.spacing
    return values


def _level(name: str) -> str | None:
    """T12, L1 … L5 or S1, of names such as vertebrae_L3 or sacrum."""
    if name.lower() == "sacrum":
        return "S1"
    tail = name.replace("-", "_").split("_")[-1].upper()
    return tail if tail in _LEVELS else None

import json
import time
from dataclasses import replace

import numpy as np
import pytest

from anatomy.builders import block, masks, write_folder, write_nifti
from mixpinn.anatomy import TINY_PHANTOM, tiny_phantom
from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy

SCALE = np.diag([10.0, 10.0, 10.0, 1.0])
"""Voxels of 1 cm: the hand-made masks are as large as a body then."""
PHANTOM = AnatomyConfig(phantom=TINY_PHANTOM)


def test_phantom_run_directory(tmp_path):
    out = tmp_path / "run"
    result = make_anatomy(PHANTOM, out=out)
    assert {path.name for path in out.iterdir()} == {
        "run.json", "labels.nii.gz", "labels.json", "labels.manifest.json", "findings.json", "labels.png"}
    assert result.label_map.hash() == tiny_phantom().hash()
    record = json.loads((out / "run.json").read_text())
    assert record["stage"] == "anatomy"
    assert record["results"]["hash"] == result.label_map.hash()
    assert sum(record["results"]["voxels"].values()) == (result.label_map.labels > 0).sum()


def test_finished_run_is_loaded(tmp_path):
    folder = write_folder(tmp_path / "in", affine=SCALE)
    config = AnatomyConfig(source="folder", path=str(folder))
    out = tmp_path / "run"
    first = make_anatomy(config, out=out)
    written = (out / "labels.nii.gz").stat().st_mtime_ns
    again = make_anatomy(config, out=out)
    assert (out / "labels.nii.gz").stat().st_mtime_ns == written
    assert again.label_map.hash() == first.label_map.hash()
    assert again.label_map.names == first.label_map.names
    assert again.findings == first.findings


def test_lost_result_is_made_anew(tmp_path):
    make_anatomy(PHANTOM, out=tmp_path)
    (tmp_path / "labels.nii.gz").unlink()
    make_anatomy(PHANTOM, out=tmp_path)
    assert (tmp_path / "labels.nii.gz").exists()


def test_another_input_does_not_overwrite_a_run(tmp_path):
    folder = write_folder(tmp_path / "in", affine=SCALE)
    config = AnatomyConfig(source="folder", path=str(folder))
    make_anatomy(config, out=tmp_path / "run")
    write_nifti(folder / "vertebrae_L1.nii.gz", block((4, 4, 11), (7, 7, 14)), SCALE)
    with pytest.raises(InputError, match="another inputs"):
        make_anatomy(config, out=tmp_path / "run")


def test_seed_varies_the_phantom():
    hashes = {make_anatomy(AnatomyConfig(phantom=TINY_PHANTOM, seed=seed)).label_map.hash() for seed in (None, 1, 2)}
    assert len(hashes) == 3


def test_multilabel_gives_the_same_as_the_folder(tmp_path):
    structures = masks()
    labels = np.zeros(structures["body_trunc"].shape, dtype=np.int16)
    labels[structures["vertebrae_L1"]], labels[structures["vertebrae_L2"]] = 31, 30
    file = write_nifti(tmp_path / "total.nii.gz", labels, SCALE)
    folder = write_folder(tmp_path / "in", affine=SCALE)
    first = make_anatomy(AnatomyConfig(source="folder", path=str(folder)))
    second = make_anatomy(AnatomyConfig(source="multilabel", path=str(file), body=str(folder / "body_trunc.nii.gz")))
    assert first.label_map.hash() == second.label_map.hash()


def test_errors_write_nothing_and_repair_mends_them(tmp_path):
    structures = masks()
    structures["vertebrae_L2"] = block((4, 4, 6), (7, 7, 11))
    folder = write_folder(tmp_path / "in", structures, SCALE)
    config = AnatomyConfig(source="folder", path=str(folder))
    with pytest.raises(InputError, match="16 shared voxels"):
        make_anatomy(config, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
    result = make_anatomy(AnatomyConfig(source="folder", path=str(folder), repair=True), out=tmp_path / "run")
    assert {finding.kind for finding in result.findings if finding.repaired} == {"overlap", "touch"}
    assert {finding.kind for finding in result.findings if not finding.repaired} == {"size"}  # L2 is twice L1


def test_a_vertebra_outside_the_body_is_never_accepted(tmp_path):
    structures = masks()
    structures["vertebrae_L1"] = block((4, 10, 11), (7, 10, 13))
    folder = write_folder(tmp_path / "in", structures, SCALE)
    for mend in (False, True):
        with pytest.raises(InputError, match="vertebrae_L1"):
            make_anatomy(AnatomyConfig(source="folder", path=str(folder), repair=mend))


def test_repair_takes_the_crop_anew(tmp_path):
    structures = masks()
    structures["vertebrae_L1"] |= block((5, 5, 18), (5, 5, 18))
    folder = write_folder(tmp_path / "in", structures, SCALE)
    settings = {"source": "folder", "path": str(folder), "crop_above": 20.0, "crop_below": 10.0}
    wide, right = (make_anatomy(AnatomyConfig(**settings, repair=mend)).label_map for mend in (False, True))
    assert wide.labels.shape[2] - 2 == 15  # planes 5–19
    assert right.labels.shape[2] - 2 == 11  # planes 5–15


def refused(folder, says, **settings):
    with pytest.raises(InputError) as caught:
        make_anatomy(AnatomyConfig(source="folder", path=str(folder), **settings))
    assert says in str(caught.value)


def test_lengths_in_other_units_are_refused_with_the_unit(tmp_path):
    for unit, size in (("metres", 0.016), ("centimetres", 1.6)):
        folder = write_folder(tmp_path / unit, affine=np.diag([size, size, size, 1.0]))
        refused(folder, f"look like {unit}")
        refused(folder, f"look like {unit}", repair=True)


def test_half_a_vertebra_stays_half_a_vertebra_after_repair(tmp_path):
    """The image ends in the middle of L2: the repair takes the bare voxels, the warning stays."""
    low = slice(7, None)
    folder = write_folder(tmp_path / "in", {name: mask[..., low] for name, mask in masks().items()}, SCALE)
    for mend in (False, True):
        result = make_anatomy(AnatomyConfig(source="folder", path=str(folder), repair=mend))
        assert "vertebrae_L2" in {finding.structure for finding in result.findings if finding.kind == "cut off"}
        assert not any(finding.repaired for finding in result.findings if finding.kind == "cut off")


def test_a_back_outside_the_image_is_refused_and_may_be_accepted(tmp_path):
    cut = {name: mask[:, 3:] for name, mask in masks().items()}
    folder = write_folder(tmp_path / "in", cut, SCALE)
    refused(folder, "the side that is pressed, is cut off by the field of view")
    result = make_anatomy(AnatomyConfig(source="folder", path=str(folder), accept=("cut off",)))
    assert any(finding.error and finding.kind == "cut off" for finding in result.findings)
    flank = write_folder(tmp_path / "flank", {name: mask[3:] for name, mask in masks().items()}, SCALE)
    flank_findings = make_anatomy(AnatomyConfig(source="folder", path=str(flank))).findings
    assert [finding.error for finding in flank_findings if finding.kind == "cut off"] == [False]


def test_settings_without_sense_are_refused():
    for name, value in (("crop_above", float("nan")), ("crop_below", -1.0)):
        with pytest.raises(InputError, match=name):
            build_config(AnatomyConfig, {name: value})
    with pytest.raises(InputError, match="accept"):
        AnatomyConfig(accept=("outside",))


def test_missing_path():
    with pytest.raises(InputError, match="path of the folder"):
        make_anatomy(AnatomyConfig(source="folder"))


def test_config_from_plain_values():
    config = build_config(AnatomyConfig, {"source": "folder", "path": "a", "rigid": ["vertebrae_L1"],
                                          "phantom": {"vertebra": {"body_width": 40}}})
    assert config.rigid == ("vertebrae_L1",)
    assert config.phantom.vertebra.body_width == 40.0
    with pytest.raises(InputError, match="unknown setting"):
        build_config(AnatomyConfig, {"phantom": {"vertebra": {"width": 40}}})


def test_patient_works_without_flags(shared_data):
    start = time.perf_counter()
    result = make_anatomy(AnatomyConfig(source="folder", path=str(shared_data / "patient1")))
    assert time.perf_counter() - start < 60.0
    assert result.label_map.rigid_names == tuple(f"vertebrae_L{i}" for i in range(1, 6))
    assert {finding.kind for finding in result.findings} == {"touch"}
    assert len(result.findings) == 4


def test_an_image_upside_down_is_refused_and_may_be_accepted(tmp_path):
    """Whether it is turned or mirrored: its left and right cannot be told apart from its matrix any more."""
    structures = masks()
    structures["vertebrae_L3"] = block((4, 4, 1), (7, 7, 3))
    source = write_folder(tmp_path / "in", structures, np.diag([10.0, 10.0, -10.0, 1.0]))
    config = AnatomyConfig(source="folder", path=str(source), repair=True)
    with pytest.raises(InputError, match=r"upside down, so that left may be right.*accept=\[.direction.\]"):
        make_anatomy(config)
    doubts = make_anatomy(replace(config, accept=("direction",))).label_map.doubts
    assert any("upside down" in doubt for doubt in doubts)

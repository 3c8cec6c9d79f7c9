import json
import time

import numpy as np
import pytest

from anatomy.builders import block, masks, write_folder, write_nifti
from mixpinn.anatomy import TINY_PHANTOM, tiny_phantom
from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy

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
    folder = write_folder(tmp_path / "in")
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
    folder = write_folder(tmp_path / "in")
    config = AnatomyConfig(source="folder", path=str(folder))
    make_anatomy(config, out=tmp_path / "run")
    write_nifti(folder / "vertebrae_L1.nii.gz", block((4, 4, 11), (7, 7, 14)))
    with pytest.raises(InputError, match="another inputs"):
        make_anatomy(config, out=tmp_path / "run")


def test_seed_varies_the_phantom():
    hashes = {make_anatomy(AnatomyConfig(phantom=TINY_PHANTOM, seed=seed)).label_map.hash() for seed in (None, 1, 2)}
    assert len(hashes) == 3


def test_multilabel_gives_the_same_as_the_folder(tmp_path):
    structures = masks()
    labels = np.zeros(structures["body_trunc"].shape, dtype=np.int16)
    labels[structures["vertebrae_L1"]], labels[structures["vertebrae_L2"]] = 31, 30
    file = write_nifti(tmp_path / "total.nii.gz", labels)
    folder = write_folder(tmp_path / "in")
    first = make_anatomy(AnatomyConfig(source="folder", path=str(folder)))
    second = make_anatomy(AnatomyConfig(source="multilabel", path=str(file), body=str(folder / "body_trunc.nii.gz")))
    assert first.label_map.hash() == second.label_map.hash()


def test_errors_write_nothing_and_repair_mends_them(tmp_path):
    structures = masks()
    structures["vertebrae_L2"] = block((4, 4, 6), (7, 7, 11))
    folder = write_folder(tmp_path / "in", structures)
    config = AnatomyConfig(source="folder", path=str(folder))
    with pytest.raises(InputError, match="16 shared voxels"):
        make_anatomy(config, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()
    result = make_anatomy(AnatomyConfig(source="folder", path=str(folder), repair=True), out=tmp_path / "run")
    assert {finding.kind for finding in result.findings} == {"overlap", "touch"}
    assert all(finding.repaired for finding in result.findings)


def test_a_vertebra_outside_the_body_is_never_accepted(tmp_path):
    structures = masks()
    structures["vertebrae_L1"] = block((4, 10, 11), (7, 10, 13))
    folder = write_folder(tmp_path / "in", structures)
    for mend in (False, True):
        with pytest.raises(InputError, match="vertebrae_L1"):
            make_anatomy(AnatomyConfig(source="folder", path=str(folder), repair=mend))


def test_repair_takes_the_crop_anew(tmp_path):
    structures = masks()
    structures["vertebrae_L1"] |= block((5, 5, 18), (5, 5, 18))
    folder = write_folder(tmp_path / "in", structures)
    settings = {"source": "folder", "path": str(folder), "crop_above": 2.0, "crop_below": 1.0}
    wide, right = (make_anatomy(AnatomyConfig(**settings, repair=mend)).label_map for mend in (False, True))
    assert wide.labels.shape[2] - 2 == 15  # planes 5–19
    assert right.labels.shape[2] - 2 == 11  # planes 5–15


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

import pytest

from mixpinn.base.checksum import with_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json
from mixpinn.fem import PAPER_TISSUE, StableNeoHookean
from mixpinn.fem.scene_record import recorded_contact, recorded_materials
from mixpinn.interop import PAPER_SOFA, SofaConstants, SofaContact, SofaTissue
from mixpinn.interop.sofa_constants import PARAMETERS

CONTACT = SofaContact(gap=1.0, alarm=3.0, friction=0.5)


def test_record_gives_materials_and_contact_back():
    constants = SofaConstants(SofaTissue(8.0, 80.0), {"fat": SofaTissue(2.0, 20.0)}, CONTACT)
    record = constants.record(("muscle", "fat"))
    assert recorded_materials(record, "store") == (
        StableNeoHookean(mu=8.0 * 1e-3, lam=80.0 * 1e-3), StableNeoHookean(mu=2.0 * 1e-3, lam=20.0 * 1e-3),
    )
    contact = recorded_contact(record, "store")
    assert (contact.gap, contact.alarm, contact.friction) == (1.0, 3.0, 0.5)


def test_constants_of_the_paper():
    (tissue,) = recorded_materials(PAPER_SOFA.record(("soft tissue",)), "store")
    assert (tissue.mu, tissue.lam) == pytest.approx((PAPER_TISSUE.mu, PAPER_TISSUE.lam), rel=1e-14)


@pytest.mark.parametrize(("constants", "missing"), [
    (SofaConstants(), "tissue 'muscle', tissue 'fat', contact"),
    (SofaConstants(tissue=SofaTissue(8.0, 80.0)), "nothing about contact"),
    (SofaConstants(tissues={"fat": SofaTissue(8.0, 80.0)}, contact=CONTACT), "nothing about tissue 'muscle'"),
])
def test_what_is_not_said_is_refused(constants, missing):
    with pytest.raises(InputError, match=missing) as caught:
        constants.record(("muscle", "fat"))
    assert "--paper-constants" in str(caught.value)


def test_unknown_tissue_is_refused():
    with pytest.raises(InputError, match="'bone'"):
        SofaConstants(SofaTissue(8.0, 80.0), {"bone": SofaTissue(1.0, 1.0)}, CONTACT).record(("muscle",))


def test_constants_of_a_scene_that_were_altered_are_refused(tmp_path):
    path = tmp_path / PARAMETERS
    written = {"tissue_names": ["skin"], "mu": [2.5], "lam": [12.5], "gap": 2.0, "alarm": 3.0, "friction": 0.25}
    write_json(path, with_checksum(written))
    known = SofaConstants.of_scene(tmp_path)
    path.write_text(path.read_text().replace("12.5", "13.5"))
    with pytest.raises(InputError, match="altered after it was made"):
        SofaConstants.of_scene(tmp_path)
    write_json(path, written)  # by hand, or of an older version
    assert SofaConstants.of_scene(tmp_path) == known

"""Label maps: what is where in the patient."""

from mixpinn.anatomy.checks.labels import check
from mixpinn.anatomy.crop import CROP_ABOVE, CROP_BELOW, crop, place_in_frame
from mixpinn.anatomy.finding import Finding, require_sound
from mixpinn.anatomy.name_table import read_names
from mixpinn.anatomy.names import TOTAL_CLASSES
from mixpinn.anatomy.phantom import TINY_PHANTOM, PhantomConfig, make_phantom, phantom_segmentation, tiny_phantom
from mixpinn.anatomy.picture import draw_label_map
from mixpinn.anatomy.read import read_folder, read_multilabel
from mixpinn.anatomy.repair import repair
from mixpinn.anatomy.segmentation import Segmentation, Structure
from mixpinn.anatomy.vertebra import VertebraShape

__all__ = [
    "CROP_ABOVE", "CROP_BELOW", "TINY_PHANTOM", "TOTAL_CLASSES", "Finding",
    "PhantomConfig", "Segmentation", "Structure", "VertebraShape", "check", "crop", "draw_label_map",
    "make_phantom", "phantom_segmentation", "place_in_frame", "read_folder", "read_multilabel", "read_names", "repair",
    "require_sound", "tiny_phantom",
]

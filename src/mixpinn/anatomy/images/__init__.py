"""Label images as files hold them: NIfTI, NRRD, MetaImage, on one lattice."""

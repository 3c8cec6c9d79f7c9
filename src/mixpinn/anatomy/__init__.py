"""Label maps: what is where in the patient."""

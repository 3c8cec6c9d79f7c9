"""docs/results.md, section by section, from what finished runs have stored."""

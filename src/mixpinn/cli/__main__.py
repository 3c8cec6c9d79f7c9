"""`python -m mixpinn.cli`."""

from mixpinn.cli import main

main()

"""Names of tissues that a cell holds two of, by volume: ``fat 75 % + muscle 25 %``."""

import re

_MIXED = re.compile(r"(?P<first>.+) (?P<share>\d{1,2}) % \+ (?P<second>.+) (?P<rest>\d{1,2}) %")


def mixture_name(first: str, second: str, share: float) -> str:
    """The name of a tissue that is `first` by this share and else `second`."""
    percent = round(100.0 * share)
    return f"{first} {percent} % + {second} {100 - percent} %"


def mixed_parts(name: str) -> tuple[tuple[str, float], ...]:
    """The tissues that `name` stands for and the share of each; one alone for a tissue that is no mixture."""
    match = _MIXED.fullmatch(name)
    if match is None or int(match["share"]) + int(match["rest"]) != 100:
        return ((name, 1.0),)
    return (match["first"], int(match["share"]) / 100.0), (match["second"], int(match["rest"]) / 100.0)

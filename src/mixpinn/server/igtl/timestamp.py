"""Time in the protocol: seconds since 1970 in units of 2⁻³² s, as one whole number of 64 bits; 0 where unused."""

_ONE_SECOND = 1 << 32


def ticks_of(seconds: float) -> int:
    """Seconds since 1970 as the protocol writes them."""
    return round(seconds * _ONE_SECOND)


def seconds_of(ticks: int) -> float:
    """The protocol's time in seconds since 1970 [s]."""
    return ticks / _ONE_SECOND

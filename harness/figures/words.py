"""Numbers as people write them, the same in every output."""

from __future__ import annotations


def count(number: int, noun: str, several: str = "") -> str:
    """Write `1 case`, `2 cases`."""
    return f"{number:,} {noun if number == 1 else several or noun + 's'}"


def percent(change: float) -> str:
    """Write a relative change with a sign and as many digits as matter: `+12.3 %`."""
    size = abs(change) * 100
    digits = 0 if size >= 100 else 1 if size >= 0.1 else 3
    return f"{change * 100:+,.{digits}f} %"


def figure(value: float) -> str:
    """Write a number with as many digits as matter."""
    whole = float(value).is_integer() or abs(value) >= 1000
    return f"{value:,.0f}" if whole else f"{value:,.4g}"

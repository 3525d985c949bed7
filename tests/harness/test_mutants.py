"""Changes of code that mutation testing tries, and equivalent changes that it skips."""

import pytest

from scripts.mutate import EQUIVALENT_CHANGES, ROOT, find_changes, find_reason, list_files

CODE = '''
MOST = 3

def least(values: list[int], most: int = 4) -> int:
    """Return 5."""
    if not values:
        raise ValueError("6" + "7")
    return min(each for each, _ in zip(values, values, strict=True) if each <= most - 1)
'''


def test_only_tokens_of_statements_are_changed():
    descriptions = [str(change) for change in find_changes("a.py", CODE)]
    assert descriptions == [
        "a.py:6: not -> (nothing)",
        "a.py:8: min -> max",
        "a.py:8: True -> False",
        "a.py:8: <= -> <",
        "a.py:8: - -> +",
        "a.py:8: 1 -> (1 + 1)",
    ]


def test_equivalent_changes_are_matched_by_their_code():
    skipped = [change for change in find_changes("a.py", CODE) if find_reason(change, CODE)]
    assert [change.before for change in skipped] == ["True"]
    other_code = CODE.replace("strict=True", "strict=any([True])")
    assert not any(find_reason(change, other_code) for change in find_changes("a.py", other_code))


@pytest.mark.parametrize("key", EQUIVALENT_CHANGES, ids=" ".join)
def test_equivalent_changes_match_the_current_code(key):
    """An entry for edited code could hide a surviving change."""
    file, _, tokens = key
    reasons = {key: EQUIVALENT_CHANGES[key]}
    tokens_in_code = set()
    for name in list_files():
        text = (ROOT / name).read_text(encoding="utf-8")
        if name.startswith(file):
            equivalent = (c for c in find_changes(name, text) if find_reason(c, text, reasons))
            tokens_in_code |= {change.before for change in equivalent}
    assert tokens_in_code == set(tokens.split())

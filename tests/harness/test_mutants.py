"""Which changes of code are tried, and which no result can tell."""

import pytest

from scripts.mutate import EQUIVALENT, ROOT, changes, equivalent, files

CODE = '''
MOST = 3

def least(values: list[int], most: int = 4) -> int:
    """Return 5."""
    if not values:
        raise ValueError("6" + "7")
    return min(each for each, _ in zip(values, values, strict=True) if each <= most - 1)
'''


def test_tokens_of_statements_are_changed_one_at_a_time():
    found = [str(change) for change in changes("a.py", CODE)]
    assert found == [
        "a.py:6: not becomes (nothing)",
        "a.py:8: min becomes max",
        "a.py:8: True becomes False",
        "a.py:8: <= becomes <",
        "a.py:8: - becomes +",
        "a.py:8: 1 becomes (1 + 1)",
    ]


def test_what_no_result_can_tell_is_named_by_its_place():
    named = [change for change in changes("a.py", CODE) if equivalent(change, CODE)]
    assert [change.before for change in named] == ["True"]
    elsewhere = CODE.replace("strict=True", "strict=any([True])")
    assert not any(equivalent(change, elsewhere) for change in changes("a.py", elsewhere))


@pytest.mark.parametrize("key", EQUIVALENT, ids=" ".join)
def test_what_is_named_is_there(key):
    """Code that was changed since may not hide behind it."""
    file, _, tokens = key
    own = {key: EQUIVALENT[key]}
    found = set()
    for name in files():
        text = (ROOT / name).read_text(encoding="utf-8")
        if name.startswith(file):
            found |= {c.before for c in changes(name, text) if equivalent(c, text, own)}
    assert found == set(tokens.split())

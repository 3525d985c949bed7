"""Random search for inputs that violate a guarantee, and regression tests of those inputs.

A target is a strategy of inputs and a check, in a module in `targets/`:

    @target("name", inputs)          # inputs: a Hypothesis strategy of JSON values
    def check(value: Any) -> None:   # raises if the guarantee is violated
        ...

`make fuzz` searches all targets at random for FUZZ_SECONDS in total (search.py). Hypothesis reduces
a failing input, which is stored as regressions/<name>/<hash>.json; commit it with the fix.
`make test` replays all stored inputs and tries a few inputs of every target (test_regressions.py).
"""

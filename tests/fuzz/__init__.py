"""Random search for inputs that break a promise, and those that it found.

A target is a strategy of inputs and a check; a new one is a module in `targets/`:

    @target("name", inputs)          # inputs: a Hypothesis strategy of values that JSON can hold
    def check(value: Any) -> None:   # raises where the promise is broken
        ...

`make fuzz` searches all targets for FUZZ_SECONDS in total, at random (search.py). What fails is
made as small as Hypothesis can and kept as found/<name>/<hash>.json; commit it with the repair.
`make test` replays everything found and tries a few inputs of every target (test_found.py).
"""

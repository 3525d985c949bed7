"""Tasks in this very process."""

from collections.abc import Callable
from typing import Any

from harness.errors import HarnessError
from harness.workers.serving import failure


class Inline:
    """In place of a `Worker`: nothing is started, and nothing interrupts a task."""

    def call(self, function: Callable[..., Any], *arguments: Any, **_: Any) -> Any:
        """Return `function(*arguments)`; errors other than HarnessError become TaskError."""
        try:
            return function(*arguments)
        except (HarnessError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise failure(error) from error

    def close(self, *, at_once: bool = False) -> None:
        """Nothing to end."""

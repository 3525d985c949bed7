from collections.abc import Callable
from typing import Any

from harness.errors import HarnessError
from harness.serving import make_failure


class InlineWorker:
    """Replaces a `Worker`, without a child process or time limits."""

    def call(self, function: Callable[..., Any], *arguments: Any, **_: Any) -> Any:
        """Return `function(*arguments)`; errors other than HarnessError become TaskError."""
        try:
            return function(*arguments)
        except (HarnessError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise make_failure(error) from error

    def close(self, *, at_once: bool = False) -> None:
        """Do nothing."""

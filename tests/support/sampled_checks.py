"""Shapes and types are checked at a sample of the calls: checks of all took two thirds of some tests' time.

In every test the first calls of each function are checked, and of its later ones every so many-th.  A wrong
shape is wrong at the first call, nearly always; what it is only after many still has its chance.  Functions
inside of others are not checked: each call of the outer one would make their checks anew.
"""

import functools
import inspect
from collections import Counter
from collections.abc import Callable
from typing import Any

import jaxtyping

FIRST, EVERY = 30, 100
calls: Counter[Callable[..., Any]] = Counter()
"""Of each function in the test that runs."""


def install() -> None:
    """Has jaxtyping's import hook wrap functions so; before the package is imported."""
    jaxtyping.jaxtyped = functools.partial(_jaxtyped, jaxtyping.jaxtyped)


def _jaxtyped(original: Any, *, typechecker: Any) -> Any:
    always = original(typechecker=typechecker)

    def decorate(thing: Any) -> Any:
        if not isinstance(thing, type):
            inner = "<locals>" in getattr(thing, "__qualname__", "")
            return _sampled(thing, always) if inspect.isfunction(thing) and not inner else thing
        plain = thing.__init__
        always(thing)
        if (checked := thing.__init__) is not plain:
            thing.__init__ = _sampled(plain, lambda _: checked)
        return thing

    return decorate


def _sampled(
    plain: Callable[..., Any], with_checks: Callable[[Callable[..., Any]], Callable[..., Any]]
) -> Callable[..., Any]:
    """The checks are made at the first call, so that functions that no test calls cost nothing."""
    made: list[Callable[..., Any]] = []

    @functools.wraps(plain)
    def call(*args: Any, **kwargs: Any) -> Any:
        calls[plain] += 1
        if calls[plain] > FIRST and calls[plain] % EVERY:
            return plain(*args, **kwargs)
        if not made:
            made.append(with_checks(plain))
        return made[0](*args, **kwargs)

    return call

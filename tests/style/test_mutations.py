"""What counts as landed since a release."""

from __future__ import annotations

from tests.mutations import statements_of


def test_what_landed_is_of_other_code_not_of_another_layout():
    old = "def f(x):\n    return g(2.0, x)\n"
    new = "def f(x):\n    y = (\n        3.0\n    )\n    return g(\n        2.0, x)\n"
    old_code = {code for code, _ in statements_of(old)}
    new_lines = [
        list(lines) for code, lines in statements_of(new) if code not in old_code
    ]
    assert new_lines == [[2, 3, 4]]

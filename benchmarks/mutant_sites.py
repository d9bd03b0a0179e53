"""Where code can be mutated, and how: the operators of `mutmut` and three more, on `libcst` trees.

Both packages are needed to draw mutants, not to run them: `pip install --no-deps mutmut libcst`.
The further operators remove a call that is a statement, return `None` in the place of a value, and
negate a condition. Left alone are type hints, imports, decorators, `raise` statements, docstrings,
texts that people read, and what only a type checker or a main guard reads.
"""

from __future__ import annotations

import ast
import importlib
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

PUNCTUATION = "<>=!*/+-|&^%~"
TYPING_CALLS = {"cast", "TypeVar", "ParamSpec", "NewType"}
PLAIN_CALLS = {"len", "isinstance", "print"}
"""Their arguments stay: without them the first two fail in any test, and the third is a text."""
KEPT_ARGUMENTS = {"encoding", "strict", "kw_only"}
"""No test can tell whether they are there, as long as nothing else is wrong."""
CHECKER_ONLY = ("TYPE_CHECKING", '__name__ == "__main__"')
LOWER_CASE_WORDS = re.compile(r"(?<![\w{])[a-z]{2,}(?![\w}(])")


@dataclass(frozen=True)
class Change:
    """A piece of a source, from the character `start`, and what takes its place."""

    start: int
    original: str
    replacement: str


class Sites:
    """Everything that the operators can change in a source."""

    def __init__(self, source: str) -> None:
        self.source = source
        self._cst: Any = importlib.import_module("libcst")
        self._operators: Any = importlib.import_module("mutmut.mutation.mutators")
        self._module = self._cst.parse_module(source)
        self._replacements: dict[str, list[tuple[Any, Any]]] = defaultdict(list)
        for operator, node, replacement in self._walk(self._module):
            self._replacements[operator].append((node, replacement))

    def counts(self) -> dict[str, int]:
        """Return how many replacements each operator has here."""
        return {name: len(pairs) for name, pairs in sorted(self._replacements.items())}

    def change(self, operator: str, number: int) -> Change | None:
        """Return one replacement as a change of the source; none if the code stays the same."""
        mutated = self._module.deep_replace(*self._replacements[operator][number]).code
        try:
            same = ast.dump(ast.parse(mutated)) == ast.dump(ast.parse(self.source))
        except SyntaxError:
            return None
        return None if same else difference(self.source, mutated)

    def _walk(self, node: Any) -> Iterator[tuple[str, Any, Any]]:
        cst = self._cst
        if self._is_left_alone(node):
            return
        yield from self._own(node)
        for kind, operator in self._operators.mutation_operators:
            if isinstance(node, kind):
                for replacement in operator(node):
                    if not self._changes_a_text(node, replacement):
                        yield operator.__name__.removeprefix("operator_"), node, replacement
        children = node.children
        if isinstance(node, cst.ClassDef):
            children = [node.body]
        for child in children:
            yield from self._walk(child)

    def _own(self, node: Any) -> Iterator[tuple[str, Any, Any]]:
        cst = self._cst
        if isinstance(node, cst.Expr) and isinstance(node.value, cst.Call):
            yield "call_removed", node, cst.Pass()
        elif isinstance(node, cst.Return) and node.value and self._code(node.value) != "None":
            yield "return_none", node, node.with_changes(value=cst.Name("None"))
        elif isinstance(node, cst.If | cst.While):
            parentheses = {"lpar": [cst.LeftParen()], "rpar": [cst.RightParen()]}
            negated = cst.UnaryOperation(cst.Not(), node.test.with_changes(**parentheses))
            yield "condition_negated", node.test, negated

    def _is_left_alone(self, node: Any) -> bool:
        cst = self._cst
        if isinstance(
            node, cst.Annotation | cst.Import | cst.ImportFrom | cst.Decorator | cst.Raise
        ):
            return True
        if isinstance(node, cst.If):
            return self._code(node.test).removeprefix("typing.") in CHECKER_ONLY
        if isinstance(node, cst.Expr):
            return isinstance(node.value, cst.BaseString)
        if isinstance(node, cst.Call):
            return self._code(node.func) in TYPING_CALLS
        if isinstance(node, cst.Arg):
            return node.keyword is not None and node.keyword.value in KEPT_ARGUMENTS
        if isinstance(node, cst.Assign) and isinstance(node.value, cst.Subscript):
            return self._code(node.targets[0].target).lstrip("_")[0].isupper() and (
                "." not in self._code(node.value.value)
            )
        return self._is_text(node)

    def _is_text(self, node: Any) -> bool:
        cst = self._cst
        if isinstance(node, cst.SimpleString):
            return " " in node.value
        if isinstance(node, cst.FormattedString):
            parts = (part.value for part in node.parts if isinstance(part, cst.FormattedStringText))
            return len(LOWER_CASE_WORDS.findall(" ".join(parts))) > 1
        if isinstance(node, cst.ConcatenatedString):
            return self._is_text(node.left) or self._is_text(node.right)
        return False

    def _changes_a_text(self, node: Any, replacement: Any) -> bool:
        cst = self._cst
        if isinstance(node, cst.Call):
            if self._code(node.func) in PLAIN_CALLS:
                return True
            kept = {id(argument) for argument in replacement.args}
            changed = [argument for argument in node.args if id(argument) not in kept]
            return any(
                self._is_text(argument.value) or self._is_left_alone(argument)
                for argument in changed
            )
        return isinstance(node, cst.Assign | cst.AnnAssign) and self._is_text(node.value)

    def _code(self, node: Any) -> str:
        return str(self._module.code_for_node(node))


def difference(before: str, after: str) -> Change:
    """Return the one piece in which two sources differ, made longer to whole names and signs."""
    least = min(len(before), len(after))
    start = 0
    while start < least and before[start] == after[start]:
        start += 1
    least -= start
    end = 0
    while end < least and before[-1 - end] == after[-1 - end]:
        end += 1
    stop, stop_after = len(before) - end, len(after) - end
    while start and _belong(before[start - 1], before[start:stop] or after[start:stop_after]):
        start -= 1
    while stop < len(before) and _belong(
        before[stop], (before[start:stop] or after[start:stop_after])[::-1]
    ):
        stop, stop_after = stop + 1, stop_after + 1
    return Change(start, before[start:stop], after[start:stop_after])


def _belong(character: str, piece: str) -> bool:
    def of_a_name(sign: str) -> bool:
        return sign.isalnum() or sign in "_."

    return (of_a_name(character) and of_a_name(piece[:1] or " ")) or (
        character in PUNCTUATION and piece[:1] in PUNCTUATION
    )


def code_lines(source: str) -> int:
    """Return how many lines hold code: no blank line, comment or docstring."""
    rows: set[int] = set()
    docstrings = {
        row
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        for row in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    layout = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in layout and token.type != tokenize.ENDMARKER:
            rows.update(range(token.start[0], token.end[0] + 1))
    return len(rows - docstrings)

"""Writes the docstrings of the module into its stubs, where editors and type checkers read them.

    python docstrings.py      with smalto installed; run after a change of a docstring

test_stubs.py fails until this has run.
"""

import ast
import inspect
import pathlib
import textwrap

STUBS = pathlib.Path(__file__).parents[1] / "smalto" / "_smalto.pyi"


def documented(text, module):
    """The stubs with the docstrings of the module."""
    lines = text.splitlines()
    for node, found in reversed(list(public(ast.parse(text), module))):
        doc = inspect.getdoc(found)
        if not doc:
            continue
        body = node.body[0]
        is_ellipsis = isinstance(body, ast.Expr) and getattr(body.value, "value", None) is ...
        is_docstring = isinstance(body, ast.Expr) and isinstance(getattr(body.value, "value", None), str)
        indent = " " * (node.col_offset + 4)
        written = textwrap.indent(f'"""{doc}"""', indent, lambda line: bool(line.strip())).splitlines()
        if is_ellipsis:
            before = lines[body.lineno - 1][: body.col_offset].rstrip()
            lines[body.lineno - 1 : body.end_lineno] = ([before] if before else []) + written
        elif is_docstring:
            lines[body.lineno - 1 : body.end_lineno] = written
        else:
            first = min([body, *getattr(body, "decorator_list", [])], key=lambda part: part.lineno).lineno - 1
            lines[first:first] = written
    return "\n".join(lines) + "\n"


def public(tree, module):
    """Each public class, function and method of the stubs, and what it is in the module, in the order of the lines."""
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
            found = getattr(module, node.name)
            yield node, found
            for member in node.body if isinstance(node, ast.ClassDef) else []:
                if isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                    yield member, getattr(found, member.name)


if __name__ == "__main__":
    from smalto import _smalto

    STUBS.write_text(documented(STUBS.read_text(), _smalto))

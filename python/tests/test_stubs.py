"""The stubs for editors and type checkers name what the module has."""

import ast
import inspect
import pathlib

import smalto
from smalto import _smalto

STUBS = ast.parse((pathlib.Path(smalto.__file__).parent / "_smalto.pyi").read_text())


def parameters(function):
    args = function.args
    names = [arg.arg for arg in args.posonlyargs + args.args + args.kwonlyargs + [args.vararg, args.kwarg] if arg]
    return [name for name in names if name != "self"]


def check(stub, found, where):
    assert parameters(stub) == [name for name in inspect.signature(found).parameters if name != "self"], where
    assert where.startswith("_smalto") or found.__doc__, f"{where} has no docstring"


def test_stubs_name_what_there_is():
    private = {"Exported", "device_for_cuda", "main"}
    named = set()
    for node in STUBS.body:
        if isinstance(node, ast.FunctionDef):
            named.add(node.name)
            if node.name not in private:
                check(node, getattr(_smalto, node.name), node.name)
        if isinstance(node, ast.ClassDef):
            named.add(node.name)
            found = getattr(_smalto, node.name)
            members = {member.name for member in node.body if isinstance(member, ast.FunctionDef)}
            public = {name for name in vars(found) if not name.startswith("_")}
            assert public == {name for name in members if not name.startswith("_")}, node.name
            for member in (member for member in node.body if isinstance(member, ast.FunctionDef)):
                if member.name == "__init__":
                    check(member, found, node.name)
                elif not member.name.startswith("_") and callable(getattr(found, member.name)):
                    if node.name not in private:
                        check(member, getattr(found, member.name), f"{node.name}.{member.name}")
    assert named >= {name for name in vars(_smalto) if not name.startswith("__")}

#!/usr/bin/env python3
"""Prints THIRD-PARTY.md: the crates that the program consists of, their licences and the texts of these.

    packaging/licences.py [TARGET] > THIRD-PARTY.md

TARGET is a target of the Rust compiler, by default its own. The crates are the normal dependencies of `Cargo.lock` for
this target, without procedural macros, which run in the build only. The texts are those that the crates themselves
hold; equal texts are printed once.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TEXTS = re.compile(r"(licen[cs]e|copying|unlicense|notice|copyright|[ou]fl)([-_. ].*)?", re.IGNORECASE)
# Folders of a crate whose files do not become part of the program.
OTHER_FOLDERS = {"benches", "examples", "fuzz", "target", "test", "tests"}


def output(*command: str) -> str:
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def crates(target: str) -> list[dict]:
    """The packages of `cargo metadata` that `cargo tree` finds in the program, by name and version."""
    tree = output("cargo", "tree", "--locked", "--target", target, "--edges", "normal,no-proc-macro",
                  "--prefix", "none", "--format", "{p}")
    named = {tuple(line.split(" ")[:2]) for line in tree.splitlines() if line}
    packages = json.loads(output("cargo", "metadata", "--locked", "--format-version", "1"))["packages"]
    found = [p for p in packages if p["source"] and (p["name"], f"v{p['version']}") in named]
    return sorted(found, key=lambda p: (p["name"], p["version"]))


def texts(package: dict) -> list[str]:
    """The texts of licences in the folder of a package and in the folders inside it."""
    folder = Path(package["manifest_path"]).parent
    files = [f for f in sorted(folder.rglob("*")) if f.is_file() and TEXTS.fullmatch(f.name)]
    files = [f for f in files if not OTHER_FOLDERS.intersection(f.relative_to(folder).parts)]
    files = [f for f in files if f.suffix not in {".rs", ".c", ".h", ".py"}]
    return [f.read_text(encoding="utf-8", errors="replace").strip() for f in files]


def main() -> None:
    host = re.search(r"^host: (.*)$", output("rustc", "-vV"), re.MULTILINE).group(1)
    packages = crates(sys.argv[1] if len(sys.argv) > 1 else host)
    print("# Third parties\n")
    print("smalto contains the following crates, and the standard library of Rust (MIT or Apache-2.0,")
    print("<https://github.com/rust-lang/rust>). The texts of the licences are below.\n")
    print("| crate | version | licence | repository |")
    print("|---|---|---|---|")
    users: dict[str, tuple[str, list[str]]] = {}
    without = []
    for package in packages:
        name, licence = package["name"], package["license"] or package["license_file"]
        print(f"| {name} | {package['version']} | {licence} | {package['repository'] or ''} |")
        found = texts(package)
        if not found:
            without.append(f"{name} {package['version']}")
        for text in found:
            # Texts that differ only in how their lines are wrapped are equal.
            _, names = users.setdefault(" ".join(text.split()), (text, []))
            if name not in names:
                names.append(name)
    if without:
        print(f"\nThese crates hold no text of their licence; their repositories do: {', '.join(without)}.")
    for text, names in users.values():
        print(f"\n## {', '.join(names)}\n")
        print("\n".join(f"    {line.rstrip()}".rstrip() for line in text.splitlines()))


if __name__ == "__main__":
    main()

"""Writes the folder `licences` of the wheel: the licences of smalto, and those of the crates that are linked into it.

    python licences.py      before `maturin build`; needs cargo, and the sources of the crates, which a build brings
"""

import collections
import json
import pathlib
import shutil
import subprocess

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parent
NAMES = ("licen", "copying", "notice", "copyright", "unlicense", "ofl", "ufl")


def linked(metadata):
    """The packages that are linked: dependencies that are neither of builds nor of tests, and no macros."""
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    root = next(package["id"] for package in metadata["packages"] if package["name"] == "smalto-python")
    found, waiting = set(), [root]
    while waiting:
        name = waiting.pop()
        kinds = {kind for target in packages[name]["targets"] for kind in target["kind"]}
        if name in found or "proc-macro" in kinds:
            continue
        found.add(name)
        for dependency in nodes[name]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                waiting.append(dependency["pkg"])
    return sorted((packages[name] for name in found), key=lambda package: (package["name"], package["version"]))


def texts(package):
    """The licences of a package: files in its folder, or in one of them that are about fonts and the like."""
    folder = pathlib.Path(package["manifest_path"]).parent
    for path in sorted(folder.rglob("*")):
        depth = len(path.relative_to(folder).parts)
        if depth <= 3 and path.is_file() and path.name.lower().startswith(NAMES) and path.suffix in ("", ".txt", ".md"):
            yield path.read_text(errors="replace").strip()


def main():
    out = HERE / "licences"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    for name in ("LICENSE-MIT", "LICENSE-APACHE"):
        shutil.copy(ROOT / name, out)
    host = next(line.split()[1] for line in run("rustc", "-vV").splitlines() if line.startswith("host"))
    manifest = str(HERE / "Cargo.toml")
    metadata = json.loads(
        run("cargo", "metadata", "--format-version", "1", "--filter-platform", host, "--manifest-path", manifest)
    )
    # Many crates have the same text.
    users, without = collections.defaultdict(list), []
    for package in linked(metadata):
        if not package["source"]:
            continue
        name = f"{package['name']} {package['version']} ({package['license']})"
        found = list(texts(package))
        for text in found:
            users[text].append(name)
        if not found:
            without.append(name)
    parts = ["The module of smalto has these crates of Rust linked into it, and the standard library of Rust (MIT OR\n"
             "Apache-2.0). Their licences follow, each after the names of the crates that it comes with."]
    if without:
        parts.append("These crates come without the text of their licence, which is that of LICENSE-MIT or LICENSE-APACHE:\n" + "\n".join(without))
    parts += ["\n".join(names) + "\n\n" + text for text, names in users.items()]
    (out / "THIRD-PARTY.txt").write_text(f"\n\n{'-' * 80}\n\n".join(parts) + "\n")


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


if __name__ == "__main__":
    main()

"""The Python in the documents runs."""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).parents[2]
DOCUMENTS = ["docs/python.md", "python/README.md"]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_the_blocks_of_a_document_run_one_after_the_other(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```$", (ROOT / name).read_text(), re.MULTILINE | re.DOTALL)
    assert blocks
    names = {}
    for block in blocks:
        exec(compile(block, name, "exec"), names)
    assert (tmp_path / "cactus.png").stat().st_size > 10_000

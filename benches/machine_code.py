"""Machine code of compiled pipelines, from a pipeline cache that NVIDIA's driver wrote (seen with driver 580).

python3 benches/machine_code.py FILE [FOLDER] prints a row for each pipeline: its number in the file, bytes of code,
and the instructions that it has most. With FOLDER it also writes each pipeline's code there. FILE is a cache of
`cargo bench --bench micro -- --caches FOLDER`, or the program's own (~/.cache/smalto/device-*.bin).

It needs the programs zstd and nvdisasm (of the CUDA toolkit, or of the wheel nvidia-cuda-nvdisasm).

A cache has one zstd frame for each pipeline. In it lies a container that begins with NVuc: eight words, then sections
of eight words each, the first three of which are kind, bytes, and offset from the container. Kind 1 is the code.
"""

import collections
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

FRAME = b"\x28\xb5\x2f\xfd"
CONTAINER = b"NVuc"
HEADER_BYTES = SECTION_BYTES = 32
CODE = 1


def pipelines(cache):
    """The decompressed frames of a cache."""
    begins = [match.start() for match in re.finditer(re.escape(FRAME), cache)]
    for begin, end in zip(begins, begins[1:] + [len(cache)]):
        # The bytes behind the frame make zstd fail, after it wrote the frame.
        yield subprocess.run(["zstd", "-dc"], input=cache[begin:end], capture_output=True).stdout


def code(pipeline):
    """The code of a pipeline; None if it has none."""
    container = pipeline[pipeline.find(CONTAINER) :]
    for section in range(HEADER_BYTES, len(container) - SECTION_BYTES, SECTION_BYTES):
        kind, size, offset = struct.unpack_from("<3I", container, section)
        if kind == CODE:
            return container[offset : offset + size]
    return None


def disassembled(machine_code, architecture):
    with tempfile.NamedTemporaryFile() as file:
        file.write(machine_code)
        file.flush()
        command = ["nvdisasm", "--binary", architecture, "--print-code", file.name]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def instructions(text):
    """How often each instruction occurs; of some with their variant."""
    found = re.findall(r"^\s*(?:/\*\w+\*/)?\s*(?:@!?U?P\w+\s+)?([A-Z][A-Z0-9_.]*)", text, re.MULTILINE)
    with_variant = ("MUFU", "HMMA", "LDS", "STS", "LDG")
    names = (name if name.startswith(with_variant) else name.split(".")[0] for name in found)
    return collections.Counter(names)


def main(file, folder=None, architecture="SM90"):
    for number, pipeline in enumerate(pipelines(pathlib.Path(file).read_bytes())):
        machine_code = code(pipeline)
        if machine_code is None:
            continue
        text = disassembled(machine_code, architecture)
        most = ", ".join(f"{count} {name}" for name, count in instructions(text).most_common(12))
        print(f"{number:4} {len(machine_code):7}  {most}")
        if folder:
            pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
            (pathlib.Path(folder) / f"{number}.txt").write_text(text)


if __name__ == "__main__":
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])

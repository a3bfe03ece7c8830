"""The command `smalto`."""

import sys

from . import _smalto


def main() -> None:
    sys.exit(_smalto.main(["smalto", *sys.argv[1:]]))


if __name__ == "__main__":
    main()

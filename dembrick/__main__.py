"""``python -m dembrick`` is the same as ``dembrick``."""

import sys

from dembrick.cli import main

if __name__ == "__main__":
    sys.exit(main())

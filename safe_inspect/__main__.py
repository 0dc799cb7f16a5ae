"""``python -m safe_inspect`` is the command ``safe-inspect``."""

import sys

from safe_inspect.cli.main import main

if __name__ == "__main__":
    sys.exit(main())

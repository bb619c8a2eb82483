"""Measure one thing in a fresh process: `python -m benchmarks.child MODULE CHOICES`."""

import json
import sys
from importlib import import_module


def main() -> None:
    """Print the result of the module's `in_child` as JSON on the last line."""
    module, choices = sys.argv[1], json.loads(sys.argv[2])
    answer = import_module(module).in_child(**choices)
    sys.stdout.write(f"\n{json.dumps(answer)}\n")


if __name__ == "__main__":
    main()
